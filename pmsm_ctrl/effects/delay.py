"""Delay between channels: the logged currents are older than the logged position."""

from __future__ import annotations

from pmsm_ctrl.effects.base import Effect, Parameter
from pmsm_ctrl.effects.structures import Delay
from pmsm_ctrl.kernels import kernel


@kernel
def term(di_d: float, di_q: float, tau: float) -> tuple[float, float]:
    """Measured less true current to first order in the delay: -tau di/dt. The simulation delays exactly."""
    return -tau * di_d, -tau * di_q


effect = Effect(
    id="delay",
    title="Delay between channels",
    equation=r"i_{meas}(t) = i(t - \tau)",
    source="A. Janot, M. Gautier, M. Brunot, EMPS benchmark (2019): synchronous sampling assumed, and not met",
    enters="measurement",
    structure=Delay(age="tau"),
    parameters=(
        Parameter("tau", "s", 0.0, -0.1, 0.1, "age of the logged currents; negative: the angle is older", linear=True),
    ),
    term=term,
    example={"tau": 0.0005},
    needs="fast changes of acceleration",
    look_alikes={"compliance": "below the resonance both shift torque against acceleration"},
    validated="simulated logs, EMPS",
)

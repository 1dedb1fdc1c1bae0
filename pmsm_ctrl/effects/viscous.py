"""Viscous friction: a torque proportional to speed."""

from __future__ import annotations

from math import inf

from pmsm_ctrl.effects.base import Effect, Parameter
from pmsm_ctrl.kernels import kernel


@kernel
def term(omega: float, F_v: float) -> float:
    """F_v omega."""
    return F_v * omega


effect = Effect(
    id="viscous",
    title="Viscous friction",
    equation=r"F_v\,\omega",
    source="B. Armstrong-Helouvry, P. Dupont, C. Canudas de Wit, Automatica 30 (1994) 1083",
    enters="torque",
    parameters=(Parameter("F_v", "N m s/rad", 0.0, 0.0, inf, "viscous friction coefficient", linear=True),),
    term=term,
    example={"F_v": 0.000168},
    needs="at least two different speeds in one direction",
    look_alikes={
        "coulomb": "at a single speed only the sum of F_c and F_v omega shows",
        "iron_loss": "its drag is proportional to speed as well",
        "thermal_drift": "in a monotonic warm-up the drift follows the speed's own trend",
    },
    validated="simulated logs, the reference paper's table, EMPS",
)

"""Friction that falls, or rises, as the axis warms up."""

from __future__ import annotations

from math import exp, inf

from pmsm_ctrl.effects.base import Effect, Parameter
from pmsm_ctrl.kernels import kernel


@kernel
def term(t: float, omega: float, direction: float, dF_v: float, dF_c: float, tau: float) -> float:
    """(dF_v omega + dF_c sgn(omega)) (1 - exp(-t/tau)): the change since the log began, first-order warm-up."""
    return (dF_v * omega + dF_c * direction) * (1.0 - exp(-t / tau))


effect = Effect(
    id="thermal_drift",
    title="Thermal drift of friction",
    equation=r"(\Delta F_v\,\omega + \Delta F_c\,\mathrm{sgn}(\omega))\,(1 - e^{-t/\tau})",
    source="L. Simoni, M. Beschi, G. Legnani, A. Visioli, IEEE Trans. Control Syst. Technol. 23 (2015) 2146",
    enters="torque",
    parameters=(
        Parameter("dF_v", "N m s/rad", 0.0, -inf, inf, "change of F_v once warm", linear=True),
        Parameter("dF_c", "N m", 0.0, -inf, inf, "change of F_c once warm", linear=True),
        Parameter("tau", "s", 10.0, 1e-3, 1e6, "time constant of warming up"),
    ),
    term=term,
    example={"dF_v": -5e-05, "dF_c": -0.003, "tau": 10.0},
    needs="the same speeds early and late in the log",
    look_alikes={
        "viscous": "if speed only rises while the axis warms up, the drift follows the speed",
        "viscous_power": "if the speed was raised step by step, drag that falls with time looks sub-linear",
    },
)

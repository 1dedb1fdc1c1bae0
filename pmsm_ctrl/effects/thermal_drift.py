"""Friction that falls, or rises, as the axis warms up."""

from __future__ import annotations

from collections.abc import Iterator
from math import exp, inf

from pmsm_ctrl.effects.base import Effect, Parameter
from pmsm_ctrl.effects.structures import LogView
from pmsm_ctrl.kernels import kernel


@kernel
def term(t: float, omega: float, direction: float, dF_v: float, dF_c: float, tau: float) -> float:
    """(dF_v omega + dF_c sgn(omega)) (1 - exp(-t/tau)): the change since the log began, first-order warm-up."""
    return (dF_v * omega + dF_c * direction) * (1.0 - exp(-t / tau))


def search(log: LogView) -> Iterator[dict[str, float]]:
    """Yield time constants from a tenth of the log to thrice its length."""
    for share in (0.1, 0.3, 1.0, 3.0):
        yield {"tau": share * log.duration}


def change(dF_c: float, dF_v: float, tau: float) -> dict[str, float]:
    """Return the parameters of a change of Coulomb and viscous friction with this time constant, s."""
    return {"dF_c": dF_c, "dF_v": dF_v, "tau": tau}


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
    search=search,
    example={"dF_v": -5e-05, "dF_c": -0.003, "tau": 10.0},
    needs="the same speeds early and late in the log",
    look_alikes={
        "viscous": "if speed only rises while the axis warms up, the drift follows the speed",
        "viscous_power": "if the speed was raised step by step, drag that falls with time looks sub-linear",
    },
)

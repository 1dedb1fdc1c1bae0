"""Friction that falls, or rises, as the axis warms up."""

from __future__ import annotations

from math import exp, inf

from pmsm_ctrl.effects.base import Effect, Parameter
from pmsm_ctrl.effects.structures import LogView, Search
from pmsm_ctrl.kernels import kernel

# Time constants that are tried, as shares of the log; the shortest, as a multiple of the time in gaps.
SHARES, UNSEEN = (0.03, 0.1, 0.3, 1.0, 3.0), 10.0


@kernel
def term(t: float, omega: float, direction: float, dF_v: float, dF_c: float, tau: float) -> float:
    """(dF_v omega + dF_c sgn(omega)) (1 - exp(-t/tau)): the change since the log began, first-order warm-up."""
    return (dF_v * omega + dF_c * direction) * (1.0 - exp(-t / tau))


def search(log: LogView) -> Search:
    """Return time constants from a thirtieth of the log to thrice its length: a longer one is a straight line as well.

    In a gap the axis may have warmed up or cooled down. That matters little to a time constant ten times as long.
    """
    shapes = tuple({"tau": share * log.duration} for share in SHARES if share * log.duration >= UNSEEN * log.unseen)
    if not shapes:
        return Search(
            (), 1, f"the log has gaps of {log.unseen:.3g} s, in which the axis warmed up or cooled down unseen"
        )
    return Search(shapes)


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
        Parameter("tau", "s", 10.0, 1e-3, 1e6, "time constant of warming up", within_grid=True),
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

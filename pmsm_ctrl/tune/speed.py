"""Speed controllers: symmetrical optimum, pole placement, bandwidth with phase margin.

The symmetrical optimum (C. Kessler, Regelungstechnik 6 (1958) 395; A. Umland, M. Safiuddin, IEEE Trans. Ind. Appl.
26 (1990) 489) places the crossover of an integrating plant with the small time constant T_sigma at 1/(a T_sigma),
midway between the corner of the PI and that of the plant: phase margin arctan((a^2 - 1) / (2 a)).
"""

from __future__ import annotations

import math
from typing import Any

import control as ct

from pmsm_ctrl.design import CurrentLoop, Design, SpeedLoop
from pmsm_ctrl.errors import RequestError, nearest
from pmsm_ctrl.tune.current import check_bandwidth, phase_limit, pi_for_margin
from pmsm_ctrl.tune.delays import Delays, delays
from pmsm_ctrl.tune.sampled import Cascade, pi, speed_plant

__all__ = [
    "METHODS", "highest_bandwidth", "open_loop", "pole_placement", "symmetrical_optimum",
    "tune_speed",
]  # fmt: skip

METHODS = ("symmetrical_optimum", "pole_placement", "bandwidth")
LEAST_LAG = math.radians(6.0)  # T_n of about 9.5 / omega_c: slower integrators leave a load standing


def symmetrical_optimum(K_t: float, J: float, T_sigma: float, a: float = 2.0) -> tuple[float, float]:
    """K_p in A/(rad/s) and T_n in s: K_p = J / (a K_t T_sigma), T_n = a^2 T_sigma."""
    return J / (a * K_t * T_sigma), a * a * T_sigma


def pole_placement(K_t: float, J: float, slope: float, omega_0: float, damping: float) -> tuple[float, float]:
    """K_p in A/(rad/s) and T_n in s that give J s^2 + (slope + K_t K_p) s + K_t K_p/T_n the poles asked for.

    `slope` is the friction slope in N m s/rad, `omega_0` in rad/s. Small time constants are neglected, which is
    why this holds only while omega_0 T_sigma is well below one.
    """
    K_p = (2.0 * damping * omega_0 * J - slope) / K_t
    return K_p, K_p * K_t / (J * omega_0 * omega_0)


def highest_bandwidth(cascade: Cascade, phase_margin: float = 45.0) -> float:
    """Highest crossover of the speed loop in Hz that its delays allow at this phase margin (deg)."""
    return phase_limit(speed_plant(cascade), phase_margin, LEAST_LAG)


def tune_speed(
    design: Design,
    current: CurrentLoop,
    method: str = "symmetrical_optimum",
    *,
    cascade: Cascade | None = None,
    bandwidth: float | None = None,
    phase_margin: float = 60.0,
    damping: float = 0.8,
    a: float = 1.0 + math.sqrt(2.0),
) -> SpeedLoop:
    """Return the speed controller around a current loop.

    Parameters
    ----------
    design : Design
    current : CurrentLoop
    method : {"symmetrical_optimum", "pole_placement", "bandwidth"}
        "bandwidth" meets crossover and phase margin exactly on the sampled loop.
    cascade : Cascade, optional
        Linear plant to tune on; by default the design's own at standstill's sliding slope.
    bandwidth : Hz, optional
        Crossover for "bandwidth" (required), natural frequency for "pole_placement" (default: as fast as the
        symmetrical optimum).
    phase_margin : deg
        For "bandwidth", and the least margin for "pole_placement" (45 deg at most is asked of it).
    damping : float
        For "pole_placement".
    a : float
        For "symmetrical_optimum". 2 is the textbook's (37 deg, 43 % overshoot unfiltered);
        1 + sqrt(2) makes the closed loop's damping 1/sqrt(2) and the phase margin 45 deg.

    Raises
    ------
    RequestError
        For an unknown method or a bandwidth that the delays do not allow: the message gives the highest one.
    """
    if method not in METHODS:
        raise RequestError(
            f"speed loop: unknown method '{method}'{nearest(method, METHODS)} (known: {', '.join(METHODS)})"
        )
    cascade = cascade or Cascade.of(design, current, at=1e-3)
    budget = delays(design, current)
    J, K_t = design.assumed.J or design.J, design.K_t_assumed
    if method == "symmetrical_optimum":
        if bandwidth is not None:
            a = 1.0 / (2.0 * math.pi * bandwidth * budget.speed)
        if not 1.2 <= a <= 50.0:
            fastest = 1.0 / (2.0 * math.pi * 1.2 * budget.speed)
            raise RequestError(
                f"speed loop: the symmetrical optimum would need a = {a:.3g}, outside 1.2 to 50; with "
                f"{budget.explain_speed()} its crossover is at most {fastest:.4g} Hz (a = 1.2, 10 deg)"
            )
        K_p, T_n = symmetrical_optimum(K_t, J, budget.speed, a)
        # The filter cancels the zero of the PI, without which the step overshoots by 43 % at a = 2.
        return SpeedLoop(K_p=K_p, T_n=T_n, reference_filter=T_n)
    least = phase_margin if method == "bandwidth" else min(phase_margin, 45.0)
    limit = highest_bandwidth(cascade, least)
    if method == "bandwidth":
        return _by_crossover(cascade, budget, bandwidth, limit, phase_margin)
    if bandwidth is None:
        bandwidth = 1.0 / (2.0 * math.pi * (1.0 + math.sqrt(2.0)) * budget.speed) / (2.0 * damping)
    return _by_poles(cascade, budget, bandwidth, damping, limit, least)


def _by_crossover(
    cascade: Cascade, budget: Delays, bandwidth: float | None, limit: float, phase_margin: float
) -> SpeedLoop:
    """Meet crossover (Hz) and phase margin (deg) exactly on the sampled loop."""
    if bandwidth is None:
        raise RequestError(
            f"speed loop: the method 'bandwidth' needs a bandwidth in Hz (up to {limit:.4g} Hz is possible)"
        )
    check_bandwidth("speed loop", bandwidth, limit, phase_margin, budget.explain_speed())
    K_p, T_n = pi_for_margin(speed_plant(cascade), bandwidth, phase_margin)
    if math.isnan(K_p):
        raise RequestError(
            f"speed loop: at {bandwidth:g} Hz the plant lags so little that a PI cannot make the phase margin as "
            f"small as {phase_margin:g} deg; ask for a higher bandwidth (up to {limit:.4g} Hz) or margin"
        )
    return SpeedLoop(K_p=K_p, T_n=T_n)


def _by_poles(
    cascade: Cascade, budget: Delays, bandwidth: float, damping: float, limit: float, least: float
) -> SpeedLoop:
    """Place the poles at `bandwidth` (Hz) if the delays allow the crossover that this takes."""
    # The crossover of the placed pair is about 2 zeta omega_0: that is what the delays have to allow.
    check_bandwidth(
        f"speed loop (poles at {bandwidth:g} Hz cross at about {2.0 * damping * bandwidth:.4g} Hz)",
        2.0 * damping * bandwidth, limit, least, budget.explain_speed(),
    )  # fmt: skip
    design = cascade.design
    J, K_t, slope = design.assumed.J or design.J, design.K_t_assumed, cascade.model.point.friction_slope
    K_p, T_n = pole_placement(K_t, J, slope, 2.0 * math.pi * bandwidth, damping)
    if K_p <= 0.0:
        raise RequestError(
            f"speed loop: friction alone damps more than poles at {bandwidth:g} Hz with damping {damping:g} ask for; "
            "choose a higher frequency"
        )
    return SpeedLoop(K_p=K_p, T_n=T_n)


def open_loop(cascade: Cascade, speed: SpeedLoop, filters: tuple[Any, ...] = ()) -> Any:
    """Return the open speed loop in z: PI, filters behind it, and everything it drives and measures."""
    loop = speed_plant(cascade) * ct.ss(pi(speed.K_p, speed.T_n, cascade.period))
    for item in filters:
        loop = loop * ct.ss(item.sampled(cascade.period))
    return loop

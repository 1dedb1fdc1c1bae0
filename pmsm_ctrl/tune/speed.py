"""Speed controllers: symmetrical optimum, pole placement, bandwidth with phase margin.

The symmetrical optimum (C. Kessler, Regelungstechnik 6 (1958) 395; A. Umland, M. Safiuddin, IEEE Trans. Ind. Appl.
26 (1990) 489) places the crossover of an integrating plant with the small time constant T_sigma at 1/(a T_sigma),
midway between the corner of the PI and that of the plant: phase margin arctan((a^2 - 1) / (2 a)).
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import control as ct
import numpy as np

from pmsm_ctrl.design import Filter, SpeedLoop
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.tune.current import check_bandwidth, lags_too_much, phase_limit, pi_for_margin
from pmsm_ctrl.tune.delays import Delays, delays
from pmsm_ctrl.tune.margins import margins
from pmsm_ctrl.tune.requirements import Specification
from pmsm_ctrl.tune.sampled import Cascade, filters, pi, speed_plant

__all__ = [
    "highest_bandwidth", "open_loop", "pole_placement", "slowed", "symmetrical_optimum", "tune_speed",
]  # fmt: skip

LEAST_A, MOST_A = 1.2, 50.0  # of the symmetrical optimum
LEAST_LAG = math.radians(6.0)  # T_n of about 9.5 / omega_c: slower integrators reject loads too slowly


def symmetrical_optimum(K_t: float, J: float, T_sigma: float, a: float = 2.0) -> tuple[float, float]:
    """Return K_p = J / (a K_t T_sigma) in A/(rad/s) and T_n = a^2 T_sigma in s."""
    return J / (a * K_t * T_sigma), a * a * T_sigma


def pole_placement(K_t: float, J: float, slope: float, omega_0: float, damping: float) -> tuple[float, float]:
    """Return K_p in A/(rad/s) and T_n in s that place the poles of J s^2 + (slope + K_t K_p) s + K_t K_p/T_n.

    `slope` is the friction slope in N m s/rad, `omega_0` in rad/s. Small time constants are neglected, so it holds only
    while omega_0 T_sigma is well below one.
    """
    K_p = (2.0 * damping * omega_0 * J - slope) / K_t
    return K_p, K_p * K_t / (J * omega_0 * omega_0)


def highest_bandwidth(cascade: Cascade, phase_margin: float = 45.0, behind: tuple[Filter, ...] = ()) -> float:
    """Return the highest crossover of the speed loop (Hz) that its delays allow at this phase margin (deg)."""
    return phase_limit(_filtered_plant(cascade, behind), phase_margin, LEAST_LAG)


def _filtered_plant(cascade: Cascade, behind: tuple[Filter, ...]) -> Any:
    plant = speed_plant(cascade)
    return plant * filters(behind, cascade.period) if behind else plant


def tune_speed(
    cascade: Cascade, specification: Specification | None = None, behind: tuple[Filter, ...] = ()
) -> SpeedLoop:
    """Return the speed controller around the current loop of a cascade, with filters behind it, for a specification.

    Raises
    ------
    RequestError
        For a bandwidth that the delays do not allow: the message gives the highest one.
    """
    wanted = specification or Specification()
    budget = delays(cascade.design, cascade.current, behind)
    if wanted.speed == "symmetrical_optimum":
        found = _symmetrical(cascade, budget, wanted, behind)
    else:
        least = wanted.phase_margin if wanted.speed == "bandwidth" else min(wanted.phase_margin, 45.0)
        limit = highest_bandwidth(cascade, least, behind)
        if wanted.speed == "bandwidth":
            found = _by_crossover(_filtered_plant(cascade, behind), budget, wanted, limit)
        else:
            found = _by_poles(cascade, budget, wanted, limit, least)
    return found.model_copy(update={"filters": behind})


def slowed(wanted: Specification, factor: float, budget: Delays) -> Specification:
    """Return the specification of a speed loop that is slower by a factor >= 1, by the same method."""
    if factor == 1.0:
        return wanted
    if wanted.speed == "symmetrical_optimum" and wanted.speed_bandwidth is None:
        return replace(wanted, a=wanted.a * factor)
    asked = wanted.speed_bandwidth if wanted.speed_bandwidth is not None else _default_poles(budget, wanted.damping)
    return replace(wanted, speed_bandwidth=asked / factor)


def _default_poles(budget: Delays, damping: float) -> float:
    """Natural frequency with the crossover that the symmetrical optimum has at a = 1 + sqrt(2), Hz."""
    return 1.0 / (2.0 * math.pi * (1.0 + math.sqrt(2.0)) * budget.speed) / (2.0 * damping)


def _assumed(cascade: Cascade) -> tuple[float, float]:
    """Torque constant and inertia that the controller assumes."""
    return cascade.design.K_t_assumed, cascade.design.assumed.J or cascade.design.J


def _symmetrical(cascade: Cascade, budget: Delays, wanted: Specification, behind: tuple[Filter, ...]) -> SpeedLoop:
    a = wanted.a
    if wanted.speed_bandwidth is not None:
        a = 1.0 / (2.0 * math.pi * wanted.speed_bandwidth * budget.speed)
    if not LEAST_A <= a <= MOST_A:
        least = _smallest(cascade, budget, wanted, behind)
        fastest = math.floor(1.0 / (2.0 * math.pi * least * budget.speed))
        raise RequestError(
            f"speed loop: the symmetrical optimum would need a = {a:.3g}, outside {LEAST_A:g} to {MOST_A:g}; with "
            f"{budget.explain_speed()} the required margins hold up to --speed-bandwidth {fastest} (a = {least:.3g})"
        )
    return _optimal(cascade, budget, a)


def _optimal(cascade: Cascade, budget: Delays, a: float) -> SpeedLoop:
    K_p, T_n = symmetrical_optimum(*_assumed(cascade), budget.speed, a)
    # The filter cancels the zero of the PI; without it the step overshoots by 43 % at a = 2.
    return SpeedLoop(K_p=K_p, T_n=T_n, reference_filter=T_n)


def _smallest(cascade: Cascade, budget: Delays, wanted: Specification, behind: tuple[Filter, ...]) -> float:
    """Return the smallest a whose sampled loop has the required margins; where none has, the largest."""

    def met(a: float) -> bool:
        loop = open_loop(cascade, _optimal(cascade, budget, a).model_copy(update={"filters": behind}))
        return not wanted.requirements.missed(margins(loop))

    tried = np.geomspace(LEAST_A, MOST_A, 60)
    return next((float(a) for a in tried if met(a)), MOST_A)


def _by_crossover(plant: Any, budget: Delays, wanted: Specification, limit: float) -> SpeedLoop:
    """Meet crossover and phase margin exactly on the sampled loop."""
    phase_margin = wanted.phase_margin
    asked = check_bandwidth("speed loop", wanted.speed_bandwidth, limit, phase_margin, budget.explain_speed())
    K_p, T_n = pi_for_margin(plant, asked, phase_margin)
    if math.isnan(K_p):
        if lags_too_much(plant, asked, phase_margin):
            raise RequestError(
                f"speed loop: at {asked:g} Hz the plant lags too much for {phase_margin:g} deg of phase margin, though "
                f"it has them at other frequencies up to {limit:.4g} Hz; ask for a lower bandwidth or margin"
            )
        raise RequestError(
            f"speed loop: at {asked:g} Hz the plant lags so little that a PI cannot make the phase margin as "
            f"small as {phase_margin:g} deg; ask for a higher bandwidth (up to {limit:.4g} Hz) or margin"
        )
    return SpeedLoop(K_p=K_p, T_n=T_n)


def _by_poles(cascade: Cascade, budget: Delays, wanted: Specification, limit: float, least: float) -> SpeedLoop:
    """Place the poles, if the delays allow the crossover 2 zeta omega_0 that this takes."""
    damping = wanted.damping
    asked = wanted.speed_bandwidth if wanted.speed_bandwidth is not None else _default_poles(budget, damping)
    check_bandwidth(
        f"speed loop (poles at {asked:g} Hz cross at about {2.0 * damping * asked:.4g} Hz)",
        2.0 * damping * asked, limit, least, budget.explain_speed(),
    )  # fmt: skip
    slope = cascade.model.point.friction_slope
    K_p, T_n = pole_placement(*_assumed(cascade), slope, 2.0 * math.pi * asked, damping)
    if K_p <= 0.0:
        raise RequestError(
            f"speed loop: friction alone damps more than poles at {asked:g} Hz with damping {damping:g} ask for; "
            "choose a higher frequency"
        )
    return SpeedLoop(K_p=K_p, T_n=T_n)


def open_loop(cascade: Cascade, speed: SpeedLoop) -> Any:
    """Return the open speed loop in z: the PI, the filters behind it, and the plant with its speed measurement."""
    loop = speed_plant(cascade) * ct.ss(pi(speed.K_p, speed.T_n, cascade.period))
    return loop * filters(speed.filters, cascade.period) if speed.filters else loop

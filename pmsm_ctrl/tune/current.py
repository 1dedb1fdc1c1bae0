"""Current controllers from winding data: pole cancellation (internal model), modulus optimum, bandwidth and margin.

Internal model control of an R-L plant with the filter alpha / (s + alpha) *is* the PI that cancels the pole
(L. Harnefors, H.-P. Nee, IEEE Trans. Ind. Appl. 34 (1998) 133): K_p = alpha L, T_n = L / R.
The modulus optimum (C. Kessler 1955; D. Schroeder, Elektrische Antriebe 2) is the same PI with alpha = 1 / (2 T_sigma).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from pmsm_ctrl.design import CurrentLoop, Design
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.simulate.parameters import Plant
from pmsm_ctrl.tune.delays import delays
from pmsm_ctrl.tune.margins import response
from pmsm_ctrl.tune.requirements import Specification
from pmsm_ctrl.tune.sampled import current_loop

__all__ = [
    "check_bandwidth", "highest_bandwidth", "lags_too_much", "modulus_optimum", "phase_limit",
    "pi_for_margin", "pole_cancellation", "tune_current",
]  # fmt: skip

LEAST_LAG = math.radians(3.0)  # smallest lag of the PI at crossover: T_n of about 19 / omega_c


def pole_cancellation(R: float, L: float, bandwidth: float) -> tuple[float, float]:
    """Return K_p in V/A and T_n in s for a closed loop alpha / (s + alpha), alpha = 2 pi `bandwidth` (Hz)."""
    return 2.0 * math.pi * bandwidth * L, L / R


def modulus_optimum(R: float, L: float, T_sigma: float) -> tuple[float, float]:
    """Return K_p in V/A and T_n in s for the small time constant T_sigma (s): damping 1/sqrt(2), 4.3 % overshoot."""
    return L / (2.0 * T_sigma), L / R


def pi_for_margin(plant: Any, crossover: float, phase_margin: float) -> tuple[float, float]:
    """Return gain and T_n (s) of the discrete PI that crosses at a frequency (Hz) with a phase margin (deg).

    In closed form; NaN where no PI has this phase there. `plant` is the discrete plant (control.StateSpace).
    """
    T = plant.dt
    w = 2.0 * math.pi * crossover
    P, lag = _lag_to_spare(plant, crossover, phase_margin)
    if not 0.0 < lag < 0.5 * math.pi:
        return math.nan, math.nan
    # On the unit circle 1/(z-1) = -1/2 - j/2 cot(wT/2), so tan(lag) = (b/2) cot / (1 - b/2) for b = T/T_n.
    tangent, cotangent = math.tan(lag), 1.0 / math.tan(0.5 * w * T)
    b = 2.0 * tangent / (cotangent + tangent)
    z = np.exp(1j * w * T)
    return float(1.0 / abs(P * (1.0 + b / (z - 1.0)))), T / b


def _lag_to_spare(plant: Any, crossover: float, phase_margin: float) -> tuple[complex, float]:
    """Return the plant's response at a frequency (Hz) and the lag (rad) that a margin (deg) leaves to a PI there."""
    P = complex(response(plant, np.array([2.0 * math.pi * crossover]))[0])
    lag = (math.pi + float(np.angle(P)) - math.radians(phase_margin)) % (2.0 * math.pi)
    return P, lag - 2.0 * math.pi if lag > math.pi else lag


def lags_too_much(plant: Any, crossover: float, phase_margin: float) -> bool:
    """Whether the plant alone has less than a phase margin (deg) at a frequency (Hz)."""
    return _lag_to_spare(plant, crossover, phase_margin)[1] <= 0.0


def phase_limit(plant: Any, phase_margin: float, least_lag: float = LEAST_LAG) -> float:
    """Return the highest crossover (Hz) at which the phase leaves a margin (deg) and the smallest lag of a PI (rad)."""
    T = plant.dt
    omega = np.geomspace(1e-4, 0.999, 4000) * math.pi / T
    phase = np.unwrap(np.angle(response(plant, omega)))
    phase -= 2.0 * math.pi * round(float(phase[0]) / (2.0 * math.pi))
    need = -math.pi + math.radians(phase_margin) + least_lag
    below = np.flatnonzero((phase[1:] < need) & (phase[:-1] >= need))
    if not below.size:
        return float(omega[-1]) / (2.0 * math.pi) if phase[-1] >= need else math.nan
    k = int(below[-1])
    share = (need - phase[k]) / (phase[k + 1] - phase[k])
    return float(omega[k] + share * (omega[k + 1] - omega[k])) / (2.0 * math.pi)


def highest_bandwidth(design: Design, phase_margin: float = 45.0) -> float:
    """Return the highest crossover of the current loop (Hz) that sampling and delay allow at this margin (deg)."""
    return min(phase_limit(_winding(design, axis), phase_margin) for axis in ("d", "q"))


def _winding(design: Design, axis: str) -> Any:
    """The plant of one axis: the loop with a unit gain and no integrator."""
    return current_loop(design, CurrentLoop(K_p=1.0, T_n=1e9, K_p_d=1.0, T_n_d=1e9), axis)


def tune_current(design: Design, specification: Specification | None = None) -> CurrentLoop:
    """Return the current controllers of both axes for a specification.

    The rules take the winding that the controller assumes; a crossover, and the highest one, are those of the motor's.

    Raises
    ------
    RequestError
        For a bandwidth that the delay does not allow: the message gives the highest one.
    """
    wanted = specification or Specification()
    method, asked, phase_margin = wanted.current, wanted.current_bandwidth, wanted.phase_margin
    R, L_q, L_d = _assumed(design)
    if not 5.0 <= phase_margin <= 85.0:
        raise RequestError(
            f"current loop: phase margin of {phase_margin:g} deg asked for; between 5 and 85 deg is possible"
        )
    budget = delays(design, CurrentLoop(K_p=1.0, T_n=1.0))
    if method == "modulus_optimum":
        if asked is not None:
            raise RequestError(
                "current loop: the modulus optimum fixes the bandwidth by the delay; leave `current_bandwidth` out, "
                "or take the method 'pole_cancellation' or 'bandwidth'"
            )
        return _loop([modulus_optimum(R, L, budget.current) for L in (L_q, L_d)])
    limit = highest_bandwidth(design, phase_margin)
    if asked is not None or method == "bandwidth":
        asked = check_bandwidth("current loop", asked, limit, phase_margin, budget.explain_current())
    if method == "pole_cancellation":
        return _loop([pole_cancellation(R, L, limit if asked is None else asked) for L in (L_q, L_d)])
    assert asked is not None
    return _loop([pi_for_margin(_winding(design, axis), asked, phase_margin) for axis in ("q", "d")])


def _assumed(design: Design) -> tuple[float, float, float]:
    """Resistance and inductances of q and d that the controller assumes."""
    m, assumed = Plant.of(design), design.assumed
    return assumed.R or m.R, assumed.L_q or m.L_q, assumed.L_d or m.L_d


def _loop(gains: list[tuple[float, float]]) -> CurrentLoop:
    (K_p, T_n), (K_d, T_d) = gains
    if math.isclose(K_p, K_d, rel_tol=1e-9) and math.isclose(T_n, T_d, rel_tol=1e-9):
        return CurrentLoop(K_p=K_p, T_n=T_n)
    return CurrentLoop(K_p=K_p, T_n=T_n, K_p_d=K_d, T_n_d=T_d)


def check_bandwidth(loop: str, bandwidth: float | None, limit: float, phase_margin: float, why: str) -> float:
    """Return a bandwidth (Hz) that the delays allow.

    Raises
    ------
    RequestError
        Naming the highest possible bandwidth and where the delay comes from.
    """
    if bandwidth is None:
        raise RequestError(f"{loop}: the method 'bandwidth' needs a bandwidth in Hz (up to {limit:.4g} Hz is possible)")
    if not (math.isfinite(bandwidth) and bandwidth > 0.0):
        raise RequestError(f"{loop}: bandwidth of {bandwidth:g} Hz asked for; a positive number was expected")
    if math.isnan(limit):
        raise RequestError(f"{loop}: no bandwidth has {phase_margin:g} deg of phase margin with {why}")
    if bandwidth > limit:
        raise RequestError(
            f"{loop}: {bandwidth:g} Hz asked for, but with {why} the highest bandwidth that keeps "
            f"{phase_margin:g} deg of phase margin is {limit:.4g} Hz"
        )
    return bandwidth

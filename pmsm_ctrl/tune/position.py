"""Position controller: proportional, with velocity and acceleration feedforward, and its stiffness."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import control as ct
import numpy as np

from pmsm_ctrl.design import PositionLoop
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.simulate.parameters import matched_filter
from pmsm_ctrl.tune.margins import response
from pmsm_ctrl.tune.sampled import Cascade, frequencies

__all__ = ["Stiffness", "highest_gain", "open_loop", "stiffness", "tune_position"]

PEAK = 1.01  # largest abs(T) accepted: 1 % of resonance
SENSITIVITY = 1.4  # largest abs(S) accepted: above it the step response swings back although abs(T) has no peak


@dataclass(frozen=True)
class Stiffness:
    """How the axis resists a load torque.

    Attributes
    ----------
    position_dynamic : float
        Smallest abs(T_load / theta) over frequency with the position loop closed, N m/rad.
    position_frequency : float
        Where that is, Hz.
    position_integral : float
        K_t K_p K_v / T_n, N m/(rad s). At low frequency T_load / theta is this over s: infinite at rest.
    position_proportional : float
        Stiffness of the proportional parts, K_t K_p (K_v + 1/T_n), N m/rad.
    speed_dynamic : float
        Smallest abs(T_load / omega) with the speed loop closed, N m s/rad.
    speed_frequency : float
        Where that is, Hz.
    """

    position_dynamic: float
    position_frequency: float
    position_integral: float
    position_proportional: float
    speed_dynamic: float
    speed_frequency: float


def open_loop(cascade: Cascade, K_v: float) -> Any:
    """Return the open position loop in z: K_v (1/s) times the closed speed loop to the angle."""
    assert cascade.speed is not None
    # The reference filter acts on the reference speed alone, not on the position controller's output.
    bare = cascade.speed.model_copy(update={"reference_filter": 0.0})
    return K_v * cascade.with_gains(speed=bare, position=None).system(("omega_ref",), ("theta",))


def highest_gain(cascade: Cascade) -> float:
    """Return the largest K_v (1/s) whose closed loop shows no resonance (`PEAK`, `SENSITIVITY`); NaN without one."""
    loop = open_loop(cascade, 1.0)
    L = response(loop, frequencies(cascade.period, 1e-5, 3000))

    def accepted(K_v: float) -> bool:
        closed = np.abs(1.0 + K_v * L)
        return bool(np.abs(K_v * L / closed).max() <= PEAK and (1.0 / closed).max() <= SENSITIVITY)

    low, high = 1e-3, math.pi / cascade.period
    if not accepted(low):
        return math.nan
    # The peaks grow with the gain until the loop is unstable: bisection finds the largest gain before that.
    for _ in range(60):
        middle = math.sqrt(low * high)
        if accepted(middle) and _stable(loop, middle):
            low = middle
        else:
            high = middle
    return low


def _stable(loop: Any, K_v: float) -> bool:
    return bool(np.all(np.abs(ct.feedback(K_v * loop, 1).poles()) < 1.0))


def tune_position(cascade: Cascade, gain: float | None = None) -> PositionLoop:
    """Return the position controller around a tuned speed loop, with velocity and acceleration fed forward.

    By default with the largest gain (1/s) whose closed loop shows no resonance.

    Raises
    ------
    RequestError
        When the gain asked for makes the loop unstable: the message gives the highest without resonance.
    """
    best = highest_gain(cascade)
    if gain is not None and not (math.isfinite(gain) and gain > 0.0):
        raise RequestError(f"position loop: a gain of {gain:g} 1/s asked for; a positive number was expected")
    if gain is not None and not _stable(open_loop(cascade, 1.0), gain):
        raise RequestError(
            f"position loop: unstable with K_v = {gain:g} 1/s around this speed loop; the highest gain without "
            f"resonance is {best:.4g} 1/s"
        )
    if gain is None and math.isnan(best):
        raise RequestError("position loop: no gain is free of resonance; the speed loop itself resonates")
    return PositionLoop(
        K_v=gain if gain is not None else best,
        velocity_feedforward=1.0,
        acceleration_feedforward=1.0,
        velocity_filter=matched_filter(cascade.design),
    )


def stiffness(cascade: Cascade) -> Stiffness:
    """Return the stiffness of a cascade with its speed loop set."""
    speed, K_v, K_t = cascade.speed, cascade.position.K_v if cascade.position else 0.0, cascade.truth.K_t
    assert speed is not None
    omega = frequencies(cascade.period, 1e-6, 3000)
    by_angle = 1.0 / np.abs(response(cascade.system(("T_load",), ("theta",)), omega))
    by_speed = 1.0 / np.abs(response(cascade.with_gains(position=None).system(("T_load",), ("omega",)), omega))
    k, m = int(np.argmin(by_angle)), int(np.argmin(by_speed))
    return Stiffness(
        position_dynamic=float(by_angle[k]),
        position_frequency=float(omega[k]) / (2.0 * math.pi),
        position_integral=K_t * speed.K_p * K_v / speed.T_n,
        position_proportional=K_t * speed.K_p * (K_v + 1.0 / speed.T_n),
        speed_dynamic=float(by_speed[m]),
        speed_frequency=float(omega[m]) / (2.0 * math.pi),
    )

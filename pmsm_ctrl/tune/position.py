"""Position controller: proportional, with velocity and acceleration feedforward, and its stiffness."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import control as ct
import numpy as np

from pmsm_ctrl.design import PositionLoop
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.tune.margins import response
from pmsm_ctrl.tune.sampled import Cascade, frequencies

__all__ = ["Stiffness", "highest_gain", "open_loop", "stiffness", "tune_position"]

PEAK = 1.01  # largest abs(T) granted: 1 % of resonance is what a settled axis does not show
SENSITIVITY = 1.4  # largest abs(S) granted: above it the step swings back although abs(T) has no peak


@dataclass(frozen=True)
class Stiffness:
    """How the axis resists a load torque.

    Attributes
    ----------
    position_dynamic : N m/rad
        Smallest abs(T_load / theta) over frequency with the position loop closed: the worst case of a sine.
    position_frequency : Hz, where that is
    position_integral : N m/(rad s)
        K_t K_p K_v / T_n: at low frequency T_load / theta is this over s, so a constant load leaves no error
        at all and the static stiffness is infinite.
    position_proportional : N m/rad
        K_t K_p (K_v + 1/T_n), the spring that the controllers imitate.
    speed_dynamic : N m s/rad
        Smallest abs(T_load / omega) with the speed loop closed.
    speed_frequency : Hz
    """

    position_dynamic: float
    position_frequency: float
    position_integral: float
    position_proportional: float
    speed_dynamic: float
    speed_frequency: float


def open_loop(cascade: Cascade, K_v: float) -> Any:
    """Return the open position loop in z: K_v times the closed speed loop to the angle."""
    assert cascade.speed is not None
    # The reference filter acts on the reference speed alone, not on the position controller's output.
    bare = cascade.speed.model_copy(update={"reference_filter": 0.0})
    closed = cascade.with_gains(speed=bare, position=None).system(("omega_ref",), ("theta",))
    return K_v * closed


def highest_gain(cascade: Cascade, peak: float = PEAK, sensitivity: float = SENSITIVITY) -> float:
    """Largest K_v in 1/s whose closed loop keeps abs(T) below `peak` and abs(S) below `sensitivity`."""
    omega = frequencies(cascade.period, 1e-5, 3000)
    L = response(open_loop(cascade, 1.0), omega)

    def worst(K_v: float) -> float:
        closed = np.abs(1.0 + K_v * L)
        return float(max(np.abs(K_v * L / closed).max() / peak, (1.0 / closed).max() / sensitivity))

    low, high = 1e-3, math.pi / cascade.period
    if worst(low) > 1.0:
        return math.nan
    # The peak grows with the gain until the loop is unstable; bisect towards the largest gain before that.
    for _ in range(60):
        middle = math.sqrt(low * high)
        if worst(middle) <= 1.0 and _stable(cascade, middle):
            low = middle
        else:
            high = middle
    return low


def _stable(cascade: Cascade, K_v: float) -> bool:
    return bool(np.all(np.abs(ct.feedback(open_loop(cascade, K_v), 1).poles()) < 1.0))


def tune_position(
    cascade: Cascade,
    *,
    gain: float | None = None,
    velocity_feedforward: float = 1.0,
    acceleration_feedforward: float = 1.0,
) -> PositionLoop:
    """Return the position controller around a tuned speed loop.

    Parameters
    ----------
    cascade : Cascade
        With its speed loop set.
    gain : float, optional
        K_v in 1/s; by default the largest whose closed loop shows no resonance (1 %).
    velocity_feedforward, acceleration_feedforward : shares fed forward, usually 1

    Raises
    ------
    RequestError
        When the gain asked for makes the loop unstable: the message gives the highest without resonance.
    """
    best = highest_gain(cascade)
    if gain is not None and not (math.isfinite(gain) and gain > 0.0):
        raise RequestError(f"position loop: a gain of {gain:g} 1/s asked for; a positive number was expected")
    if gain is not None and not _stable(cascade, gain):
        raise RequestError(
            f"position loop: unstable with K_v = {gain:g} 1/s around this speed loop; the highest gain without "
            f"resonance is {best:.4g} 1/s"
        )
    if gain is None and math.isnan(best):
        raise RequestError("position loop: no gain keeps it free of resonance; the speed loop itself resonates")
    return PositionLoop(
        K_v=gain if gain is not None else best,
        velocity_feedforward=velocity_feedforward,
        acceleration_feedforward=acceleration_feedforward,
    )


def stiffness(cascade: Cascade) -> Stiffness:
    """Return the stiffness of a tuned cascade (speed and position loops set)."""
    speed, position = cascade.speed, cascade.position
    assert speed is not None
    assert position is not None
    omega = frequencies(cascade.period, 1e-6, 3000)
    by_angle = 1.0 / np.abs(response(cascade.system(("T_load",), ("theta",)), omega))
    by_speed = 1.0 / np.abs(response(cascade.with_gains(position=None).system(("T_load",), ("omega",)), omega))
    k, m = int(np.argmin(by_angle)), int(np.argmin(by_speed))
    K_t = cascade.truth.K_t
    return Stiffness(
        position_dynamic=float(by_angle[k]),
        position_frequency=float(omega[k]) / (2.0 * math.pi),
        position_integral=K_t * speed.K_p * position.K_v / speed.T_n,
        position_proportional=K_t * speed.K_p * (position.K_v + 1.0 / speed.T_n),
        speed_dynamic=float(by_speed[m]),
        speed_frequency=float(omega[m]) / (2.0 * math.pi),
    )

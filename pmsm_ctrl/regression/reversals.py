"""Dry friction through a reversal: the share of its level that acts in each sample.

The speed is smoothed before it is differentiated. Dry friction puts a kink into it where the direction changes, so that
the smoothed speed crosses zero up to a millisecond late, always late. In the torque balance this looks like a delay, a
spring or a gap. A shaft that reverses slowly also sticks for a while. So each reversal is simulated with the measured
torque, from the speed before it, which the kink does not affect, to the speed after it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.kernels import kernel

__all__ = ["reversals", "timed_sign"]

Array = NDArray[np.float64]

SUBSTEPS = 16  # of a sample: the direction turns at a substep
LONGEST = 30  # times what the smoothing mixes: longer rests have no part in a reversal
ROUNDS = 12  # of either bisection
LEVELS = (0.5, 2.5)  # friction at the reversal over its usual level


def timed_sign(omega: Array) -> Array:
    """Sign of the speed whose area is right where it changes between two samples."""
    sign = np.sign(omega)
    turns = np.flatnonzero(sign[:-1] * sign[1:] < 0.0)
    share = omega[turns] / (omega[turns] - omega[turns + 1])
    nearest = turns + (share > 0.5)
    out = sign.copy()
    out[nearest] += sign[turns] * (2.0 * share - 1.0)
    return out


def reversals(
    direction: Array, resting: NDArray[np.bool_], omega: Array, ends: tuple[Array, Array], torque: Array, J: float,
    period: float, reach: int,
) -> list[slice]:  # fmt: skip
    """Overwrite `direction` around every reversal by what a shaft with dry friction would do there.

    Returns the stretches in which the shaft stops, or nearly, and goes on as before: its direction is not known there.

    Parameters
    ----------
    direction : array, shape (n,)
        Friction as a share of its level; changed in place.
    resting : bool array, shape (n,)
        Samples at which the shaft rests.
    omega : array, shape (n,)
        Smoothed speed.
    ends : (array, array), shape (n,)
        Speed and position before and after a reversal, in the band of the torque.
    torque : array, shape (n,)
        What drives the axis less everything but dry friction, as a share of its level.
    J : float
        Inertia over the level of dry friction, s^2.
    period : float
        s.
    reach : int
        Samples on either side that the smoothing of the speed mixes.
    """
    longest = reach * (2 + LONGEST)
    speed, theta = ends
    share = np.empty(longest)
    unknown = []
    for first, last in _events(omega, resting, reach):
        start, stop = first - reach, last + reach + 1
        if start < 0 or stop > len(omega) or stop - start > longest:
            continue
        if turned(speed[start:stop], theta[start:stop], torque[start:stop], J, period, share):
            direction[start + 1 : stop - 1] = share[1 : stop - start - 1]
        elif omega[start] * omega[stop - 1] > 0.0:
            unknown.append(slice(start, stop))
    return unknown


def _events(omega: Array, resting: NDArray[np.bool_], reach: int) -> list[tuple[int, int]]:
    """First and last sample of what is uncertain: changes of sign and rests, together where they are close."""
    sign = np.sign(omega)
    doubtful = resting.copy()
    turns = np.flatnonzero(sign[:-1] * sign[1:] < 0.0)
    doubtful[turns] = doubtful[turns + 1] = True
    found = np.flatnonzero(doubtful)
    if not len(found):
        return []
    cuts = np.flatnonzero(np.diff(found) > 2 * reach)
    firsts = found[np.concatenate([[0], cuts + 1])]
    lasts = found[np.concatenate([cuts, [len(found) - 1]])]
    return list(zip(firsts.tolist(), lasts.tolist(), strict=True))


@kernel
def turned(omega: Array, theta: Array, torque: Array, J: float, period: float, share: Array) -> bool:
    """Fill `share` for one reversal; False when no dry friction turns the shaft like that.

    Two unknowns are solved for: a missing torque, from the speed at the end, and the level of friction at low speed,
    from the travel, since more friction bends the path more.
    """
    travel = theta[-1] - theta[0]
    low_level, high_level = LEVELS
    inside = False
    for _ in range(ROUNDS):
        level = np.sqrt(low_level * high_level)
        low, high = -1.0, 1.0
        missing = travelled = 0.0
        for _ in range(ROUNDS):
            missing = 0.5 * (low + high)
            last, travelled = through(omega[0], torque, missing, level, J, period, share)
            if last > omega[-1]:
                high = missing
            else:
                low = missing
        inside = abs(missing) < 0.5
        # friction delays the turn: with more of it the shaft gets further the way it drives
        if (travelled - travel) * (omega[-1] - omega[0]) > 0.0:
            high_level = level
        else:
            low_level = level
    return inside


@kernel
def through(
    speed: float, torque: Array, missing: float, level: float, J: float, period: float, share: Array
) -> tuple[float, float]:
    """Simulate a reversal; return the last speed and the travel, and in `share` the friction around every sample.

    Set-valued friction in a semi-implicit step: a speed that would change its sign in a step is zero after it.
    """
    h = period / SUBSTEPS
    push, most = h / J, level * h / J
    travel = 0.0
    share[: torque.size] = 0.0
    for n in range(torque.size - 1):
        early = late = 0.0
        for m in range(SUBSTEPS):
            x = (m + 0.5) / SUBSTEPS
            free = speed + push * ((1.0 - x) * torque[n] + x * torque[n + 1] + missing)
            held = min(most, max(-most, free))
            before = speed
            speed = free - held
            travel += before + speed
            if m < SUBSTEPS // 2:
                early += held
            else:
                late += held
        share[n] += early / (most * SUBSTEPS)
        share[n + 1] += late / (most * SUBSTEPS)
    return speed, 0.5 * h * travel

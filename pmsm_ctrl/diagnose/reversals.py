"""When dry friction turns: the share of its level that acts, sample by sample, through every reversal.

The speed is smoothed before it is differentiated, and friction kinks it where the direction changes: the smoothed
speed crosses zero up to a millisecond late, always late. Seen from the torque that is an actuation delay, a
spring or a gap that nobody built in. And a shaft that is turned round slowly sticks for a while in between.
So each reversal is run through: from the speed before it, which the kink has not reached, to the speed after it,
driven by the measured torque.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.kernels import kernel

__all__ = ["reversals", "timed_sign"]

Array = NDArray[np.float64]

SUBSTEPS = 8  # of a sample
LONGEST = 30  # times what the smoothing mixes: longer rests have no part in a reversal
ROUNDS = 14  # of the bisection for the torque that is missing to meet the speed after the reversal


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
    direction: Array, resting: NDArray[np.bool_], omega: Array, torque: Array, J: float, period: float, reach: int
) -> None:
    """Overwrite `direction` around every reversal by what a shaft with dry friction would do there.

    Parameters
    ----------
    direction : array, shape (n,)
        Friction as a share of its level; changed in place.
    resting : bool array, shape (n,)
        Samples at which the shaft rests.
    omega, torque : array, shape (n,)
        Smoothed speed, and what drives it less everything but dry friction, as a share of its level.
    J : float
        Inertia over the level of dry friction, s^2.
    reach : int
        Samples on either side that the smoothing of the speed mixes.
    """
    longest = reach * (2 + LONGEST)
    share = np.empty(longest)
    for first, last in _events(omega, resting, reach):
        start, stop = first - reach, last + reach + 1
        if start < 0 or stop > len(omega) or stop - start > longest:
            continue
        driving = torque[start:stop]
        low, high = -1.0, 1.0
        for _ in range(ROUNDS):
            middle = 0.5 * (low + high)
            if through(omega[start], driving, middle, J, period, SUBSTEPS, share) > omega[stop - 1]:
                high = middle
            else:
                low = middle
        if abs(middle) < 0.5:  # else it is no dry friction that turns the shaft here
            direction[start + 1 : stop - 1] = share[1 : stop - start - 1]


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
def through(speed: float, torque: Array, missing: float, J: float, period: float, substeps: int, share: Array) -> float:
    """Run through a reversal; return the last speed, and in `share` the friction around every sample.

    Set-valued friction of level 1 in a semi-implicit step: what would carry the speed through zero stops it there.
    """
    h = period / substeps
    share[: torque.size] = 0.0
    for n in range(torque.size - 1):
        for m in range(substeps):
            x = (m + 0.5) / substeps
            free = speed + h / J * ((1.0 - x) * torque[n] + x * torque[n + 1] + missing)
            friction = min(1.0, max(-1.0, free * J / h))
            speed = free - h / J * friction
            share[n + (1 if x > 0.5 else 0)] += friction / substeps
    return speed

"""What one control period makes of a linear drive: the held voltage rests in the stator while the rotor turns."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

__all__ = ["held_period"]

Array = NDArray[np.float64]

# Taylor's series of a matrix whose norm is at most SMALL ends within rounding; HALVED so often a larger one is as well.
SMALL, ORDER, HALVED = 0.5, 14, 4


def held_period(A: Array, B: Array, turning: float, period: float) -> tuple[Array, Array]:
    """Return the map of a control period under a voltage that turns back at a rate.

    Seen from the rotor the held voltage turns back at the electrical speed, from half a period ahead, to which the
    controller turns it. Further inputs are held as they are.

    Parameters
    ----------
    A, B : array, shape (parts, n, n) and (parts, n, m)
        Of the continuous drive in equal parts of the period, in which it is constant; the first two inputs are u_d and
        u_q.
    turning : float
        Rate at which the voltage turns back, rad/s (electrical).
    period : float
        s.

    Returns
    -------
    carried, driven : array, shape (n, n) and (n, m)
        The states after a period are ``carried @ states + driven @ inputs``.
    """
    parts, n, m = B.shape
    back, ahead, half = np.zeros((m, m)), np.eye(m), 0.5 * turning * period
    back[0, 1], back[1, 0] = turning, -turning
    ahead[:2, :2] = [[math.cos(half), -math.sin(half)], [math.sin(half), math.cos(half)]]
    rates = np.zeros((parts, n + m, n + m))
    rates[:, :n, :n], rates[:, :n, n:], rates[:, n:, n:] = A, B, back
    found = np.eye(n + m)
    for part in _exponentials(rates * (period / parts)):
        found = part @ found
    return found[:n, :n], found[:n, n:] @ ahead


def _exponentials(matrices: Array) -> Array:
    """Return the exponential of each matrix, shape (parts, k, k): all at once where they are small."""
    norm = float(np.abs(matrices).sum(axis=1).max())
    halvings = math.ceil(math.log2(norm / SMALL)) if norm > SMALL else 0
    if halvings > HALVED:
        return np.array([expm(one) for one in matrices])
    one, small = np.eye(matrices.shape[-1]), matrices / 2.0**halvings
    found = one + small / ORDER
    for k in range(ORDER - 1, 0, -1):
        found = one + (small @ found) / k
    for _ in range(halvings):
        found = found @ found
    return found

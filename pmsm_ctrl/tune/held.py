"""What one control period makes of a linear drive: the held voltage rests in the stator while the rotor turns."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

__all__ = ["held_period"]

Array = NDArray[np.float64]


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
    found = np.eye(n + m)
    for a, b in zip(A, B, strict=True):
        found = expm(np.block([[a, b], [np.zeros((m, n)), back]]) * (period / parts)) @ found
    return found[:n, :n], found[:n, n:] @ ahead

"""A Kalman filter of two masses whose equation has kinks: mean and covariance are carried through it by points.

Five quantities are uncertain, the four states (position and speed of shaft and load) and the torque until the next
sample, so there are two points for each and one at the mean.

Source: S. J. Julier, J. K. Uhlmann, Proc. IEEE 92 (2004) 401; without a centre: I. Arasaratnam, S. Haykin, IEEE Trans.
Automatic Control 54 (2009) 1254.
"""

from __future__ import annotations

from math import sqrt

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.kernels import kernel

__all__ = ["POINTS", "corrected", "gathered"]

Array = NDArray[np.float64]

STATES, POINTS = 4, 11
UNCERTAIN = 5.0  # quantities: the points lie this many variances from the mean
SMALLEST = 1e-18  # variance


@kernel
def corrected(
    x: Array, P: Array, measured: float, noise: float, torque_noise: float, work: Array, points: Array
) -> float:
    """Correct mean and covariance by a measured position of the shaft, and lay the points around them.

    Parameters
    ----------
    x : array, shape (4,)
        Position and speed of the shaft, position and speed of the load. Corrected.
    P : array, shape (4, 4)
        Covariance. Corrected.
    measured, noise : float
        Position, and its variance.
    torque_noise : float
        Standard deviation of the torque until the next sample.
    work : array, shape (4, 4)
        Overwritten.
    points : array, shape (5, 11)
        Filled: the states and the error of the torque, the mean last.

    Returns
    -------
    float
        Variance of what was expected of the measurement.
    """
    variance, off = P[0, 0] + noise, measured - x[0]
    for a in range(STATES):
        work[0, a], work[1, a] = P[a, 0] / variance, P[a, 0]
    for a in range(STATES):
        x[a] += work[0, a] * off
    for a in range(STATES):
        for b in range(STATES):
            P[a, b] -= work[0, a] * work[1, b]
    for a in range(STATES):  # Cholesky
        for b in range(a + 1):
            left = P[a, b]
            for c in range(b):
                left -= work[a, c] * work[b, c]
            work[a, b] = sqrt(max(left, SMALLEST)) if a == b else left / work[b, b]
    far = sqrt(UNCERTAIN)
    for m in range(POINTS):
        for a in range(STATES):
            points[a, m] = x[a]
        points[STATES, m] = 0.0
    for b in range(STATES):
        for a in range(b, STATES):
            points[a, 2 * b] += far * work[a, b]
            points[a, 2 * b + 1] -= far * work[a, b]
    points[STATES, 2 * STATES], points[STATES, 2 * STATES + 1] = far * torque_noise, -far * torque_noise
    return float(variance)


@kernel
def gathered(points: Array, load_noise: float, kept: float, x: Array, P: Array) -> None:
    """Set mean and covariance to those of the points.

    Parameters
    ----------
    points : array, shape (5, 11)
        Carried to the next sample.
    load_noise : float
        Variance that the load's speed gains.
    kept : float
        Share of the covariance that is kept: 1, or 0 for one known course.
    x : array, shape (4,)
        Filled.
    P : array, shape (4, 4)
        Filled.
    """
    for a in range(STATES):
        total = 0.0
        for m in range(POINTS - 1):
            total += points[a, m]
        x[a] = total / (POINTS - 1)
    for a in range(STATES):
        for b in range(a + 1):
            total = 0.0
            for m in range(POINTS - 1):
                total += (points[a, m] - x[a]) * (points[b, m] - x[b])
            P[a, b] = P[b, a] = kept * total / (POINTS - 1)
    P[3, 3] += load_noise

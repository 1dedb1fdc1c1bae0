"""Angles that wrap: by their own period, whatever it is."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

__all__ = ["unwrapped", "wrap_period"]

Array = NDArray[np.float64]

SAME = 0.02  # relative scatter of the heights of wraps
NEAR = 2e-3  # of a known period


def wrap_period(theta: Array, pole_pairs: float | None = None) -> float:
    """Return the period at which an angle wraps, 0 where it does not.

    An angle that wraps stays within one period and jumps by nearly all of it, always by the same height. The height
    is that of the jump less the motion of the samples beside it; a period near a turn, near a turn over the pole
    pairs, or near a whole number is taken for that.

    Parameters
    ----------
    theta : array, shape (n,)
    pole_pairs : float, optional
    """
    step = np.diff(theta)
    span = float(np.ptp(theta))
    if step.size < 8 or not span > 0.0:
        return 0.0
    at = np.flatnonzero(np.abs(step) > 0.7 * span)
    at = at[(at > 0) & (at < step.size - 1)]
    if at.size == 0 or at.size > 0.2 * step.size:
        return 0.0
    beside = 0.5 * (step[at - 1] + step[at + 1])
    clear = np.abs(beside) < 0.3 * span
    heights = np.abs(step[at] - beside)[clear]
    if heights.size < max(1, 0.5 * at.size):
        return 0.0
    period = float(np.median(heights))
    # a single jump may be a reset; that the angle fills the whole period shows that it wraps
    scatter = float(np.median(np.abs(heights - period)))
    if scatter > SAME * period or span > 1.001 * period or span < 0.97 * period:
        return 0.0
    known = [2.0 * math.pi, 360.0, 1.0, *([2.0 * math.pi / pole_pairs] if pole_pairs else [])]
    whole = float(round(period))
    return next((k for k in (*known, whole) if k > 0.0 and abs(period / k - 1.0) < NEAR), period)


def unwrapped(theta: Array, period: float) -> Array:
    """Return the angle without its wraps, shape (n,)."""
    return np.asarray(np.unwrap(theta, period=period))

"""A logged reference at any time: what it was between two samples.

A reference is either held until the next sample, as from a controller that renews it once per sample, or it runs
smoothly between jumps and corners, as from a profile that is evaluated more often than it is logged.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

__all__ = ["held", "running"]

Array = NDArray[np.float64]

JUMP = 5.0  # steps of a reference above this multiple of their neighbours are jumps
STRAIGHT = 1e-6  # relative difference of two steps below which they are one straight line


def held(at: Array, t: Array, values: Array) -> Array:
    """Return a reference that is held until the next sample.

    Parameters
    ----------
    at : array, shape (m,)
        Times, s.
    t, values : array, shape (n,)
        Times, s, and the samples.

    Returns
    -------
    array, shape (m,)
    """
    k = np.searchsorted(t, at + 1e-6 * (t[1] - t[0]), side="right") - 1
    found: Array = values[np.clip(k, 0, len(values) - 1)]
    return found


def running(at: Array, t: Array, values: Array) -> Array:
    """Return a reference that runs on between its samples: a cubic spline between its jumps and corners.

    A reference that jumps is new at the sample that shows it first. A corner between two samples lies where the
    straight pieces on either side meet. Straight pieces stay straight.

    Parameters
    ----------
    at : array, shape (m,)
        Times, s.
    t, values : array, shape (n,)
        Times, s, and the samples.

    Returns
    -------
    array, shape (m,)
    """
    times, knots, breaks = _knots(t, values)
    out = np.interp(at, times, knots)
    bounds = np.concatenate([[0], np.flatnonzero(breaks), [len(times) - 1]])
    for first, last in pairwise(bounds.tolist()):
        if last - first < 4:
            continue
        x, y = times[first : last + 1], knots[first : last + 1]
        steps = np.diff(y) / np.diff(x)
        if np.ptp(steps) <= STRAIGHT * float(np.max(np.abs(steps))):
            continue
        inside = (at >= x[0]) & (at < x[-1])
        if inside.any():
            from scipy.interpolate import CubicSpline

            out[inside] = CubicSpline(x, y)(at[inside])
    return out


def _knots(t: Array, values: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return times and values at which a reference is known, and whether its slope breaks there."""
    step = np.diff(values)
    size = np.abs(step)
    around = np.maximum(np.concatenate([[0.0], size[:-1]]), np.concatenate([size[1:], [0.0]]))
    jumps = np.flatnonzero(size > np.maximum(JUMP * around, 1e-9 * (float(np.ptp(values)) or 1.0)))
    slope = step / np.diff(t)
    when, what = _corners(t, values, slope)
    times = np.concatenate([t, t[jumps + 1] - 1e-6 * (t[1] - t[0]), when])
    known = np.concatenate([values, values[jumps], what])
    breaks = np.zeros(len(times), dtype=bool)
    breaks[len(t) :] = True
    breaks[jumps + 1] = True
    breaks[_edges(slope)] = True
    order = np.argsort(times, kind="stable")
    return times[order], known[order], breaks[order]


def _corners(t: Array, values: Array, slope: Array) -> tuple[Array, Array]:
    """Return the times inside steps at which two straight pieces meet, and the values there."""
    if len(slope) < 5:
        return np.zeros(0), np.zeros(0)
    k = np.arange(2, len(slope) - 2)
    same = STRAIGHT * float(np.max(np.abs(slope))) + 1e-300
    before, after = slope[k - 1], slope[k + 1]
    straight = (np.abs(before - slope[k - 2]) < same) & (np.abs(after - slope[k + 2]) < same)
    bent = (np.abs(slope[k] - before) > same) & (np.abs(slope[k] - after) > same) & (np.abs(before - after) > same)
    k = k[straight & bent]
    before, after, T = slope[k - 1], slope[k + 1], t[k + 1] - t[k]
    into = T * (slope[k] - after) / (before - after)
    inside = (into > 0.0) & (into < T)
    return (t[k] + into)[inside], (values[k] + into * before)[inside]


def _edges(slope: Array) -> NDArray[np.intp]:
    """Return the samples at which two straight pieces meet."""
    if len(slope) < 4:
        return np.zeros(0, dtype=np.intp)
    k = np.arange(2, len(slope) - 1)  # sample k lies between the steps k - 1 and k
    same = STRAIGHT * float(np.max(np.abs(slope))) + 1e-300
    straight = (np.abs(slope[k - 1] - slope[k - 2]) < same) & (np.abs(slope[k] - slope[k + 1]) < same)
    return k[straight & (np.abs(slope[k] - slope[k - 1]) > same)]

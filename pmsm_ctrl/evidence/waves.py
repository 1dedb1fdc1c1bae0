"""Waves of a signal over time, or over the position of a linear axis."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["FINER", "PASSED", "PERIODS", "highest_over_position", "spectrum_over", "strongest_periods", "tops"]

Array = NDArray[np.float64]

PERIODS = 4  # fewest of a wave
FINER = 4  # waves that are looked at, per wave that the log can tell apart
BINS = 8  # per period of the shortest wave
PASSED = 0.8  # of the cutoff: a low-pass leaves a wave below it


def spectrum_over(values: Array, place: Array, extent: float, highest: float) -> Array:
    """Return the power of `FINER` waves per wave that the log can tell apart, up to `highest` waves per unit.

    Parameters
    ----------
    values : array, shape (m,)
    place : array, shape (m,)
        Time, s, or position, m, of each; from zero on.
    extent : float
        Of the place.
    highest : float
        Waves per s (m).
    """
    bins = math.ceil(BINS * highest * extent)
    sums = np.bincount(np.minimum((place * (bins / extent)).astype(np.int64), bins - 1), values, bins)
    power: Array = np.abs(np.fft.rfft(sums, FINER * bins))[: math.floor(highest * extent * FINER) + 1] ** 2
    return power


def highest_over_position(theta: Array, omega: Array, cutoff: float) -> float:
    """Return the waves per m that pass a low-pass in half of the motion: no others can be most of what is left.

    No more than half as many as there are samples: an axis that creeps, and jumps far once, passes no others.

    Parameters
    ----------
    theta : array, shape (m,)
        Position where the axis moves, m.
    omega : array, shape (m,)
        Speed where the axis moves, m/s.
    cutoff : float
        Hz.
    """
    if not len(theta):
        return 0.0
    passed = PASSED * cutoff / max(float(np.median(np.abs(omega))), 1e-12)
    return min(passed, 0.5 * len(theta) / max(float(np.ptp(theta)), 1e-12))


def tops(power: Array, peaks: NDArray[np.int64]) -> Array:
    """Return the places of peaks between the samples of a spectrum, by a parabola through three of them.

    Parameters
    ----------
    power : array, shape (n,)
    peaks : int array, shape (k,)
        Each at least as high as its neighbours; the ends of the spectrum stay where they are.
    """
    inner = np.clip(peaks, 1, max(len(power) - 2, 1))
    left, middle, right = power[inner - 1], power[inner], power[inner + 1]
    bent = left - 2.0 * middle + right
    off = np.divide(0.5 * (left - right), bent, out=np.zeros(len(inner)), where=bent < 0.0)
    return np.asarray(peaks + np.where(inner == peaks, off, 0.0), dtype=np.float64)


def strongest_periods(parts: Sequence[tuple[Array, Array]], highest: float, number: int) -> tuple[Array, int]:
    """Return the periods of the strongest waves over a position, strongest first, and how many waves there can be.

    Parameters
    ----------
    parts : sequence of (array, array)
        Values of the samples that count, weighted, and the position of each, m: of every part of a log in which a wave
        may have a phase of its own.
    highest : float
        Waves per m.
    number : int
        Of periods at most.

    Returns
    -------
    (array, int)
        m; none where fewer than `PERIODS` waves lie within the extent.
    """
    extent = max((float(np.ptp(place)) for _, place in parts if place.size), default=0.0)
    if extent <= 0.0 or highest * extent <= PERIODS:
        return np.zeros(0), 0
    powers = [spectrum_over(values, place - place.min(), extent, highest) for values, place in parts if place.size]
    power = np.sum(powers, axis=0)
    inner = power[1:-1]
    peaks = 1 + np.flatnonzero((inner >= power[:-2]) & (inner > power[2:]))
    peaks = peaks[peaks >= PERIODS * FINER]
    best = peaks[np.argsort(power[peaks])[::-1][:number]]
    return FINER * extent / tops(power, best), max(int(highest * extent) - PERIODS, 1)

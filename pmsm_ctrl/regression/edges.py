"""Edges of the drive signal: how far the torque of a log may be off around those that its samples do not resolve."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.log import Span
from pmsm_ctrl.regression.conditioning import Prepared
from pmsm_ctrl.regression.filters import low_pass

__all__ = ["MAD", "UPPER", "WRONG_TORQUE", "by_variance", "edge_error", "highest", "steep"]

Array = NDArray[np.float64]

MAD = 1.4826  # standard deviation of normal noise over the median of its magnitude
# A channel's own noise is what it holds above this share of its rate: no motion reaches there.
UPPER = 0.25
# Samples that are filtered at once, and those beside them: the filter has forgotten all others to the last digit.
PART, BESIDE = 1 << 18, 1 << 9
# Height of the highest of a few hundred samples of noise, in its standard deviation.
NOISE_PEAK = 4.5
# Periods of the cutoff on either side of an edge in which it rings at full height.
EDGE_PERIODS = 3.0
# What the steep filter still rings of an edge so many periods of its cutoff further away: 8th order, run twice.
RINGING = ((1.0, 0.035), (3.0, 0.023), (5.0, 0.009), (9.0, 0.004), (13.0, 0.0007))
# Share of the torque's scatter below which its errors need no care, as long as nobody knows how well a model fits.
WRONG_TORQUE = 0.02


def by_variance(error: Array) -> Array:
    """Return the weight of samples by their error, which adds to the noise.

    Parameters
    ----------
    error : array, shape (m,)
        In units of the noise.
    """
    return np.asarray(1.0 / np.sqrt(1.0 + error**2))


HUGE = 1e75  # beside no noise at all, as of an axis that rests, an error has no bound, and its fourth power overflows


def steep(error: Array) -> Array:
    """Return the weight of samples of which those in doubt are to count next to nothing.

    Parameters
    ----------
    error : array, shape (m,)
        In units of the noise.
    """
    return np.asarray(1.0 / (1.0 + np.minimum(error, HUGE) ** 2) ** 2)


def edge_error(
    raw: Array, prepared: Prepared, records: Sequence[Span] = (), least: float = WRONG_TORQUE
) -> Array:  # fmt: skip
    """Return by how much edges may falsify each thinned sample, in units of its noise, shape (m,).

    An edge that is faster than the sampling is logged up to one period too early or too late, always the same way
    where the drive and the log share a clock. Its error in the filtered balance, against the noise there, is about
    the height of the edge over the noise times the root of what the filter lets through, for so many periods of the
    filter's cutoff on either side as it rings. Edges are what the signal holds above a quarter of the rate.

    Parameters
    ----------
    raw : array, shape (n * times,)
        At a whole number of times the rate of the uniform grid: a fast log was thinned by a filter, which folds
        nothing, and the edges that it does not resolve lie above its own rate.
    prepared : Prepared
    records : sequence of Span
        Each has a noise of its own.
    least : float
        Share of the signal's scatter that counts as noise in any case.
    """
    times = len(raw) // len(prepared.t)
    rate, fast_rate = prepared.rate, times * prepared.rate
    # the filters mirror a log in its last value: an edge there is a step of twice its height
    beyond = min(len(prepared.t) - 1, round((EDGE_PERIODS + RINGING[-1][0]) * rate / prepared.cutoff))
    inside = slice(beyond, beyond + len(prepared.t))
    beside = np.pad(raw, times * beyond, mode="reflect", reflect_type="odd")
    _keep_edges(beside, fast_rate)
    pieces = [slice(*np.searchsorted(prepared.t, [one.start, one.stop])) for one in records] or [slice(None)]
    level = np.zeros(len(prepared.t))
    for piece in pieces:
        part = slice(times * (piece.start or 0), None if piece.stop is None else times * piece.stop)
        own = MAD * float(np.median(beside[times * beyond :][: len(raw)][part]))
        level[piece] = np.hypot(own, least * np.sqrt(times) * np.std(raw[part]))
    level[level == 0.0] = float(np.min(level[level > 0.0], initial=np.inf))
    if not np.isfinite(level).all():
        return np.zeros(len(prepared.keep))
    noise = level[prepared.keep]
    fast = _highest_of_each(beside, times) if times > 1 else beside
    del beside

    def peaks_within(periods: float) -> Array:
        return highest(fast, 2 * round(periods * rate / prepared.cutoff) + 1)[inside][prepared.keep] / noise

    peaks = peaks_within(EDGE_PERIODS)
    # where every stretch has such peaks they are the drive's ripple, not single edges
    usual = np.full(len(peaks), NOISE_PEAK)
    for piece in pieces:
        here = slice(*np.searchsorted(prepared.keep, [piece.start or 0, piece.stop or len(prepared.t)]))
        usual[here] = max(NOISE_PEAK, float(np.median(peaks[here])) if here.stop > here.start else 0.0)
    edge = np.maximum(peaks - usual, 0.0)
    for further, left in RINGING:
        edge = np.maximum(edge, left * (peaks_within(EDGE_PERIODS + further) - usual))
    passed = np.sqrt(2.0 * prepared.cutoff / fast_rate)
    return np.asarray(passed * edge)


def _keep_edges(values: Array, rate: float) -> None:
    """Leave the size of what a signal holds above a quarter of its rate, Hz, in its place: a fast log is large."""
    before = values[:0]
    for start in range(0, len(values), PART):
        stop = min(start + PART, len(values))
        slow = low_pass(np.concatenate([before, values[start : stop + BESIDE]]), rate, UPPER * rate)
        slow = slow[len(before) : len(before) + stop - start]
        before = values[max(start, stop - BESIDE) : stop].copy()
        np.abs(np.subtract(values[start:stop], slow, out=slow), out=values[start:stop])


def _highest_of_each(values: Array, times: int) -> Array:
    """Return the highest value around every so many samples, as far as to those halfway to the next one."""
    reach, out = times + 1 - times % 2, np.empty(-(-len(values) // times))
    for start in range(0, len(values), times * PART):
        first, stop = max(0, start - times), min(start + times * PART, len(values))
        around = highest(values[first : stop + times], reach)[start - first : stop - first : times]
        out[start // times : start // times + len(around)] = around
    return out


def highest(values: Array, reach: int) -> Array:
    """Return the highest value within a window around each sample.

    Parameters
    ----------
    values : array, shape (n,)
    reach : int
        Samples of the window.
    """
    from scipy.ndimage import maximum_filter1d

    return maximum_filter1d(values, reach)

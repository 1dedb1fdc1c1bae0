"""Properties of time stamps and values: rate, jitter, gaps, quantisation, saturation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pmsm_ctrl.importers.table import Array

__all__ = ["TimeBase", "growing_steps", "longest_run", "quantum", "saturated_share", "time_base"]

SAMPLE = 200_000  # values used to find the quantisation


@dataclass(frozen=True)
class TimeBase:
    """Regularity of time stamps.

    Attributes
    ----------
    period : float
        Median, s.
    jitter_rms, jitter_max : float
        Deviation of a step from the period, gaps left out, s.
    gaps : int
        Steps above 1.9 periods.
    longest_gap, longest_gap_at : float
        Its length and begin, s.
    """

    period: float
    jitter_rms: float
    jitter_max: float
    gaps: int
    longest_gap: float
    longest_gap_at: float

    @property
    def irregular(self) -> bool:
        """Whether small delays cannot be estimated: gaps, or jitter above 20 % of the period."""
        return self.gaps > 0 or self.jitter_max > 0.2 * self.period


def time_base(t: Array) -> TimeBase:
    """Describe time stamps `t` in s, shape (n,); with fewer than two samples everything is NaN."""
    if t.size < 2:
        return TimeBase(np.nan, np.nan, np.nan, 0, np.nan, np.nan)
    step = np.diff(t)
    period = float(np.median(step))
    gap = step > 1.9 * period
    deviation = step - period
    if gap.any():
        deviation = deviation[~gap]
    widest = int(np.argmax(step))
    return TimeBase(
        period=period,
        jitter_rms=_rms(deviation),
        jitter_max=float(np.max(np.abs(deviation))),
        gaps=int(np.count_nonzero(gap)),
        longest_gap=float(step[widest]) if gap.any() else 0.0,
        longest_gap_at=float(t[widest]) if gap.any() else np.nan,
    )


def _rms(values: Array) -> float:
    """Root mean square, of numbers whose squares a double cannot hold as well."""
    largest = float(np.max(np.abs(values)))
    return largest * float(np.sqrt(np.mean((values / largest) ** 2))) if largest > 0.0 else 0.0


def quantum(values: Array) -> float:
    """Return the step of which all differences are multiples, 0 where there is none, NaN for a constant.

    Looks at the first `SAMPLE` values. Rounding in the text of a file is a quantum as well.
    """
    levels = np.unique(values[:SAMPLE])
    if levels.size < 2:
        return float("nan")
    span = float(levels[-1] - levels[0])
    steps = np.diff(levels)
    steps = steps[steps > 1e-9 * max(span, float(np.max(np.abs(levels))) * 1e-3)]
    if steps.size == 0 or not np.isfinite(span):
        return float("nan")
    smallest = float(steps.min())
    # the mean over the steps that are one quantum long removes the rounding of a single difference
    single = steps[steps < 1.5 * smallest]
    step = float(single.mean())
    # only small multiples count: the rounding error of `step` grows with the multiple
    multiples = steps[steps < 20.5 * step] / step
    if multiples.size < min(8, steps.size) or not step > 1e-7 * span:
        return 0.0
    fits = np.abs(multiples - np.round(multiples)) < 0.05
    return step if fits.mean() > 0.98 else 0.0


def growing_steps(values: Array) -> float:
    """Return the coarsest step of a channel written with few significant digits, 0 where its resolution is uniform.

    `csvwrite` keeps five digits: 0.01 rad from the 16th turn on, and a thousandth of that near zero. At constant speed
    the samples themselves are evenly spaced; a grid holds from one end of the range to the other, they do not.
    """
    size = np.abs(values)
    top = float(size.max(initial=0.0))
    coarse = _grid(values[size > 0.9 * top])
    near_zero = np.unique(values[size < 0.09 * top][:SAMPLE])
    if not coarse > 0.0 or near_zero.size < 100 or _off_grid(near_zero - near_zero[0], coarse) <= 0.2:
        return 0.0
    # a tenth of the size has a tenth of the step, or an eighth in binary: no other finer grid comes from digits
    small = np.unique(values[(size < 0.09 * top) & (size > 0.01 * top)][:SAMPLE])
    finer = [_off_grid(small - small[0], coarse / part) for part in (100.0, 128.0)] if small.size else [1.0]
    return coarse if min(finer) < 0.02 else 0.0


def _grid(values: Array) -> float:
    """Return the step of a grid that all values lie on, 0 where there is none: its estimate sharpens with distance."""
    levels = np.unique(values[:SAMPLE])
    step = quantum(levels)
    if not step > 0.0 or levels.size < 20:
        return 0.0
    distance = levels - levels[0]
    reach = 10.0 * step
    while True:
        near = distance[distance <= reach]
        counts = np.round(near / step)
        if counts[-1] > 0.0:
            step = float(near @ counts) / float(counts @ counts)
        if _off_grid(near, step) > 0.02:
            return 0.0
        if reach >= distance[-1]:
            return step
        reach *= 2.0


def _off_grid(distance: Array, step: float) -> float:
    """Return the share of distances that are no multiple of a step."""
    steps = distance / step
    return float(np.mean(np.abs(steps - np.round(steps)) > 0.05))


def longest_run(mask: np.ndarray) -> int:
    """Return the length of the longest stretch of True."""
    if not mask.any():
        return 0
    edges = np.flatnonzero(np.diff(np.concatenate(([False], mask, [False])).astype(np.int8)))
    return int(np.max(edges[1::2] - edges[::2]))


def saturated_share(values: Array) -> float:
    """Return the share of samples that sit exactly at the largest magnitude, 0 unless they do so in long runs.

    A signal with few levels stays at its extreme without any limit; below 50 levels the result is 0.
    """
    if values.size < 50:
        return 0.0
    magnitude = np.abs(values)
    peak = float(magnitude.max())
    if peak == 0.0 or np.unique(values[:SAMPLE]).size < 50:
        return 0.0
    at_peak = magnitude >= peak * (1.0 - 1e-9)
    share = float(np.mean(at_peak))
    return share if longest_run(at_peak) >= 10 and share >= 0.001 else 0.0

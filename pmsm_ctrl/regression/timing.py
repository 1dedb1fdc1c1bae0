"""Time base of a log: jitter, gaps, late time stamps, edges at the ends, and angles that wrap."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.errors import LogError
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression import notices as words
from pmsm_ctrl.regression.filters import low_pass
from pmsm_ctrl.section import Notice

__all__ = [
    "between_records",
    "bridge_time",
    "end_speeds",
    "ending_steadily",
    "own_time",
    "punctual",
    "time_in_gaps",
    "uniform",
    "unwrapped",
]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# A time stamp that is off by more than this share of a period is late.
LATE = 0.5
# A step of more periods is a hole. What bridges one that is longer than the low-pass's memory is no measurement: it
# spreads as far as that remembers, in periods of the cutoff.
HOLE, AROUND_HOLES = 5.0, 5.0
LOST = 1.9  # periods between two samples from which on at least one is missing
OFF_CLOCK = 0.1  # periods by which a step of a clock whose samples are lost may differ from a multiple of its period
# Time at the end of a record from which its speed there is taken, s, and the fewest samples.
END, FEWEST_END = 0.01, 5
LONGEST_BRIDGE = 50.0  # times the usual time between two records
# A speed that changes by so many times its usual change from one sample to the next jumps.
JUMP = 12.0
# Time, s, and fewest samples at either end of a log that an edge there may take; and how far beyond the median it lies,
# in median distances from that, or thirds of the greatest.
AT_END, FEWEST_AT_END, EDGE_AT_END = 0.01, 4, 6.0


def uniform(log: Log) -> tuple[Array, dict[str, Array], Mask, tuple[Notice, ...]]:
    """Bring a log to one uniform time grid: time in s and channels of shape (n,), samples outside gaps, and notes.

    Where time stamps jitter by more than a thousandth of a period, the channels are resampled with a cubic spline. This
    is not done where the motion is smoother with the samples at equal steps: a clock took them, and only the stamps
    jitter. A hole of more than five periods is bridged and marked. Each of several records is resampled by itself.

    Raises
    ------
    LogError
        When a gap is too long to be bridged.
    """
    t, step, period = log.t, np.diff(log.t), log.period
    channels = {name: values for name, values in log.channels.items() if name != "t"}
    if float(np.max(np.abs(step - period))) <= 1e-3 * period:
        return t, dict(channels), np.ones(len(t), dtype=bool), ()
    # the mean step and not the median: a median of rounded stamps drifts away from the clock
    holes = step > HOLE * period
    if log.duration / period > 100.0 * len(log) + 1e6:
        where, widest = (f"{log.provenance.file}: " if log.provenance.file else ""), int(np.argmax(step))
        raise LogError(
            f"{where}a gap of {step[widest]:.4g} s after t = {t[widest]:.6g} s is too long to be bridged; "
            "cut the log there"
        )
    # a sample that was lost makes a step of two periods: it does not make the clock slower, and it is no jitter
    periods = np.round(step / period)
    if np.any(np.abs(step - periods * period)[~holes] > OFF_CLOCK * period):
        periods = np.ones(len(step))  # a late stamp has early ones behind it, and nothing is lost
    period = float(np.sum(step[~holes]) / np.sum(periods[~holes]))
    usual = step[step < LOST * period]
    jitter = 100.0 * float(np.max(np.abs(usual - period))) / period
    if "theta" in channels:
        channels["theta"] = unwrapped(channels["theta"])
    if not holes.any() and (even := _clocked(t, channels)) is not None:
        return even, channels, np.ones(len(t), dtype=bool), (words.EQUAL_STEPS(jitter=jitter),)
    grid = t[0] + period * np.arange(int((t[-1] - t[0]) / period * (1 + 1e-12)) + 1)
    resampled = {name: _resampled(log, name, values, grid) for name, values in channels.items()}
    good = np.ones(len(grid), dtype=bool)
    for k in np.flatnonzero(holes):
        good[(grid > t[k]) & (grid < t[k + 1])] = False
    inside = holes & ~_between(log, t)
    notes = [words.RESAMPLED(jitter=jitter, rate=1.0 / period)] if jitter > 0.1 else []
    if inside.any():
        notes.append(words.GAPS(count=int(inside.sum()), seconds=float(step[inside].sum())))
    return grid, resampled, good, tuple(notes)


def _resampled(log: Log, name: str, values: Array, grid: Array) -> Array:
    """Resample a channel with a cubic spline; from record to record it passes without a jump."""
    from scipy.interpolate import CubicHermiteSpline, CubicSpline

    t = log.t
    if not log.records:
        return np.asarray(CubicSpline(t, values)(grid))
    out = np.interp(grid, t, values)
    edges = [(int(np.searchsorted(t, one.start)), int(np.searchsorted(t, one.stop, "right"))) for one in log.records]
    for first, stop in edges:
        here = slice(*np.searchsorted(grid, [t[first] - 1e-9, t[stop - 1] + 1e-9]))
        if stop - first > 1:
            out[here] = CubicSpline(t[first:stop], values[first:stop])(grid[here])
    if name == "theta":
        for (first, stop), (following, last) in itertools.pairwise(edges):
            leaving = end_speeds(t[first:stop], values[first:stop], log.rate)[1]
            arriving = end_speeds(t[following:last], values[following:last], log.rate)[0]
            ends = [stop - 1, following]
            here = slice(*np.searchsorted(grid, [t[ends[0]] + 1e-9, t[ends[1]] - 1e-9]))
            out[here] = CubicHermiteSpline(t[ends], values[ends], [leaving, arriving])(grid[here])
    return np.asarray(out)


def _between(log: Log, t: Array) -> Mask:
    """Whether what follows a sample is the time between two records, in which nothing was missed, shape (n - 1,)."""
    middle = 0.5 * (t[1:] + t[:-1])
    out = np.zeros(len(middle), dtype=bool)
    for before, after in zip(log.records[:-1], log.records[1:], strict=True):
        out |= (middle > before.stop) & (middle < after.start)
    return out


def end_speeds(t: Array, theta: Array, rate: float) -> tuple[float, float]:
    """Return the speeds at both ends of a record, from its first and last `END` seconds.

    Parameters
    ----------
    t, theta : array, shape (n,)
    rate : float
        Of the record, Hz.
    """
    some = min(len(t), max(FEWEST_END, round(END * rate)))
    if some < 2:
        return 0.0, 0.0
    first, last = (float(np.polyfit(t[part], theta[part], 1)[0]) for part in (slice(some), slice(-some, None)))
    return first, last


def bridge_time(way: float, least: float, usual: float) -> float:
    """Return the time in which an axis gets from the end of one record to the begin of the next one, s.

    Parameters
    ----------
    way : float
        rad (m).
    least : float
        s.
    usual : float
        Speed at which the axis usually moves, rad/s (m/s).
    """
    return least if usual <= 0.0 else float(np.clip(1.5 * abs(way) / usual, least, LONGEST_BRIDGE * least))


def between_records(log: Log, t: Array, around: float) -> Mask:
    """Return the samples, shape (n,), between records, and those `around` s of either end of one.

    Parameters
    ----------
    log : Log
    t : array, shape (n,)
        Uniform time, s.
    around : float
        s.
    """
    out = np.zeros(len(t), dtype=bool)
    for before, after in zip(log.records[:-1], log.records[1:], strict=True):
        first, last = np.searchsorted(t, [before.stop - around, after.start + around])
        out[first:last] = True
    return out


def own_time(log: Log, t: Array) -> Array:
    """Return the time since the begin of each record, shape (n,); of a log that is one, since its first sample.

    Parameters
    ----------
    log : Log
    t : array, shape (n,)
        Uniform time, s.
    """
    out: Array = t - t[0]
    for one in log.records:
        first = int(np.searchsorted(t, one.start - 1e-9))
        out[first:] = t[first:] - one.start + one.begin
    return out


def _clocked(t: Array, channels: Mapping[str, Array]) -> Array | None:
    """Return the even times at which samples were taken whose stamps alone jitter; None where the samples do as well.

    A time error makes the angle of a moving shaft rough, by speed times error, so the rougher reading is the wrong one.
    """
    from scipy.interpolate import CubicSpline

    motion = next((channels[name] for name in ("theta", "omega") if name in channels), None)
    if motion is None:
        return None
    line = np.polynomial.Polynomial.fit(np.arange(len(t)), t, 1)
    even = line(np.arange(len(t)))
    if float(np.max(np.abs(t - even))) > 0.5 * (even[1] - even[0]):
        return None
    stamped = CubicSpline(t, motion)(np.clip(even, t[0], t[-1]))
    rough = [float(np.sum(np.diff(values, 3) ** 2)) for values in (motion, stamped)]
    return even if rough[0] < rough[1] else None


def unwrapped(theta: Array) -> Array:
    """Undo a wrap at one turn: jumps of nearly 2 pi within a range of one turn, and nothing else."""
    if np.ptp(theta) <= 2 * np.pi * (1 + 1e-6) and float(np.max(np.abs(np.diff(theta)))) > 1.5 * np.pi:
        return np.unwrap(theta)
    return theta


def punctual(log: Log, t: Array, cutoff: float, jumps: bool = True) -> Mask:
    """Return samples, shape (n,), away from time stamps that are off by more than half a period.

    Such a stamp, or the count that went with it, makes the speed jump: where there are any, samples around jumps of the
    speed are left out as well, unless `jumps` are dealt with elsewhere. Where that would be nearly everywhere, holes
    alone are left out. `t` is the uniform time, s; one and a half periods of the cutoff, Hz, are left out on either
    side, and `AROUND_HOLES` around holes.
    """
    apart = between_records(log, t, AROUND_HOLES / cutoff)
    late = np.flatnonzero(np.abs(np.diff(log.t) - log.period) > LATE * log.period)
    late = late[~_between(log, log.t)[late]]
    if len(late) == 0:
        return ~apart
    reach, hole = 1.5 / cutoff, AROUND_HOLES / cutoff
    wide = np.diff(log.t)[late] > 1.0 / cutoff
    around = np.where(wide, hole, reach)
    spans = list(zip(log.t[late] - around, log.t[late + 1] + around, strict=True))
    bridged = _outside(t, [span for span, hole in zip(spans, wide.tolist(), strict=True) if hole])
    if jumps and "theta" in log:
        rate = (len(t) - 1) / float(t[-1] - t[0])
        speed = np.gradient(np.interp(t, log.t, np.unwrap(log["theta"])))
        fast = np.abs(speed - low_pass(speed, rate, 0.25 * rate))
        jumping = np.flatnonzero(fast > JUMP * max(float(np.median(fast)), 1e-300))
        spans += [(t[k] - reach, t[k] + reach) for k in jumping]
    good = _outside(t, spans)
    return (good if good.mean() > 0.4 else bridged) & ~apart


def _outside(t: Array, spans: Sequence[tuple[float, float]]) -> Mask:
    """Return which times lie in none of the spans, s."""
    good = np.ones(len(t), dtype=bool)
    for first, last in spans:
        good[slice(*np.searchsorted(t, (first, last)))] = False
    return good


def time_in_gaps(log: Log) -> float:
    """Return the time without samples, s.

    Parameters
    ----------
    log : Log
    """
    step = np.diff(log.t)
    return float(np.sum(step[step > 1.5 * log.period] - log.period))


def ending_steadily(log: Log) -> Log:
    """Return a log without the edge in the drive signal at which it begins or ends, where there is one.

    The filters mirror a log in its last value: an edge there would be a step of twice its height, which no weight can
    remove. The log of a drive that is switched off, or trips, ends like that.
    """
    source = next((name for name in ("torque", "i_q") if name in log), None)
    if source is None or log.records:
        return log
    values = log[source]
    count = max(FEWEST_AT_END, round(AT_END * log.rate))
    if len(values) < 8 * count:
        return log
    first, last = _steady(values[: 4 * count], count), len(values) - _steady(values[: -4 * count - 1 : -1], count)
    if last - first == len(values):
        return log
    channels = {name: part[first:last] for name, part in log.channels.items()}
    return replace(log, channels=channels, segments=())


def _steady(values: Array, count: int) -> int:
    """Return how many samples at the beginning, at most `count`, belong to an edge.

    The rest of the values tells what is usual; the sample after an edge is the first that is.
    """
    usual = float(np.median(values[count:]))
    scatter = np.abs(values[count:] - usual)
    far = np.abs(values[:count] - usual) > EDGE_AT_END * max(float(np.median(scatter)), float(scatter.max()) / 3.0)
    return int(np.flatnonzero(far)[-1]) + 1 if far[0] else 0

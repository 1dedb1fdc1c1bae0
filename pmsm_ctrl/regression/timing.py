"""When the samples of a log were taken, and how surely: jitter, gaps, late time stamps, angles that wrap."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.errors import LogError
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression import notices as words
from pmsm_ctrl.regression.filters import low_pass
from pmsm_ctrl.section import Notice

__all__ = ["punctual", "uniform", "unwrapped"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# A time stamp that is off by more than this share of a period is late.
LATE = 0.5
# A step of more periods is a hole. What bridges one that is longer than the low-pass's memory is no measurement: it
# spreads as far as that remembers, in periods of the cutoff.
HOLE, AROUND_HOLES = 5.0, 5.0
# A speed that changes by so many times its usual change from one sample to the next jumps.
JUMP = 12.0


def uniform(log: Log) -> tuple[Array, dict[str, Array], Mask, tuple[Notice, ...]]:
    """Bring a log to one uniform time grid: time in s and channels of shape (n,), samples outside gaps, and notes.

    Where time stamps jitter by more than a thousandth of a period, the channels are resampled with a cubic spline,
    unless the motion is smoother with the samples taken at equal steps: then a clock took them, and only the stamps
    are late. A hole of more than five periods is bridged and marked.

    Raises
    ------
    LogError
        When a gap is too long to be bridged.
    """
    t, step, period = log.t, np.diff(log.t), log.period
    channels = {name: values for name, values in log.channels.items() if name != "t"}
    if float(np.max(np.abs(step - period))) <= 1e-3 * period:
        return t, dict(channels), np.ones(len(t), dtype=bool), ()
    from scipy.interpolate import CubicSpline

    # the mean step and not the median: a median of rounded stamps drifts away from the clock
    holes = step > HOLE * period
    if log.duration / period > 100.0 * len(log) + 1e6:
        where, widest = (f"{log.provenance.file}: " if log.provenance.file else ""), int(np.argmax(step))
        raise LogError(
            f"{where}a gap of {step[widest]:.4g} s after t = {t[widest]:.6g} s is too long to be bridged; "
            "cut the log there"
        )
    period = float(np.mean(step[~holes]))
    jitter = 100.0 * float(np.max(np.abs(step[~holes] - period))) / period
    if "theta" in channels:
        channels["theta"] = unwrapped(channels["theta"])
    if not holes.any() and (even := _clocked(t, channels)) is not None:
        return even, channels, np.ones(len(t), dtype=bool), (words.EQUAL_STEPS(jitter=jitter),)
    grid = t[0] + period * np.arange(int((t[-1] - t[0]) / period * (1 + 1e-12)) + 1)
    resampled = {name: CubicSpline(t, values)(grid) for name, values in channels.items()}
    good = np.ones(len(grid), dtype=bool)
    for k in np.flatnonzero(holes):
        good[(grid > t[k]) & (grid < t[k + 1])] = False
    notes = [words.RESAMPLED(jitter=jitter, rate=1.0 / period)]
    if holes.any():
        notes.append(words.GAPS(count=int(holes.sum()), seconds=float(step[holes].sum())))
    return grid, resampled, good, tuple(notes)


def _clocked(t: Array, channels: Mapping[str, Array]) -> Array | None:
    """Return the even times at which samples were taken whose stamps alone jitter; None where the samples do as well.

    A wrong time makes a moving shaft's angle rough, by speed times error: the rougher of the two readings is wrong.
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
    speed are left out as well, unless `jumps` are dealt with elsewhere. Where that would be nearly everywhere, nothing
    is left out. `t` is the uniform time, s; one and a half periods of the cutoff, Hz, are left out on either side, and
    `AROUND_HOLES` around holes.
    """
    good = np.ones(len(t), dtype=bool)
    late = np.flatnonzero(np.abs(np.diff(log.t) - log.period) > LATE * log.period)
    if len(late) == 0:
        return good
    reach, hole = 1.5 / cutoff, AROUND_HOLES / cutoff
    wide = np.diff(log.t)[late] > 1.0 / cutoff
    around = np.where(wide, hole, reach)
    spans = list(zip(log.t[late] - around, log.t[late + 1] + around, strict=True))
    if jumps and "theta" in log:
        rate = (len(t) - 1) / float(t[-1] - t[0])
        speed = np.gradient(np.interp(t, log.t, np.unwrap(log["theta"])))
        fast = np.abs(speed - low_pass(speed, rate, 0.25 * rate))
        jumping = np.flatnonzero(fast > JUMP * max(float(np.median(fast)), 1e-300))
        spans += [(t[k] - reach, t[k] + reach) for k in jumping]
    for first, last in np.searchsorted(t, np.array(spans)):
        good[first:last] = False
    return good if good.mean() > 0.4 else np.ones_like(good)

"""The delay between two channels that measure the same quantity."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pmsm_ctrl.importers.table import Array
from pmsm_ctrl.importers.timebase import time_base
from pmsm_ctrl.log import Log

__all__ = ["Delay", "delays", "lag"]

SAMPLES = 1 << 17
MAX_LAG = 200
REFINED = 5  # times at most
SMOOTHED = 9  # samples; both signals alike, which changes no delay


@dataclass(frozen=True)
class Delay:
    """`later` follows `earlier` by `seconds`; negative when it leads. `correlation` is that after alignment."""

    later: str
    earlier: str
    seconds: float
    correlation: float


def delays(log: Log) -> tuple[Delay, ...]:
    """Estimate the delays of omega behind dtheta/dt and of torque behind i_q.

    The first holds the filter of the speed signal as well. Empty where a channel is missing, the log has gaps, or the
    two are not correlated. Of irregular time stamps only a delay beyond their jitter is told.
    """
    out = []
    base = time_base(log.t)
    if len(log) < 64 or base.gaps:
        return ()
    least = base.jitter_max if base.irregular else 0.0
    pairs = (("omega", "dtheta/dt", "theta", "omega"), ("torque", "i_q", "i_q", "torque"))
    with np.errstate(all="ignore"):
        for later, earlier, first, second in pairs:
            if first not in log or second not in log:
                continue
            a, b = (_evenly(log.t, log[name]) if base.irregular else log[name] for name in (first, second))
            found = lag(np.gradient(a, base.period) if first == "theta" else a, b)
            if found is not None and abs(found[0]) * base.period > least:
                out.append(Delay(later, earlier, found[0] * base.period, found[1]))
    return tuple(out)


def _evenly(t: Array, values: Array) -> Array:
    """Return as many values at equal steps of time."""
    return np.interp(np.linspace(t[0], t[-1], t.size), t, values)


def lag(first: Array, second: Array) -> tuple[float, float] | None:
    """Return (samples by which `second` follows `first`, correlation), None when they are not correlated.

    Whole samples come from the largest cross-correlation, the fraction d from the first-order expansion
    ``second(t) = g first(t) - g d first'(t)`` (Taylor): multiplied by the slope of the first signal and averaged, with
    the product of both slopes in place of ``g first'^2``. The noise of either signal has no share in that product;
    least squares would make d smaller by the noise of the first.
    """
    start = max(0, (first.size - SAMPLES) // 2)
    a, b = (x[start : start + SAMPLES] - np.mean(x[start : start + SAMPLES]) for x in (first, second))
    scale_a, scale_b = float(np.max(np.abs(a))), float(np.max(np.abs(b)))
    if not (0.0 < scale_a < math.inf and 0.0 < scale_b < math.inf):
        return None
    a, b = a / scale_a, b / scale_b
    reach = min(MAX_LAG, a.size // 8)
    size = 1 << int(np.ceil(np.log2(a.size + reach + 1)))
    cross = np.fft.irfft(np.fft.rfft(b, size) * np.conj(np.fft.rfft(a, size)), size)
    shifts = np.concatenate((np.arange(reach + 1), np.arange(-reach, 0)))
    whole = int(shifts[np.argmax(np.abs(cross[shifts]))])
    inner = slice(reach, a.size - reach)
    fraction = _fraction(a[inner], np.roll(b, -whole)[inner])
    for _ in range(REFINED):  # the top of a slow signal's correlation is flat, and what its ends leave moves it
        if not 1.0 <= abs(fraction) < math.inf or abs(whole + round(fraction)) > reach:
            break
        whole += round(fraction)
        fraction = _fraction(a[inner], np.roll(b, -whole)[inner])
    smooth_a, smooth_b = _means(a[inner]), _means(np.roll(b, -whole)[inner])
    correlation = float(np.corrcoef(smooth_a, smooth_b)[0, 1])
    if not correlation > 0.7 or not abs(fraction) < 2.0:
        return None
    return whole + fraction, correlation


def _fraction(a: Array, b: Array) -> float:
    """Return the samples by which `b` follows `a`, less than a few."""
    x, y = (_centred(np.convolve(values, np.full(SMOOTHED, 1.0 / SMOOTHED), "valid")) for values in (a, b))
    slope_x, slope_y = np.gradient(x), np.gradient(y)
    both = float(slope_x @ slope_y)
    if not both > 0.0:
        return math.nan
    # the product of a signal and its own slope is what its ends leave, small unless they differ
    ends = float(slope_x @ x) * math.copysign(float(np.std(y)) / float(np.std(x)), both)
    return (ends - float(slope_x @ y)) / both


def _centred(values: Array) -> Array:
    return np.asarray(values - values.mean())


def _means(values: Array) -> Array:
    """Return means over a few samples, in which noise counts less."""
    width = 8 if values.size >= 256 else 1
    return np.asarray(values[: values.size // width * width].reshape(-1, width).mean(axis=1))

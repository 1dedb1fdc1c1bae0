"""A log in bins of a few milliseconds, and smooth averages of them whose derivatives are exact.

The average of an acceleration over a window made of three boxes of width h is the second difference, at lag h, of the
angle averaged over one box: no derivative is taken of noise. The torque is averaged over the same three boxes, so that
the balance holds between averages as it does between instants (modulating functions: M. Shinbrot, Transactions of the
ASME 79, 1957).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.log import Log

__all__ = ["Bins", "binned", "summed"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

BIN = 5e-3  # s; the period where that is longer


@dataclass(frozen=True, eq=False)
class Bins:
    """Means of the channels over bins of equally many samples.

    Attributes
    ----------
    t : array, shape (m,)
        Mean time, s.
    channels : mapping of str to array, shape (m,)
    width : float
        Median distance, s.
    samples : int
        Per bin.
    motions : dict
        Those that were worked out: several relations read them.
    """

    t: Array
    channels: Mapping[str, Array]
    width: float
    samples: int
    motions: dict[int, tuple[Array, Array]] = field(default_factory=dict, init=False, repr=False)

    def means(self, values: Array) -> Array:
        """Return the means over the bins, shape (m,), of what has as many samples as their log."""
        return np.asarray(values[: len(self.t) * self.samples].reshape(-1, self.samples).mean(axis=1))

    def smooth(self, values: Array, boxes: int) -> Array:
        """Return values averaged over three boxes of so many bins, shape (m,); NaN at the ends and across gaps."""
        return self._marked(summed(summed(summed(values, boxes), boxes), boxes) / boxes**3, boxes)

    def motion(self, angle: Array, boxes: int) -> tuple[Array, Array]:
        """Return speed and acceleration over the same window, rad/s and rad/s^2, shape (m,)."""
        h = boxes * self.width
        speed = summed(summed(_risen(angle, boxes), boxes), boxes) / boxes**2 / h
        bent = _difference(_difference(summed(angle, boxes) / boxes, boxes, 0), boxes, 1) / h**2
        return self._marked(speed, boxes), self._marked(bent, boxes)

    def speed(self, omega: Array, boxes: int) -> tuple[Array, Array]:
        """Return a logged speed and its derivative over the same window, shape (m,)."""
        rise = summed(summed(_risen(omega, boxes), boxes), boxes) / boxes**2 / (boxes * self.width)
        return self.smooth(omega, boxes), self._marked(rise, boxes)

    def _marked(self, values: Array, boxes: int) -> Array:
        """Mark the ends, and windows with a gap in time or an edge of the log in them."""
        step = np.diff(self.t, prepend=self.t[0] - self.width)
        bad = (np.abs(step - self.width) > 0.5 * self.width).astype(np.float64)
        bad[0] = 1.0
        reach = 3 * boxes
        spread = summed(bad, 2 * reach + 1) > 0.5
        out = values.copy()
        out[spread] = np.nan
        out[:reach] = out[-reach:] = np.nan
        return out


def binned(log: Log) -> Bins:
    """Average the channels of a log over bins of `BIN`."""
    period = log.period
    k = max(1, round(BIN / period))
    m = len(log) // k
    kept = {name: np.asarray(values[: m * k].reshape(m, k).mean(axis=1)) for name, values in log.channels.items()}
    t = kept.pop("t")
    return Bins(t, kept, float(np.median(np.diff(t))) if m > 1 else period * k, k)


def summed(values: Array, count: int) -> Array:
    """Return the centred moving sum over `count` values, shape (m,); ends hold what is there."""
    total = np.concatenate([[0.0], np.cumsum(values)])
    first = np.arange(len(values)) - count // 2
    last = np.clip(first + count, 0, len(values))
    return np.asarray(total[last] - total[np.clip(first, 0, len(values))])


def _difference(values: Array, lag: int, back: int) -> Array:
    """Return the moving sum over `lag` of the differences to the value before (`back` 1) or after (`back` 0)."""
    place = np.arange(len(values)) - lag // 2 - back
    last = np.clip(place + lag, 0, len(values) - 1)
    return np.asarray(values[last] - values[np.clip(place, 0, len(values) - 1)])


def _risen(values: Array, lag: int) -> Array:
    """Return the moving sum over `lag` of central differences."""
    return 0.5 * (_difference(values, lag, 0) + _difference(values, lag, 1))

"""The worst stretches of time, each named by what the axis was doing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Stretch", "motion_in_words", "worst_stretches"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# The running rms is taken over a sixtieth of the log, at least and at most so many seconds.
SHARE, SHORTEST, LONGEST = 1 / 60, 0.2, 2.0
# A stretch reaches as far as the running rms stays above this share of its peak.
EXTENT = 0.7
# and no farther than so many widths of the running rms to either side.
REACH = 1.0
# A stretch that is not this much worse than the whole log is no stretch.
STANDS_OUT = 1.25
STEADY = 0.1  # of its mean: a speed that varies less is called constant
STILL = 0.002  # of the fast speed: below it the axis rests


@dataclass(frozen=True)
class Stretch:
    """A stretch of time in which a prediction fails.

    Attributes
    ----------
    start, stop : float
        s, on the log's clock.
    rms : float
        Of the residual, in `unit`.
    doing : str
        What the axis was doing.
    """

    start: float
    stop: float
    rms: float
    unit: str
    doing: str

    def sentence(self) -> str:
        """Say when, what, and how bad."""
        return f"{self.start:.4g} to {self.stop:.4g} s, {self.doing}: rms {self.rms:.3g} {self.unit}"


def worst_stretches(
    t: Array, residual: Array, mask: Mask, omega: Array, unit: str, speed_unit: str, count: int = 3
) -> tuple[Stretch, ...]:
    """Return the worst stretches, worst first, none overlapping another; none where none stands out.

    Parameters
    ----------
    t, residual, omega : array, shape (m,)
        Time in s, measured less predicted, and speed, on a uniform grid.
    mask : bool array, shape (m,)
        Samples that count.
    """
    from scipy.ndimage import uniform_filter1d

    rate = (len(t) - 1) / float(t[-1] - t[0])
    width = max(5, round(min(max(SHARE * float(t[-1] - t[0]), SHORTEST), LONGEST) * rate))
    power = uniform_filter1d(np.where(mask, residual**2, 0.0), width, mode="constant")
    share = uniform_filter1d(mask.astype(np.float64), width, mode="constant")
    # a few samples between two that do not count are no stretch
    running = np.where(share > 0.3, power / np.maximum(share, 1e-12), 0.0)
    whole = max(float(np.sqrt(np.mean(residual[mask] ** 2))), 1e-300)
    found = []
    for _ in range(count):
        peak = int(np.argmax(running))
        if running[peak] <= 0.0:
            break
        above = running > (EXTENT * np.sqrt(running[peak])) ** 2
        above[: max(0, peak - round(REACH * width))] = False
        above[peak + round(REACH * width) + 1 :] = False
        first = peak - int(np.argmin(above[: peak + 1][::-1])) + 1 if not above[: peak + 1].all() else 0
        last = peak + int(np.argmin(above[peak:])) - 1 if not above[peak:].all() else len(t) - 1
        # the running rms looks half its width to either side
        first, last = max(0, first - width // 4), min(len(t) - 1, last + width // 4)
        part = slice(first, last + 1)
        inside = mask[part]
        rms = float(np.sqrt(np.mean(residual[part][inside] ** 2)))
        running[max(0, first - width // 2) : last + width // 2 + 1] = 0.0
        if rms < STANDS_OUT * whole:
            continue
        doing = motion_in_words(omega[part], float(np.quantile(np.abs(omega), 0.99)), speed_unit)
        found.append(Stretch(float(t[first]), float(t[last]), rms, unit, doing))
    return tuple(sorted(found, key=lambda s: -s.rms))


def motion_in_words(omega: Array, fast: float, unit: str) -> str:
    """Describe a piece of motion by its speed, shape (n,); `fast` is the fast speed of the whole log."""
    top = float(np.max(np.abs(omega)))
    if top <= STILL * fast:
        return "at rest"
    low, high, mean = float(omega.min()), float(omega.max()), float(omega.mean())
    signs = np.sign(omega[np.abs(omega) > 0.02 * top])
    turns = int(np.sum(np.diff(signs) != 0))
    if turns > 2:
        return f"back and forth, up to {top:.3g} {unit}"
    if turns:
        return f"reversal{'s' if turns > 1 else ''}, up to {top:.3g} {unit}"
    way = "forward" if mean > 0.0 else "backward"
    if high - low <= STEADY * abs(mean):
        return f"constant {mean:+.3g} {unit}"
    start, stop = abs(float(omega[0])), abs(float(omega[-1]))
    if float(np.min(np.abs(omega))) < 0.1 * top and min(start, stop) > 0.2 * top:
        return f"stopping and starting again {way}, up to {top:.3g} {unit}"
    change = abs(stop - start)
    if change < 0.5 * (high - low):
        return f"unsteady, {min(abs(low), abs(high)):.3g} to {top:.3g} {unit} {way}"
    if min(start, stop) <= 0.02 * top:
        return f"{'starting' if stop > start else 'stopping'} {way}, up to {top:.3g} {unit}"
    return f"{'speeding up' if stop > start else 'slowing down'} {way}, {start:.3g} to {stop:.3g} {unit}"

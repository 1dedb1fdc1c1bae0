"""How two columns hang together: rate and integral, drive signal and acceleration, two drive signals.

Every factor is estimated with instruments: a second measurement of the same quantity, whose noise is another one.
Least squares would make factors smaller by the noise of the columns (errors in variables).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pmsm_ctrl.importers.table import Array

__all__ = [
    "NOTHING", "Balance", "axis_balance", "block_edges", "drive_balance", "drive_factor", "integral", "rate_factor",
    "rate_likeness", "ratio", "roughness",
]  # fmt: skip

BLOCKS = 500  # of a rate
LAGS = 20_000  # samples in which the time scale of a motion is looked for
FEWEST_BLOCKS = 120  # of a balance
MOST_BLOCKS = 4000
WIDEST = 50  # samples beside an edge that a speed there is taken from
STRETCHES = 24  # of time, over which the scatter is taken
STEADY = 1e-4  # share of a speed's mean square that its changes make at least
SMOOTHED = 9  # samples over which a correlation is taken: noise would make it smaller


@dataclass(frozen=True)
class Balance:
    """A drive signal as inertia times acceleration, dry and viscous friction, and a constant.

    Attributes
    ----------
    inertia, stderr : float
        Coefficient of the acceleration.
    left : float
        Share of the drive signal's variance that is not explained, over blocks of time.
    """

    inertia: float
    stderr: float
    left: float

    @property
    def certain(self) -> float:
        """The inertia over its standard error."""
        if not math.isfinite(self.inertia):
            return 0.0
        return abs(self.inertia) / self.stderr if self.stderr > 0.0 else math.inf


NOTHING = Balance(math.nan, math.inf, 1.0)


def integral(t: Array, values: Array) -> Array:
    """Return the cumulative trapezoidal integral, shape (n,), starting at 0."""
    out = np.zeros(t.size)
    np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(t), out=out[1:])
    return out


def block_edges(n: int, blocks: int) -> np.ndarray:
    """Return the first samples of about so many blocks."""
    return np.arange(0, n, max(2, n // blocks))


def ratio(numerator: Array, denominator: Array) -> tuple[float, float]:
    """Return (ratio, its relative spread) over the entries with a large denominator; NaN where there are too few."""
    size = np.abs(denominator)
    top = np.percentile(size, 95) if size.size else 0.0
    large = size > 0.2 * top
    if not top > 0.0 or np.count_nonzero(large) < 8:
        return math.nan, math.nan
    x, y = denominator[large], numerator[large]
    middle = float(np.median(y / x))
    error = np.abs(y / x - middle)
    spread = 1.4826 * float(np.median(error))
    # the ratio of sizes is not biased by a delay between the two, unlike the mean of ratios; jumps are left out
    kept = error <= 6.0 * spread + 1e-9 * abs(middle)
    factor = math.copysign(math.sqrt(float(np.sum(y[kept] ** 2) / np.sum(x[kept] ** 2))), middle)
    return factor, spread / abs(middle) if middle else math.inf


def rate_factor(t: Array, position: Array, speed: Array, step: float = 0.0) -> tuple[float, float]:
    """Return the factor d(position)/dt over speed and its relative spread; NaN when nothing moves.

    Parameters
    ----------
    t, position, speed : array, shape (n,)
    step : float
        Quantisation of the position; an axis that moves by less than five steps a block does not move.
    """
    edges = block_edges(t.size, BLOCKS)
    travelled = np.diff(position[edges])
    if not travelled.size or np.percentile(np.abs(travelled), 95) < 5.0 * step:
        return math.nan, math.nan
    return ratio(travelled, np.diff(integral(t, speed)[edges]))


def rate_likeness(t: Array, position: Array, speed: Array) -> tuple[float, float]:
    """Return the factor d(position)/dt over speed, and how much the two are alike, 0 to 1.

    Distances and integrals over blocks of time are compared about their means, so that no constant looks like the speed
    of a steady motion; where the speed hardly varies, nothing can be said.
    """
    if t.size < 4 * FEWEST_BLOCKS // 2 or position.size != t.size or speed.size != t.size:
        return math.nan, 0.0
    edges = block_edges(t.size, BLOCKS)
    length = np.diff(t[edges])
    moved, summed = np.diff(position[edges]) / length, np.diff(integral(t, speed)[edges]) / length
    x, y = summed - summed.mean(), moved - moved.mean()
    size = float(x @ x), float(y @ y)
    if not (size[0] > STEADY * float(summed @ summed) and size[1] > STEADY * float(moved @ moved)):
        return math.nan, 0.0
    return ratio(moved, summed)[0], float(x @ y) / math.sqrt(size[0] * size[1])


def roughness(values: Array) -> float:
    """Return the size of the fourth differences over that of the signal: noise makes it large, the motion hardly.

    Their mean, and no mean square: a reference of ramps has large ones at its corners, and none elsewhere.
    """
    size = float(np.std(values))
    return float(np.mean(np.abs(np.diff(values, 4)))) / size if size > 0.0 and values.size > 4 else 0.0


def drive_balance(
    t: Array, drive: Array, *, speed: Array | None = None, position: Array | None = None, loads: Array | None = None
) -> Balance:
    """Return the inertia that a drive signal and a motion give, in their units.

    Both sides are integrals over blocks, which need no derivative: the change of the speed against the integral of
    the drive signal. Blocks are as long as the motion takes to change. The speed at an edge is measured twice, with
    different samples, and one is the instrument of the other.

    Parameters
    ----------
    t, drive : array, shape (n,)
    speed, position : array, shape (n,), optional
        One of them; a position is measured more exactly.
    loads : array, shape (k, n), optional
        What else the drive signal may hold, of unknown size: the sine and the cosine of the angle, as of gravity.
    """
    source = position if position is not None else speed
    if source is None or t.size < 4 * FEWEST_BLOCKS // 2:
        return NOTHING
    length = _block(t, source, position is not None)
    wide = int(np.clip(length // 10, 2, WIDEST))  # wider means would round the motion off
    stride = max(1, length // 2, (t.size - length) // MOST_BLOCKS)
    first = np.arange(wide + 1, t.size - length - wide - 1, stride)
    if first.size < FEWEST_BLOCKS // 2:
        return NOTHING
    last = first + length
    measure = _slopes if position is not None else _means
    change, other = (
        b - a for a, b in zip(measure(t, source, first, wide), measure(t, source, last, wide), strict=True)
    )
    rough = np.gradient(_smooth(source, SMOOTHED), t) if position is not None else _smooth(source, SMOOTHED)
    moved = source[last] - source[first] if position is not None else _over(t, source, first, last)
    shared = [_over(t, np.sign(rough), first, last), moved, t[last] - t[first]]
    shared += [] if loads is None else [_over(t, load, first, last) for load in loads]
    target = _over(t, drive, first, last)
    return _instrumented(target, np.column_stack([change, *shared]), np.column_stack([other, *shared]))


def axis_balance(t: Array, drive: Array, *, speed: Array | None, position: Array | None, linear: bool) -> Balance:
    """Return the inertia that a torque and the motion of an axis give, of which a mass may hang.

    The weight of a mass that turns with the axis follows its angle, as the acceleration of a swing does: left out, it
    makes the inertia too small or negative. Of the balance with it and the one without, the surer one counts.

    Parameters
    ----------
    t, drive : array, shape (n,)
    speed, position : array, shape (n,), or None
        One of them at least; a position is measured more exactly.
    linear : bool
        Whether the position is no angle.
    """
    if position is None:
        return drive_balance(t, drive, speed=speed)
    plain = drive_balance(t, drive, position=position)
    if linear:
        return plain
    hung = drive_balance(t, drive, position=position, loads=np.stack([np.sin(position), np.cos(position)]))
    return min(plain, hung, key=lambda found: found.stderr)


def _block(t: Array, source: Array, is_position: bool) -> int:
    """Return the samples in which the speed changes by half of what it changes by at most."""
    thin = max(1, t.size // LAGS)
    if is_position:
        series = np.diff(source[::thin]) / np.diff(t[::thin])
    else:
        whole = t.size - t.size % thin
        series = source[:whole].reshape(-1, thin).mean(axis=1)
    lags = [1 << k for k in range(20) if 1 << k <= series.size // 8]
    changes = [float(np.mean((series[lag:] - series[:-lag]) ** 2)) for lag in lags]
    if not changes or not np.isfinite(changes).all() or not max(changes) > 0.0:
        return 8
    lag = next(lag for lag, change in zip(lags, changes, strict=True) if change >= 0.5 * max(changes))
    return int(np.clip(lag * thin, 8, max(8, 2 * t.size // FEWEST_BLOCKS)))


def _slopes(t: Array, position: Array, at: np.ndarray, wide: int) -> tuple[Array, Array]:
    """Return the speed at these samples twice, from different samples of the position."""
    pairs = ((at - k, at + k) for k in (wide, wide + 1))
    one, two = ((position[b] - position[a]) / (t[b] - t[a]) for a, b in pairs)
    return one, two


def _means(t: Array, speed: Array, at: np.ndarray, wide: int) -> tuple[Array, Array]:
    """Return the speed at these samples twice, from every second sample around."""
    offsets = np.arange(-wide, wide + 1)
    around = speed[at[:, None] + offsets]
    even = offsets % 2 == 0
    return around[:, even].mean(axis=1), around[:, ~even].mean(axis=1)


def _over(t: Array, values: Array, first: np.ndarray, last: np.ndarray) -> Array:
    total = integral(t, values)
    return np.asarray(total[last] - total[first])


def _smooth(values: Array, width: int) -> Array:
    """Return the mean over a few samples around each."""
    if values.size < 2 * width:
        return values
    total = np.cumsum(np.concatenate([[0.0], values - values[0]]))
    half = width // 2
    index = np.arange(values.size)
    first, last = np.maximum(index - half, 0), np.minimum(index + half + 1, values.size)
    return np.asarray(values[0] + (total[last] - total[first]) / (last - first))


def _instrumented(target: Array, columns: Array, instruments: Array) -> Balance:
    """Solve with instruments; the first coefficient counts. The scatter is taken over stretches of time."""
    scale = np.max(np.abs(columns), axis=0)
    if not (np.isfinite(columns).all() and np.isfinite(target).all() and (scale > 0.0).all()):
        return NOTHING
    x, z = columns / scale, instruments / scale
    product = z.T @ x / len(x)
    if not np.isfinite(product).all() or not np.linalg.cond(product) < 1e8:
        return NOTHING  # not excited
    inverse = np.linalg.inv(product)
    solution = inverse @ (z.T @ target) / len(x)
    residual = target - x @ solution
    edges = np.linspace(0, len(x), min(STRETCHES, len(x)) + 1).astype(int)
    scores = np.add.reduceat(z * residual[:, None], edges[:-1], axis=0)
    covariance = inverse @ (scores.T @ scores) @ inverse.T / len(x) ** 2
    power = float(np.var(target))
    left = float(np.var(residual)) / power if power > 0.0 else 1.0
    return Balance(float(solution[0] / scale[0]), float(math.sqrt(covariance[0, 0]) / scale[0]), left)


def drive_factor(first: Array, second: Array) -> tuple[float, float]:
    """Return the factor second over first and their correlation, not made smaller by the noise of either.

    The neighbours of a sample are the instrument of the first signal; the correlation is that of means over a few
    samples.

    Parameters
    ----------
    first, second : array, shape (n,)
    """
    scale = float(np.max(np.abs(first))), float(np.max(np.abs(second)))
    if not min(scale) > 0.0 or not np.isfinite(max(scale)):
        return math.nan, math.nan
    x, y = first / scale[0], second / scale[1]
    beside = x[:-4] + x[4:]
    size = float(beside @ x[2:-2])
    if not size > 0.0:
        return math.nan, math.nan
    factor = float(beside @ y[2:-2]) / size * scale[1] / scale[0]
    a, b = _smooth(x, SMOOTHED), _smooth(y, SMOOTHED)
    return factor, float(a @ b / np.sqrt((a @ a) * (b @ b)))

"""What curves explain of a residual: by a prewhitened F-test, and by cross-validation on blocks of time.

A residual is correlated, and tests that take its samples for independent find a dependence in nearly every log. The
noise is therefore modelled from what even the curves of all coordinates together do not explain, each stretch of time
at its own level, and everything is whitened with that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.evidence.blocks import equal_blocks, left_out_gains
from pmsm_ctrl.evidence.linalg import added, gram_of, orthonormal, projection_on_all
from pmsm_ctrl.evidence.tests import f_tail, rank_test
from pmsm_ctrl.evidence.whitening import ChannelWhitener, channel_whitener, inflation

__all__ = ["Bench", "Noise", "Outcome", "bench", "noise_of"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Index = list[int]

# Samples whose rms is the size of a dependence: the tenth where it is largest, and so many at least.
TENTH, FEWEST_LARGEST = 10, 10
BLOCKS = 16
# Longest time left out on either side of a block, s, and of the memory of the noise so many.
LONGEST_GAP, MEMORIES = 1.0, 3.0
# Samples for each direction that is fitted, and the fewest directions of a short log.
SAMPLES_PER_DIRECTION, FEWEST_DIRECTIONS = 8, 8
# A curve's ends often lie in one block: without it they would be fitted to a few samples of noise.
CURVE_RIDGE = 1e-6
# Time over which the level of the noise is taken, s, and its highest weight: a quiet stretch counts no more than that.
LEVEL_TIME, HIGHEST_WEIGHT = 0.5, 2.0


@dataclass(frozen=True, eq=False)
class Noise:
    """Noise of a residual.

    Attributes
    ----------
    mask : bool array, shape (m,)
        Samples that count.
    rms : float
        In the residual's unit: what no curve explains, as if nothing had been fitted.
    left : array, shape (m,)
        The residual less what all curves together explain; zero where a sample does not count.
    weight : array, shape (m,)
        Relative inverse level; zero where a sample does not count.
    whitener : ChannelWhitener
    rank : int
        Rank of the fitted columns.
    """

    mask: Mask
    rms: float
    left: Array
    weight: Array
    whitener: ChannelWhitener
    rank: int


def noise_of(residual: Array, columns: Sequence[Array], mask: Mask, rate: float) -> Noise:
    """Model the noise by what all columns together do not explain.

    Parameters
    ----------
    residual : array, shape (m,)
    columns : sequence of arrays, shape (m, k)
    mask : bool array, shape (m,)
        Samples that count.
    rate : float
        Of the grid, Hz.
    """
    blocks = [residual[None], *(np.ascontiguousarray(some.T) for some in columns)]
    weight = mask.astype(np.float64)
    for _ in range(2):
        left, rank = _unexplained(blocks, weight)
        level = _level(np.where(mask, left, 0.0), mask, rate)
        weight = np.where(mask, 1.0 / level, 0.0)
        weight *= np.sqrt(mask.sum() / np.sum(weight**2))
        weight = np.minimum(weight, HIGHEST_WEIGHT)
    left, rank = _unexplained(blocks, weight)
    whitener = channel_whitener(left * weight, weight, mask, rate, rank)
    left = np.where(mask, left, 0.0) * np.sqrt(inflation(int(mask.sum()), rank))
    return Noise(mask, float(np.sqrt(np.mean(left[mask] ** 2))), left, weight, whitener, rank)


def _unexplained(blocks: Sequence[Array], weight: Array) -> tuple[Array, int]:
    """Return the target, which is the first block, without what the columns explain, and how many were fitted."""
    gram = gram_of(blocks, weight)
    # a short log has no room for all: what the columns share comes first
    room = max(FEWEST_DIRECTIONS, int(np.count_nonzero(weight)) // SAMPLES_PER_DIRECTION)
    coefficients, rank = projection_on_all(gram[1:, 1:], gram[1:, 0], room)
    left, start = blocks[0][0].copy(), 0
    for block in blocks[1:]:
        left -= coefficients[start : start + len(block)] @ block
        start += len(block)
    return left, rank


def _level(left: Array, mask: Mask, rate: float) -> Array:
    """Return the level of the noise around each sample, at least half the usual one."""
    from scipy.ndimage import uniform_filter1d

    width = 2 * round(0.5 * LEVEL_TIME * rate) + 1
    power = uniform_filter1d(np.where(mask, left**2, 0.0), width, mode="nearest")
    share = uniform_filter1d(mask.astype(np.float64), width, mode="nearest")
    level = np.sqrt(np.maximum(np.divide(power, share, out=np.zeros_like(power), where=share > 0.0), 0.0))
    usual = float(np.median(level[mask]))
    return np.maximum(level, max(0.5 * usual, 1e-300))


@dataclass(frozen=True)
class Outcome:
    """What columns explain beyond a base.

    Attributes
    ----------
    p_value : float
        Of the F-test on whitened rows.
    share : float
        Of the residual's mean square, by cross-validation, that base and columns explain more than the base.
    gain, stderr : float
        Cross-validation gain of a block, whitened, and its standard error.
    p_rank : float
        Wilcoxon's p-value of the same gains.
    size : float
        Rms of what the columns alone explain, on the tenth of the samples where that is largest.
    """

    p_value: float
    share: float
    gain: float
    stderr: float
    p_rank: float
    size: float


@dataclass(frozen=True, eq=False)
class Bench:
    """A residual and all columns that may explain it, as measured and whitened, on the samples that count.

    Attributes
    ----------
    t : array, shape (used,)
    plain, white : array, shape (used, 1 + k)
        The residual, then the columns.
    plain_gram, white_gram : array, shape (1 + k, 1 + k)
    gap : float
        Time left out on either side of a block, s.
    free : int
        Degrees of freedom of the noise.
    """

    t: Array
    plain: Array
    white: Array
    plain_gram: Array
    white_gram: Array
    gap: float
    free: int

    def judge(self, base: Index, own: Index) -> Outcome | None:
        """Judge what the columns `own` explain beyond `base`, both by number; None where they are nothing new.

        `base` may be empty: then the residual's own mean square is what there is to explain.
        """
        beta, k, gain = _beyond(self.white_gram, base, own)
        if k == 0:
            return None
        edges = equal_blocks((self.white[:, [*own, *base]] @ beta) ** 2, self.t, BLOCKS)
        gains, _ = self._left_out(self.white, self.white_gram, base, own, edges)
        if len(gains) == 0:
            return None
        plain, total = self._left_out(self.plain, self.plain_gram, base, own, edges)
        spread = float(gains.std(ddof=1) / np.sqrt(len(gains)))
        share = float(np.sum(plain)) / max(total, 1e-300)
        p = self._tail(gain, k, base)
        return Outcome(p, share, float(gains.mean()), spread, rank_test(gains), self._size(base, own))

    def significance(self, base: Index, own: Index) -> float:
        """Return the F-test's p-value alone, which costs little."""
        _, k, gain = _beyond(self.white_gram, base, own)
        return self._tail(gain, k, base) if k else 1.0

    def _tail(self, gain: float, k: int, base: Index) -> float:
        # the noise has unit variance, known from so many samples
        return f_tail(gain / k, k, max(self.free - len(base), 1))

    def _left_out(
        self, rows: Array, gram: Array, base: Index, own: Index, edges: list[tuple[float, float]]
    ) -> tuple[Array, float]:
        columns = [0, *base, *own]
        part, full = rows[None][:, :, columns], gram[np.ix_(columns, columns)]
        return left_out_gains(part, full, self.t, edges, self.gap, len(base), CURVE_RIDGE)

    def _size(self, base: Index, own: Index) -> float:
        beta, _, _ = _beyond(self.plain_gram, base, own)
        fitted = np.abs(self.plain[:, [*own, *base]] @ beta)
        count = max(FEWEST_LARGEST, len(fitted) // TENTH)
        return float(np.sqrt(np.mean(np.partition(fitted, -count)[-count:] ** 2))) if len(fitted) > count else 0.0


def bench(noise: Noise, t: Array, residual: Array, columns: Sequence[Array], gap: float) -> Bench:
    """Lay out a residual and columns, each of shape (m,), for judging.

    `gap` is the least time left out on either side of a block, s; noise with a longer memory takes more.
    """
    both = np.empty((1 + len(columns), int(noise.mask.sum())))  # a column's samples side by side
    white = np.empty_like(both)
    for k, column in enumerate((residual, *columns)):  # one at a time: on a long log each copy of them all is large
        both[k] = used = column[noise.mask]
        if k:
            both[k] /= max(float(np.sqrt(np.mean(used**2))), 1e-300)
        white[k] = noise.whitener(both[k : k + 1])[0]
    gap = min(LONGEST_GAP, max(MEMORIES * noise.whitener.memory, gap))
    free = both.shape[1] - noise.rank
    return Bench(t[noise.mask], both.T, white.T, both @ both.T, white @ white.T, gap, free)


def _beyond(gram: Array, base: Index, own: Index) -> tuple[Array, int, float]:
    """Return the weights of own and base columns that explain what the base does not, their rank and the gain.

    The residual comes first in the Gram matrix.
    """
    directions = orthonormal(gram[np.ix_(base, base)])
    shared = directions.T @ gram[np.ix_(base, own)]
    found = added(gram[np.ix_(own, own)], shared, gram[own, 0] - shared.T @ (directions.T @ gram[base, 0]))
    return np.concatenate([found.values, -directions @ (shared @ found.values)]), found.rank, found.gain

"""What a curve explains of a residual: by a prewhitened F-test, and on blocks of time that were left out.

A residual is correlated, and tests that take its samples for independent find a dependence in nearly every log. The
noise is therefore modelled from what even the curves of all coordinates together leave over, each stretch of time at
its own level, and everything is whitened with that; and a curve has to hold where it was not fitted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.evidence.linalg import gram_of, projection_on_all
from pmsm_ctrl.evidence.tests import f_tail, rank_test
from pmsm_ctrl.evidence.whitening import ChannelWhitener, channel_whitener, inflation

__all__ = ["Bench", "Noise", "Outcome", "bench", "equal_blocks", "left_out_gains", "noise_of"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Index = list[int]

BLOCKS = 16
LONGEST_GAP = 1.0  # s left out on either side of a block that is judged
MOST_ORDER = 16  # of the autoregressive model
MOST_WEIGHT = 2.0  # of a calm sample, in those of a usual one
# Samples for each direction that is fitted away, and the fewest directions of a short log.
SAMPLES_PER_DIRECTION, FEWEST_DIRECTIONS = 8, 8
# Curves of one coordinate overlap more than effects do: eigenvalues below this share of the largest are none.
CURVE_RANK_TOLERANCE = 1e-8
# The gap in memories of the noise, and in periods of the filter: both have died away by then.
GAP_MEMORIES, GAP_PERIODS = 3.0, 4.0
# Least share of a column that the base must leave for it to be something new.
INDEPENDENT = 0.02
FEWEST_BLOCKS = 4  # whose gains have a standard error
FEWEST_ROWS = 3  # of a block that is judged
ROWS_PER_COLUMN = 5  # of the data that a block's fit is made from
RIDGE = 1e-10  # keeps a column solvable that shows in the left-out block alone
# A curve's ends often lie in one block: without it they would be fitted to a few samples of noise.
CURVE_RIDGE = 1e-6
LEVEL_TIME = 0.5  # s over which the level of the noise is taken


@dataclass(frozen=True, eq=False)
class Noise:
    """Noise of a residual on the samples that count.

    Attributes
    ----------
    rms : float
        In the residual's unit: what no curve explains, as if nothing had been fitted away.
    left : array, shape (m,)
        What all columns together leave over; zero where a sample does not count.
    weight : array, shape (m,)
        Relative inverse level, at most `MOST_WEIGHT`; zero where a sample does not count.
    whitener : ChannelWhitener
        Of the samples that count.
    lost : int
        Columns that were fitted away.
    """

    rms: float
    left: Array
    weight: Array
    whitener: ChannelWhitener
    lost: int


def noise_of(residual: Array, columns: Sequence[Array], mask: Mask, rate: float) -> Noise:
    """Model the noise by what all columns together leave over.

    Parameters
    ----------
    residual : array, shape (m,)
    columns : arrays of shape (m, k)
    mask : bool array, shape (m,)
        Samples that count.
    rate : float
        Of the thinned grid, Hz.
    """
    blocks = [residual[None], *(np.ascontiguousarray(some.T) for some in columns)]
    weight = mask.astype(np.float64)
    for _ in range(2):
        left, lost = _left(blocks, weight)
        level = _level(np.where(mask, left, 0.0), mask, rate)
        weight = np.where(mask, 1.0 / level, 0.0)
        weight *= np.sqrt(mask.sum() / np.sum(weight**2))
        weight = np.minimum(weight, MOST_WEIGHT)
    left, lost = _left(blocks, weight)
    whitener = channel_whitener(left * weight, weight, mask, rate, lost, MOST_ORDER)
    plain = np.where(mask, left, 0.0) * np.sqrt(inflation(int(mask.sum()), lost))
    return Noise(float(np.sqrt(np.mean(plain[mask] ** 2))), plain, weight, whitener, lost)


def _left(blocks: Sequence[Array], weight: Array) -> tuple[Array, int]:
    """What columns leave of the target, which is the first block; and how many directions were fitted away."""
    gram = gram_of(blocks, weight)
    # a short log has no room for all: what the columns share comes first
    room = max(FEWEST_DIRECTIONS, int(np.count_nonzero(weight)) // SAMPLES_PER_DIRECTION)
    coefficients, rank = projection_on_all(gram[1:, 1:], gram[1:, 0], room, CURVE_RANK_TOLERANCE)
    left, start = blocks[0][0].copy(), 0
    for block in blocks[1:]:
        left -= coefficients[start : start + len(block)] @ block
        start += len(block)
    return left, rank


def _level(left: Array, mask: Mask, rate: float) -> Array:
    """Level of the noise around each sample, at least half the usual one."""
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
        Of the residual's mean square, on blocks left out, that base and columns explain more than the base.
    gain, stderr : float
        Mean gain of a left-out block, whitened, and its standard error.
    p_rank : float
        Wilcoxon's p-value of the same gains. Source: F. Wilcoxon, Biometrics Bulletin 1 (1945) 80.
    size : float
        Rms of what the columns alone explain, on the tenth of the samples where that is largest.
    """

    p_value: float
    share: float
    gain: float
    stderr: float
    p_rank: float
    blocks: int
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
        Time left out on either side of a block that is judged, s.
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
        # the noise has unit variance, known from so many samples
        p = f_tail(gain / k, k, max(self.free - len(base), 1))
        along = self.white[:, [*own, *base]] @ beta
        edges = equal_blocks(along**2, self.t, BLOCKS)
        gains, _ = self._left_out(self.white, self.white_gram, base, own, edges)
        if len(gains) == 0:
            return None
        plain, total = self._left_out(self.plain, self.plain_gram, base, own, edges)
        spread = float(gains.std(ddof=1) / np.sqrt(len(gains)))
        share = float(np.sum(plain)) / max(total, 1e-300)
        size = self._size(base, own)
        return Outcome(p, share, float(gains.mean()), spread, rank_test(gains), len(gains), size)

    def significance(self, base: Index, own: Index) -> float:
        """The F-test's p-value alone, which costs little."""
        _, k, gain = _beyond(self.white_gram, base, own)
        return f_tail(gain / k, k, max(self.free - len(base), 1)) if k else 1.0

    def _left_out(
        self, rows: Array, gram: Array, base: Index, own: Index, edges: list[tuple[float, float]]
    ) -> tuple[Array, float]:
        columns = [0, *base, *own]
        part, full = rows[None][:, :, columns], gram[np.ix_(columns, columns)]
        return left_out_gains(part, full, self.t, edges, self.gap, len(base), CURVE_RIDGE)

    def _size(self, base: Index, own: Index) -> float:
        beta, _, _ = _beyond(self.plain_gram, base, own)
        fitted = np.abs(self.plain[:, [*own, *base]] @ beta)
        count = max(10, len(fitted) // 10)
        return float(np.sqrt(np.mean(np.partition(fitted, -count)[-count:] ** 2))) if len(fitted) > count else 0.0


def bench(noise: Noise, t: Array, residual: Array, mask: Mask, columns: Array, cutoff: float) -> Bench:
    """Lay out a residual of shape (m,) and columns of shape (m, k) for judging."""
    both = np.column_stack([residual, columns])
    both[:, 1:] /= np.maximum(np.sqrt(np.mean(both[mask, 1:] ** 2, axis=0)), 1e-300)
    plain = both[mask]
    white = noise.whitener(plain.T).T
    gap = min(LONGEST_GAP, max(GAP_MEMORIES * noise.whitener.memory, GAP_PERIODS / cutoff))
    free = int(mask.sum()) - noise.lost
    return Bench(t[mask], plain, white, plain.T @ plain, white.T @ white, gap, free)


def _beyond(gram: Array, base: Index, own: Index) -> tuple[Array, int, float]:
    """Return the weights of own and base columns that explain what the base does not, their rank and the gain."""
    g = gram[np.ix_(own, own)]
    cross, right = gram[np.ix_(base, own)], gram[own, 0]
    onto = _inverse(gram[np.ix_(base, base)]) @ np.column_stack([cross, gram[base, 0]])
    g, right = g - cross.T @ onto[:, :-1], right - cross.T @ onto[:, -1]
    size = np.sqrt(np.maximum(np.diag(gram)[own], 1e-300))
    values, vectors = np.linalg.eigh(g / np.outer(size, size))
    kept = values > INDEPENDENT**2
    along = vectors[:, kept].T @ (right / size)
    gain = float(np.sum(along**2 / values[kept]))
    weights = (vectors[:, kept] / values[kept]) @ along / size
    return np.concatenate([weights, -onto[:, :-1] @ weights]), int(kept.sum()), gain


def _inverse(gram: Array) -> Array:
    """Inverse on the directions that there are."""
    if len(gram) == 0:
        return gram
    size = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    values, vectors = np.linalg.eigh(gram / np.outer(size, size))
    kept = values > 1e-9 * values[-1]
    return (vectors[:, kept] / values[kept]) @ vectors[:, kept].T / np.outer(size, size)


def equal_blocks(weight: Array, t: Array, count: int) -> list[tuple[float, float]]:
    """Cut time into contiguous blocks that each hold the same share of what there is to explain.

    Parameters
    ----------
    weight : array, shape (n,) or (channels, n)
        What each sample could tell.
    t : array, shape (n,)
        Increasing, s.
    count : int

    Returns
    -------
    list of (start, stop)
        In s; empty where no sample tells anything.
    """
    rows = np.atleast_2d(weight)
    total = np.cumsum(rows.T.ravel())
    if total[-1] <= 0.0:
        return []
    cuts = np.interp(np.linspace(0.0, 1.0, count + 1)[1:-1] * total[-1], total, np.repeat(t, len(rows)))
    edges = np.concatenate([[t[0] - 1.0], cuts, [t[-1] + 1.0]])
    return list(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True))


def left_out_gains(
    rows: Array, full: Array, t: Array, edges: Sequence[tuple[float, float]], gap: float, base: int,
    ridge: float = RIDGE,
) -> tuple[Array, float]:  # fmt: skip
    """Return by how much columns lower the sum of squares of blocks that were left out of the fit.

    A block's training data are all rows less its own and those of the gap on either side: their Gram matrix is the
    whole one less that of these few rows, and no fit touches the others.

    Parameters
    ----------
    rows : array, shape (channels, n, 1 + base + own)
        Target, columns of the base and own columns, whitened.
    full : array, shape (1 + base + own, 1 + base + own)
        Gram matrix of all rows, and of the priors where there are any.
    t : array, shape (n,)
        Increasing, s.
    edges : sequence of (start, stop)
        Of the blocks, s.
    gap : float
        Time on either side of a block that is used neither to fit nor to judge, s.
    base : int
        Columns that both fits have.
    ridge : float
        Share of the mean diagonal that is added to the scaled Gram matrix.

    Returns
    -------
    gains : array, shape (blocks,)
        Empty where fewer than `FEWEST_BLOCKS` could be judged.
    total : float
        Sum of squares that there was to explain in these blocks.
    """
    channels, n, columns = rows.shape
    grams, judged = [], []
    for start, stop in edges:
        near = slice(*np.searchsorted(t, [start - gap, stop + gap]))
        test = slice(*np.searchsorted(t, [start, stop]))
        left = channels * (n - (near.stop - near.start))
        if channels * (test.stop - test.start) < FEWEST_ROWS or left < ROWS_PER_COLUMN * columns:
            continue
        excluded = rows[:, near].reshape(-1, columns)
        grams.append(full - excluded.T @ excluded)
        judged.append(rows[:, test].reshape(-1, columns))
    if len(grams) < FEWEST_BLOCKS:
        return np.zeros(0), 0.0
    training = np.array(grams)
    small = _ridge_solutions(training[:, : base + 1, : base + 1], ridge) if base else np.zeros((len(grams), 0))
    big = _ridge_solutions(training, ridge)
    gains, total = [], 0.0
    for block, few, all_of_them in zip(judged, small, big, strict=True):
        y = block[:, 0]
        before, after = y - block[:, 1 : base + 1] @ few, y - block[:, 1:] @ all_of_them
        gains.append(float(before @ before - after @ after))
        total += max(float(y @ y), float(before @ before))
    return np.array(gains), total


def _ridge_solutions(grams: Array, ridge: float) -> Array:
    """Coefficients of the columns for the target, which comes first in each Gram matrix, shape (blocks, k)."""
    size = np.sqrt(np.maximum(np.diagonal(grams, axis1=1, axis2=2)[:, 1:], 0.0))
    size[size == 0.0] = 1.0
    scaled = grams[:, 1:, 1:] / (size[:, :, None] * size[:, None, :])
    k = scaled.shape[-1]
    scaled += (ridge * np.trace(scaled, axis1=1, axis2=2) / k)[:, None, None] * np.eye(k)
    return np.linalg.solve(scaled, (grams[:, 1:, 0] / size)[..., None])[..., 0] / size

"""Cross-validation on blocks of time, or on whole records, that are left out."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "FEWEST_RECORDS", "block_sums", "equal_blocks", "left_out_gains", "no_smaller_than_by_blocks", "record_blocks",
]  # fmt: skip

Array = NDArray[np.float64]

FEWEST_BLOCKS = 4  # whose gains have a standard error
FEWEST_RECORDS = 3  # that are left out as a whole, each in its turn
MOST_OF_IT = 0.5  # share of what all records tell; without such a record the others say too little
FEWEST_ROWS = 3  # of a block that is judged
ROWS_PER_COLUMN = 5  # of the data that a block's fit is made from
BLOCKS = 24  # of equal length, whose scatter gives a standard error
LEAST_LEFT = 0.1  # share of a direction that the other blocks must tell
LEAK = 1e-3  # weight of left-out rows in the fit that judges them: a hundredth of what `LEAST_LEFT` asks of the others
RIDGE = 1e-10  # keeps a column solvable that shows in the left-out block alone


def equal_blocks(weight: Array, t: Array, count: int, even: float = 0.0) -> list[tuple[float, float]]:
    """Cut time into contiguous blocks that each hold the same share of the squares to be explained, or of samples.

    Where a single slow move holds most of what is to be explained, blocks of equal shares are shorter than the gap
    around them, and none can be judged.

    Parameters
    ----------
    weight : array, shape (n,) or (channels, n)
        Square of what is to be explained in each sample.
    t : array, shape (n,)
        Increasing, s.
    count : int
    even : float
        Part of a block's share that is its share of the samples, 0 to 1. A block holds 1 / (1 - even) / count of the
        squares at most.

    Returns
    -------
    list of (start, stop)
        In s; empty where every weight is zero.
    """
    rows = np.atleast_2d(weight)
    total = np.cumsum(rows.T.ravel())
    if total[-1] <= 0.0:
        return []
    total = (1.0 - even) * total / total[-1] + even * np.arange(1, len(total) + 1) / len(total)
    cuts = np.interp(np.linspace(0.0, 1.0, count + 1)[1:-1] * total[-1], total, np.repeat(t, len(rows)))
    edges = np.concatenate([[t[0] - 1.0], cuts, [t[-1] + 1.0]])
    return list(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True))


def record_blocks(
    weight: Array, t: Array, records: Sequence[tuple[float, float]], count: int
) -> tuple[list[tuple[float, float]], list[tuple[float, float]]]:
    """Cut each of several records into blocks that hold about equal shares, and say which record each belongs to.

    When a block is judged, its whole record is left out, so that nothing of the record was fitted. The blocks serve
    only to estimate the scatter of the gain. A record with more than half of the total is left out block by block.

    Parameters
    ----------
    weight : array, shape (n,) or (channels, n)
        Square of what is to be explained in each sample.
    t : array, shape (n,)
        Increasing, s.
    records : sequence of (start, stop)
        s.
    count : int
        Approximate number of blocks in all; a record with any weight has at least one.

    Returns
    -------
    blocks, left_out : list of (start, stop)
        Block that is judged, and the time that is left out of its fit, s.
    """
    rows = np.atleast_2d(weight)
    pieces = [slice(*np.searchsorted(t, [start, stop])) for start, stop in records]
    sums = [float(np.sum(rows[:, piece])) for piece in pieces]
    total = sum(sums)
    blocks: list[tuple[float, float]] = []
    left_out: list[tuple[float, float]] = []
    for record, piece, share in zip(records, pieces, sums, strict=True):
        if share <= 0.0:
            continue
        own = equal_blocks(rows[:, piece], t[piece], max(1, round(count * share / total)))
        own = [(max(start, record[0]), min(stop, record[1])) for start, stop in own]
        blocks += own
        left_out += own if share > MOST_OF_IT * total else [record] * len(own)
    return blocks, left_out


def left_out_gains(
    rows: Array, full: Array, t: Array, edges: Sequence[tuple[float, float]], gap: float, base: int,
    ridge: float = RIDGE, left_out: Sequence[tuple[float, float]] | None = None,
) -> tuple[Array, float]:  # fmt: skip
    """Return the fall of the sum of squares by columns in blocks that were left out of the fit.

    The training data of a block are all rows except its own and those of the gap on either side, which count `LEAK`:
    what no other row tells of the base is as in the whole, and not extrapolated. Their Gram matrix is
    the whole one less that of these few rows. A direction of the own columns that has less than a tenth of its
    information in the training data is left at zero, because its value would be an extrapolation. This does not apply
    where whole records are left out.

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
    left_out : sequence of (start, stop), optional
        What is left out of the fit for each block, s; the block itself when not given.

    Returns
    -------
    gains : array, shape (blocks,)
        Empty where fewer than `FEWEST_BLOCKS` could be judged.
    total : float
        Sum of squares to be explained in these blocks.
    """
    channels, n, columns = rows.shape
    grams, judged = [], []
    for (start, stop), (first, last) in zip(edges, left_out or edges, strict=True):
        near = slice(*np.searchsorted(t, [first - gap, last + gap]))
        test = slice(*np.searchsorted(t, [start, stop]))
        left = channels * (n - (near.stop - near.start))
        if channels * (test.stop - test.start) < FEWEST_ROWS or left < ROWS_PER_COLUMN * columns:
            continue
        excluded = rows[:, near].reshape(-1, columns)
        grams.append(full - (1.0 - LEAK) * (excluded.T @ excluded))
        judged.append(rows[:, test].reshape(-1, columns))
    if len(grams) < FEWEST_BLOCKS:
        return np.zeros(0), 0.0
    training = np.array(grams)
    small = _ridge_solutions(training[:, : base + 1, : base + 1], ridge) if base else np.zeros((len(grams), 0))
    big = _ridge_solutions(training, ridge)
    if left_out is None:  # else the levels of a record are held by their priors
        share, along = _shares(training, full, base)
        for k in np.flatnonzero(share[:, 0] < LEAST_LEFT):
            big[k] = _determined_alone(training[k], along[k][:, share[k] >= LEAST_LEFT], base, ridge)
    gains, total = [], 0.0
    for block, few, all_of_them in zip(judged, small, big, strict=True):
        y = block[:, 0]
        before, after = y - block[:, 1 : base + 1] @ few, y - block[:, 1:] @ all_of_them
        gains.append(float(before @ before - after @ after))
        total += max(float(y @ y), float(before @ before))
    return np.array(gains), total


def _beyond(gram: Array, base: int) -> Array:
    """Gram matrix of the own columns beyond the base, shape (..., own, own)."""
    few, own = gram[..., 1 : base + 1, 1 : base + 1], gram[..., base + 1 :, base + 1 :]
    if not base:
        return own
    across = gram[..., 1 : base + 1, base + 1 :]
    return np.asarray(own - across.swapaxes(-1, -2) @ np.linalg.pinv(few, hermitian=True) @ across)


def _shares(training: Array, full: Array, base: int) -> tuple[Array, Array]:
    """Share of information of training data on directions of the own columns, (..., own), and the directions."""
    size, turn = np.linalg.eigh(_beyond(full, base))
    whole = turn / np.sqrt(np.maximum(size, RIDGE * size[-1] + 1e-300))
    share, along = np.linalg.eigh(whole.T @ _beyond(training, base) @ whole)
    return share, whole @ along


def _determined_alone(gram: Array, kept: Array, base: int, ridge: float) -> Array:
    """Coefficients of one block, but for the base in those directions of the own columns that are determined."""
    mixed = np.zeros((len(gram), 1 + base + kept.shape[1]))
    mixed[: 1 + base, : 1 + base] = np.eye(1 + base)
    mixed[1 + base :, 1 + base :] = kept
    found = _ridge_solutions((mixed.T @ gram @ mixed)[None], ridge)[0]
    return np.asarray(mixed[1:, 1:] @ found)


def _ridge_solutions(grams: Array, ridge: float) -> Array:
    """Coefficients of the columns for the target, which comes first in each Gram matrix, shape (blocks, k)."""
    if grams.shape[-1] == 1:  # no column, and a mean diagonal of none
        return np.zeros((len(grams), 0))
    size = np.sqrt(np.maximum(np.diagonal(grams, axis1=1, axis2=2)[:, 1:], 0.0))
    size[size == 0.0] = 1.0
    scaled = grams[:, 1:, 1:] / (size[:, :, None] * size[:, None, :])
    k = scaled.shape[-1]
    scaled += (ridge * np.trace(scaled, axis1=1, axis2=2) / k)[:, None, None] * np.eye(k)
    return np.asarray(np.linalg.solve(scaled, (grams[:, 1:, 0] / size)[..., None])[..., 0] / size)


def block_sums(basis: Array | Callable[[NDArray[np.int64]], Array], residual: Array, place: Array) -> Array:
    """Return what each of some blocks of rows contributes to least squares, in the directions of its basis.

    The sum of the squares over the blocks is the covariance of the estimate, whatever the noise is inside of a block.
    What is wrong with a model comes block by block, at an edge of the torque or a reversal, and no model of the noise
    knows of that. For white noise the sum has the expectation that least squares states.

    Sources: K.-Y. Liang, S. L. Zeger, Biometrika 73 (1986) 13; R. M. Bell, D. F. McCaffrey, Survey Methodology 28
    (2002) 169 (without bias).

    Parameters
    ----------
    basis : array, shape (n, r), or function of int array
        Part of an orthonormal basis of the columns that belongs to the data; priors may make up the rest. A function
        returns some of its rows: that of a long log is large.
    residual : array, shape (n,)
    place : array, shape (n,)
        Where in the record each row stands, from 0 to 1.

    Returns
    -------
    array, shape (blocks, r)
    """
    number = np.minimum((BLOCKS * place).astype(np.uint8), BLOCKS - 1)  # sorted by counting
    order = np.argsort(number, kind="stable")
    ends = np.flatnonzero(np.diff(number[order])) + 1
    blocks = np.split(order, ends)
    grams, along = [], []
    for block in blocks:
        rows = basis(block) if callable(basis) else basis[block]
        grams.append(rows.T @ rows)
        along.append((rows.T @ residual[block])[:, None])
    share, turn = np.linalg.eigh(np.array(grams))
    left = np.sqrt(np.maximum(1.0 - share, LEAST_LEFT))[:, :, None]
    return np.asarray((turn @ (turn.swapaxes(1, 2) @ np.array(along) / left))[:, :, 0])


def no_smaller_than_by_blocks(covariance: Array, changes: Array, prior: Array) -> Array:
    """Return a covariance whose standard errors are no smaller than what blocks of the record differ by.

    Parameters
    ----------
    covariance : array, shape (k, k)
        By a model of the noise.
    changes : array, shape (blocks, k)
        What each block contributes to the estimates: `block_sums`, as values.
    prior : array, shape (k,)
        Variance that the priors add.

    Returns
    -------
    array, shape (k, k)
    """
    by_blocks = np.sqrt(np.sum(changes**2, axis=0) + prior)
    stderr = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    larger = np.maximum(np.divide(by_blocks, stderr, out=np.ones_like(stderr), where=stderr > 0.0), 1.0)
    return np.asarray(covariance * np.outer(larger, larger))

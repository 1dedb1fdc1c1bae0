"""Least squares with scaled columns, and what a few columns have beyond a model, on small factors.

A model's rows are factored once per channel. Whether further columns explain more is then a matter of their Gram
matrix and of their products with that factor and with the residual: a trial costs the square of the number of columns
and not the number of samples.

A Gram matrix has the squares of the singular values, and so half of their digits. Columns are scaled to unit length
first, and a direction of which less than `OWN_SHARE` is its own counts as none at all: its square, 1e-4, still has
eleven digits.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "GRAM_RANK_TOLERANCE",
    "OWN_SHARE",
    "RANK_TOLERANCE",
    "Added",
    "Factored",
    "added",
    "added_each",
    "factored",
    "gram_of",
    "in_blocks",
    "occupied",
    "orthonormal",
    "orthonormal_rows",
    "own_shares",
    "projection_on_all",
    "triangle",
]

Array = NDArray[np.float64]

# Singular values of scaled columns below this share of the largest are rounding errors of the columns.
RANK_TOLERANCE = 1e-7
# The same of eigenvalues of their Gram matrix: its rounding errors, 1e-16, stay seven digits below.
GRAM_RANK_TOLERANCE = 1e-9
# A direction of which a model leaves less than this share is in the model already.
OWN_SHARE = 1e-2
CHUNK = 1024  # samples that are weighted and multiplied at once: a few hundred columns of them fit into a cache
ROWS = 1 << 15  # that are factored at once: a few MB
# Share of a scaled column that the earlier ones must leave for Cholesky's factor of the Gram matrix to serve: twice in
# turn, it makes columns orthonormal to the last digit then, and else reflections do.
APART = 1e-3
SPARSE = 97  # every so many samples of a column tell at once that it is not zero
FEW = 64  # columns, of fewer of which all eigenvalues take less time than the largest


@dataclass(frozen=True, eq=False)
class Factored:
    """Least squares by a factor of the columns.

    Attributes
    ----------
    basis : array, shape (n, rank)
        Orthonormal columns.
    inverse : array, shape (k, rank)
        The coefficients are ``inverse @ basis.T @ target``.
    condition : float
        Condition number of the columns scaled to unit length.
    """

    basis: Array
    inverse: Array
    condition: float

    def solve(self, target: Array) -> Array:
        """Return the coefficients, shape (k,), for a target of shape (n,)."""
        return np.asarray(self.inverse @ (self.basis.T @ target))


def factored(columns: Array) -> Factored:
    """Return the factor of columns, scaled to unit length, on the directions that there are.

    Parameters
    ----------
    columns : array, shape (n, k)
    """
    scale = np.linalg.norm(columns, axis=0)
    scale[scale == 0.0] = 1.0
    u, s, vt = np.linalg.svd(columns / scale, full_matrices=False)
    kept = s > RANK_TOLERANCE * s[0] if s.size else np.zeros(0, dtype=bool)
    condition = float(s[0] / s[-1]) if s.size and s[-1] > 0.0 else float("inf")
    return Factored(u[:, kept], vt[kept].T / s[kept] / scale[:, None], condition)


def orthonormal_rows(columns: Array) -> tuple[Array, Array]:
    """Return orthonormal rows that span columns, one a row, and the columns in them.

    Source: Y. Yamamoto, Y. Nakatsukasa, Y. Yanagisawa, T. Fukaya, Electr. Trans. Numer. Anal. 44 (2015) 306.

    Parameters
    ----------
    columns : array, shape (k, n)
        Overwritten: of a long log a copy is large.

    Returns
    -------
    basis : array, shape (min(k, n), n)
    triangle : array, shape (min(k, n), k)
    """
    gram = columns @ columns.T
    size = np.sqrt(np.diag(gram))
    if size.all() and len(columns) < columns.shape[1]:
        first = _lower(gram / np.outer(size, size))
        if first is not None and np.diag(first).min() > APART:
            _mix(np.linalg.inv(first) / size, columns)
            second = np.linalg.cholesky(columns @ columns.T)
            _mix(np.linalg.inv(second), columns)
            return columns, (first @ second).T * size
    columns /= np.where(size > 0.0, size, 1.0)[:, None]
    tall, triangle = np.linalg.qr(columns.T)
    del columns
    return np.ascontiguousarray(tall.T), triangle * size


def _mix(weights: Array, columns: Array) -> None:
    """Replace columns, one a row, by weighted sums of them."""
    for start in range(0, columns.shape[1], CHUNK):
        part = columns[:, start : start + CHUNK]
        part[:] = weights @ part


def _lower(gram: Array) -> Array | None:
    """Cholesky's factor; None where rounding makes the matrix indefinite."""
    try:
        return np.asarray(np.linalg.cholesky(gram))
    except np.linalg.LinAlgError:
        return None


def triangle(blocks: Iterable[Array]) -> Array:
    """Return the triangle of the QR factorisation of blocks of rows, one below the other.

    Parameters
    ----------
    blocks : arrays of shape (n, k)

    Returns
    -------
    array, shape (k or fewer, k)

    Raises
    ------
    ValueError
        When there is no block.
    """
    upper: Array | None = None
    for block in blocks:
        upper = np.asarray(np.linalg.qr(block if upper is None else np.vstack([upper, block]), mode="r"))
    if upper is None:
        raise ValueError("no rows to factor")
    return upper


def occupied(columns: Array) -> NDArray[np.int64]:
    """Return which columns, one a row, are not zero throughout.

    Parameters
    ----------
    columns : array, shape (k, n)
    """
    found = np.asarray(columns[:, ::SPARSE].any(axis=1))  # of most a few samples tell it
    for k in np.flatnonzero(~found).tolist():
        found[k] = columns[k].any()
    return np.flatnonzero(found)


def in_blocks(rows: int) -> Iterator[slice]:
    """Yield slices of so many rows, each small enough to be factored at once.

    Parameters
    ----------
    rows : int
    """
    return (slice(start, start + ROWS) for start in range(0, rows, ROWS))


def own_shares(columns: Array) -> Array:
    """Return the share of each column's length that the others leave; 0 for a column that is zero.

    Parameters
    ----------
    columns : array, shape (n, k)

    Returns
    -------
    array, shape (k,)
        0 to 1.
    """
    size = np.linalg.norm(columns, axis=0)
    triangle = np.linalg.qr(columns / np.where(size > 0.0, size, 1.0))[1]
    shares = np.zeros(len(size))
    for k in np.flatnonzero(size).tolist():
        others = np.delete(triangle, k, axis=1)
        column = triangle[:, k]
        shares[k] = np.linalg.norm(column - others @ np.linalg.lstsq(others, column, rcond=RANK_TOLERANCE)[0])
    return shares


def gram_of(blocks: Sequence[Array], weight: Array) -> Array:
    """Return the Gram matrix of weighted columns, some samples at a time.

    Parameters
    ----------
    blocks : arrays of shape (k, m)
        Columns, one a row.
    weight : array, shape (m,)

    Returns
    -------
    array, shape (columns, columns)
    """
    total = sum(len(block) for block in blocks)
    out = np.zeros((total, total))
    buffer = np.empty((total, CHUNK))
    for start in range(0, len(weight) if total else 0, CHUNK):
        part_weight = weight[start : start + CHUNK]
        if not np.any(part_weight):
            continue
        part = buffer[:, : len(part_weight)]
        np.concatenate([block[:, start : start + CHUNK] for block in blocks], out=part)
        part *= part_weight
        out += part @ part.T
    return out


def orthonormal(gram: Array) -> Array:
    """Return the weights that make columns with this Gram matrix orthonormal, on the directions that there are.

    Parameters
    ----------
    gram : array, shape (k, k)

    Returns
    -------
    array, shape (k, rank)
    """
    size = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    values, vectors = np.linalg.eigh(gram / np.outer(size, size))
    kept = values > GRAM_RANK_TOLERANCE * values.max(initial=0.0)
    weights: Array = vectors[:, kept] / np.sqrt(values[kept]) / size[:, None]
    return weights


def projection_on_all(gram: Array, right: Array, room: int, first: int = 0) -> tuple[Array, int]:
    """Return the coefficients of a least-squares fit of all columns, and how many directions it has.

    Parameters
    ----------
    gram : array, shape (k, k)
        Of the columns.
    right : array, shape (k,)
        Their products with the target.
    room : int
        Most directions that are fitted: those that the columns have in common come first.
    first : int
        Columns that are fitted in any case, the leading ones: where the room is small, the directions that the others
        have in common need not hold them.

    Returns
    -------
    coefficients : array, shape (k,)
    rank : int
    """
    size = np.sqrt(np.diag(gram))
    alive = size > 0.0
    size = size[alive]
    scaled, along = gram[np.ix_(alive, alive)] / np.outer(size, size), right[alive] / size
    lead = int(alive[:first].sum())
    powers, ways = np.linalg.eigh(scaled[:lead, :lead])
    there = powers > GRAM_RANK_TOLERANCE * powers.max(initial=0.0)
    own = (ways[:, there] / powers[there]) @ ways[:, there].T
    beside = own @ scaled[:lead, lead:]
    left = scaled[lead:, lead:] - scaled[lead:, :lead] @ beside
    values, vectors = np.linalg.eigh(left) if len(left) else (np.zeros(0), np.zeros((0, 0)))
    largest = float(values.max(initial=0.0)) if lead == 0 else _largest_eigenvalue(scaled)
    kept = values > GRAM_RANK_TOLERANCE * max(largest, 1e-300)
    kept[: max(0, len(kept) - max(room - lead, 0))] = False
    further = vectors[:, kept] @ ((vectors[:, kept].T @ (along[lead:] - beside.T @ along[:lead])) / values[kept])
    coefficients = np.zeros(len(gram))
    coefficients[alive] = np.concatenate([own @ along[:lead] - beside @ further, further]) / size
    return coefficients, lead + int(kept.sum())


def _largest_eigenvalue(gram: Array) -> float:
    if len(gram) < FEW:
        return float(np.linalg.eigvalsh(gram)[-1])
    from scipy.linalg import eigh

    last = len(gram) - 1
    return float(eigh(gram, eigvals_only=True, subset_by_index=[last, last], check_finite=False)[0])


@dataclass(frozen=True, eq=False)
class Added:
    """What a few columns explain beyond a model.

    Attributes
    ----------
    back : array, shape (k, rank)
        Their own orthonormal directions are the columns, less what the model has of them, times this.
    along : array, shape (rank,)
        The residual along these directions.
    size : array, shape (k,)
        Length of each column, what the model has of it included; 1 where it is zero.
    """

    back: Array
    along: Array
    size: Array

    @property
    def rank(self) -> int:
        """Directions that the model has not."""
        return len(self.along)

    @property
    def gain(self) -> float:
        """Fall of the sum of squares."""
        return float(self.along @ self.along)

    @property
    def values(self) -> Array:
        """Coefficients, shape (k,)."""
        return self.back @ self.along

    @property
    def stderr(self) -> Array:
        """Standard errors of the coefficients where rows have unit variance, shape (k,)."""
        return np.asarray(np.sqrt(np.sum(self.back**2, axis=1)))


def added(gram: Array, shared: Array, along: Array, own_share: float = OWN_SHARE) -> Added:
    """Return what columns explain beyond a model.

    Parameters
    ----------
    gram : array, shape (k, k)
        Of the columns.
    shared : array, shape (rank of the model, k)
        Products of the model's orthonormal basis with the columns.
    along : array, shape (k,)
        Products of the columns with the model's residual.
    own_share : float
        As in `added_each`.
    """
    size = np.sqrt(np.diag(gram))
    size = np.where(size > 0.0, size, 1.0)
    left = (gram - shared.T @ shared) / (size[:, None] * size)
    values, vectors = np.linalg.eigh(left) if len(left) != 1 else (left[0], np.ones((1, 1)))  # most have one
    return _own(values, vectors, size, along, own_share)


def _own(values: Array, vectors: Array, size: Array, along: Array, own_share: float) -> Added:
    """Return the directions of columns that are their own, by the eigenvalues and -vectors of what the model leaves."""
    kept = values > own_share**2
    back = vectors[:, kept] / np.sqrt(values[kept]) / size[:, None]
    return Added(back, back.T @ along, size)


def added_each(grams: Sequence[Array], shared: Array, along: Array, own_share: float = OWN_SHARE) -> list[Added]:
    """Return what each of several groups of columns explains beyond a model, none of the others in it.

    Parameters
    ----------
    grams : arrays of shape (k, k)
        Of the columns of a group.
    shared : array, shape (rank of the model, columns)
        Products of the model's orthonormal basis with the columns of all groups, one group after the other.
    along : array, shape (columns,)
        Products of the columns with the model's residual.
    own_share : float
        A direction of which the model leaves less than this share is in the model already.
    """
    if len(grams) == 1:
        return [added(grams[0], shared, along, own_share)]
    counts = np.array([len(gram) for gram in grams], dtype=np.int64)
    starts = np.cumsum(counts) - counts
    out: dict[int, Added] = {}
    for k in set(counts.tolist()):  # groups of as many columns are decomposed at once
        places = np.flatnonzero(counts == k)
        columns = starts[places, None] + np.arange(k)
        gram, beside, right = np.array([grams[i] for i in places.tolist()]), shared[:, columns], along[columns]
        size = np.sqrt(np.diagonal(gram, axis1=1, axis2=2))
        size = np.where(size > 0.0, size, 1.0)
        left = (gram - np.einsum("rgi,rgj->gij", beside, beside)) / (size[:, :, None] * size[:, None, :])
        values, vectors = np.linalg.eigh(left) if k != 1 else (left[:, 0], np.ones_like(left))  # most have one
        for i, size_i, values_i, vectors_i, right_i in zip(places.tolist(), size, values, vectors, right, strict=True):
            out[i] = _own(values_i, vectors_i, size_i, right_i, own_share)
    return [out[i] for i in range(len(grams))]

"""Prewhitening: an autoregressive model per balance turned into one sparse matrix that makes rows independent.

Within every stretch of samples the first ones use the models of lower order, so that none is lost.
Source: G. E. P. Box, G. M. Jenkins, Time Series Analysis, 1976, ch. 7; J. P. Burg 1975 for the coefficients.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.evidence.noise import burg, memory_of, schwarz, stretches

__all__ = ["Whitener", "make_whitener"]

Array = NDArray[np.float64]
MAX_ORDER = 16


@dataclass(frozen=True, eq=False)
class Whitener:
    """Rows made independent and of unit variance.

    Attributes
    ----------
    matrices : one sparse matrix per balance, shape (used samples, m)
    sigma : array, shape (channels,)
        Noise of each balance, rms, in its unit, before whitening, samples of full weight.
    index : array of int
        Thinned sample of each whitened row, all balances in order.
    """

    matrices: tuple[Any, ...]
    sigma: Array
    index: NDArray[np.int64]
    channel: NDArray[np.int64]
    memory: float

    def __call__(self, values: Array) -> Array:
        """Whiten values of shape (channels, m) or (channels, m, k) into shape (rows,) or (rows, k)."""
        return np.concatenate([matrix @ values[row] for row, matrix in enumerate(self.matrices)])

    def backward(self, row: int, values: Array) -> Array:
        """Solve with the transposed matrix of one balance, shape (used samples, k): its noise's correlation undone."""
        from scipy.linalg.lapack import dtbtrs

        solution, wrong = dtbtrs(self._bands[row], values, uplo="L", trans="T")
        if wrong:
            raise np.linalg.LinAlgError(f"the whitening matrix of balance {row} is singular")
        return solution

    @cached_property
    def _bands(self) -> tuple[Array, ...]:
        """Lower bands of the matrices over the samples that are used, as LAPACK keeps them."""
        bands = []
        for matrix in self.matrices:
            place = matrix.tocoo()
            column = np.searchsorted(np.unique(place.col), place.col)
            lag = place.row - column
            band = np.zeros((int(lag.max(initial=0)) + 1, matrix.shape[0]))
            band[lag, column] = place.data
            bands.append(band)
        return tuple(bands)


def make_whitener(
    residual: Array, weight: Array, mask: NDArray[np.bool_], rate: float, lost: int, most: int = MAX_ORDER
) -> Whitener:
    """Fit the noise of each balance to its residual.

    Parameters
    ----------
    residual, weight : array, shape (channels, m)
    mask : bool array, shape (m,)
        Samples that take part.
    rate : float
        Sampling rate of the grid, Hz.
    lost : int
        Columns that were fitted away in each balance.
    most : int
        Highest order of the autoregressive model; 0 for weights alone.
    """
    matrices, sigma, index, channel = [], [], [], []
    memory = 0.0
    for row in range(len(residual)):
        weighted = residual[row] * weight[row]
        matrix, level, used, reach = _channel(weighted, mask, weight[row], lost, rate, most)
        matrices.append(matrix)
        sigma.append(level)
        index.append(used)
        channel.append(np.full(len(used), row))
        memory = max(memory, reach)
    return Whitener(tuple(matrices), np.array(sigma), np.concatenate(index), np.concatenate(channel), memory)


def _channel(
    weighted: Array, mask: NDArray[np.bool_], weight: Array, lost: int, rate: float, most: int
) -> tuple[Any, float, NDArray[np.int64], float]:
    from scipy.sparse import csr_matrix

    parts = stretches(mask)
    pieces = [weighted[part] for part in parts]
    n = int(mask.sum())
    limit = max(0, min(most, n // 20, max(len(piece) for piece in pieces) // 3))
    models, variances = burg(pieces, limit)
    best = schwarz(variances, n)
    inflate = n / max(n - lost, n // 4)
    scales = 1.0 / np.sqrt(np.maximum(np.asarray(variances) * inflate, 1e-300))
    filters = [scales[order] * np.concatenate([[1.0], models[order]]) for order in range(best + 1)]
    rows, cols, data = [], [], []
    base = 0
    for part in parts:
        length = part.stop - part.start
        for order in range(min(best, length)):
            rows.append(np.full(order + 1, base + order))
            cols.append(part.start + np.arange(order, -1, -1))
            data.append(filters[order])
        steady = np.arange(best, length)
        for lag, coefficient in enumerate(filters[best]):
            rows.append(base + steady)
            cols.append(part.start + steady - lag)
            data.append(np.full(len(steady), coefficient))
        base += length
    used = np.flatnonzero(mask)
    place = np.concatenate(cols)
    values = np.concatenate(data) * weight[place]
    matrix = csr_matrix((values, (np.concatenate(rows), place)), shape=(len(used), len(mask)))
    level = float(np.sqrt(variances[0] * inflate))
    return matrix, level, used, memory_of(models[best], rate)

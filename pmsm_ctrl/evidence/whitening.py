"""Prewhitening: an autoregressive model of each channel's noise as a filter that makes samples independent.

Within every stretch of samples the first ones use the models of lower order, so that none is lost.
Source: G. E. P. Box, G. M. Jenkins, Time Series Analysis, 1976, ch. 7; J. P. Burg 1975 for the coefficients.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.evidence.noise import burg, memory_of, schwarz, stretches

__all__ = ["ChannelWhitener", "Whitener", "channel_whitener", "inflation", "make_whitener"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MAX_ORDER = 16  # of the autoregressive model
SAMPLES_PER_ORDER = 20  # fewer do not carry one more coefficient
STRETCH_PER_ORDER = 3  # samples of the longest stretch for each order
# Share of the samples that always counts as free, however many columns were fitted away.
LEAST_FREE = 0.25
SMALLEST_VARIANCE = 1e-300  # a residual of zeros has a level all the same


@dataclass(frozen=True, eq=False)
class ChannelWhitener:
    """Samples of one channel made independent and of unit variance.

    Attributes
    ----------
    weight : array, shape (n,)
        Relative inverse noise level of each sample that is used.
    position : int array, shape (n,)
        Number of samples before each one in its stretch.
    filters : array, shape (order + 1, order + 1)
        Row o holds the coefficients, lags 0 to o, for a sample with o others before it.
    sigma : float
        Noise of a sample of full weight, rms, in the channel's unit.
    model : array, shape (order,)
        Of the noise, autoregressive.
    rate : float
        Of the samples, Hz.
    """

    weight: Array
    position: NDArray[np.int64]
    filters: Array
    sigma: float
    model: Array
    rate: float

    # Few of those that are made are asked for it.
    @cached_property
    def memory(self) -> float:
        """Time after which the noise has forgotten all but 5 % of itself, s."""
        return memory_of(self.model, self.rate)

    @property
    def scale(self) -> Array:
        """Inverse standard deviation of each sample, its correlation aside, shape (n,)."""
        return self.weight / self.sigma

    def __call__(self, rows: Array) -> Array:
        """Whiten rows of shape (k, n)."""
        return self._whitened(np.array(rows, dtype=np.float64, order="C"))

    def _whitened(self, weighted: Array) -> Array:
        """Whiten rows of an array that is overwritten."""
        from pmsm_ctrl.kernels.filters import whitened

        weighted *= self.weight
        if len(self.filters) == 1:
            weighted *= self.filters[0, 0]
            return weighted
        out = np.empty_like(weighted)
        whitened(weighted, self.position, self.filters, out)
        return out

    def transposed_solve(self, rows: Array) -> Array:
        """Solve with the transposed whitening matrix, shape (k, n): ``x x'`` is then the noise's covariance of rows."""
        from pmsm_ctrl.kernels.filters import coloured_back

        scaled = np.ascontiguousarray(rows / self.weight)
        out = np.empty_like(scaled)
        coloured_back(scaled, self.position, self.filters, out)
        return out


@dataclass(frozen=True, eq=False)
class Whitener:
    """Rows of all channels made independent and of unit variance; all channels use the same samples.

    Attributes
    ----------
    used : int array, shape (n,)
        Samples that take part.
    channels : tuple of ChannelWhitener
    """

    used: NDArray[np.int64]
    channels: tuple[ChannelWhitener, ...]

    @property
    def sigma(self) -> Array:
        """Noise of each channel, rms, in its unit, before whitening, samples of full weight, shape (channels,)."""
        return np.array([one.sigma for one in self.channels])

    @property
    def memory(self) -> float:
        """Longest memory of the channels, s."""
        return max(one.memory for one in self.channels)

    @property
    def channel(self) -> NDArray[np.int64]:
        """Channel of each whitened row, all channels in order, shape (rows,)."""
        return np.repeat(np.arange(len(self.channels)), len(self.used))

    def part(self, row: int, values: Array) -> Array:
        """Whiten signals of one channel.

        Parameters
        ----------
        row : int
            The channel.
        values : array, shape (m,) or (k, m)
            All samples.

        Returns
        -------
        array, shape (n,) or (k, n)
        """
        rows = np.take(values, self.used, axis=-1).astype(np.float64, copy=False)
        return self.channels[row]._whitened(np.atleast_2d(rows)).reshape(rows.shape)

    def __call__(self, values: Array) -> Array:
        """Whiten values of shape (channels, m) or (channels, m, k) into shape (rows,) or (rows, k)."""
        return np.concatenate([self.part(row, values[row].T).T for row in range(len(self.channels))])


def make_whitener(
    residual: Array, weight: Array, mask: Mask, rate: float, rank: int, most: int = MAX_ORDER
) -> Whitener:
    """Fit the noise of each channel to its residual.

    Parameters
    ----------
    residual, weight : array, shape (channels, m)
    mask : bool array, shape (m,)
        Samples that take part.
    rate : float
        Sampling rate of the grid, Hz.
    rank : int
        Rank of the columns fitted in each channel.
    most : int
        Highest order of the autoregressive model; 0 for weights alone.
    """
    parts = stretches(mask)
    channels = [
        channel_whitener(one * one_weight, one_weight, mask, rate, rank, most, parts)
        for one, one_weight in zip(residual, weight, strict=True)
    ]
    return Whitener(np.flatnonzero(mask), tuple(channels))


def channel_whitener(
    weighted: Array, weight: Array, mask: Mask, rate: float, rank: int, most: int = MAX_ORDER,
    parts: Sequence[slice] | None = None,
) -> ChannelWhitener:  # fmt: skip
    """Fit the noise of one channel.

    Parameters
    ----------
    weighted, weight : array, shape (m,)
        The residual times its weight, and the weight.
    mask : bool array, shape (m,)
    rate : float
        Sampling rate of the grid, Hz.
    rank : int
        Rank of the fitted columns: the noise level is corrected for the degrees of freedom that they take.
    most : int
        Highest order of the autoregressive model; 0 for weights alone.
    parts : sequence of slice, optional
        The stretches of the mask, where they are known.
    """
    parts = stretches(mask) if parts is None else parts
    pieces = [weighted[part] for part in parts]
    lengths = np.array([len(piece) for piece in pieces])
    n = int(mask.sum())
    limit = max(0, min(most, n // SAMPLES_PER_ORDER, int(lengths.max()) // STRETCH_PER_ORDER))
    models, variances = burg(pieces, limit)
    variances = np.maximum(np.asarray(variances) * inflation(n, rank), SMALLEST_VARIANCE)
    best = schwarz(variances, n)
    filters = np.zeros((best + 1, best + 1))
    for order in range(best + 1):
        filters[order, : order + 1] = np.concatenate([[1.0], models[order]]) / np.sqrt(variances[order])
    position = np.arange(n) - np.repeat(np.cumsum(lengths) - lengths, lengths)
    sigma = float(np.sqrt(variances[0]))
    return ChannelWhitener(weight[mask], position, filters, sigma, models[best], rate)


def inflation(n: int, rank: int) -> float:
    """Return the variance of the noise over that of the residual of a fit.

    Parameters
    ----------
    n, rank : int
        Samples, and rank of the fitted columns.
    """
    return n / max(n - rank, int(LEAST_FREE * n), 1)

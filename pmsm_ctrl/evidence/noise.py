"""Correlated residuals: an autoregressive model, and standard errors of least squares that allow for it.

The point estimates stay those of ordinary least squares, because whitening shifts the weight to high frequencies,
where differentiation and timing errors are large. Only the standard errors use the noise model: with the residual's
autocorrelation matrix R, ``cov = s^2 (X'X)^-1 X'R X (X'X)^-1`` and ``s^2 = e'e / tr(M R)``, M the projection that
made the residual. Unlike a Newey-West kernel this does not cut a long memory short, and gaps of the mask are exact.

Sources: J. P. Burg, Maximum Entropy Spectral Analysis, 1975 (coefficients, over separate stretches);
G. Schwarz, Annals of Statistics 6 (1978) 461 (order);
F. E. Satterthwaite, Biometrics Bulletin 2 (1946) 110 (degrees of freedom).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "NoiseModel",
    "SampleMean",
    "autocorrelation",
    "burg",
    "degrees_of_freedom",
    "fit_noise",
    "mean_of",
    "memory_of",
    "schwarz",
    "stretches",
]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# Correlation below which noise has forgotten itself, and for how long it is followed, s.
FORGOTTEN, LONGEST_MEMORY = 0.05, 2.0
# Highest order of an autoregressive model, of the noise of a mean, and the samples that carry one coefficient.
MOST_ORDER, MOST_ORDER_OF_A_MEAN, SAMPLES_PER_ORDER = 30, 10, 10
# Shares of the bias that are tried: the first that leaves the model stable.
CORRECTIONS = (1.0, 0.5, 0.25)


@dataclass(frozen=True, eq=False)
class NoiseModel:
    """Autoregressive model ``e[k] + a[0] e[k-1] + ... = white`` of a residual.

    Attributes
    ----------
    a : array, shape (order,)
    variance : float
        Of the white input, in the residual's unit squared.
    correlation : array, shape (n,)
        Autocorrelation at lags 0 to n-1.
    """

    a: Array
    variance: float
    correlation: Array

    @property
    def order(self) -> int:
        """Order of the model."""
        return len(self.a)

    def toeplitz(self, columns: Array) -> Array:
        """Return R times columns of shape (n, m), R the autocorrelation matrix."""
        from scipy.fft import next_fast_len

        n = len(columns)
        size = next_fast_len(2 * n, real=True)
        row = np.concatenate([self.correlation[:n], np.zeros(size - 2 * n + 1), self.correlation[1:n][::-1]])
        spectrum = np.fft.rfft(row)[:, None]
        return np.fft.irfft(spectrum * np.fft.rfft(columns, size, axis=0), size, axis=0)[:n]


def stretches(mask: Mask) -> list[slice]:
    """Return the contiguous stretches of a mask as slices."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return [slice(int(start), int(stop)) for start, stop in zip(edges[::2], edges[1::2], strict=True)]


def burg(pieces: list[Array], order: int) -> tuple[list[Array], Array]:
    """Fit autoregressive models of all orders up to `order` to separate stretches of one process.

    Returns
    -------
    models : list of arrays, model k has shape (k,)
    variances : array, shape (order + 1,)
        Prediction error variance per order.
    """
    from pmsm_ctrl.kernels.filters import reflections

    values = np.concatenate(pieces)
    found = np.empty(order)
    reflections(values, np.array([len(piece) for piece in pieces]), found)
    a, variance = np.zeros(0), float(values @ values) / len(values)
    models, variances = [a], [variance]
    for k in found.tolist():
        a = np.concatenate([a + k * a[::-1], [k]])
        variance *= 1.0 - k * k
        models.append(a)
        variances.append(variance)
    return models, np.array(variances)


def schwarz(variances: Array, n: int) -> int:
    """Return the order, out of 0, 1, ..., that Schwarz' criterion takes for n samples."""
    return int(np.argmin(n * np.log(np.maximum(variances, 1e-300)) + np.arange(len(variances)) * np.log(n)))


def memory_of(a: Array, rate: float) -> float:
    """Return the time after which an autoregressive process has forgotten all but 5 % of itself, s."""
    if len(a) == 0:
        return 1.0 / rate
    above = np.flatnonzero(np.abs(autocorrelation(a, int(LONGEST_MEMORY * rate) + 2)) > FORGOTTEN)
    return float((above[-1] + 1) / rate)


def autocorrelation(a: Array, n: int) -> Array:
    """Return the autocorrelation of an autoregressive process at lags 0 to n-1, shape (n,)."""
    size = 1 << max(12, int(np.ceil(np.log2(4 * n))))
    response = np.fft.rfft(np.concatenate([[1.0], a]), size)
    power = np.fft.irfft(1.0 / np.maximum(np.abs(response) ** 2, 1e-300), size)
    return np.asarray(power[:n] / power[0])


def fit_noise(
    residual: Array, mask: Mask | None = None, max_order: int | None = None, basis: Array | None = None
) -> NoiseModel:
    """Fit an autoregressive model to a residual, its order chosen by Schwarz' criterion.

    Parameters
    ----------
    residual : array, shape (n,)
    mask : bool array, shape (n,), optional
        Samples that take part; only neighbours in time form a pair.
    max_order : int, optional
        Default: 30, or less for short residuals.
    basis : array, shape (n, m), optional
        Orthonormal columns that were fitted away (zero where masked). A residual is less correlated than the
        noise it came from; with the basis that loss is corrected.
    """
    mask = np.ones(len(residual), dtype=bool) if mask is None else mask
    pieces = [residual[piece] for piece in stretches(mask)]
    n = int(mask.sum())
    limit = max_order if max_order is not None else min(MOST_ORDER, n // SAMPLES_PER_ORDER)
    limit = max(0, min(limit, max(len(piece) for piece in pieces) // 3))
    models, variances = burg(pieces, limit)
    if variances[0] <= 0.0:
        return NoiseModel(np.zeros(0), 0.0, np.eye(1, len(residual))[0])
    best = schwarz(variances, n)
    model = NoiseModel(models[best], float(variances[best]), autocorrelation(models[best], len(residual)))
    return model if basis is None or best == 0 else _corrected(model, mask, basis)


def _corrected(model: NoiseModel, mask: Mask, basis: Array) -> NoiseModel:
    """Undo the loss of correlation that fitting the basis away caused, to first order.

    Were the model true, the residual would have the correlation M R M. The coefficients one would find from that,
    less the model's own, are the bias; it is subtracted as far as the model stays stable.
    """
    from scipy.linalg import solve_toeplitz

    n, order = len(mask), model.order
    smooth = model.toeplitz(basis)  # R U
    core = basis.T @ smooth  # U'RU
    inside = smooth * mask[:, None]  # of a pair both take part; the basis is zero where one does not
    left = inside - basis @ core
    counted = mask.astype(np.float64)
    seen = np.zeros(order + 1)
    for lag in range(order + 1):
        loss = np.vdot(basis[: n - lag], inside[lag:]) + np.vdot(left[: n - lag], basis[lag:])
        seen[lag] = model.correlation[lag] - loss / max(float(counted[: n - lag] @ counted[lag:]), 1.0)
    bias = -solve_toeplitz(seen[:-1], seen[1:]) - model.a
    for share in CORRECTIONS:
        a = model.a - share * bias
        if np.max(np.abs(np.roots(np.concatenate([[1.0], a])))) < 1.0 - 1.0 / n:
            return NoiseModel(a, model.variance, autocorrelation(a, n))
    return model


def degrees_of_freedom(noise: NoiseModel, free: float, n: int) -> float:
    """Return the effective degrees of freedom of a variance computed with a noise model.

    Satterthwaite's figure for the spread, ``free`` = tr(M R), lessened by the uncertainty of the model itself: an
    autoregressive spectrum of order p has the relative variance 4 p / n at low frequency (K. N. Berk, Annals of
    Statistics 2 (1974) 489), and a chi-square with nu degrees of freedom 2 / nu.
    """
    spread = max(1.0, free / float(2.0 * np.sum(noise.correlation**2) - 1.0))
    return max(1.0, 1.0 / (1.0 / spread + 2.0 * noise.order / n))


@dataclass(frozen=True)
class SampleMean:
    """Mean of a correlated record with its standard error and the degrees of freedom of that error."""

    value: float
    stderr: float
    dof: float


def mean_of(values: Array) -> SampleMean:
    """Return the mean of a correlated record, shape (n,), with a standard error that allows for the correlation."""
    n = len(values)
    mean = float(np.mean(values))
    residual = values - mean
    noise = fit_noise(
        residual, max_order=min(MOST_ORDER_OF_A_MEAN, n // SAMPLES_PER_ORDER), basis=np.full((n, 1), n**-0.5)
    )
    if noise.variance <= 0.0:
        return SampleMean(mean, 0.0, float("inf"))
    # R of a shorter memory than the record: the mean's variance is 1'R1 / n^2
    ones = float(np.sum(noise.toeplitz(np.ones((n, 1))))) / n
    spread = float(residual @ residual) / max(n - ones, 1.0)
    return SampleMean(mean, float(np.sqrt(spread * ones / n)), degrees_of_freedom(noise, n - ones, n))

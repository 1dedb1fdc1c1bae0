"""Standard errors of a fit by weighted least squares that allow for the noise's correlation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.evidence.blocks import block_sums, no_smaller_than_by_blocks
from pmsm_ctrl.evidence.whitening import Whitener
from pmsm_ctrl.regression.model import Solved

__all__ = ["NoiseCovariance", "basis_rows", "noise_covariance", "with_honest_errors"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class NoiseCovariance:
    """Covariance of sums of weighted rows under the noise's correlation, for a fit by weighted least squares.

    With the weights V and the prewhitener W (W'W the inverse covariance) the estimate is ``P V y`` and its
    covariance ``P V (W'W)^-1 V' P'``; priors add their own unit variance.

    Attributes
    ----------
    fit : Solved
        By weighted least squares.
    weights, whitener : Whitener
    bases : arrays of shape (p, n)
        ``V' W^-T`` times the fit's basis of each balance.
    """

    fit: Solved
    weights: Whitener
    whitener: Whitener
    bases: tuple[Array, ...]

    def rows(self, row: int, weighted: Array) -> Array:
        """Return ``W^-T V`` times weighted rows of one balance, shape (k, n)."""
        return self.whitener.channels[row].transposed_solve(weighted * self.weights.channels[row].scale)

    def of_fit(self) -> Array:
        """Covariance of the fit's values, shape (k, k), no smaller than what blocks of the record differ by."""
        covariance = no_smaller_than_by_blocks(self.of_noise(), *self._by_blocks())
        for k, size in self.fit.model.bias.items():
            covariance[k, k] += size**2
        return covariance

    def _by_blocks(self) -> tuple[Array, Array]:
        """Return what blocks of the record contribute to the fit's values, and the variances that the priors add."""
        fit, used = self.fit, self.weights.used
        place = np.tile((used - used[0]) / max(float(used[-1] - used[0]), 1.0), len(fit.bases))
        changes = block_sums(partial(basis_rows, fit), fit.rest[: fit.rows], place) @ fit.inverse.T
        prior = fit.inverse @ (fit.mixing[fit.parts[-1].stop :] * fit.model.prior_doubt[:, None]).T
        return changes, np.asarray(np.sum(prior**2, axis=1))

    def of_noise(self) -> Array:
        """Covariance of the fit's values by the model of the noise alone, shape (k, k)."""
        mixing = self.fit.mixing
        prior = mixing[self.fit.parts[-1].stop :] * self.fit.model.prior_doubt[:, None]
        core = prior.T @ prior
        for basis, part in zip(self.bases, self.fit.parts, strict=True):
            core += mixing[part].T @ (basis @ basis.T) @ mixing[part]
        return self.fit.inverse @ core @ self.fit.inverse.T

    def of_added(self, own: Mapping[int, Array], shared: Array, back: Array) -> Array:
        """Covariance of the residual along what columns have beyond the fit, shape (rank, rank).

        Parameters
        ----------
        own : dict of balance to array, shape (k, n)
            The columns, weighted, in the balances they enter.
        shared : array, shape (rank of the fit, k)
            Products of the fit's basis with them.
        back : array, shape (k, rank)
            From the columns to their own directions.
        """
        mixed = self.fit.mixing @ (shared @ back)
        prior = mixed[self.fit.parts[-1].stop :] * self.fit.model.prior_doubt[:, None]
        covariance = prior.T @ prior
        for row, (basis, part) in enumerate(zip(self.bases, self.fit.parts, strict=True)):
            if row in own:
                left = back.T @ self.rows(row, own[row]) - mixed[part].T @ basis
                covariance += left @ left.T
            else:
                covariance += mixed[part].T @ (basis @ basis.T) @ mixed[part]
        return covariance


def basis_rows(fit: Solved, which: NDArray[np.int64]) -> Array:
    """Return rows of the orthonormal basis of a fit's whitened columns, shape (n, rank).

    Parameters
    ----------
    fit : Solved
    which : int array, shape (n,)
        Increasing, of all balances one after the other, without the priors.
    """
    out, n = [], fit.bases[0].shape[1]
    for k, (basis, part) in enumerate(zip(fit.bases, fit.parts, strict=True)):
        start, end = np.searchsorted(which, [k * n, (k + 1) * n])
        out.append(np.take(basis, which[start:end] - k * n, axis=1).T @ fit.mixing[part])
    return np.vstack(out)


def noise_covariance(fit: Solved, weights: Whitener, whitener: Whitener) -> NoiseCovariance:
    """Return the covariance of sums of weighted rows.

    Parameters
    ----------
    fit : Solved
        By the weights.
    weights, whitener : Whitener
    """
    made = NoiseCovariance(fit, weights, whitener, ())
    return replace(made, bases=tuple(made.rows(row, basis) for row, basis in enumerate(fit.bases)))


def with_honest_errors(covariance: NoiseCovariance) -> Solved:
    """Return a fit by weighted least squares with standard errors that allow for the noise's correlation.

    Parameters held at a bound have none.
    """
    stderr = np.sqrt(np.maximum(np.diag(covariance.of_fit()), 0.0))
    stderr[list(covariance.fit.held)] = np.nan
    return replace(covariance.fit, stderr=stderr)

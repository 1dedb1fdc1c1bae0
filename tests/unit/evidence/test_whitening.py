"""Whitening filters against the process they were fitted to."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from pmsm_ctrl.evidence.noise import burg, stretches
from pmsm_ctrl.evidence.whitening import channel_whitener, inflation, make_whitener


def _process(rng: np.random.Generator, n: int) -> np.ndarray:
    return lfilter([1.0], [1.0, -1.2, 0.5], rng.standard_normal(n + 500))[500:]


def test_rows_become_independent_and_of_unit_variance(rng: np.random.Generator) -> None:
    n = 20000
    mask = np.ones(n, dtype=bool)
    mask[3000:3050] = mask[7001:7003] = False
    weight = np.where(np.arange(n) < 10000, 1.0, 0.25)
    residual = np.array([3.0 * _process(rng, n) / weight])
    whitener = make_whitener(residual, weight[None], mask, 100.0, 0)
    rows = whitener(residual)
    assert rows.std() == pytest.approx(1.0, abs=0.02)
    for lag in (1, 2, 3):
        assert abs(np.corrcoef(rows[lag:], rows[:-lag])[0, 1]) < 0.03
    # variance of this process: (1 + a2) / ((1 - a2) ((1 + a2)^2 - a1^2)), a1 = -1.2, a2 = 0.5
    assert whitener.sigma[0] == pytest.approx(3.0 * np.sqrt(1.5 / (0.5 * (1.5**2 - 1.2**2))), rel=0.05)


def test_transposed_solve_gives_the_covariance_of_sums(rng: np.random.Generator) -> None:
    """x'x of the solution is the variance of a sum of rows: the noise's own autocovariance says the same."""
    n = 4000
    one = channel_whitener(_process(rng, n), np.ones(n), np.ones(n, dtype=bool), 100.0, 0, 2)
    sums = rng.standard_normal((2, 300))
    padded = np.zeros((2, n))
    padded[:, 2000:2300] = sums
    solved = one.transposed_solve(padded)
    response = 1.0 / np.abs(np.fft.rfft(one.filters[-1], 8192)) ** 2
    covariance = np.fft.irfft(response)[:300]
    toeplitz = covariance[np.abs(np.arange(300)[:, None] - np.arange(300))]
    assert solved @ solved.T == pytest.approx(sums @ toeplitz @ sums.T, rel=1e-6)


def test_burg_finds_the_process_over_separate_stretches(rng: np.random.Generator) -> None:
    x = _process(rng, 60000)
    mask = rng.uniform(size=x.size) > 0.002
    models, variances = burg([x[piece] for piece in stretches(mask)], 4)
    assert models[2] == pytest.approx([-1.2, 0.5], abs=0.02)
    assert variances[4] == pytest.approx(1.0, abs=0.03)
    assert np.all(np.diff(variances) <= 0.0)


@pytest.mark.parametrize(("n", "rank", "factor"), [(100, 20, 1.25), (100, 90, 4.0), (3, 5, 3.0), (1, 0, 1.0)])
def test_the_noise_of_few_samples_has_a_finite_level(n: int, rank: int, factor: float) -> None:
    assert inflation(n, rank) == pytest.approx(factor)

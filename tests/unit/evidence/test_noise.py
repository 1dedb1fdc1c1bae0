"""Standard errors with correlated residuals: coverage over hundreds of seeds, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import toeplitz
from scipy.signal import lfilter
from scipy.stats import binom

from pmsm_ctrl.evidence.noise import autocorrelation, burg, fit_noise, mean_of, stretches
from pmsm_ctrl.regression.inverse_dynamics import Column, Problem
from pmsm_ctrl.regression.least_squares import solve, t_quantile
from tests.effort import amount, slow


def ar1(rng: np.random.Generator, n: int, rho: float) -> np.ndarray:
    return lfilter([1.0], [1.0, -rho], rng.normal(size=n + 500))[500:]


def problem(target: np.ndarray, matrix: np.ndarray, mask: np.ndarray | None = None) -> Problem:
    n = len(target)
    columns = tuple(Column(f"b{k}", matrix[:, k], "N m", 100.0) for k in range(matrix.shape[1]))
    keep = np.ones(n, dtype=bool) if mask is None else mask
    return Problem(target, columns, keep, np.arange(n) * 0.01, target, target, "N m", 100.0, 40.0)


def test_autocorrelation_of_ar1_is_a_power_of_rho() -> None:
    np.testing.assert_allclose(autocorrelation(np.array([-0.9]), 50), 0.9 ** np.arange(50), rtol=1e-9)


def test_autocorrelation_of_ar2_satisfies_yule_walker() -> None:
    # Box and Jenkins: rho_1 = phi_1 / (1 - phi_2), rho_2 = phi_1 rho_1 + phi_2
    rho = autocorrelation(np.array([-1.2, 0.7]), 3)
    assert rho[1] == pytest.approx(1.2 / 1.7, rel=1e-9)
    assert rho[2] == pytest.approx(1.2 * 1.2 / 1.7 - 0.7, rel=1e-9)


def test_burg_finds_a_process_from_pieces() -> None:
    rng = np.random.default_rng(1)
    pieces = [lfilter([1.0], [1.0, -1.2, 0.7], rng.normal(size=4000))[200:] for _ in range(5)]
    models, variances = burg(pieces, 4)
    np.testing.assert_allclose(models[2], [-1.2, 0.7], atol=0.02)
    assert variances[2] == pytest.approx(1.0, rel=0.05)


def test_stretches() -> None:
    assert stretches(np.array([True, True, False, True, False])) == [slice(0, 2), slice(3, 4)]
    assert stretches(np.zeros(3, dtype=bool)) == []


def test_toeplitz_product_against_scipy() -> None:
    rng = np.random.default_rng(2)
    noise = fit_noise(ar1(rng, 400, 0.8))
    x = rng.normal(size=(400, 3))
    np.testing.assert_allclose(noise.toeplitz(x), toeplitz(noise.correlation) @ x, atol=1e-9)


def assert_covers(hits: np.ndarray, seeds: int) -> None:
    """Hold coverages of 95 % intervals: 92 to 98 % of 400 seeds and more, what chance allows of fewer."""
    low, high = (0.92, 0.98) if seeds >= 400 else binom.ppf([5e-4, 1.0 - 5e-4], seeds, 0.95) / seeds
    assert ((hits / seeds >= low) & (hits / seeds <= high)).all(), hits / seeds


def test_what_was_fitted_is_given_back_as_written_with_whole_matrices() -> None:
    """The residual of a model with correlation R has M R M; its coefficients, less the model's own, are subtracted."""
    n, t = 300, np.arange(300)
    mask = (t < 120) | (t >= 150)
    columns = np.column_stack([np.ones(n), np.sin(t / 40.0), np.where(t < 200, 1.0, -1.0)]) * mask[:, None]
    basis = np.linalg.qr(columns)[0] * mask[:, None]
    residual = ar1(np.random.default_rng(3), n, 0.6) * mask
    residual -= basis @ (basis.T @ residual)
    plain = fit_noise(residual, mask, max_order=2)
    correlation, fitted = toeplitz(plain.correlation), basis @ basis.T
    left = (np.eye(n) - fitted) @ correlation @ (np.eye(n) - fitted)
    pairs = [mask[: n - lag] & mask[lag:] for lag in range(plain.order + 1)]
    seen = np.array([np.mean(np.diagonal(left, lag)[pair]) for lag, pair in enumerate(pairs)])
    bias = -np.linalg.solve(toeplitz(seen[:-1]), seen[1:]) - plain.a
    assert np.abs(bias).max() > 0.01
    assert fit_noise(residual, mask, max_order=2, basis=basis).a == pytest.approx(plain.a - bias, rel=1e-9)


@pytest.mark.parametrize(("rho", "n"), [(0.0, 300), (0.5, 500), (0.9, 1500), slow(0.97, 5000)])
def test_95_percent_intervals_cover(rho: float, n: int) -> None:
    t = np.arange(n) * 0.01
    speed = np.sin(0.8 * t) + 0.4 * np.sin(2.9 * t)
    matrix = np.column_stack([np.gradient(speed, t), speed, np.sign(speed), np.ones(n)])
    truth = np.array([0.5, -0.3, 1.0, 0.2])
    hits, seeds = np.zeros(4), amount(100, 400)
    for seed in range(seeds):
        fit = solve(problem(matrix @ truth + ar1(np.random.default_rng(seed), n, rho), matrix))
        for k in range(4):
            low, high = fit.interval(f"b{k}")
            hits[k] += low <= truth[k] <= high
    assert_covers(hits, seeds)


def test_intervals_cover_with_gaps() -> None:
    n, hits, seeds = 1500, np.zeros(2), amount(100, 400)
    t = np.arange(n) * 0.01
    matrix = np.column_stack([np.sin(0.7 * t), np.ones(n)])
    mask = (np.arange(n) % 200) > 40
    for seed in range(seeds):
        fit = solve(problem(ar1(np.random.default_rng(seed), n, 0.9), matrix, mask))
        hits += [fit.interval(f"b{k}")[0] <= 0.0 <= fit.interval(f"b{k}")[1] for k in range(2)]
    assert_covers(hits, seeds)


def test_naive_standard_errors_would_not_cover() -> None:
    # The reason for the noise model: with rho = 0.9 the textbook error of a mean is 4.4 times too small.
    rng = np.random.default_rng(3)
    values = ar1(rng, 20000, 0.9)
    mean = mean_of(values)
    naive = float(np.std(values, ddof=1)) / np.sqrt(len(values))
    assert mean.stderr / naive == pytest.approx(np.sqrt(1.9 / 0.1), rel=0.1)
    assert mean.stderr == pytest.approx(1.0 / 0.1 / np.sqrt(len(values)), rel=0.1)


def test_mean_of_a_constant_is_exact() -> None:
    mean = mean_of(np.full(50, 3.0))
    assert (mean.value, mean.stderr) == (3.0, 0.0)


@pytest.mark.parametrize(("rho", "n"), [(0.0, 100), (0.6, 150)])
def test_mean_covers_on_short_records(rho: float, n: int) -> None:
    hits, seeds = 0, amount(200, 600)
    for seed in range(seeds):
        mean = mean_of(ar1(np.random.default_rng(seed), n, rho))
        hits += abs(mean.value) <= t_quantile(0.95, mean.dof) * mean.stderr
    assert_covers(np.array([hits]), seeds)


def test_t_quantiles_of_the_tables() -> None:
    assert t_quantile(0.95, 5) == pytest.approx(2.570582, rel=1e-6)
    assert t_quantile(0.95, float("inf")) == pytest.approx(1.959964, rel=1e-6)

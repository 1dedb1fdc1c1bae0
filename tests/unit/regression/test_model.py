"""The base model's solution against the normal equations with priors, and its standard errors in coloured noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from pmsm_ctrl.design import Design
from pmsm_ctrl.evidence.whitening import Whitener, make_whitener
from pmsm_ctrl.regression.balances import Record, make_record
from pmsm_ctrl.regression.model import Model, Solved, base_groups, noise_covariance, solve_model, with_honest_errors
from pmsm_ctrl.simulate import scenario, simulate


@pytest.fixture(scope="module")
def seed_motor(designs) -> Design:
    return Design.read(designs / "seed_motor.toml")


@pytest.fixture(scope="module")
def record(seed_motor: Design) -> Record:
    truth = seed_motor.with_effect("constant_load", {"T_0": 0.004})
    motion = scenario("identification", seed_motor, duration=10.0)
    return make_record(seed_motor, simulate(seed_motor, motion, truth=truth, seed=1))


@pytest.fixture(scope="module")
def model(seed_motor: Design, record: Record) -> Model:
    return base_groups(seed_motor, record)[0]


@pytest.fixture(scope="module")
def weights(record: Record) -> Whitener:
    return make_whitener(record.target, record.weight, record.mask, record.rate, 0, 0)


@pytest.fixture(scope="module")
def solved(record: Record, model: Model, weights: Whitener) -> Solved:
    return solve_model(record, model, weights)


def test_the_solution_is_that_of_the_normal_equations_with_priors(
    record: Record, model: Model, weights: Whitener, solved: Solved
) -> None:
    """``(X'X + diag(1/sigma^2)) b = X'y + nominal/sigma^2``, rows of unit variance."""
    known = np.isfinite(model.sigma)
    x, y = weights(model.matrix), weights(record.target)
    there = known | (np.linalg.norm(x, axis=0) > 0.0)  # what this log does not excite at all is left at zero
    assert known.any()
    assert (there & ~known).any()
    assert solved.values[~there] == pytest.approx(0.0, abs=1e-12)
    scale = np.linalg.norm(x, axis=0)
    scale = np.where(known, 1.0 / model.sigma + scale, scale)[there]
    x, sure, nominal = (
        x[:, there] / scale,
        (np.where(known, 1.0 / model.sigma, 0.0)[there] / scale),
        model.nominal[there],
    )
    normal = x.T @ x + np.diag(sure**2)
    expected = np.linalg.solve(normal, x.T @ y + sure**2 * nominal * scale)
    errors = np.sqrt(np.diag(np.linalg.inv(normal)))
    assert np.abs(solved.values[there] * scale - expected) == pytest.approx(0.0, abs=1e-4 * errors.min())
    assert solved.stderr[there] * scale == pytest.approx(errors, rel=1e-5)
    left = np.concatenate([y - x @ expected, (sure * (nominal * scale - expected))[known[there]]])
    assert solved.chi2 == pytest.approx(left @ left, rel=1e-9)


def test_standard_errors_allow_for_the_noises_correlation(record: Record, model: Model) -> None:
    """Autoregressive noise (0.9) in place of the balances: estimates scatter by their standard errors."""
    rng = np.random.default_rng(4)
    there = np.any(model.matrix, axis=(0, 1))
    free = replace(model, nominal=0.0 * model.nominal, sigma=np.where(there, np.inf, 1.0))
    honest, naive = [], []
    for _ in range(12):
        noise = np.array([lfilter([1.0], [1.0, -0.9], rng.standard_normal(record.target.shape[1])) for _ in range(3)])
        drawn = replace(record, target=noise / np.maximum(record.weight, 1e-3))
        given = drawn.target, drawn.weight, drawn.mask, drawn.rate, 0
        whitener, weights = make_whitener(*given), make_whitener(*given, 0)
        plain = solve_model(drawn, free, weights)
        found = with_honest_errors(noise_covariance(plain, weights, whitener))
        honest.append((found.values / found.stderr)[there])
        naive.append((plain.values / plain.stderr)[there])
    # 12 draws of a dozen parameters: the mean of their squares is known to 12 %, were they independent
    assert 0.7 < np.mean(np.square(honest)) < 1.4
    assert np.mean(np.square(naive)) > 2.0

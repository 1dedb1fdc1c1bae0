"""The base model's solution against the normal equations with priors."""

from __future__ import annotations

import numpy as np
import pytest

from pmsm_ctrl.design import Design
from pmsm_ctrl.evidence.whitening import Whitener, make_whitener
from pmsm_ctrl.regression.balances import Record, make_record
from pmsm_ctrl.regression.model import Model, Solved, base_groups, solve_model
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

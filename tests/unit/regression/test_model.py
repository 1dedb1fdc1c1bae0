"""A model solved on the factors of each balance against tall solves over all of them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.linalg import block_diag

from pmsm_ctrl.effects.catalogue import CATALOGUE
from pmsm_ctrl.evidence.linalg import added
from pmsm_ctrl.evidence.whitening import Whitener, make_whitener
from pmsm_ctrl.regression.bounds import bounded, holding
from pmsm_ctrl.regression.columns import Group
from pmsm_ctrl.regression.covariance import basis_rows, noise_covariance, with_honest_errors
from pmsm_ctrl.regression.model import Model, Solved, solve_model
from pmsm_ctrl.regression.saturated import _responses_to

CHANNELS, M = 2, 400


@pytest.fixture
def case(rng: np.random.Generator) -> tuple[Any, Model, Whitener, Whitener]:
    matrix = rng.standard_normal((CHANNELS, M, 4)) * [1.0, 1e3, 1e-4, 1.0]
    matrix[0, :, 3] = 0.0
    matrix[1, :, 0] = 0.0
    noise = np.cumsum(rng.standard_normal((CHANNELS, M)), axis=1) * 0.1
    target = matrix @ [1.0, 1e-3, 1e4, -1.0] + noise
    mask = np.ones(M, dtype=bool)
    mask[150:170] = False
    weight = rng.uniform(0.3, 1.0, (CHANNELS, M))
    model = Model(
        (), ("a", "b", "c", "d"), np.array([1.1, 0.0, 9e3, 0.0]), np.array([0.01, np.inf, 1e3, np.inf]), matrix
    )
    fitted = noise, weight, mask, 100.0, 4
    return SimpleNamespace(target=target), model, make_whitener(*fitted), make_whitener(*fitted, 0)


def _tall(record: Any, model: Model, whitener: Whitener) -> tuple[np.ndarray, np.ndarray]:
    prior = np.diag(1.0 / model.sigma)[np.isfinite(model.sigma)]
    rows = np.vstack([whitener(model.matrix), prior])
    return rows, np.concatenate([whitener(record.target), (prior @ model.nominal)])


def _basis(solved: Solved) -> np.ndarray:
    """Orthonormal basis of all rows, priors included."""
    return np.vstack([basis_rows(solved, np.arange(solved.rows)), solved.mixing[solved.parts[-1].stop :]])


def test_solution_is_that_of_all_rows_and_priors(case: tuple[Any, Model, Whitener, Whitener]) -> None:
    record, model, whitener, _ = case
    solved = solve_model(record, model, whitener)
    rows, target = _tall(record, model, whitener)
    size = np.linalg.norm(rows, axis=0)
    beta = np.linalg.lstsq(rows / size, target)[0] / size
    assert solved.values == pytest.approx(beta, rel=1e-9)
    assert solved.rest == pytest.approx(target - rows @ beta, abs=1e-9)
    assert _basis(solved).T @ _basis(solved) == pytest.approx(np.eye(4), abs=1e-12)
    assert rows @ solved.inverse == pytest.approx(_basis(solved), abs=1e-10)
    covariance = np.linalg.inv((rows / size).T @ (rows / size)) / np.outer(size, size)
    assert solved.stderr == pytest.approx(np.sqrt(np.diag(covariance)), rel=1e-9)


def test_covariance_is_that_of_the_weights_and_the_noise(
    case: tuple[Any, Model, Whitener, Whitener], rng: np.random.Generator
) -> None:
    record, model, whitener, weights = case
    solved = solve_model(record, model, weights)
    found = noise_covariance(solved, weights, whitener)
    n = len(weights.used)

    def matrix_of(row: int, one: Whitener) -> np.ndarray:
        return one.channels[row](np.eye(n)).T

    noise = block_diag(*(np.linalg.inv(w.T @ w) for w in (matrix_of(row, whitener) for row in range(CHANNELS))))
    v = block_diag(*(matrix_of(row, weights) for row in range(CHANNELS)))
    whole = block_diag(v @ noise @ v.T, np.eye(2))
    p = solved.inverse @ _basis(solved).T
    expected = p @ whole @ p.T
    assert found.of_noise() == pytest.approx(expected, rel=1e-8)
    # what blocks of the record differ by counts where it is more: the record is no noise of that model
    assert np.all(with_honest_errors(found).stderr >= np.sqrt(np.diag(expected)) * (1.0 - 1e-8))

    # a column in one balance alone
    column = weights.channels[0](rng.standard_normal((1, n)))
    z = np.concatenate([column, np.zeros((1, n + 2))], axis=1).T
    own = added(z.T @ z, _basis(solved).T @ z, z.T @ solved.rest)
    u = (z - _basis(solved) @ (_basis(solved).T @ z)) @ own.back
    assert found.of_added({0: column}, _basis(solved).T @ z, own.back) == pytest.approx(u.T @ whole @ u, rel=1e-8)


# ---- bounds -----------------------------------------------------------------------------------------------------


def drag_below_zero(seed: int) -> tuple[np.ndarray, Model, Whitener, Solved]:
    """A target, a model with a negative viscous friction, its weights, and the fit without bounds."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, 10.0, M)
    speed = np.sin(t) * (1.0 + 0.3 * t)
    columns = [np.cos(t), np.sign(speed), speed, speed * np.abs(speed)]
    effects = [None, *(CATALOGUE[name] for name in ("coulomb", "viscous", "quadratic_drag"))]
    symbols = ("J", "F_c", "F_v", "k")
    groups = [
        Group(effect, (symbol,), (column[None],), {}, entry)
        for entry, (effect, symbol, column) in enumerate(zip(effects, symbols, columns, strict=True))
    ]
    model = Model.of(groups, symbols, np.array([1.0, 0.0, 0.0, 0.0]), np.array([0.1, np.inf, np.inf, np.inf]))
    target = model.matrix @ [1.0, 0.5, -0.4, 0.3] + 0.01 * rng.standard_normal(M)
    mask = np.ones(M, dtype=bool)
    whitener = make_whitener(target - model.matrix @ [1.0, 0.5, -0.4, 0.3], np.ones((1, M)), mask, 40.0, 4, 0)
    free = solve_model(SimpleNamespace(target=target), model, whitener)  # type: ignore[arg-type]
    return target, model, whitener, free


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_bounds_are_constraints_of_the_fit(seed: int) -> None:
    target, model, whitener, free = drag_below_zero(seed)
    found = bounded(free)
    assert free.values[2] < -0.3
    assert list(found.held) == [2]
    assert found.values[2] == 0.0
    assert np.isnan(found.stderr[2])

    rows, right = _tall(SimpleNamespace(target=target), model, whitener)
    kept = [0, 1, 3]
    assert found.values[kept] == pytest.approx(np.linalg.lstsq(rows[:, kept], right)[0], rel=1e-8)
    assert found.rest == pytest.approx(right - rows @ found.values, abs=1e-8)
    clipped = np.maximum(free.values, 0.0)
    assert found.chi2 < 0.5 * float(np.sum((right - rows @ clipped) ** 2))
    assert rows[:, kept] @ found.inverse[kept] == pytest.approx(_basis(found), abs=1e-10)
    assert holding(free, {}).values == pytest.approx(free.values, rel=1e-10)


def test_a_bound_is_kept_where_another_of_many_optima_keeps_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of columns that hang together the solver of bounded fits found another optimum than the fit: F_c was -0.004."""
    _, _, _, free = drag_below_zero(1)
    inside = SimpleNamespace(active_mask=np.zeros(4, dtype=int))
    monkeypatch.setattr("scipy.optimize.lsq_linear", lambda *a, **given: inside)
    found = bounded(free)
    assert found.held == {2: 0.0}
    assert found.values[2] == 0.0


def test_held_values_respond_to_nothing_where_no_candidate_enters_the_torque() -> None:
    """A dead time alone, on a log of 15 s that leaves the inertia held, ended a diagnosis with an error."""
    model: Any = SimpleNamespace(responses=[SimpleNamespace(slope=np.ones(5)), SimpleNamespace(slope=np.zeros(5))])
    voltage: Any = SimpleNamespace(rows=(None, np.ones((1, 5)), None))
    torque: Any = SimpleNamespace(rows=(np.full((1, 5), 2.0), None, None))
    assert _responses_to(model, [voltage]).shape == (2, 0)
    assert _responses_to(model, [voltage, torque]).tolist() == [[10.0], [0.0]]

"""Small factors against tall solves."""

from __future__ import annotations

import numpy as np
import pytest

from pmsm_ctrl.evidence.linalg import (
    OWN_SHARE,
    added,
    factored,
    gram_of,
    orthonormal_rows,
    own_shares,
    projection_on_all,
)


@pytest.fixture
def model(rng: np.random.Generator) -> np.ndarray:
    return rng.standard_normal((600, 5)) * [1.0, 1e-6, 1e3, 1.0, 1e5]


def test_factor_solves_as_lstsq_does(model: np.ndarray, rng: np.random.Generator) -> None:
    y = rng.standard_normal(600)
    factor = factored(model)
    expected = np.linalg.lstsq(model / np.linalg.norm(model, axis=0), y)[0] / np.linalg.norm(model, axis=0)
    assert factor.inverse @ (factor.basis.T @ y) == pytest.approx(expected, rel=1e-10)
    assert factor.basis.T @ factor.basis == pytest.approx(np.eye(5), abs=1e-12)


def test_factor_leaves_out_what_there_is_not(model: np.ndarray) -> None:
    twice = np.column_stack([model, model[:, 0] + 1e-4 * model[:, 2], np.zeros(600)])
    assert factored(twice).basis.shape == (600, 5)


def test_own_share_is_the_sine_of_the_angle_between_two_columns() -> None:
    angle = 0.03
    columns = np.array([[1.0, 7.0 * np.cos(angle), 0.0], [0.0, 7.0 * np.sin(angle), 0.0], [0.0, 0.0, 0.0]])
    assert own_shares(columns) == pytest.approx([np.sin(angle), np.sin(angle), 0.0], rel=1e-9)


def test_gram_is_that_of_the_weighted_columns(rng: np.random.Generator) -> None:
    blocks = [rng.standard_normal((k, 2500)) for k in (1, 3, 2)]
    weight = rng.uniform(0.0, 1.0, 2500)
    weight[1000:2100] = 0.0
    whole = np.vstack(blocks) * weight
    assert gram_of(blocks, weight) == pytest.approx(whole @ whole.T, rel=1e-12, abs=1e-10)
    assert gram_of([], weight).shape == (0, 0)


@pytest.mark.parametrize("columns", [1, 3])
def test_what_columns_add_is_what_the_whole_regression_says(
    model: np.ndarray, rng: np.random.Generator, columns: int
) -> None:
    z = rng.standard_normal((600, columns)) * 1e4 + model[:, :1]
    y = model @ [1.0, 1e6, -1e-3, 0.0, 1e-5] + 1e-4 * z.sum(axis=1) + rng.standard_normal(600)
    q = factored(model).basis
    rest = y - q @ (q.T @ y)
    found = added(z.T @ z, q.T @ z, z.T @ rest)
    whole = np.column_stack([model, z])
    size = np.linalg.norm(whole, axis=0)
    beta = np.linalg.lstsq(whole / size, y)[0] / size
    left = y - whole @ beta
    assert found.rank == columns
    assert found.values == pytest.approx(beta[5:], rel=1e-9)
    assert found.gain == pytest.approx(rest @ rest - left @ left, rel=1e-9)
    covariance = np.linalg.inv((whole / size).T @ (whole / size)) / np.outer(size, size)
    assert found.stderr == pytest.approx(np.sqrt(np.diag(covariance))[5:], rel=1e-9)


@pytest.mark.parametrize(("own", "rank"), [(1.05 * OWN_SHARE, 1), (0.95 * OWN_SHARE, 0)])
@pytest.mark.parametrize("columns", [1, 2])
def test_squares_know_a_nearly_dependent_column_as_well_as_the_tall_solve(
    model: np.ndarray, rng: np.random.Generator, own: float, rank: int, columns: int
) -> None:
    """At the share below which a column counts as none its square still has the digits that are needed."""
    q = factored(model).basis
    free = rng.standard_normal((600, columns))
    free -= q @ (q.T @ free)
    free = np.linalg.qr(free)[0]
    inside = q[:, :1]
    z = np.sqrt(1.0 - own**2) * inside + own * free[:, :1]
    if columns == 2:
        z = np.column_stack([z, q[:, 1]])
    y = rng.standard_normal(600)
    rest = y - q @ (q.T @ y)
    found = added(z.T @ z, q.T @ z, z.T @ rest)
    assert found.rank == rank
    if rank:
        left = z[:, 0] - q @ (q.T @ z[:, 0])
        assert found.gain == pytest.approx((left @ rest) ** 2 / (left @ left), rel=1e-9)


def test_projection_on_all_leaves_what_lstsq_leaves(rng: np.random.Generator) -> None:
    columns = rng.standard_normal((40, 900))
    columns = np.vstack([columns, columns[:3] + columns[3:6], np.zeros(900)])
    y = rng.standard_normal(900)
    coefficients, rank = projection_on_all(columns @ columns.T, columns @ y, room=100)
    expected = y - columns.T @ np.linalg.lstsq(columns.T, y)[0]
    assert rank == 40
    assert y - coefficients @ columns == pytest.approx(expected, abs=1e-9)
    assert projection_on_all(columns @ columns.T, columns @ y, room=7)[1] == 7


def test_own_share_of_columns() -> None:
    x = np.linspace(0.0, 1.0, 1001)
    shares = own_shares(np.column_stack([x, 2.0 * x, x**2, 0.0 * x]))
    assert shares[:2] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert shares[3] == 0.0
    # x^2 beside x: 1 - (1/4)^2 / (1/3 1/5) = 1/16
    assert own_shares(np.column_stack([x, x**2])) == pytest.approx([0.25, 0.25], rel=0.01)
    assert own_shares(x[:, None]) == pytest.approx([1.0])


def test_projection_on_all_holds_the_first_columns_however_small_the_room(rng: np.random.Generator) -> None:
    base, much = rng.standard_normal((2, 400)), np.repeat(rng.standard_normal((10, 400)), 30, axis=0)
    columns = np.vstack([base, much + 0.1 * rng.standard_normal((300, 400))])
    y = base.T @ [3.0, -2.0] + 1e-3 * rng.standard_normal(400)
    coefficients, rank = projection_on_all(columns @ columns.T, columns @ y, room=5, first=2)
    left = y - coefficients @ columns
    assert rank == 5
    assert np.sqrt(np.mean(left**2)) < 1.1e-3
    assert base @ left == pytest.approx([0.0, 0.0], abs=1e-8)
    assert np.std(y - projection_on_all(columns @ columns.T, columns @ y, room=5)[0] @ columns) > 1.0


@pytest.mark.parametrize("apart", [1.0, 1e-2, 1e-6, 0.0])
def test_orthonormal_rows_span_the_columns(rng: np.random.Generator, apart: float) -> None:
    columns = rng.standard_normal((7, 3000)) * np.geomspace(1e-6, 1e3, 7)[:, None]
    columns[4] = 1e3 * columns[2] + apart * columns[4]
    basis, triangle = orthonormal_rows(columns.copy())
    np.testing.assert_allclose(basis @ basis.T, np.eye(7), atol=1e-13)
    scale = np.linalg.norm(columns, axis=1)[:, None]
    np.testing.assert_allclose(triangle.T @ basis / scale, columns / scale, atol=1e-14)
    assert np.all(np.abs(np.tril(triangle / scale.T, -1)) < 1e-15)


def test_orthonormal_rows_of_a_column_of_zeros(rng: np.random.Generator) -> None:
    columns = rng.standard_normal((3, 50))
    columns[1] = 0.0
    basis, triangle = orthonormal_rows(columns.copy())
    np.testing.assert_allclose(triangle.T @ basis, columns, atol=1e-13)


def test_no_columns_add_nothing() -> None:
    # as of a curve over a coordinate that a very short log does not vary
    found = added(np.zeros((0, 0)), np.zeros((2, 0)), np.zeros(0))
    assert (found.rank, found.gain, found.values.shape) == (0, 0.0, (0,))

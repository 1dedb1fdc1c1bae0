"""Trends and steps against closed forms, and their intervals on simulated series."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import linregress

from pmsm_ctrl.evidence.trends import between_records, regression, step
from tests.effort import amount


def test_with_equal_errors_the_line_is_ordinary_regression(rng: np.random.Generator) -> None:
    t, y = np.arange(9.0), rng.standard_normal(9)
    found, known = regression(t, y, np.full(9, 0.01)), linregress(t, y)
    assert found is not None
    assert found.slope == pytest.approx(known.slope, rel=1e-9)
    assert found.stderr == pytest.approx(known.stderr, rel=1e-9)
    assert found.p_value == pytest.approx(known.pvalue, rel=1e-9)
    assert found.level == pytest.approx(known.intercept + 8.0 * known.slope, rel=1e-9)


def test_the_variance_between_records_is_that_of_restricted_likelihood(rng: np.random.Generator) -> None:
    """With equal errors s it is the sample variance less s squared, on the grid that is tried."""
    y = rng.standard_normal(12)
    found = between_records(np.ones((12, 1)), y, np.full(12, 0.3))
    assert found == pytest.approx(np.var(y, ddof=1) - 0.09, rel=0.2)


def test_a_step_without_noise_is_where_it_is() -> None:
    y = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0, 2.0]) + 1e-6 * np.array([1, -1, 0, 1, 0, -1, 1])
    found = step(y, np.full(7, 1e-6))
    assert found is not None
    assert (found.index, found.first, found.last) == (3, 3, 3)
    assert found.size == pytest.approx(1.0, abs=1e-5)
    assert found.p_value < 1e-12


def test_too_few_records_are_not_judged() -> None:
    three = np.arange(3.0)
    assert regression(three, three, three + 1) is None
    assert step(three, three + 1) is None
    assert regression(np.zeros(5), np.arange(5.0), np.ones(5)) is None


@pytest.mark.parametrize(("n", "between"), [(6, 1.0), (12, 0.0), (12, 1.0)])
def test_intervals_hold_what_they_promise(n: int, between: float) -> None:
    """95 % of the slopes and places within their intervals, 5 % of false steps at most; bounds of 4 standard errors."""
    rng, count = np.random.default_rng(11), amount(60, 2000)
    slopes = places = steps = 0
    for _ in range(count):
        errors = 0.5 * rng.uniform(0.5, 2.0, n)
        t, noise = np.sort(rng.uniform(0, n, n)), between * rng.standard_normal(n) + errors * rng.standard_normal(n)
        line = regression(t, 100.0 + 0.1 * t + noise, errors)
        assert line is not None
        low, high = line.interval()
        slopes += low <= 0.1 <= high
        none, k = step(100.0 + noise, errors), int(rng.integers(2, n - 1))
        assert none is not None
        steps += none.p_value < 0.05
        found = step(100.0 + noise + 4.0 * (np.arange(n) >= k), errors)
        assert found is not None
        places += found.first <= k <= found.last
    tolerance = 4.0 * np.sqrt(0.95 * 0.05 / count)
    assert slopes / count > 0.95 - tolerance - 0.01  # the weights are estimated: 0.93 to 0.96 in 1500 draws
    assert places / count > 0.95 - tolerance
    assert steps / count < 0.05 + tolerance

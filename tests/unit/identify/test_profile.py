"""Profile intervals of a fit by simulation, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq, least_squares, minimize_scalar

from pmsm_ctrl.identify.profile import NORMAL, Optimum

INFINITE = np.full(2, np.inf)


def optimum(residual, values, slopes, lower=-INFINITE, upper=INFINITE) -> Optimum:
    """White noise: the standard errors are those of the linear problem."""
    variance = np.linalg.inv(slopes.T @ slopes) * np.mean(residual(values) ** 2)
    return Optimum(residual, values, slopes, np.sqrt(np.diag(variance)), lower, upper)


def test_a_parabola_keeps_its_standard_error() -> None:
    rng = np.random.default_rng(1)
    x = rng.normal(size=(400, 2))
    y = x @ [1.0, 2.0] + rng.normal(size=400)
    best = np.linalg.lstsq(x, y, rcond=None)[0]
    assert optimum(lambda b: y - x @ b, best, -x).ends([0, 1]) == {}


def made(count: int = 300) -> tuple[np.ndarray, np.ndarray]:
    t = np.linspace(0.0, 4.0, count)
    return t, 1.0 - np.exp(-2.0 * t) + 0.5 * np.random.default_rng(3).normal(size=count)


def test_an_exponential_has_the_ends_of_its_own_profile() -> None:
    """y = a (1 - exp(-b t)): at every b the least sum of squares over a is known in closed form."""
    t, y = made()

    def column(b: float) -> np.ndarray:
        return 1.0 - np.exp(-b * t)

    def least(b: float) -> float:
        return float(y @ y - (y @ column(b)) ** 2 / (column(b) @ column(b)))

    b = float(minimize_scalar(least, bounds=(0.1, 10.0), method="bounded", options={"xatol": 1e-7}).x)
    a = float(y @ column(b) / (column(b) @ column(b)))
    slopes = -np.column_stack([column(b), a * t * np.exp(-b * t)])
    best = optimum(lambda p: y - p[0] * column(p[1]), np.array([a, b]), slopes)
    limit = least(b) * (1.0 + NORMAL**2 / len(t))
    low, high = best.ends([1])[1]
    assert low == pytest.approx(brentq(lambda one: least(one) - limit, 1e-3, b), abs=0.05 * b)
    assert high == pytest.approx(brentq(lambda one: least(one) - limit, b, 20.0), abs=0.05 * b)


def test_an_interval_ends_at_a_bound() -> None:
    t, y = made()

    def residual(p: np.ndarray) -> np.ndarray:
        return y - p[0] * (1.0 - np.exp(-p[1] * t))

    found = least_squares(residual, [1.0, 1.5])
    bound = found.x[1] + 0.05
    best = optimum(residual, found.x, found.jac, upper=np.array([np.inf, bound]))
    assert best.ends([1])[1][1] == bound

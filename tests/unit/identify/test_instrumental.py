"""Instrumental variables and the test for bias, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.identify import Processing, identify
from pmsm_ctrl.identify.instrumental import bias_test
from pmsm_ctrl.regression.drive_timing import SYNCHRONOUS
from pmsm_ctrl.regression.inverse_dynamics import Column, Problem
from pmsm_ctrl.regression.least_squares import solve
from pmsm_ctrl.section import Table
from pmsm_ctrl.simulate import scenario, simulate
from tests.effort import amount, seeds

N = 1500


def ar1(rng: np.random.Generator, rho: float, n: int = N) -> np.ndarray:
    return np.sqrt(1.0 - rho**2) * lfilter([1.0], [1.0, -rho], rng.normal(size=n + 300))[300:]


def problem(target: np.ndarray, matrix: np.ndarray) -> Problem:
    columns = tuple(Column(f"b{k}", matrix[:, k], "N m", 100.0) for k in range(matrix.shape[1]))
    n = len(target)
    return Problem(target, columns, np.ones(n, dtype=bool), np.arange(n) * 0.01, target, target, "N m", 100.0, 40.0)


def motion(n: int = N) -> np.ndarray:
    t = np.arange(n) * 0.01
    return np.column_stack([np.sin(0.83 * t) + 0.5 * np.sin(2.7 * t), np.sign(np.sin(0.83 * t)), np.ones(n)])


def test_estimate_is_the_textbook_formula() -> None:
    rng = np.random.default_rng(1)
    z = motion()
    x = z + 0.3 * rng.normal(size=z.shape)
    y = x @ [0.5, 1.0, -0.2] + rng.normal(size=N)
    fit = solve(problem(y, x), instruments=z)
    np.testing.assert_allclose(list(fit.values.values()), np.linalg.solve(z.T @ x, z.T @ y), rtol=1e-9)
    # white noise: s^2 (Z'X)^-1 Z'Z (X'Z)^-1 (Wooldridge, Econometric Analysis, 2nd ed., eq. 5.24)
    inverse = np.linalg.inv(z.T @ x)
    variance = np.sum((y - x @ list(fit.values.values())) ** 2) / (N - 3) * inverse @ (z.T @ z) @ inverse.T
    np.testing.assert_allclose(list(fit.stderr.values()), np.sqrt(np.diag(variance)), rtol=0.1)


def test_noise_in_the_column_attenuates_least_squares_and_not_the_instruments() -> None:
    # errors in variables: the slope shrinks by S / (S + N), W. A. Fuller, Measurement Error Models, 1987, eq. 1.1.7
    rng = np.random.default_rng(2)
    clean = motion(40000)[:, :1]
    x = clean + 0.5 * rng.normal(size=clean.shape)
    y = 2.0 * clean[:, 0] + 0.1 * rng.normal(size=len(x))
    power = float(np.mean(clean**2))
    assert solve(problem(y, x)).values["b0"] == pytest.approx(2.0 * power / (power + 0.25), rel=0.01)
    assert solve(problem(y, x), instruments=clean).values["b0"] == pytest.approx(2.0, rel=0.01)


def rejected(seeds: range, rho: float, endogenous: float) -> tuple[float, float]:
    """Share of p-values below 5 %, and of logs called biased."""
    low, called = 0, 0
    z = motion()
    for seed in seeds:
        rng = np.random.default_rng(seed)
        noise, disturbance = ar1(rng, rho), ar1(rng, rho)
        x = z.copy()
        x[:, 0] += 0.3 * (disturbance + endogenous * noise)
        target = problem(x @ [0.5, 1.0, -0.2] + 0.5 * noise, x)
        test = bias_test(target, solve(target), solve(target, instruments=z))
        low += test.p_value < 0.05
        called += bool(test.biased)
    return low / len(seeds), called / len(seeds)


@pytest.mark.parametrize("rho", seeds(0.9, 0.0))
def test_false_alarms_with_white_and_with_coloured_noise(rho: float) -> None:
    # 5 % of 400: 2.6 % to 7.8 % with probability 99 %; the short form has 100
    low, called = rejected(range(amount(100, 400)), rho, 0.0)
    assert 0.02 <= low <= 0.08, low
    assert called <= 0.02, called


def test_power_where_the_column_holds_the_noise() -> None:
    low, called = rejected(range(40), 0.9, 0.8)
    assert low >= 0.95
    assert called >= 0.8


@pytest.fixture(scope="module")
def design(designs) -> Design:
    return Design.read(designs / "hand_tuned.toml")


def test_a_noisy_encoder_in_a_wide_band_biases_least_squares(design) -> None:
    log = simulate(design, scenario("triangle", design, speed=150.0, period=2.0), seed=1)
    noisy = log.with_channels(theta=log["theta"] + 3e-4 * np.random.default_rng(1).normal(size=len(log)))
    wide = Processing(cutoff=150.0, sampling=SYNCHRONOUS)  # noise alone is to be seen
    ordinary = identify(design, noisy, processing=wide).estimates["J"]
    result = identify(design, noisy, method="iv", processing=wide)
    unbiased = result.estimates["J"]
    assert ordinary.value < 0.97 * design.J
    assert abs(unbiased.value - design.J) < 3.0 * unbiased.stderr
    assert result.bias is not None
    assert "J" in result.bias.biased
    assert result.bias.bias["J"] == pytest.approx(ordinary.value - unbiased.value, rel=1e-6)
    assert result.remarks[-1].code == "biased"
    assert "least squares is biased on this log: J by -" in result.summary(width=1000)
    assert result.to_dict()["least_squares_bias"]["biased"] == ["J"]
    table = [block for block in result.section().blocks if isinstance(block, Table)][1]
    assert table.rows[0][4] == "biased"


@pytest.mark.parametrize("seed", seeds(1, 2, 3))
def test_a_clean_log_is_not_called_biased(design, seed) -> None:
    log = simulate(design, scenario("triangle", design, speed=150.0, period=2.0), seed=seed)
    result = identify(design, log, method="iv")
    assert result.bias is not None
    assert result.bias.biased == ()
    assert result.remarks[-1].code == "not_biased"
    for name, true in (("J", 9e-5), ("F_c", 0.0213), ("F_v", 0.000168)):
        assert abs(result.estimates[name].value - true) < 4.0 * result.estimates[name].stderr


def test_a_wrong_start_does_not_matter(design) -> None:
    log = simulate(design, scenario("triangle", design, speed=150.0, period=2.0), seed=1)
    elsewhere = design.with_parameters(J=1.4e-4)
    elsewhere = elsewhere.with_effect("coulomb", {"F_c": 0.01}).with_effect("viscous", elsewhere.parameters("viscous"))
    a, b = (identify(d, log, method="iv").estimates for d in (design, elsewhere))
    for name in a:
        assert b[name].value == pytest.approx(a[name].value, abs=0.1 * a[name].stderr)


def test_unknown_method(design) -> None:
    log = simulate(design, scenario("triangle", design, period=1.0, cycles=1.0))
    with pytest.raises(RequestError, match=r"'outputerror'; did you mean 'output_error'\?.*regression, iv"):
        identify(design, log, method="outputerror")  # type: ignore[arg-type]

"""The compiled low-pass against scipy's, and the whitening kernels against matrices."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.signal import butter, cheby1, sosfiltfilt

from pmsm_ctrl.kernels.filters import coloured_back, whitened
from pmsm_ctrl.regression.filters import low_pass, shifted


@pytest.mark.parametrize("steep", [False, True])
@pytest.mark.parametrize("columns", [1, 2, 17, 40])
def test_low_pass_is_scipys_to_the_last_bit(rng: np.random.Generator, columns: int, steep: bool) -> None:
    x = np.cumsum(rng.standard_normal((columns, 3000)), axis=1)
    sections = cheby1(8, 0.05, 40.0, fs=1000.0, output="sos") if steep else butter(4, 40.0, fs=1000.0, output="sos")
    expected = sosfiltfilt(sections, x, axis=-1, padtype="odd", padlen=75)
    # a load in a gap bounces: what is simulated from a filtered angle turns the last bit into per cents
    np.testing.assert_array_equal(low_pass(x, 1000.0, 40.0, steep), expected)
    np.testing.assert_array_equal(low_pass(x, 1000.0, 40.0, steep, step=7), expected[:, ::7])


def test_low_pass_of_one_signal_has_its_shape(rng: np.random.Generator) -> None:
    x = rng.standard_normal(500)
    assert low_pass(x, 1000.0, 40.0).shape == (500,)
    assert low_pass(x[None, None], 1000.0, 40.0, step=3).shape == (1, 1, 167)


@pytest.mark.parametrize("n", [4, 5, 200])
@pytest.mark.parametrize("by", [0.0, 0.3, -0.3, 1.0, 2.7, -1.5, 500.0, -500.0])
def test_a_shift_is_scipys_cubic_spline(rng: np.random.Generator, n: int, by: float) -> None:
    period, x = 1e-3, rng.standard_normal(n)
    t = period * np.arange(n)
    expected = CubicSpline(t, x)(np.clip(t + by * period, t[0], t[-1]))
    assert shifted(x, period, by * period) == pytest.approx(expected, abs=1e-12)


def test_a_shifted_cubic_is_itself() -> None:
    t = np.arange(40.0)
    cubic = np.polynomial.Polynomial([1.0, -2.0, 0.3, 0.01])
    assert shifted(cubic(t), 1.0, 0.4)[:-1] == pytest.approx(cubic(t[:-1] + 0.4), rel=1e-12)


def test_whitening_kernels_are_a_matrix_and_its_transposed_inverse(rng: np.random.Generator) -> None:
    order, n = 3, 40
    position = np.concatenate([np.arange(25), np.arange(2), np.arange(13)])
    filters = np.tril(rng.uniform(-0.3, 0.3, (order + 1, order + 1)))
    filters[:, 0] = rng.uniform(0.5, 2.0, order + 1)
    matrix = np.zeros((n, n))
    for i, known in enumerate(np.minimum(position, order)):
        for lag in range(known + 1):
            matrix[i, i - lag] = filters[known, lag]
    x = rng.standard_normal((2, n))
    out = np.empty_like(x)
    whitened(x, position, filters, out)
    assert out == pytest.approx(x @ matrix.T, abs=1e-12)
    coloured_back(x, position, filters, out)
    assert out == pytest.approx(np.linalg.solve(matrix.T, x.T).T, abs=1e-10)

"""The local polynomial method against responses in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import dlsim, dlti, freqz

from pmsm_ctrl.evidence.local_polynomial import local_polynomial, strongest_lines

NUMERATOR, DENOMINATOR = [0.2, 0.1], [1.0, -1.5, 0.8]  # a resonance at 0.088 of the rate


def through(u: np.ndarray) -> np.ndarray:
    """Return the output of the filter, which starts from rest: the transient is in the record."""
    return dlsim(dlti(NUMERATOR, DENOMINATOR, dt=1.0), u)[1][:, 0]


def test_without_noise_transient_and_leakage_are_gone(rng: np.random.Generator) -> None:
    u = rng.normal(size=4096)
    U, Y = np.fft.rfft(u), np.fft.rfft(through(u))
    lines = strongest_lines(U, 1, len(U) - 20)
    found = local_polynomial(U, Y[:, None], lines)
    true = freqz([0.0, *NUMERATOR], DENOMINATOR, 2.0 * np.pi * found.place / 4096)[1]
    # the quotient of the spectra, which knows of no transient, is off by a per cent and more
    assert np.median(np.abs(found.response[:, 0] / true - 1.0)) < 1e-5
    assert np.median(np.abs(Y[lines] / U[lines] / true - 1.0)) > 1e-3


def test_errors_are_as_large_as_the_covariance_says(rng: np.random.Generator) -> None:
    u = rng.normal(size=65536)
    U, Y = np.fft.rfft(u), np.fft.rfft(through(u) + 0.5 * rng.normal(size=65536))
    lines = strongest_lines(U, 1, len(U) - 20)
    found = local_polynomial(U, Y[:, None], lines)
    true = freqz([0.0, *NUMERATOR], DENOMINATOR, 2.0 * np.pi * found.place / 65536)[1]
    away = np.abs(found.response[:, 0] - true) ** 2 / found.covariance[:, 0, 0].real
    # |error|^2 over an estimated variance is Fisher-distributed with 2 and 2 x 7 degrees of freedom: its mean is 7/6
    assert np.mean(away) == pytest.approx(7.0 / 6.0, rel=0.08)


def test_a_sine_between_two_lines_has_its_own_frequency(rng: np.random.Generator) -> None:
    n, place = 8192, 300.37
    u = np.cos(2.0 * np.pi * place / n * np.arange(n))
    U, Y = np.fft.rfft(u), np.fft.rfft(through(u) + 1e-3 * rng.normal(size=n))
    found = local_polynomial(U, Y[:, None], np.array([300]))
    true = freqz([0.0, *NUMERATOR], DENOMINATOR, [2.0 * np.pi * place / n])[1][0]
    assert found.place[0] == pytest.approx(place, abs=0.02)
    assert abs(found.response[0, 0] / true - 1.0) < 1e-3


def test_spectra_that_are_too_short_are_refused() -> None:
    with pytest.raises(ValueError, match="10 lines found; at least 14"):
        local_polynomial(np.ones(10, complex), np.ones((10, 1), complex), np.array([3]))

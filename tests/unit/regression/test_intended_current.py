"""Which part of a logged d-current was meant to flow, and which is noise."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.currents import intended_i_d
from tests.effort import seeds

RATE, CUTOFF = 500.0, 40.0
T = np.arange(0.0, 20.0, 1.0 / RATE)
NOISE = 0.02


def intended(i_d: np.ndarray) -> np.ndarray:
    prepared: Any = SimpleNamespace(rate=RATE, cutoff=CUTOFF)
    return intended_i_d(Log({"t": T, "i_q": np.zeros_like(T), "i_d": i_d}), prepared, i_d)


def noise(seed: int) -> np.ndarray:
    return NOISE * np.random.default_rng(seed).standard_normal(T.size)


@pytest.mark.parametrize("seed", seeds(1, 2, 3))
def test_a_current_of_noise_alone_is_none(seed: int) -> None:
    assert not np.any(intended(noise(seed)))


@pytest.mark.parametrize("seed", seeds(1, 2, 3))
def test_a_slow_current_is_kept_without_its_noise(seed: int) -> None:
    slow = 0.8 * np.sin(2.0 * np.pi * 0.5 * T)
    left = intended(slow + noise(seed)) - slow
    assert np.std(left) < 0.5 * NOISE


@pytest.mark.parametrize("seed", seeds(1, 2, 3))
def test_a_current_that_flows_for_moments_is_kept(seed: int) -> None:
    """That of the most torque per ampere, 1 A for 40 ms at each start, was zero: u_d was explained to 57 % less."""
    pulses = np.where(np.mod(T, 2.0) < 0.04, 1.0, 0.0)
    assert np.std(intended(pulses + noise(seed)) - pulses) < 1.1 * NOISE

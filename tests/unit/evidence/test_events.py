"""Events in a residual: found where something happens once, and never where it does not."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from pmsm_ctrl.evidence.events import Burst, Search, basis_of, bursts, explained_by, shift

Array = NDArray[np.float64]
RATE, SECONDS = 100.0, 30.0
N = int(RATE * SECONDS)
T = np.arange(N) / RATE
OMEGA = np.sin(2.0 * np.pi * 0.31 * T)
DIRECTION = np.sign(OMEGA)
MOTION = np.column_stack([DIRECTION, OMEGA, np.ones(N)])
WEIGHT = np.ones(N)
BASIS = basis_of(MOTION, WEIGHT)
SEARCH = Search(), RATE


def noise(seed: int, memory: float = 0.0) -> Array:
    """Unit variance; `memory` is the coefficient of an autoregression of first order."""
    white = np.random.default_rng(seed).standard_normal(N)
    return np.asarray(lfilter([np.sqrt(1.0 - memory**2)], [1.0, -memory], white))


def found(residual: Array) -> list[Burst]:
    return bursts(residual, WEIGHT, DIRECTION, BASIS, SEARCH)


def stepped(residual: Array) -> object:
    return shift(residual, WEIGHT, DIRECTION, BASIS, SEARCH)


@pytest.mark.parametrize("memory", [0.0, 0.8, 0.95])
@pytest.mark.parametrize("seed", range(8))
def test_noise_holds_no_event(seed: int, memory: float) -> None:
    assert found(noise(seed, memory)) == []
    assert stepped(noise(seed, memory)) is None


def test_steps_of_correlated_noise_are_as_rare_as_stated() -> None:
    """Some two dozen means tell the level of slow noise, and not exactly: four of these 500 had a step."""
    assert sum(stepped(noise(seed, 0.98)) is not None for seed in range(500)) <= 1


@pytest.mark.parametrize("memory", [0.0, 0.8])
@pytest.mark.parametrize("seed", range(4))
def test_a_push_is_found_with_its_times_and_size(seed: int, memory: float) -> None:
    inside = (T >= 12.0) & (T < 12.5)
    (one,) = found(noise(seed, memory) + 8.0 * inside)
    assert (one.start / RATE, one.stop / RATE) == pytest.approx((12.0, 12.5), abs=0.1)
    assert one.size == pytest.approx(8.0, abs=2.0)


@pytest.mark.parametrize("seed", range(4))
def test_a_brake_that_drags_for_four_seconds_is_found_along_the_motion(seed: int) -> None:
    inside = (T >= 15.0) & (T < 19.0)
    residual = noise(seed) + 3.0 * inside * DIRECTION
    one = found(residual)[0]
    assert one.along
    assert (one.start / RATE, one.stop / RATE) == pytest.approx((15.0, 19.0), abs=0.3)
    step = shift(residual, WEIGHT, DIRECTION, BASIS, SEARCH)
    least = explained_by(one, residual, WEIGHT, DIRECTION, BASIS)
    assert step is None or explained_by(step, residual, WEIGHT, DIRECTION, BASIS) < least


@pytest.mark.parametrize("seed", range(4))
def test_a_friction_that_steps_is_found_at_its_time(seed: int) -> None:
    one = shift(noise(seed) + 2.0 * (T >= 11.0) * DIRECTION, WEIGHT, DIRECTION, BASIS, SEARCH)
    assert one is not None
    assert one.start / RATE == pytest.approx(11.0, abs=0.4)
    assert one.size == pytest.approx(2.0, abs=0.2)


@pytest.mark.parametrize("tau", [2.0, 8.0, 30.0])
def test_a_friction_that_drifts_is_no_step_and_no_stretch(tau: float) -> None:
    residual = noise(1) + 4.0 * np.exp(-T / tau) * DIRECTION
    assert stepped(residual) is None
    assert found(residual) == []


@pytest.mark.parametrize("seed", range(4))
def test_a_load_that_steps_is_no_friction(seed: int) -> None:
    assert stepped(noise(seed) + 2.0 * (T >= 11.0)) is None


@pytest.mark.parametrize("order", [3.0, 5.0])
def test_what_a_model_lacks_shows_everywhere_and_is_no_event(order: float) -> None:
    assert found(noise(2) + 5.0 * np.cos(2.0 * np.pi * 0.31 * order * T)) == []
    peaks = 8.0 * np.exp(-np.abs(OMEGA) / 0.1) * DIRECTION
    assert found(noise(2) + peaks) == []

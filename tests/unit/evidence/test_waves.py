"""The periods that stand out over a position: those of waves that were put there."""

from __future__ import annotations

import numpy as np
import pytest

from pmsm_ctrl.evidence.waves import highest_over_position, strongest_periods


def test_the_strongest_waves_come_first() -> None:
    rng = np.random.default_rng(1)
    place = rng.uniform(-1.0, 2.0, 20_000)
    values = 0.5 * np.sin(2.0 * np.pi * place / 0.05) + np.cos(2.0 * np.pi * place / 0.12) + rng.normal(size=place.size)
    periods, possible = strongest_periods([(values, place)], 40.0, 2)
    assert periods == pytest.approx([0.12, 0.05], rel=0.01)
    assert possible == pytest.approx(116, abs=1)  # 120 in three metres, but for those of less than four periods


@pytest.mark.parametrize(
    ("place", "highest"), [(np.zeros(0), 40.0), (np.ones(9), 40.0), (np.linspace(0.0, 0.1, 9), 40.0)]
)
def test_a_travel_of_less_than_four_periods_shows_none(place: np.ndarray, highest: float) -> None:
    periods, possible = strongest_periods([(np.ones(place.size), place)], highest, 4)
    assert (periods.size, possible) == (0, 0)


def test_a_wave_of_two_periods_is_none() -> None:
    place = np.linspace(0.0, 1.0, 4000)
    values = 5.0 * np.sin(2.0 * np.pi * place / 0.5) + np.sin(2.0 * np.pi * place / 0.04)
    periods, _ = strongest_periods([(values, place)], 40.0, 1)
    assert periods == pytest.approx([0.04], rel=0.01)


def test_waves_that_are_passed_too_fast_for_a_low_pass_are_not_looked_for() -> None:
    theta = np.linspace(0.0, 0.01, 300)
    slow, fast = (
        highest_over_position(theta, np.tile([-speed, speed, 3.0 * speed], 100), 40.0) for speed in (0.1, 0.2)
    )
    assert slow == pytest.approx(2.0 * fast)


def test_there_are_no_more_waves_than_samples_tell() -> None:
    """Of an axis that creeps, and jumps by half a metre once, a spectrum of millions of waves would be taken."""
    theta = np.concatenate([np.linspace(0.0, 1e-4, 500), np.linspace(0.5, 0.5001, 500)])
    assert highest_over_position(theta, np.full(1000, 1e-5), 40.0) * 0.5001 == pytest.approx(500.0)
    assert highest_over_position(np.zeros(0), np.zeros(0), 40.0) == 0.0

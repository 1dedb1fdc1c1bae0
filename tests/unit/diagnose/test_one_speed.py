"""An order of a turn that shows at one speed only is a wave over time as well."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pmsm_ctrl.diagnose.one_speed import at_one_speed
from pmsm_ctrl.diagnose.policy import POLICY
from pmsm_ctrl.diagnose.refusal import Reason
from pmsm_ctrl.effects import CATALOGUE

RATE = 100.0  # Hz of the grid


def fits(speeds: list[float], falls: list[float], seconds: float, linear: bool = False) -> tuple[Any, Any]:
    """Return two fits of stretches at these speeds; the effect explains this share of the residual in each."""
    n = round(seconds * RATE)
    omega, share = np.repeat(speeds, n), np.repeat(falls, n)
    left = np.random.default_rng(4).normal(size=omega.size)
    record = SimpleNamespace(
        mask=np.ones(omega.size), weight=np.ones((1, omega.size)), rate=RATE, linear=linear,
        signals={"omega": omega}, at_grid=lambda values: values,
    )  # fmt: skip
    before = SimpleNamespace(record=record, residual=left[None])
    return before, SimpleNamespace(record=record, residual=(left * np.sqrt(1.0 - share))[None])


def refused(effect: str, *args: Any, **options: Any) -> Reason | None:
    before, after = fits(*args, **options)
    found = at_one_speed(before, after, CATALOGUE[effect], POLICY)
    return found and found.reason


def test_a_wave_at_one_speed_is_no_cogging() -> None:
    assert refused("cogging", [0.5, -0.5, 3.0], [0.4, 0.4, 0.0], 2.0) is Reason.ONE_SPEED
    assert refused("cogging", [0.5, 3.0, 8.0], [0.0, 0.4, 0.01], 2.0) is Reason.ONE_SPEED


def test_at_two_speeds_it_is_one() -> None:
    assert refused("cogging", [0.5, -0.5, 3.0], [0.4, 0.4, 0.2], 2.0) is None


@pytest.mark.parametrize(("seconds", "reason"), [(8.0, Reason.ONE_SPEED), (12.0, None)])
def test_in_ten_turns_a_whole_order_is_no_chance(seconds: float, reason: Reason | None) -> None:
    """At 6 rad/s ten turns take 10.5 s."""
    assert refused("cogging", [6.0, 30.0], [0.4, 0.0], seconds) is reason


def test_effects_of_a_known_order_and_linear_axes_are_not_asked() -> None:
    assert refused("unbalance", [0.5, 3.0], [0.4, 0.0], 2.0) is None
    assert refused("cogging", [0.5, 3.0], [0.4, 0.0], 2.0, linear=True) is None


def test_the_words_say_where() -> None:
    said = str(at_one_speed(*fits([0.5, 3.0], [0.4, 0.0], 2.0), CATALOGUE["cogging"], POLICY))
    assert said.startswith("seen at one speed only, about 0.5")
    assert "for 0.2 turns" in said

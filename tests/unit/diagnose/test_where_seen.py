"""Where an effect is seen: at one speed only a wave over time, and in passing a rest or a bristle, is seen as well."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pmsm_ctrl.diagnose.policy import POLICY
from pmsm_ctrl.diagnose.refusal import Reason
from pmsm_ctrl.diagnose.where_seen import where_seen
from pmsm_ctrl.effects import CATALOGUE

RATE = 100.0  # Hz of the grid


def fits(
    effect: str, speeds: list[float], falls: list[float], seconds: float, linear: bool = False,
    alpha: float = 0.0, shape: Mapping[str, float] = MappingProxyType({}), turning: float = 0.0, driven: bool = False,
) -> tuple[Any, Any]:  # fmt: skip
    """Return two fits of stretches at these speeds; the effect explains this share of the residual in each."""
    n = round(seconds * RATE)
    omega, share = np.repeat(speeds, n), np.repeat(falls, n)
    left = np.random.default_rng(4).normal(size=omega.size)
    record = SimpleNamespace(
        mask=np.ones(omega.size, dtype=bool), weight=np.ones((1, omega.size)), rate=RATE, cutoff=40.0, linear=linear,
        turning=turning, driven=driven,
        signals={"omega": omega, "alpha": np.where(omega > 0.0, 0.0, alpha)}, at_grid=lambda values: values,
    )  # fmt: skip
    before = SimpleNamespace(record=record, residual=left[None])
    last = SimpleNamespace(effect=CATALOGUE[effect], shape=shape)
    return before, SimpleNamespace(record=record, residual=(left * np.sqrt(1.0 - share))[None], accepted=(last,))


def refused(effect: str, *args: Any, **options: Any) -> Reason | None:
    found = where_seen(*fits(effect, *args, **options), POLICY)
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


def test_what_drives_an_axis_one_way_is_a_load_and_no_bristle() -> None:
    """Friction drives nothing."""
    for driven, reason in ((False, Reason.ONE_WAY), (True, None)):
        assert refused("constant_load", [0.5, 3.0], [0.4, 0.4], 2.0, driven=driven) is reason
    assert refused("presliding", [0.5, 3.0], [0.4, 0.4], 2.0, driven=True) is Reason.ONE_WAY


def test_effects_of_a_known_order_and_linear_axes_are_not_asked() -> None:
    assert refused("unbalance", [0.5, 3.0], [0.4, 0.0], 2.0) is None
    assert refused("cogging", [0.5, 3.0], [0.4, 0.0], 2.0, linear=True) is None


def test_the_words_say_where() -> None:
    said = str(where_seen(*fits("cogging", [0.5, 3.0], [0.4, 0.0], 2.0), POLICY))
    assert said.startswith("seen at one speed only, about 0.4")  # the first of ten per decade that holds 0.5
    assert "for 0.2 turns" in said


@pytest.mark.parametrize(("alpha", "reason"), [(70.0, None), (90.0, Reason.IN_PASSING)])
def test_a_friction_that_rises_shows_slowly(alpha: float, reason: Reason | None) -> None:
    """In half a period of 40 Hz 80 rad/s^2 make 1 rad/s. Half of what it explains is at the negative speed."""
    rises = {"alpha": alpha, "shape": {"w_r": 1.0}}
    assert refused("rising_friction", [-0.5, 3.0], [0.4, 0.4], 2.0, **rises) is reason
    assert refused("rising_friction", [-0.5, 3.0], [0.02, 0.4], 2.0, **rises) is None
    assert refused("stribeck", [-0.5, 3.0], [0.4, 0.4], 2.0, alpha=alpha, shape={"w_s": 1.0}) is None


@pytest.mark.parametrize("effect", ["constant_load", "viscous_asymmetry", "presliding"])
@pytest.mark.parametrize(("back", "reason"), [(0.19, Reason.ONE_WAY), (0.21, None), (10.0, None)])
def test_a_load_and_a_bristle_take_an_axis_that_goes_back(effect: str, back: float, reason: Reason | None) -> None:
    """2 % of the way."""
    assert refused(effect, [10.0, -back], [0.4, 0.4], 2.0) is reason
    assert refused(effect, [-10.0, back], [0.4, 0.4], 2.0) is reason
    assert refused("stribeck", [10.0, -back], [0.4, 0.4], 2.0) is None


@pytest.mark.parametrize("effect", ["backlash", "presliding", "compliance", "cogging", "delay", "stribeck"])
@pytest.mark.parametrize("turning", [0.49, 0.51])
def test_what_acts_at_reversals_is_not_judged_where_most_of_them_are_left_out(effect: str, turning: float) -> None:
    found = refused(effect, [1.0, -1.0, 3.0], [0.4, 0.4, 0.4], 20.0, turning=turning)
    assert (found is Reason.TURNS_TOO_OFTEN) == (turning > 0.5 and effect in ("backlash", "presliding", "compliance"))

"""What a candidate's columns tell, in the order in which it is asked."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pmsm_ctrl.diagnose import judging
from pmsm_ctrl.diagnose.judging import judge_sampling, judge_trial
from pmsm_ctrl.diagnose.policy import POLICY
from pmsm_ctrl.diagnose.refusal import Reason, Refusal
from pmsm_ctrl.diagnose.search import Trial
from pmsm_ctrl.effects import CATALOGUE
from pmsm_ctrl.effects.structures.spring import FREQUENCY
from pmsm_ctrl.regression.drive_timing import SPREAD

STRUCTURE = SimpleNamespace(has_memory=True, never_minor=lambda shape: False)
CANDIDATE: Any = SimpleNamespace(effect=SimpleNamespace(structure=STRUCTURE))
PART, WHOLE = 0.001, 0.5  # of the balance; and of the residual above its noise floor


def trial(size: float) -> Trial:
    group: Any = SimpleNamespace(shape={}, size=size)
    judge: Any = (None, None)
    return Trial(CANDIDATE, group, 100.0, 100.0, 0.0, np.ones(1), np.ones(1), judge, plain_gain=100.0)


class ReachedError(Exception):
    """Cross-validation was reached."""


@pytest.mark.parametrize("as_a_whole", [True, False])
def test_an_effect_that_is_too_small_in_part_is_sized_as_a_whole(
    monkeypatch: pytest.MonkeyPatch, as_a_whole: bool
) -> None:
    def confirmed(fit: Any, trial: Any) -> Any:
        raise ReachedError

    part, whole = trial(PART), trial(WHOLE)
    monkeypatch.setattr(judging, "contribution", lambda fit, one: one.group.size)
    monkeypatch.setattr(judging, "excess_of", lambda solved, one, gain: (one.group.size, one.group.size))
    monkeypatch.setattr(judging, "has_own_order", lambda fit, one: False)
    monkeypatch.setattr(judging, "sized", lambda fit, one, share: whole if as_a_whole else one)
    monkeypatch.setattr(judging, "cross_validated", confirmed)
    fit: Any = SimpleNamespace(plain=None, solved=None, accepted=())
    if as_a_whole:
        with pytest.raises(ReachedError):
            judge_trial(fit, part, 0.0, POLICY)
        return
    found = judge_trial(fit, part, 0.0, POLICY)
    assert isinstance(found, Refusal)
    assert found.reason is Reason.TOO_SMALL


def delayed(late: float, spread: tuple[float, float], stated: bool = False) -> Any:
    """Return a fit with a delay of this size, s, beside half the variance of a filter, s^2; sampling may do 0.25 ms."""
    names = ["J", SPREAD, "tau"]
    estimate = SimpleNamespace(values=np.array([1.0, spread[0], late]), stderr=np.array([1e-3, spread[1], 4e-6]))
    model = SimpleNamespace(names=names, columns_of=lambda position: slice(2, 3))
    record = SimpleNamespace(early=1.25e-3, sampling=0.25e-3, sampling_stated=stated)
    effect = SimpleNamespace(structure=SimpleNamespace(delays=True))
    return SimpleNamespace(
        accepted=(SimpleNamespace(effect=effect),), position=lambda number: 0, model=model, estimate=estimate,
        plain=estimate, record=record,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("late", "spread", "stated", "expected"),
    [
        (0.36e-3, (0.0, 1e-9), False, None),  # a filter of 0.11 ms at least would have 6e-9
        (0.36e-3, (0.0, 3e-9), False, Reason.LIKE_FILTER),  # a clean log of a filter of 0.37 ms was called a delay
        (0.36e-3, (0.0, 3e-9), True, None),  # the log says how it was sampled
        (-1.4e-3, (1e-6, 1e-9), False, None),  # no filter makes a signal early
        (0.25e-3, (0.0, 1e-9), False, Reason.WITHIN_SAMPLING),
    ],
)
def test_a_delay_is_one_where_no_filter_can_be_it(
    late: float, spread: tuple[float, float], stated: bool, expected: Reason | None
) -> None:
    refusal = judge_sampling(delayed(late, spread, stated), POLICY)
    assert (refusal and refusal.reason) is expected


@pytest.mark.parametrize(("effect", "shape"), [("compliance", {FREQUENCY: 86.0}), ("cogging", {"order": 8.0})])
@pytest.mark.parametrize(
    ("noise", "spread", "refused"), [(0.7, 4e-5, True), (0.7, 1e-5, False), (0.7, -4e-5, False), (0.04, 4e-5, False)]
)
def test_a_spring_beside_a_spread_that_no_sampling_makes_is_noise(
    monkeypatch: pytest.MonkeyPatch, effect: str, shape: dict[str, float], noise: float, spread: float, refused: bool
) -> None:
    """Of 5 ms a sampling spreads a signal by 4.2e-6 s^2: three of them and of its errors are 1.5e-5."""
    monkeypatch.setattr(judging, "noise_share", lambda *args: noise)
    record = SimpleNamespace(acceleration=lambda: None, shaft_noise=lambda: None)
    model = SimpleNamespace(names=("J", SPREAD), sigma=np.array([1e-5, 4.2e-6]))
    plain = SimpleNamespace(values=np.array([1e-4, spread]), stderr=np.array([1e-7, 8e-7]))
    last = SimpleNamespace(effect=CATALOGUE[effect], shape=shape)
    after: Any = SimpleNamespace(record=record, model=model, plain=plain, accepted=(last,))
    found = judging._judge_noise(after)
    if not refused or effect != "compliance":
        assert found is None
        return
    assert found is not None
    assert found.reason is Reason.LIKE_NOISE
    assert "spread over 8.9 ms" in str(found)


@pytest.mark.parametrize(("effect", "symbol"), [("rising_friction", "w_r"), ("stribeck", "w_s")])
@pytest.mark.parametrize(("speed", "ran_out"), [(29.0, False), (31.0, True)])
def test_a_friction_that_bends_above_the_highest_speed_is_a_slope(
    effect: str, symbol: str, speed: float, ran_out: bool
) -> None:
    """Two clean logs of instants had a friction that rises over 2 and 3 times their highest speed, and no F_v."""
    omega = np.array([-30.0, 10.0, 90.0])
    record = SimpleNamespace(
        signals={"omega": omega}, mask=np.array([True, True, False]), at_grid=lambda values: values,
    )  # fmt: skip
    one = SimpleNamespace(effect=CATALOGUE[effect], shape={symbol: speed, "delta": 1.0}, grid=())
    assert judging._ran_out(one, record) is ran_out  # type: ignore[arg-type]

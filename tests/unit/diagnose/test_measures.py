"""The numbers that the criteria judge, from fits and trials that are written down by hand."""

from __future__ import annotations

import sys
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pmsm_ctrl.diagnose import measures
from pmsm_ctrl.diagnose.case import Case
from pmsm_ctrl.diagnose.measures import (
    contribution,
    gain_of_rows,
    in_band,
    in_doubt,
    plain_errors,
    record_deviation,
    seen_beyond,
    sized,
    typical_error,
    weighted_errors,
    winding_deviation,
    winding_return,
)
from pmsm_ctrl.diagnose.search import Trial
from pmsm_ctrl.regression.model import solve_on_factors

REST = np.array([3.0, -1.0, 2.0, 4.0, 5.0, 6.0])  # three rows of the log, then the priors of J, R and psi_f
PART = np.array([1.0, 0.5, 0.0, 2.0, 1.0, 4.0])  # what an effect explains of them


def solved() -> Any:
    model = SimpleNamespace(names=("J", "F_c", "R", "psi_f"), sigma=np.array([0.1, np.inf, 0.2, 0.3]))
    return SimpleNamespace(rest=REST, rows=3, model=model)


def test_gain_is_that_of_the_rows_and_relief_that_of_the_winding() -> None:
    fall = REST**2 - (REST - PART) ** 2
    assert gain_of_rows(solved(), PART) == pytest.approx(fall[:3].sum())
    assert winding_return(solved(), PART) == pytest.approx(fall[4] + fall[5]), "the inertia is no winding"
    assert winding_deviation(solved()) == pytest.approx(5.0**2 + 6.0**2)
    assert gain_of_rows(solved(), -PART) == 0.0


def test_records_that_left_each_other_are_counted_like_a_winding_off_its_datasheet() -> None:
    found = solved()
    found.model.names = ("J", "F_c", "dF_c between records, 1", "offset of all records")
    assert record_deviation(found) == pytest.approx(5.0**2 + 6.0**2)
    assert record_deviation(solved()) == 0.0


def fit(coarse: float = 0.0) -> Any:
    """Two balances of 100 samples: rms 10 N m with noise of 2 N m, and 5 V with noise of 0.1 V."""
    record = SimpleNamespace(
        channels=("torque", "u_q"), target=np.stack([np.full(100, 10.0), np.full(100, -5.0)]),
        weight=np.stack([np.ones(100), np.linspace(0.5, 1.0, 100)]), mask=np.arange(100) < 90,
        coarse=np.array([coarse, coarse]),
    )  # fmt: skip
    whitener = SimpleNamespace(channel=np.repeat([0, 1], 90), sigma=(2.0, 0.1))
    residual = np.stack([np.where(np.arange(100) < 90, 3.0, 99.0), np.full(100, 0.2)])
    return SimpleNamespace(record=record, whitener=whitener, residual=residual, plain=SimpleNamespace(rows=180))


def test_contribution_is_judged_where_it_is_largest() -> None:
    part = np.zeros(180)
    part[:10] = 0.5  # of the noise's 2 N m: 1 N m in ten samples of 90, a tenth of the balance
    trial = SimpleNamespace(plain_direction=part, group=SimpleNamespace(entering=((0, None),)))
    assert contribution(fit(), trial) == pytest.approx(0.1, rel=0.01)  # type: ignore[arg-type]
    assert contribution(fit(coarse=0.99), trial) == pytest.approx(0.1, rel=0.01)  # type: ignore[arg-type]
    assert contribution(fit(coarse=1.01), trial) == 0.0  # type: ignore[arg-type]


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_slow_effect_is_judged_at_the_frequencies_at_which_it_acts(seed: int) -> None:
    t = np.arange(1000) / 100.0
    slow, fast = np.sin(2.0 * np.pi * 0.5 * t), 3.0 * np.sin(2.0 * np.pi * 20.0 * t)
    noise = 0.1 * np.random.default_rng(seed).normal(size=1000)
    whitener, group = SimpleNamespace(channel=np.zeros(1000, int)), SimpleNamespace(entering=((0, None),))

    def found(rest: Any, part: Any) -> float:
        plain = SimpleNamespace(rows=1000, rest_of=lambda row: rest)
        judged = SimpleNamespace(whitener=whitener, plain=plain)
        return in_band(judged, SimpleNamespace(plain_direction=part, group=group))  # type: ignore[arg-type]

    rest = slow + fast + noise
    assert found(rest, slow) > 0.99, "it is a tenth of the residual, and all of what is slow"
    assert found(rest, fast) > 0.99
    assert found(fast + noise, 0.1 * slow) < 0.5, "what is not there"
    assert found(rest, 0.5 * slow) == pytest.approx(0.75, abs=0.02), "half of an amplitude is 3/4 of its square"


@pytest.mark.parametrize(
    ("value", "left", "expected"),
    [
        (1.3, 0.0, 1.0),  # holding it at 1.15 costs all that is left then
        (1.3, 0.05, 0.15**2 / (0.15**2 + 0.05**2)),
        (1.2, 0.5, 0.05**2 / (0.05**2 + 0.5**2)),  # sure by its standard error, yet what is left there is ten times it
    ],
)
def test_a_parameter_beyond_a_bound_explains_the_residual_where_it_acts(
    value: float, left: float, expected: float
) -> None:
    turn = 2.0 * np.pi * np.arange(1000) / 50.0
    column, beside, fast = np.sin(turn), np.ones(1000), 3.0 * np.sin(9.0 * turn)
    target = (
        value * column + 0.7 * beside + left * np.cos(turn) + fast
    )  # what it is not fitted to: cos at its frequency
    basis, triangle = np.linalg.qr(np.stack([column, beside], axis=1))
    model = SimpleNamespace(sigma=np.full(2, np.inf))
    found = solve_on_factors(model, triangle, basis.T @ target, (basis.T,), [target])  # type: ignore[arg-type]
    assert found.values == pytest.approx([value, 0.7])
    assert seen_beyond(found, 0, 1.15) == pytest.approx(expected, abs=1e-6)


def test_the_typical_error_does_not_see_single_edges() -> None:
    residual = np.concatenate([np.full(90, 0.2), np.full(5, 50.0), np.full(5, 99.0)])
    record = SimpleNamespace(mask=np.arange(100) < 95)
    judged = SimpleNamespace(record=record, residual=residual[None])
    assert typical_error(judged) == pytest.approx(0.2)  # type: ignore[arg-type]


def test_errors_of_moving_samples_weighted_and_not() -> None:
    assert plain_errors(fit()) == pytest.approx({"torque": 3.0, "u_q": 0.2})
    weight = np.linspace(0.5, 1.0, 100)[:90]
    assert weighted_errors(fit()) == pytest.approx({"torque": 3.0, "u_q": 0.2 * np.sqrt(np.mean(weight**2))})


def test_the_same_effects_of_the_same_shapes_are_not_fitted_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    made = []
    monkeypatch.setattr(sys.modules[Case.__module__], "fit_design", lambda *a: made.append(a[2]))
    case = Case(None, None, {})  # type: ignore[arg-type]
    accepted = (SimpleNamespace(effect=SimpleNamespace(id="stribeck"), shape={"w_s": 8.0}),)
    other = (SimpleNamespace(effect=SimpleNamespace(id="stribeck"), shape={"w_s": 8.1}),)
    kept = case.keep(SimpleNamespace(accepted=accepted))  # type: ignore[arg-type]
    assert case.keep(kept) is kept
    assert len(case.fits) == 1
    assert case.fit(accepted) is kept  # type: ignore[arg-type]
    assert made == []
    case.fit(other)  # type: ignore[arg-type]
    assert made == [other]
    assert case.holdout_errors(kept) == {}


@pytest.mark.parametrize(("in_part", "part", "taken"), [(True, 51.0, True), (True, 49.0, False), (False, 51.0, False)])
def test_an_effect_is_sized_as_a_whole_where_most_of_it_is_beyond_noise(
    monkeypatch: pytest.MonkeyPatch, in_part: bool, part: float, taken: bool
) -> None:
    """The part is compared with the whole beside the rivals: without them it would be 10 of 300 or more."""
    candidate: Any = SimpleNamespace(effect=SimpleNamespace(structure=SimpleNamespace(judged_in_part=in_part)))
    judge: Any = (None, None)

    def trial(name: Any, gain: float) -> Trial:
        return Trial(candidate, name, gain, gain, 0.0, np.ones(1), np.ones(1), judge, plain_gain=10.0)

    def beside(solved: Any, weights: Any, candidate: Any, group: Any) -> Any:
        assert solved == "solved beside the rivals"
        return SimpleNamespace(gain={"part": part, "whole": 100.0}[group])

    seen, whole = trial("part", 10.0), trial("whole", 300.0)
    monkeypatch.setattr(measures, "as_a_whole", lambda fit, trial: whole)
    monkeypatch.setattr(measures, "with_rivals", lambda fit, trial: "model with rivals")
    monkeypatch.setattr(measures, "solve_model", lambda record, model, weights, like: "solved beside the rivals")
    monkeypatch.setattr(measures, "try_group", beside)
    fit: Any = SimpleNamespace(record=None, weights=None, plain=None)
    found = sized(fit, seen, 0.5)
    assert found.group == ("whole" if taken else "part")
    assert found.plain_gain == (300.0 if taken else 10.0)


@pytest.mark.parametrize(
    ("in_part", "beyond", "doubted"), [(True, 49.0, True), (True, 51.0, False), (False, 0.0, False)]
)
def test_an_effect_is_in_doubt_where_all_that_is_fast_could_be_most_of_it(
    monkeypatch: pytest.MonkeyPatch, in_part: bool, beyond: float, doubted: bool
) -> None:
    candidate: Any = SimpleNamespace(effect=SimpleNamespace(structure=SimpleNamespace(judged_in_part=in_part)))
    judge: Any = (None, None)
    group: Any = SimpleNamespace(shape={})
    trial = Trial(candidate, group, 90.0, 90.0, 0.0, np.ones(1), np.ones(1), judge, plain_gain=100.0)
    monkeypatch.setattr(measures, "effect_group", lambda record, effect, shape: "whole")
    monkeypatch.setattr(measures, "seen_as_candidate", lambda record, group, offered: (group, offered))
    monkeypatch.setattr(measures, "beside_held", lambda group, responses: group)
    gains = {("whole", True): beyond}
    monkeypatch.setattr(measures, "try_group", lambda s, w, c, group: SimpleNamespace(gain=gains[group]))
    fit: Any = SimpleNamespace(record=None, weights=None, plain=None, model=SimpleNamespace(responses=()))
    assert in_doubt(fit, trial, 0.5) is doubted

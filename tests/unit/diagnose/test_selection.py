"""Forward selection, swap and verdict, as functions of numbers: no log is simulated here."""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose import diagnose
from pmsm_ctrl.diagnose import selection as rounds
from pmsm_ctrl.diagnose.case import Case
from pmsm_ctrl.diagnose.diagnosis import searched
from pmsm_ctrl.diagnose.fit import Accepted
from pmsm_ctrl.diagnose.look_alikes import equivalents
from pmsm_ctrl.diagnose.made_ready import condition
from pmsm_ctrl.diagnose.measures import has_own_order
from pmsm_ctrl.diagnose.policy import POLICY
from pmsm_ctrl.diagnose.refusal import Reason, Refusal
from pmsm_ctrl.diagnose.selection import Found, Selection, _akin, best, name_of, with_sampling_told
from pmsm_ctrl.diagnose.swap import Rest, better, equals, rival_ids
from pmsm_ctrl.diagnose.unexplained import impossible_winding
from pmsm_ctrl.effects.catalogue import CATALOGUE, catalogue_of
from pmsm_ctrl.result import Verdict
from pmsm_ctrl.simulate import simulate
from tests.effort import seeds

algorithm = sys.modules["pmsm_ctrl.diagnose.diagnosis"]
other_views = sys.modules["pmsm_ctrl.diagnose.other_views"]


def trial(effect: str, direction: list[float] | None = None, **changed: Any) -> Any:
    values = {
        "look_alikes": {},
        "free": (),
        "delays": False,
        "p_value": 0.0,
        "plain": None,
        "singular": False,
        "outside": "",
        "row": 0,
    } | changed
    candidate = SimpleNamespace(
        effect=SimpleNamespace(
            id=effect,
            look_alikes=values["look_alikes"],
            enters="torque",
            label=lambda shape: effect,
            structure=SimpleNamespace(delays=values["delays"], has_memory=False),
            signals=("omega",),
        ),
        free=lambda shape: values["free"],
    )
    return SimpleNamespace(
        candidate=candidate, group=SimpleNamespace(shape={}, entering=((values["row"], None),)),
        direction=np.array(direction or [0.0]), plain_direction=np.array(values["plain"] or direction or [0.0]),
        p_value=values["p_value"], singular=values["singular"], outside=values["outside"],
        wrong_sign=bool(values["outside"]),
    )  # fmt: skip


# ---- one round --------------------------------------------------------------------------------------------------


class FakeCase:
    """Fits nothing: a fit is the ids that are in it."""

    policy, minor_too, surely = POLICY, False, False
    nameable: frozenset[str] | None = None

    def fit(self, ids: tuple[str, ...]) -> Any:
        return SimpleNamespace(accepted=ids, trials=())

    def fit_beside(self, ids: tuple[str, ...], other: Any) -> Any:
        return self.fit(ids)


@pytest.fixture
def round_of(monkeypatch: pytest.MonkeyPatch) -> Any:
    def play(names: list[str], before: dict[str, Reason], after: dict[str, Reason], **given: Any) -> Found:
        judged: list[str] = []

        def judge(fit: Any, one: Any, p_holm: float, policy: Any, *rest: Any) -> Any:
            judged.append(one.candidate.effect.id)
            given.get("told", []).append(rest[-1])
            return (
                Refusal(before[judged[-1]])
                if judged[-1] in before
                else SimpleNamespace(name=judged[-1], barely=given.get("barely", False))
            )

        def refit(old: Any, new: Any, one: Any, policy: Any) -> Refusal | None:
            found = after.get(one.candidate.effect.id)
            return Refusal(found) if found else None

        monkeypatch.setattr(rounds, "judge_trial", judge)
        monkeypatch.setattr(rounds, "of_fast_torque", lambda fit, one, policy: given.get("fast", {}).get(name_of(one)))
        monkeypatch.setattr(rounds, "like_ripple", lambda case, fit, one: given.get("ripple", {}).get(name_of(one)))
        monkeypatch.setattr(rounds, "judge_refit", refit)
        monkeypatch.setattr(rounds, "judge_holdout", lambda *a: None)
        monkeypatch.setattr(rounds, "unlike_in_half", lambda *a: given.get("asked", []).append(a[-1]))
        monkeypatch.setattr(rounds, "judge_size", lambda case, new: given.get("sizes", {}).get(new.accepted[-1]))
        monkeypatch.setattr(rounds, "unlike_above", lambda case, new: given.get("above", {}).get(new.accepted[-1]))
        monkeypatch.setattr(rounds, "slight", lambda *a: given.get("slight", False))
        monkeypatch.setattr(rounds, "_with", lambda case, fit, one: (*fit.accepted, one.candidate.effect.id))
        monkeypatch.setattr(rounds, "equivalents", lambda *a: ())
        accepted = given.get("accepted", ())
        fit = SimpleNamespace(accepted=accepted, trials=tuple(trial(name) for name in names))
        steps: Any = tuple(SimpleNamespace(evidence=SimpleNamespace(size=0.1), trial=trial(one)) for one in accepted)
        so_far = Selection((fit,), steps, {"z": Refusal(Reason.TOO_SMALL)})  # type: ignore[arg-type]
        case = FakeCase()
        case.minor_too, case.surely = given.get("minor_too", False), given.get("surely", False)
        case.nameable = given.get("nameable")
        return best(case, so_far, given.get("start", ()))  # type: ignore[arg-type]

    return play


def test_the_first_that_passes_is_accepted_and_the_better_ones_are_refused(round_of: Any) -> None:
    found = round_of(["a", "b", "c", "d"], {"a": Reason.NOT_SIGNIFICANT}, {"b": Reason.BALANCE_WORSE})
    assert found.accepted
    assert found.fit.accepted == ("c",)
    assert {name: why.reason for name, why in found.refused.items()} == {
        "a": Reason.NOT_SIGNIFICANT, "b": Reason.BALANCE_WORSE,
    }  # fmt: skip


def test_what_a_ripple_of_the_current_explains_is_refused_before_the_refit(round_of: Any) -> None:
    found = round_of(["a", "b"], {}, {"a": Reason.BALANCE_WORSE}, ripple={"a": Refusal(Reason.LIKE_RIPPLE)})
    assert found.fit.accepted == ("b",)
    assert found.refused["a"].reason is Reason.LIKE_RIPPLE


def test_an_effect_that_the_fast_torque_alone_makes_is_refused_before_the_refit(round_of: Any) -> None:
    found = round_of(["a", "b"], {}, {"a": Reason.BALANCE_WORSE}, fast={"a": Refusal(Reason.FAST_TORQUE)})
    assert found.fit.accepted == ("b",)
    assert found.refused["a"].reason is Reason.FAST_TORQUE


def test_beside_a_command_that_is_ahead_nothing_is_named_that_was_not_beside_a_delay(round_of: Any) -> None:
    found = round_of(["a", "b"], {}, {}, nameable=frozenset("b"))
    assert found.fit.accepted == ("b",)
    assert found.refused["a"].reason is Reason.LIKE_COMMAND


def test_an_effect_whose_size_is_not_determined_is_refused(round_of: Any) -> None:
    undetermined = Refusal(Reason.NOT_DETERMINED, {"parameter": "z_s", "value": 1.0, "stderr": 1.0})
    found = round_of(["a", "b"], {}, {}, sizes={"a": undetermined})
    assert found.fit.accepted == ("b",)
    assert found.refused["a"] is undetermined


def test_a_wave_of_another_size_above_the_band_is_refused(round_of: Any) -> None:
    other = Refusal(Reason.OTHER_ABOVE, {"percent": 1970.0})
    found = round_of(["a", "b"], {}, {}, above={"a": other})
    assert found.fit.accepted == ("b",)
    assert found.refused["a"] is other


@pytest.mark.parametrize("flag", ["", "minor_too", "surely", "slight", "barely"])
@pytest.mark.parametrize("accepted", [(), ("z",)])
def test_a_first_effect_that_is_minor_and_any_slight_one_is_surely_the_same(
    round_of: Any, flag: str, accepted: tuple[str, ...]
) -> None:
    asked: list[bool] = []
    given = {flag: True} if flag else {}
    assert round_of(["a"], {}, {}, accepted=accepted, asked=asked, **given).accepted
    assert asked == [flag in ("slight", "barely") or (bool(flag) and not accepted)]


@pytest.mark.parametrize("flag", ["", "minor_too", "surely"])
@pytest.mark.parametrize("accepted", [(), ("z",)])
def test_left_out_blocks_may_barely_confirm_a_first_effect_of_the_usual_band(
    round_of: Any, flag: str, accepted: tuple[str, ...]
) -> None:
    told: list[bool] = []
    given = {flag: True} if flag else {}
    round_of(["a"], {}, {}, accepted=accepted, told=told, **given)
    assert told == [not accepted and not flag]


def test_none_passes(round_of: Any) -> None:
    found = round_of(["a", "b"], {"a": Reason.TOO_SMALL, "b": Reason.NOT_CONFIRMED}, {})
    assert not found.accepted
    assert list(found.refused) == ["a", "b"]
    start = Selection((SimpleNamespace(accepted=()),))  # type: ignore[arg-type]
    assert start.plus(found).refused == found.refused
    assert start.plus(found).fits == start.fits


def test_a_round_that_begins_with_an_effect_looks_at_no_other(round_of: Any) -> None:
    assert round_of(["a", "b"], {}, {}, start=("b",)).fit.accepted == ("b",)
    assert not round_of(["a", "b"], {"b": Reason.TOO_SMALL}, {}, start=("b",)).accepted


def test_bounds_are_judged_once_all_effects_to_begin_with_are_in(round_of: Any) -> None:
    out = {"b": Reason.MODEL_OUT_OF_BOUNDS}
    assert round_of(["b"], {}, out, start=("b", "c")).accepted
    assert not round_of(["b"], {}, out, start=("b",)).accepted
    assert not round_of(["b"], {}, out, start=("c", "b"), accepted=("c",)).accepted


def test_no_more_than_eight_effects_are_accepted(round_of: Any) -> None:
    assert round_of(["a"], {}, {}, accepted=tuple("bcdefgh")).accepted
    found = round_of(["a"], {}, {}, accepted=tuple("bcdefghi"))
    assert not found.accepted
    assert list(found.refused) == ["z"], "the reasons of the round before stand"


@pytest.mark.parametrize("delays", [True, False])
@pytest.mark.parametrize("within", [True, False])
@pytest.mark.parametrize(
    ("reason", "asked"),
    [
        (Reason.MINOR, True), (Reason.TOO_SMALL, True), (Reason.NOT_CONFIRMED, True), (Reason.BESIDE_LARGER, True),
        (Reason.EXPLAINED_BY_RIVALS, True), (Reason.PARAMETER_AT_BOUND, True), (Reason.NOT_SIGNIFICANT, False),
        (Reason.NOT_INDEPENDENT, False), (Reason.BALANCE_WORSE, False),
    ],
)  # fmt: skip
def test_sampling_comes_before_any_other_reason_against_a_significant_delay(
    monkeypatch: pytest.MonkeyPatch, reason: Reason, asked: bool, within: bool, delays: bool
) -> None:
    sampling = Refusal(Reason.WITHIN_SAMPLING) if within else None
    monkeypatch.setattr(rounds, "judge_sampling", lambda after, policy: sampling if after.accepted == ("a",) else None)
    monkeypatch.setattr(rounds, "own_sampling", lambda fit, policy: None)
    monkeypatch.setattr(rounds, "_with", lambda case, fit, one: (*fit.accepted, one.candidate.effect.id))
    fit = SimpleNamespace(accepted=(), trials=(trial("b"), trial("a", delays=delays)))
    before = Selection((fit,), (), {"a": Refusal(reason), "b": Refusal(Reason.MINOR)})  # type: ignore[arg-type]
    told = with_sampling_told(FakeCase(), before)  # type: ignore[arg-type]
    assert told.refused["a"].reason is (Reason.WITHIN_SAMPLING if asked and within and delays else reason)
    assert told.refused["b"].reason is Reason.MINOR


@pytest.mark.parametrize("seed", seeds(3, 4))
def test_a_delay_that_the_sampling_takes_up_is_as_long_as_that(designs: Path, seed: int) -> None:
    design = Design.read(designs / "hand_tuned.toml")
    log = simulate(design, "identification", seed=seed)
    refusal = diagnose(design, log, candidates=["delay"], plan=False).ranking[0].refusal
    assert refusal is not None
    assert refusal.reason is Reason.WITHIN_SAMPLING
    assert abs(refusal.detail["value"]) < 1e3 * log.period  # ms; all channels are of one tick


def test_a_delay_fitted_by_the_noise_of_another_fit_is_that_fitted_by_its_own(designs: Path) -> None:
    """The model of all candidates, whose residual is the noise, has the delay among them or in its base."""
    design = Design.read(designs / "hand_tuned.toml")
    offered = {name: CATALOGUE[name] for name in ("stribeck", "cogging", "delay")}
    case = condition(design, (simulate(design, "identification", seed=3),), (), offered, POLICY)
    fit = case.fit(())
    delay = (Accepted(CATALOGUE["delay"], next(t for t in fit.trials if name_of(t) == "delay").group.shape),)
    beside, whole = case.fit_beside(delay, fit), case.fit(delay)
    assert not beside.trials
    assert beside.model.names == whole.model.names
    own = list(range(len(whole.model.names)))[whole.model.columns_of(whole.position(0) or 0)]
    for k in own:
        error = float(whole.plain.stderr[k])
        assert abs(float(beside.estimate.values[k] - whole.estimate.values[k])) < 0.1 * error
        assert beside.plain.stderr[k] == pytest.approx(error, rel=0.1)


@pytest.mark.parametrize("reason", [Reason.MINOR, Reason.NOT_CONFIRMED])
@pytest.mark.parametrize(("passes", "stays"), [(True, True), (True, False), (False, False)])
def test_minor_effects_are_selected_where_one_was_refused_as_minor(
    monkeypatch: pytest.MonkeyPatch, reason: Reason, passes: bool, stays: bool
) -> None:
    def select(case: Case, start: Any = (), progress: Any = None, taken: Any = None) -> Selection:
        steps: Any = ("a",) if case.minor_too and passes else ()
        asked.append(case.minor_too)
        return Selection((fit,), steps, {"a": Refusal(reason)})

    def answered(case: Case, selection: Selection, plan: bool, progress: Any) -> Any:
        steps = selection.steps if stays else ()
        return case, SimpleNamespace(verdict=Verdict.CONSISTENT, selection=selection, steps=steps)

    fit: Any = SimpleNamespace()
    asked: list[bool] = []
    for name, made in {
        "_select": select, "_answered": answered, "explains_most": lambda *a: True,
        "together": lambda case, found: found, "sampled_in_step": lambda *a: None,
    }.items():  # fmt: skip
        monkeypatch.setattr(algorithm, name, made)
    for name in ("in_narrower_bands", "in_bands_of_springs"):
        monkeypatch.setattr(other_views, name, lambda *a: ())
    monkeypatch.setattr(other_views, "significant", lambda *a: {"a"})
    case, found = searched(Case(None, None, {}), False, lambda share: None)  # type: ignore[arg-type]
    assert asked == ([False, True] if reason is Reason.MINOR else [False])
    assert bool(found.steps) == case.minor_too == (passes and stays and reason is Reason.MINOR)
    assert [remark.code for remark in case.remarks] == (["minor_part"] if case.minor_too else [])


@pytest.mark.parametrize(("one", "other", "akin"), [
    ("viscous_power", "load_gravity", False), ("cogging", "viscous_asymmetry", False),
    ("quadratic_drag", "coulomb", True),  # the direction is the sign of the speed
    ("rising_friction", "viscous_asymmetry", True), ("unbalance", "cogging", True), ("constant_load", "cogging", True),
    ("compliance", "cogging", True), ("current_offset", "stribeck", True),
])  # fmt: skip
def test_effects_resemble_each_other_that_depend_on_something_alike(one: str, other: str, akin: bool) -> None:
    assert _akin(CATALOGUE[one], CATALOGUE[other]) is akin
    assert _akin(CATALOGUE[other], CATALOGUE[one]) is akin


# ---- equivalents ------------------------------------------------------------------------------------------------


def test_equivalents_explain_the_same_rows() -> None:
    chosen = trial("a", [100.0, 0.0, 0.0])
    others = [
        trial("same", [50.0, 0.0, 0.0]),  # however large: the direction counts
        trial("near", [100.0, 9.0, 0.0]),  # sin^2 = 0.8 %
        trial("far", [90.0, 12.0, 0.0]),  # 1.7 %
        trial("unphysical", [100.0, 0.0, 0.0], outside="a at its bound 0"),
    ]
    assert equivalents(chosen, [chosen, *others]) == ("same", "near")


def test_a_rival_that_explains_as_much_and_mostly_the_same_is_equivalent() -> None:
    """A drag of exponent 0.6 was called a rising friction: the drag explains more, at the bound of its exponent."""
    chosen = trial("a", [100.0, 0.0])
    others = [
        trial("better", [100.0, 45.0]),  # 83 % of the chosen one's gain is in it
        trial("other", [100.0, 60.0]),  # 74 %
        trial("less", [95.0, 25.0]),
        trial("singular", [0.0, 0.0], plain=[100.0, 45.0], singular=True, free=("n",)),  # in one of the two weightings
    ]
    assert equivalents(chosen, [chosen, *others]) == ("better", "singular")


def test_a_small_gain_is_tied_by_the_noise() -> None:
    chosen = trial("a", [5.0, 0.0])
    assert equivalents(chosen, [chosen, trial("b", [1.0, 1.0])]) == ("b",), "12.5 of 25 are less than 20"
    assert equivalents(chosen, [chosen, trial("b", [1.0, 3.0])]) == (), "22.5 of 25 are more"


def test_a_known_look_alike_without_columns_of_its_own_is_equivalent() -> None:
    chosen = trial("a", [100.0], look_alikes={"b": "why", "c": "why", "d": "why"})
    singular = [trial("b", singular=True), trial("c", singular=True, free=("w",)), trial("e", singular=True)]
    assert equivalents(chosen, [chosen, *singular]) == ("b",)


# ---- swap -------------------------------------------------------------------------------------------------------


def rest(plain: float, white: float = 100.0, gain: float = 1000.0, effects: str = "a") -> Rest:
    return Rest(plain, white, gain, Counter(effects), frozenset("b"))


@pytest.mark.parametrize(
    ("other", "wins"),
    [
        (rest(970.0, effects="b"), True),
        (rest(1030.0, effects="b"), False),
        (rest(990.0, 99.0, effects="b"), True),  # a tie: the prewhitened residual decides
        (rest(990.0, 101.0, effects="b"), False),
        (rest(1010.0, 99.0, effects="b"), True),
        (rest(981.0, 1.0, effects="ab"), False),  # the same and more has to leave less than a tie
        (rest(975.0, 200.0, effects="ab"), True),
        (rest(500.0, 50.0, effects="ac"), False),  # what was no effect beside a is none because it came first
        (rest(500.0, 50.0, effects="abc"), False),
    ],
)
def test_which_of_two_selections_is_kept(other: Rest, wins: bool) -> None:
    assert better(other, rest(1000.0)) is wins


def test_one_effect_in_the_place_of_another_is_equivalent_when_both_leave_the_same() -> None:
    found = rest(1000.0, effects="ab")
    assert rival_ids(found, rest(1019.0, effects="cb")) == ("a", "c")
    assert rival_ids(found, rest(1021.0, effects="cb")) is None
    assert rival_ids(found, rest(1000.0, 121.0, effects="cb")) is None
    assert rival_ids(found, rest(1000.0, effects="cd")) is None
    assert rival_ids(found, rest(1000.0, effects="abc")) is None
    assert rival_ids(found, found) is None


def test_beside_an_error_of_the_model_chance_makes_larger_differences() -> None:
    """A Stribeck curve left 22 less than the quadratic drag of 1070140, beside an error of the model."""
    found, other = replace(rest(1000.0), scatter=1.2), replace(rest(1023.0, effects="c"), scatter=1.25)
    assert rival_ids(found, other) == ("a", "c"), "23 of 24"
    assert rival_ids(found, replace(other, scatter=1.1)) is None, "23 of 22: the smaller scatter of both counts"
    assert not better(replace(rest(977.0, 101.0, effects="c"), scatter=1.2), found), "a tie"
    assert better(rest(977.0, 101.0, effects="c"), rest(1000.0))


def test_an_equivalent_is_tried_alone_for_two_effects() -> None:
    """A drag of exponent 1.7 was called a quadratic one beside a Stribeck curve, on two of five axes (2488, 2528)."""
    effects = {name: SimpleNamespace(repeated=name == "r") for name in "abcr"}

    def step(name: str, *alike: str) -> Any:
        candidate = SimpleNamespace(effect=SimpleNamespace(id=name))
        return SimpleNamespace(trial=SimpleNamespace(candidate=candidate), equivalents=alike)

    steps = [step("a", "c", "r"), step("b", "a", "gone")]
    starts = equals(SimpleNamespace(effects=effects), SimpleNamespace(steps=steps))  # type: ignore[arg-type]
    assert list(starts) == [("c",)], (
        "neither an effect that is there, nor one with orders, nor one that is no candidate"
    )
    steps[1].equivalents = ("c",)
    starts = equals(SimpleNamespace(effects=effects), SimpleNamespace(steps=steps))  # type: ignore[arg-type]
    assert list(starts) == [("c",), ("a", "c")]


# ---- friction -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("same", [True, False])
@pytest.mark.parametrize(("R", "stderr", "found"), [(4.3, 0.1, True), (3.1, 0.1, False), (4.3, 1.2, False)])
def test_a_winding_fifteen_tolerances_off_is_unexplained(R: float, stderr: float, found: bool, same: bool) -> None:
    """The nominal resistance is 1 Ohm, its tolerance at least 15 %: impossible from 3.25 Ohm on."""
    i_q = np.linspace(-1.0, 1.0, 400)
    matrix = np.stack([0.0 * i_q, 0.0 * i_q, i_q])[:, :, None]
    plain = SimpleNamespace(
        values=np.array([R]), stderr=np.array([stderr]),
        model=SimpleNamespace(names=("R",), nominal=np.array([1.0]), sigma=np.array([0.05]), matrix=matrix),
    )  # fmt: skip
    record = SimpleNamespace(
        channels=("torque", "u_d", "u_q"), mask=np.ones(400, dtype=bool), drive="torque",
        signals={"i_q": i_q, "omega": np.ones(400)}, at_grid=lambda x: x,
    )  # fmt: skip
    trials = [
        SimpleNamespace(singular=singular, candidate=SimpleNamespace(effect=effect))
        for singular, effect in ((same, CATALOGUE["dead_time"]), (True, CATALOGUE["cogging"]))
    ]
    fit = SimpleNamespace(plain=plain, record=record, residual=np.full((3, 400), 1e-3), trials=trials)
    structure = impossible_winding(fit)  # type: ignore[arg-type]
    assert (structure is not None) is found
    if structure is not None:
        assert (structure.channel, structure.resembles, structure.notice.code) == (
            "u_q", "a resistance", "winding_impossible",
        )  # fmt: skip
        assert structure.share == pytest.approx(1.0, abs=1e-4)
        assert "R would be 4.3 Ohm, 4.3 times its nominal value" in structure.notice.text
        why = "this log does not tell dead_time from it" if same else "no effect of the catalogue explains it"
        assert structure.notice.text.endswith(f"resembles a resistance; {why}")
        x, forward, backward = structure.curve
        assert np.polyfit(x, forward, 1)[0] == pytest.approx(R - 1.0, rel=0.01)
        assert np.isnan(backward).all()


# ---- orders that an accepted effect has --------------------------------------------------------------------------


@pytest.mark.parametrize(("order", "own"), [(12.0, True), (38.0, False), (24.0, False), (48.0, True), (76.0, False)])
def test_a_wave_of_the_order_of_an_accepted_effect_is_what_that_effect_leaves(order: float, own: bool) -> None:
    catalogue = catalogue_of(Design.example("seed_motor"))
    accepted = tuple(
        SimpleNamespace(effect=catalogue[name], shape=shape)
        for name, shape in (("current_gain", {}), ("cogging", {"order": 24.0}))
    )
    record = SimpleNamespace(design=SimpleNamespace(motor=SimpleNamespace(p=19)))
    fit: Any = SimpleNamespace(record=record, accepted=accepted)
    wave: Any = SimpleNamespace(
        candidate=SimpleNamespace(effect=catalogue["cogging"]), group=SimpleNamespace(shape={"order": order})
    )
    assert has_own_order(fit, wave) is own
    load: Any = SimpleNamespace(candidate=SimpleNamespace(effect=catalogue["constant_load"]), group=wave.group)
    assert not has_own_order(fit, load)


def test_only_what_acts_in_the_same_balance_makes_a_contribution_small() -> None:
    """A dead time is 30 % of a voltage, and no model error of it is in the torque."""
    sizes = {"dead_time": (1, 0.3), "cogging": (0, 0.02)}
    steps: Any = tuple(
        SimpleNamespace(evidence=SimpleNamespace(size=size), trial=trial(name, row=row))
        for name, (row, size) in sizes.items()
    )
    found = Selection((), steps)
    assert found.largest_beside(trial("stribeck", row=0)) == 0.02
    assert found.largest_beside(trial("inductance_saturation", row=1)) == 0.3
    assert found.largest_beside(trial("something", row=2)) == 0.0

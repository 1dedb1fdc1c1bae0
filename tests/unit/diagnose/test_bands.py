"""The other bands in which a name is looked for where the usual one has none."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pmsm_ctrl import Design, simulate
from pmsm_ctrl.diagnose import above_band, diagnose
from pmsm_ctrl.diagnose.bands import conditioned_in
from pmsm_ctrl.diagnose.made_ready import condition
from pmsm_ctrl.diagnose.other_bands import hidden_by_noise, in_bands_of_springs, in_narrower_bands, rings_beyond
from pmsm_ctrl.diagnose.policy import POLICY
from pmsm_ctrl.diagnose.refusal import Reason, Refusal
from pmsm_ctrl.diagnose.same_size import same_above, same_in_half
from pmsm_ctrl.log import Log
from pmsm_ctrl.simulate import scenario
from tests.benchmarks.worlds.hidden import simulate_world
from tests.benchmarks.worlds.world import draw
from tests.effort import slow
from tests.unit.regression.test_fast_orders import DRIVEN, driven


@pytest.fixture
def seed_motor(designs: Path) -> Design:
    return Design.read(designs / "seed_motor.toml")


def test_half_of_the_default_band_follows_it_and_nothing_follows_that(seed_motor: Design) -> None:
    log = simulate(seed_motor, "triangle", seed=1)
    case = condition(seed_motor, log, (), {}, POLICY)
    assert case.record.cutoff == 40.0
    (half,) = in_narrower_bands(case)
    assert half.record.cutoff == 20.0
    (said,) = [one for one in half.remarks if one.code == "narrower_band"]
    assert said.detail == {"band": 20.0, "usual": 40.0}
    assert half.believed is case.believed, "log and design are examined once"
    assert not list(in_narrower_bands(half))


def tried(name: str, resonance: float | None) -> Any:
    structure = SimpleNamespace(resonance=lambda shape: resonance)
    effect = SimpleNamespace(structure=structure, label=lambda shape: name)
    return SimpleNamespace(candidate=SimpleNamespace(effect=effect), group=SimpleNamespace(shape={}))


def refused(reason: Reason, *trials: Any) -> Any:
    return SimpleNamespace(fit=SimpleNamespace(trials=trials), refused={"spring": Refusal(reason)})


@pytest.mark.parametrize(
    ("shown", "reason", "bands"),
    [
        ({"spring"}, Reason.EXPLAINED_BY_RIVALS, [64.0, 100.0]),
        ({"spring", "drag"}, Reason.MINOR, [64.0, 100.0]),
        ({"spring"}, Reason.OTHER_BAND, []),
        ({"drag"}, Reason.MINOR, []),
        (set(), Reason.NOT_SIGNIFICANT, []),
    ],
)
def test_a_spring_is_looked_for_in_wider_bands_where_the_usual_one_shows_it(
    seed_motor: Design, shown: set[str], reason: Reason, bands: list[float]
) -> None:
    case = condition(seed_motor, simulate(seed_motor, "triangle", seed=1), (), {}, POLICY)
    found = refused(reason, tried("spring", 70.0), tried("drag", None))
    assert [one.record.cutoff for one in in_bands_of_springs(case, found, shown)] == bands


def test_no_band_is_wider_than_the_log_holds(seed_motor: Design) -> None:
    slow_log = seed_motor.replace(sensor={"log_divider": 4 * seed_motor.sensor.log_divider})
    case = condition(slow_log, simulate(slow_log, "triangle", seed=1), (), {}, POLICY)
    found = refused(Reason.MINOR, tried("spring", 70.0))
    assert case.record.prepared.rate == pytest.approx(250.0)
    assert [one.record.cutoff for one in in_bands_of_springs(case, found, {"spring"})] == pytest.approx([50.0])


@pytest.mark.parametrize(
    ("resonance", "explained", "counts"),
    [
        (63.0, 0.6, True),
        (33.0, 0.6, True),
        (31.0, 0.6, False),
        (65.0, 0.6, False),
        (None, 0.6, False),
        (63.0, 0.4, False),
    ],
)
def test_what_rings_beyond_both_bands_or_inside_the_usual_one_or_is_a_minor_part_does_not_count(
    resonance: float | None, explained: float, counts: bool
) -> None:
    case: Any = SimpleNamespace(record=SimpleNamespace(cutoff=64.0), policy=POLICY)
    step = SimpleNamespace(evidence=SimpleNamespace(explained=explained))
    first = SimpleNamespace(effect=tried("spring", resonance).candidate.effect, shape={})
    found: Any = SimpleNamespace(steps=(step,), fits=(None, SimpleNamespace(accepted=(first,))))
    assert rings_beyond(40.0, case, found) is counts
    assert not rings_beyond(40.0, case, SimpleNamespace(steps=()))  # type: ignore[arg-type]


def test_a_spring_that_rings_beyond_the_usual_band_is_named(seed_motor: Design) -> None:
    """In 40 Hz a load that rings at 97 Hz is a filter of the torque, and the answer was consistent."""
    k = 4e-5 * (2.0 * np.pi * 97.0) ** 2
    truth = seed_motor.with_effect("compliance", {"J_load": 4e-5, "k": k, "d": 5e-4})
    log = simulate(seed_motor, scenario("identification", seed_motor, duration=15.0), truth=truth, seed=4)
    found = diagnose(seed_motor, log, plan=False)
    assert [step.effect for step in found.steps] == ["compliance"]
    assert found.steps[0].parameters["k"].value / found.steps[0].parameters["J_load"].value == pytest.approx(
        k / 4e-5, rel=0.03
    )
    assert "band_of_a_spring" in [one.code for one in found.notices]


def test_a_band_whose_filters_ring_over_all_pieces_of_a_log_is_none(seed_motor: Design) -> None:
    # pieces of half a second: four periods of 40 Hz at either end leave most of it, four of 20 Hz hardly a sample
    log = simulate(seed_motor, "triangle", seed=1)
    keep = log.t % 0.55 < 0.5
    pieces = Log({name: values[keep] for name, values in log.channels.items()})
    case = condition(seed_motor, pieces, (), {}, POLICY, band=40.0)
    assert case.record.mask.sum() > 500
    assert conditioned_in(20.0, case) is None
    assert not list(in_narrower_bands(case))


@pytest.mark.parametrize("band", [10.0, 20.0])
def test_a_band_that_was_asked_for_is_kept(seed_motor: Design, band: float) -> None:
    log = simulate(seed_motor, "triangle", seed=1)
    assert condition(seed_motor, log, (), {}, POLICY, band=band).record.cutoff == band


@pytest.mark.parametrize(
    ("left", "stderr", "same"),
    [(1.0, 0.1, True), (0.6, 0.0, True), (0.3, 0.1, True), (0.3, 0.05, False), (-0.3, 0.02, False), (-5.0, 2.0, True)],
)
def test_an_effect_of_less_than_half_its_size_is_another_one_where_that_is_sure(
    left: float, stderr: float, same: bool
) -> None:
    found = same_in_half(left, stderr)
    assert (found is None) == same
    if found is not None:
        assert found.reason is Reason.OTHER_BAND
        assert found.detail == {"percent": pytest.approx(100.0 * left)}


@pytest.mark.parametrize(
    ("left", "stderr", "fixed", "same"),
    [(1.6, 0.04, True, True), (1.7, 0.05, True, False), (3.0, 0.6, True, True), (1.7, 0.05, False, True)],
)
def test_an_effect_of_surely_half_as_much_again_is_another_one_unless_it_is_a_spring(
    left: float, stderr: float, fixed: bool, same: bool
) -> None:
    found = same_in_half(left, stderr, fixed=fixed)
    assert (None if found is None else found.reason) == (None if same else Reason.OTHER_BAND)


@pytest.mark.parametrize(
    ("left", "stderr", "same"),
    [(1.0, 0.1, True), (0.6, 0.03, True), (0.6, 0.04, False), (1.7, 0.09, True), (1.7, 0.11, False), (1.0, 0.2, False)],
)
def test_a_minor_effect_is_named_where_it_is_surely_the_same(left: float, stderr: float, same: bool) -> None:
    found = same_in_half(left, stderr, surely=True)
    assert (found is None) == same


@pytest.mark.parametrize(
    ("left", "stderr", "same"),
    [
        (1.0, 0.01, True), (0.6, 0.0, True), (0.3, 0.1, True), (0.3, 0.05, False), (-0.2, 0.2, False), (1.9, 0.0, True),
        (2.2, 0.1, True), (20.0, 0.6, False),
    ],
)  # fmt: skip
def test_a_wave_that_is_surely_another_one_above_the_band_is_none(left: float, stderr: float, same: bool) -> None:
    found = same_above(left, stderr)
    assert (found is None) == same
    if found is not None:
        assert str(found) == f"rejected: of another size above the band, {100.0 * left:.0f} % of that in it"


# of 2 order 57 is named beside the line of order 60, and what is above the band does not decide
@pytest.mark.parametrize(
    ("seed", "reason"),
    [
        (1, Reason.OTHER_ABOVE), slow(3, Reason.ONE_PATH),
        pytest.param(2, Reason.OTHER_ABOVE, marks=pytest.mark.xfail(strict=True)),
    ],
)  # fmt: skip
def test_a_line_of_the_encoder_is_no_wave_above_the_band(seed: int, reason: Reason) -> None:
    log = driven(seed, 0.0, 60, top=24.0)
    lined = log.with_channels(theta=log["theta"] + 1e-4 * np.sin(60.0 * log["theta"]))
    found = diagnose(DRIVEN, lined, candidates=["cogging"], plan=False)
    assert not found.steps
    assert [one.refusal.reason for one in found.ranking if one.refusal] == [reason]


@pytest.mark.parametrize("seed", [1, slow(2), slow(3)])
def test_a_wave_of_the_torque_is_as_large_above_the_band(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    seen = []
    judge = same_above
    monkeypatch.setattr(above_band, "same_above", lambda *a: seen.append(a) or judge(*a))
    found = diagnose(DRIVEN, driven(seed, 0.1, 30, top=24.0), candidates=["cogging"], plan=False)
    assert [step.parameters["order"].value for step in found.steps] == [30.0]
    ((size, stderr, _),) = seen
    assert size == pytest.approx(1.0, abs=0.05 + 3.0 * stderr)
    assert stderr < 0.1


@pytest.mark.slow
def test_an_error_of_the_model_that_changes_with_the_band_has_no_name() -> None:
    """A clean world: what is left at 40 Hz is a Stribeck friction of 0.5 of its excess, and its negative at 20 Hz."""
    world = draw(660131)
    found = diagnose(world.design, simulate_world(world), candidates=["stribeck"], plan=False)
    assert not found.steps
    assert str(found.verdict) == "consistent"
    assert found.record.timing.reversals > 5e-4


@pytest.mark.slow
@pytest.mark.xfail(strict=True, reason="the error was that of reversals by a torque that is late; they are in time now")
def test_why_an_error_of_the_model_that_changes_with_the_band_has_no_name() -> None:
    world = draw(660131)
    (ranked,) = diagnose(world.design, simulate_world(world), candidates=["stribeck"], plan=False).ranking
    assert ranked.refusal is not None
    assert ranked.refusal.reason is Reason.OTHER_BAND


@pytest.mark.parametrize(
    ("memory", "explained", "reason", "shown", "named"),
    [
        (False, 0.01, Reason.MINOR, True, True), (False, 0.9, Reason.NOT_SIGNIFICANT, False, False),
        (True, 0.11, Reason.MINOR, True, True), (True, 0.09, Reason.MINOR, True, False),
        (True, 0.9, Reason.PARAMETER_AT_BOUND, True, False), (True, 0.9, Reason.NOT_DETERMINED, True, False),
        (True, 0.9, Reason.BALANCE_WORSE, True, True), (True, 0.9, Reason.NOT_CONFIRMED, False, False),
    ],
)  # fmt: skip
def test_what_a_narrower_band_shows_is_what_noise_hid(
    memory: bool, explained: float, reason: Reason, shown: bool, named: bool
) -> None:
    structure = SimpleNamespace(has_memory=memory, delays=False)
    effect = SimpleNamespace(label=lambda shape: "a", structure=structure)
    trial = SimpleNamespace(candidate=SimpleNamespace(effect=effect), group=SimpleNamespace(shape={}))
    step: Any = SimpleNamespace(trial=trial, evidence=SimpleNamespace(explained=explained))
    assert hidden_by_noise(step, {"a"} if shown else set(), {"a": Refusal(reason)}, POLICY) == named
    structure.delays = True
    assert hidden_by_noise(step, {"a"} if shown else set(), {"a": Refusal(reason)}, POLICY) == (named and not memory)

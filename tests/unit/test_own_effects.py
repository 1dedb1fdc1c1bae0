"""Every effect as a user's own with all its parameters renamed: the answers are those of the catalogue's effect."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose import diagnose
from pmsm_ctrl.effects import CATALOGUE, Effect
from pmsm_ctrl.effects.structures import LogView, UnavailableError
from pmsm_ctrl.effects.structures.interface import Known
from pmsm_ctrl.export.tables import cogging_table
from pmsm_ctrl.identify import identify
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.balances import Record, make_record
from pmsm_ctrl.regression.columns import Group, candidate_groups, effect_group
from pmsm_ctrl.simulate import scenario, simulate
from pmsm_ctrl.simulate.compose import source
from pmsm_ctrl.simulate.motions import Limits
from pmsm_ctrl.simulate.run import prepare
from pmsm_ctrl.tune.linearise import rigid, second_mass
from pmsm_ctrl.tune.robust import varied
from tests.unit.renamed import names_of, renamed
from tests.unit.simulate.composed import simulate_composed

each_effect = pytest.mark.parametrize("effect", [pytest.param(e, id=e.id) for e in CATALOGUE.values()])


@pytest.fixture(scope="module")
def design(designs) -> Design:
    return Design.read(designs / "seed_motor.toml")


@pytest.fixture(scope="module")
def log(design: Design) -> Log:
    return simulate_composed(design, scenario("identification", design, duration=15.0), seed=3)


@pytest.fixture(scope="module")
def record(design: Design, log: Log) -> Record:
    return make_record(design, log)


def back(effect: Effect, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return values by the symbols of the catalogue."""
    old = {new: symbol for symbol, new in names_of(effect).items()}
    return {old.get(symbol, symbol): value for symbol, value in values.items()}


@each_effect
def test_the_kernel_has_the_same_lines(effect: Effect) -> None:
    companion = CATALOGUE["coulomb"]  # a bristle stands for the direction in it
    text, own = source((effect, companion)), source((renamed(effect), companion))
    for symbol, new in names_of(effect).items():
        own = re.sub(rf"\be0_{new}\b", f"e0_{symbol}", own)
    given = [name if name not in names_of(effect) else f"e0_{name}" for name in effect.arguments]
    for n, line in enumerate(own.splitlines()):
        calls = re.findall(r"e0_term\(([^()]*)\)", line)
        for call in calls:  # the own term takes its arguments the other way round
            arguments = call.split(", ")
            assert len(arguments) == len(given), f"line {n + 1}"
            own = own.replace(f"e0_term({call})", f"e0_term<{', '.join(reversed(arguments))}>")
    assert own.replace("<", "(").replace(">", ")") == text.replace("<", "(").replace(">", ")")


@each_effect
def test_the_simulation_starts_from_the_same_numbers(effect: Effect, design: Design) -> None:
    own = renamed(effect)
    design = design.without_effect(effect.id)
    motion = scenario("identification", design, duration=15.0)
    plain = prepare(design, motion, truth=design.with_effect(effect.id, dict(effect.example)))
    mine = prepare(design, motion, truth=design.with_own_effects(own).with_effect(own.id, dict(own.example)))
    assert mine.effects == plain.effects
    np.testing.assert_array_equal(mine.states(), plain.states())


@pytest.mark.slow
@pytest.mark.parametrize("name", ["compliance", "backlash", "presliding", "delay", "encoder_eccentricity"])
def test_the_simulation_gives_the_same_log(name: str, design: Design) -> None:
    effect = CATALOGUE[name]
    own = renamed(effect)
    mine = design.with_own_effects(own).with_effect(own.id, dict(own.example))
    motion = scenario("sweep", design, speed_max=20.0, speed_step=20.0)
    log = simulate(mine, motion, seed=1)
    wanted = simulate(design.with_effect(effect.id, dict(effect.example)), motion, seed=1)
    for channel in wanted:
        np.testing.assert_allclose(log[channel], wanted[channel], rtol=1e-7, atol=1e-9, err_msg=channel)


@each_effect
def test_tuning_scenarios_and_tables_take_it_for_what_it_is(effect: Effect, design: Design) -> None:
    own = renamed(effect)
    design = design.without_effect(effect.id)
    plain = design.with_effect(effect.id, dict(effect.example))
    mine = design.with_own_effects(own).with_effect(own.id, dict(own.example))
    assert second_mass(mine) == second_mass(plain)
    assert [e.id == own.id for e in rigid(mine).effects] == [e.id == effect.id for e in rigid(plain).effects]
    heavier = varied(mine, {"J": 0.2}).parameters(own.id), varied(plain, {"J": 0.2}).parameters(effect.id)
    assert back(effect, heavier[0]) == heavier[1]
    assert Limits.of(mine) == Limits.of(plain)
    assert cogging_table(mine) == cogging_table(plain)


# Of each structure and each channel, and of terms with a parameter that is searched; each compiles its own columns.
ALIKE = {
    "coulomb", "viscous", "rising_friction", "viscous_asymmetry", "constant_load", "quadratic_drag", "unbalance",
    "load_dependent_friction", "position_dependent_friction", "torque_saturation", "current_offset", "torque_ripple",
    "inductance_saturation",
}  # fmt: skip


@pytest.mark.parametrize(
    "effect", [pytest.param(e, id=e.id, marks=[pytest.mark.slow] * (e.id in ALIKE)) for e in CATALOGUE.values()]
)
def test_the_columns_the_search_and_the_bounds_are_the_same(effect: Effect, record: Record) -> None:
    own, names = renamed(effect), names_of(effect)
    assert effect.structure.available(record, effect) == own.structure.available(record, own)
    rng = np.random.default_rng(1)
    view = LogView(
        record,
        rng.normal(size=len(record.t)),
        lambda highest: np.arange(1.0, highest + 1.0),
        lambda number: (np.array([0.3]), 1),
    )
    found, other = effect.structure.search(effect, view), own.structure.search(own, view)
    assert [back(effect, shape) for shape in other.shapes] == list(found.shapes)
    assert (other.tried, other.why_not) == (found.tried, found.why_not)
    entered = effect.structure.shape(effect, effect.example)
    assert back(effect, own.structure.shape(own, own.example)) == entered
    known = Known(J=1e-4, F_c=0.02, dry=0.03)
    assert back(effect, own.structure.bounds(own, known, own.structure.shape(own, own.example))) == (
        effect.structure.bounds(effect, known, entered)
    )
    for shape in (*found.shapes[:1], *found.shapes[-1:], entered):
        mine = {names.get(symbol, symbol): value for symbol, value in shape.items()}
        for build in (effect_group, seen):
            wanted = build(record, effect, shape).values
            rounding = 1e-9 * max(float(np.abs(wanted).max()), 1e-300)  # a load behind a gap is followed over a minute
            np.testing.assert_allclose(build(record, own, mine).values, wanted, rtol=0.0, atol=rounding)
        amounts = dict.fromkeys(effect.structure.symbols(effect), 0.001)
        mine |= {names.get(symbol, symbol): value for symbol, value in amounts.items()}
        parameters = back(effect, own.structure.parameters(own, mine))
        assert parameters == effect.structure.parameters(effect, {**shape, **amounts})
        for name, value in shape.items():
            for factor in (0.5, 1.05, 40.0):
                there = effect.structure.inside(effect, shape, name, factor * value)
                assert own.structure.inside(own, mine, names.get(name, name), factor * value) == there


def seen(record: Record, effect: Effect, shape: Mapping[str, float]) -> Group:
    return candidate_groups(record, effect, [shape])[0]


def wrong_log(design: Design, effect: Effect, values: Mapping[str, float]) -> Log:
    truth = design.with_effect(effect.id, dict(values))
    motion = scenario("identification", design, duration=15.0)
    if effect.has_state:
        return simulate(design, motion, truth=truth, seed=3)
    return simulate_composed(design, motion, truth, seed=3)


# One of every structure, and of every role that a parameter can have.
CHOSEN = ("delay",)
FURTHER = (
    "encoder_eccentricity", "cogging", "backlash", "stribeck", "presliding", "viscous_power", "iron_loss", "dead_time",
    "current_gain", "compliance",
)  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", [*CHOSEN, *(pytest.param(name, marks=pytest.mark.slow) for name in FURTHER)])
def test_identify_and_diagnose_give_the_same_answers(name: str, design: Design) -> None:
    effect = CATALOGUE[name]
    own = renamed(effect)
    strong = {symbol: 2.0 * value if symbol in effect.amplitudes else value for symbol, value in effect.example.items()}
    log = wrong_log(design, effect, strong)
    carrying = design.with_own_effects(own)
    mine = {names_of(effect)[symbol]: value for symbol, value in strong.items()}
    found = identify(design.with_effect(effect.id, strong), log).to_dict()["parameters"]
    other = identify(carrying.with_effect(own.id, mine), log).to_dict()["parameters"]
    same(back(effect, other), found)
    answer = diagnose(design, log, candidates=(effect.id,), plan=False).to_dict()
    own_answer = diagnose(carrying, log, candidates=(own.id,), plan=False).to_dict()
    for key in ("verdict", "errors", "parameter_deviations"):
        same(own_answer[key], answer[key])
    assert len(own_answer["steps"]) == len(answer["steps"])
    for step, wanted in zip(own_answer["steps"], answer["steps"], strict=True):
        same(back(effect, step["parameters"]), wanted["parameters"])
        same(step["evidence"], wanted["evidence"])


def test_a_current_gain_of_ones_own_is_corrected_like_the_catalogues(design: Design) -> None:
    log = simulate(design, "identification", seed=3)
    own = renamed(CATALOGUE["current_gain"])
    gain = dict.fromkeys(own.example, 0.0) | {names_of(CATALOGUE["current_gain"])["g"]: 0.1}
    found = identify(design.with_own_effects(own).with_effect(own.id, gain), log)
    J = identify(design, log).estimates["J"].value
    assert found.estimates["J"].value == pytest.approx(J / (1.0 + 0.1), rel=1e-3)


def test_a_role_that_is_no_parameter_is_refused() -> None:
    from pmsm_ctrl.errors import DesignError

    effect = renamed(CATALOGUE["backlash"])
    with pytest.raises(DesignError, match="'gap' is none of its parameters"):
        replace(effect, structure=replace(effect.structure, gap="gap"))  # type: ignore[call-arg]
    with pytest.raises(DesignError, match="'n' is none of its parameters"):
        replace(renamed(CATALOGUE["cogging"]), order="n")


def test_an_own_effect_without_columns_says_so(record: Record) -> None:
    effect = renamed(CATALOGUE["stribeck"])
    none = replace(effect, parameters=tuple(replace(p, linear=False) for p in effect.parameters))
    with pytest.raises(UnavailableError, match="no parameter that multiplies a column"):
        effect_group(record, none, {p.symbol: p.start for p in none.parameters})


def same(found: Any, wanted: Any, path: str = "") -> None:
    """Equal to rounding, whatever is nested in it."""
    if isinstance(wanted, Mapping):
        assert set(found) == set(wanted), path
        for key in wanted:
            same(found[key], wanted[key], f"{path}.{key}")
    elif isinstance(wanted, list | tuple):
        assert len(found) == len(wanted), path
        for k, (a, b) in enumerate(zip(found, wanted, strict=True)):
            same(a, b, f"{path}[{k}]")
    elif isinstance(wanted, float):
        assert found == pytest.approx(wanted, rel=1e-7, abs=1e-12, nan_ok=True), path
    else:
        assert found == wanted, path

"""Generic tests over the catalogue: whoever adds an effect is tested here without adding a line."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from pmsm_ctrl.design import Design, EffectEntry
from pmsm_ctrl.effects import (
    CATALOGUE,
    SIGNALS,
    Effect,
    Parameter,
    bound_effects,
    catalogue_of,
    catalogue_with,
    kernel,
    lookup,
)
from pmsm_ctrl.effects.evaluate import columns
from pmsm_ctrl.effects.structures.interface import Known
from pmsm_ctrl.errors import DesignError, RequestError

# The ids the project has agreed on, built or not yet: look-alikes may name any of them.
AGREED = {
    "coulomb", "viscous", "stribeck", "presliding", "viscous_asymmetry", "constant_load", "viscous_power",
    "quadratic_drag", "load_dependent_friction", "position_dependent_friction", "thermal_drift", "unbalance",
    "cogging", "torque_ripple", "torque_saturation", "iron_loss", "compliance", "backlash", "dead_time",
    "inductance_saturation", "current_offset", "current_gain", "encoder_eccentricity", "delay",
    "rising_friction", "detent_force", "load_gravity",
}  # fmt: skip
# Wrong parameters are not effects, but an effect may look like one.
PARAMETERS = {"J", "psi_f", "R", "L_d", "L_q", "K_t"}

MOTOR = {"J": 9e-5, "R": 19.0, "L_d": 0.049, "L_q": 0.049, "p": 4, "psi_f": 0.172}
EFFECTS = [pytest.param(effect, id=effect.id) for effect in CATALOGUE.values()]
each_effect = pytest.mark.parametrize("effect", EFFECTS)


def effects_that(holds: Callable[[Effect], bool]) -> pytest.MarkDecorator:
    """Parametrise over the effects a test applies to; a skip is kept for what should have run and could not."""
    chosen = [pytest.param(effect, id=effect.id) for effect in CATALOGUE.values() if holds(effect)]
    assert chosen
    return pytest.mark.parametrize("effect", chosen)


def dry_torque(effect: Effect) -> bool:
    return effect.dry and effect.enters == "torque"


def modulates(effect: Effect) -> bool:
    """Whether the effect changes another friction's level up and down instead of being a friction of its own."""
    return any(p.lower < 0.0 for p in effect.linear)


def draw(parameter: Parameter, rng: np.random.Generator) -> float:
    """Draw a value inside the bounds; half-open ranges get a spread of magnitudes."""
    low, high = parameter.lower, parameter.upper
    if math.isfinite(low) and math.isfinite(high):
        return float(rng.uniform(low, high))
    size = float(10.0 ** rng.uniform(-3, 1))
    if math.isfinite(low):
        return low + size
    if math.isfinite(high):
        return high - size
    return size * float(rng.choice([-1.0, 1.0]))


def parameters_of(effect: Effect, rng: np.random.Generator) -> dict[str, float]:
    return {p.symbol: draw(p, rng) for p in effect.parameters}


def signals_of(effect: Effect, rng: np.random.Generator) -> dict[str, float]:
    omega = float(rng.uniform(-200, 200))
    values = {
        "omega": omega, "direction": float(np.sign(omega)), "theta": float(rng.uniform(-50, 50)),
        "i_d": float(rng.uniform(-3, 3)), "i_q": float(rng.uniform(-3, 3)), "torque": float(rng.uniform(-3, 3)),
        "t": float(rng.uniform(0, 60)), "p": 4.0, "di_d": float(rng.uniform(-99, 99)),
        "di_q": float(rng.uniform(-99, 99)), "twist": float(rng.uniform(-1, 1)),
        "twist_rate": float(rng.uniform(-9, 9)), "zeta": float(rng.uniform(-1, 1)),
        "travel": float(rng.uniform(-0.1, 0.1)), "limit": float(rng.uniform(0.1, 1.5)),
    }  # fmt: skip
    missing = set(SIGNALS) - set(values)
    assert not missing, f"new signals {missing}: draw them here too"
    return {name: values[name] for name in effect.signals}


def call(function: object, effect: Effect, values: dict[str, float]) -> np.ndarray:
    """Call a term with named values; voltage terms give two numbers, the others one."""
    out = function(*(values[name] for name in effect.arguments))  # type: ignore[operator]
    return np.atleast_1d(np.asarray(out, dtype=float))


def test_catalogue_is_keyed_by_id_in_agreed_words() -> None:
    assert CATALOGUE
    assert all(key == effect.id for key, effect in CATALOGUE.items())
    assert set(CATALOGUE) <= AGREED


@each_effect
def test_compiled_term_equals_the_readable_one(effect: Effect, rng: np.random.Generator) -> None:
    for _ in range(50):
        values = parameters_of(effect, rng) | signals_of(effect, rng)
        compiled, plain = call(effect.term, effect, values), call(effect.py_term, effect, values)
        # Contraction to fused multiply-add may change the last bits, nothing else may.
        np.testing.assert_allclose(compiled, plain, rtol=1e-12, atol=1e-12 * max(1.0, np.abs(plain).max()))


@each_effect
def test_everything_a_reader_needs_is_stated(effect: Effect) -> None:
    for text in (effect.title, effect.equation, effect.source, effect.needs, effect.validated):
        assert text.strip()
    assert effect.enters in ("torque", "voltage", "measurement")
    for parameter in effect.parameters:
        assert parameter.unit.strip(), f"{parameter.symbol} has no unit (write 1 for a pure number)"
        assert parameter.description.strip()
        assert parameter.lower <= parameter.start <= parameter.upper
        assert parameter.lower < parameter.upper
    symbols = [p.symbol for p in effect.parameters]
    assert len(set(symbols)) == len(symbols)
    assert not set(symbols) & {*SIGNALS, "id", "stderr", "parameters"}


@effects_that(lambda effect: bool(effect.arguments))
def test_every_parameter_is_used_by_the_term(effect: Effect) -> None:
    wired = vars(effect.structure).values()  # read where the masses are told apart
    assert {p.symbol for p in effect.parameters} <= {*effect.arguments, *wired}


@each_effect
def test_equation_can_be_typeset(effect: Effect) -> None:
    from matplotlib.mathtext import MathTextParser

    MathTextParser("path").parse(f"${effect.equation}$")


@effects_that(lambda effect: bool(effect.linear))
def test_linear_parameters_enter_linearly(effect: Effect, rng: np.random.Generator) -> None:
    fixed = {p.symbol: draw(p, rng) for p in effect.searched}
    for _ in range(20):
        signals = signals_of(effect, rng)
        x = {p.symbol: draw(p, rng) for p in effect.linear}
        y = {p.symbol: draw(p, rng) for p in effect.linear}
        both = {s: 2.0 * x[s] - 3.0 * y[s] for s in x}
        at = [call(effect.py_term, effect, fixed | signals | values) for values in (both, x, y)]
        scale = max(float(np.abs(part).max()) for part in at)
        np.testing.assert_allclose(at[0], 2.0 * at[1] - 3.0 * at[2], rtol=0, atol=1e-12 * max(scale, 1e-300) * 10)


@effects_that(lambda effect: bool(effect.linear))
def test_zero_linear_parameters_switch_the_effect_off_exactly(effect: Effect, rng: np.random.Generator) -> None:
    zero = {p.symbol: 0.0 for p in effect.linear}
    for _ in range(20):
        values = {p.symbol: draw(p, rng) for p in effect.searched} | zero | signals_of(effect, rng)
        assert (call(effect.term, effect, values) == 0.0).all()


@effects_that(lambda effect: dry_torque(effect) and not modulates(effect))
def test_dry_friction_dissipates(effect: Effect, rng: np.random.Generator) -> None:
    for _ in range(200):
        values = parameters_of(effect, rng) | signals_of(effect, rng)
        power = call(effect.term, effect, values)[0] * values["direction"]
        assert power >= 0.0, f"friction drives the axis at {values}"


@effects_that(lambda effect: dry_torque(effect) and modulates(effect))
def test_modulated_friction_is_the_same_in_both_directions(effect: Effect, rng: np.random.Generator) -> None:
    for _ in range(50):
        values = parameters_of(effect, rng) | signals_of(effect, rng)
        turned = values | {s: -values[s] for s in ("omega", "direction") if s in values}
        np.testing.assert_allclose(
            call(effect.term, effect, turned), -call(effect.term, effect, values), rtol=1e-12, atol=0
        )


@effects_that(dry_torque)
def test_dry_friction_at_standstill_follows_the_impending_motion(effect: Effect, rng: np.random.Generator) -> None:
    values = parameters_of(effect, rng) | signals_of(effect, rng)
    if "omega" in values:
        values["omega"] = 0.0
    if not modulates(effect):
        for direction in (-1.0, 1.0):
            assert call(effect.term, effect, values | {"direction": direction})[0] * direction >= 0.0
    assert call(effect.term, effect, values | {"direction": 0.0})[0] == 0.0


@each_effect
def test_design_with_this_effect_survives_toml(effect: Effect, rng: np.random.Generator, tmp_path: Path) -> None:
    values = parameters_of(effect, rng)
    if effect.order:
        values[effect.order] = float(round(values[effect.order]))
    stderr = {symbol: abs(value) / 7 for symbol, value in values.items()}
    design = Design.from_dict({"motor": MOTOR}).with_effect(effect.id, values, stderr)
    again = Design.read(design.write(tmp_path / "design.toml"))
    assert again == design
    assert bound_effects(again) == [(effect, values)]
    assert again.effects[0].stderr == stderr


@each_effect
def test_left_out_parameters_take_their_start_values(effect: Effect) -> None:
    assert effect.values(EffectEntry(id=effect.id)) == {p.symbol: p.start for p in effect.parameters}


@each_effect
def test_unknown_parameter_is_refused_with_file_and_field(effect: Effect, tmp_path: Path) -> None:
    path = tmp_path / "wrong.toml"
    symbol = effect.parameters[0].symbol
    entry = {"id": effect.id, f"{symbol}x": 1.0}
    Design.from_dict({"motor": MOTOR, "effects": [entry]}).write(path)
    with pytest.raises(DesignError) as caught:
        bound_effects(Design.read(path))
    message = str(caught.value)
    assert f"{path}: effects.{effect.id}.{symbol}x" in message
    assert f"known: {', '.join(p.symbol for p in effect.parameters)}" in message
    assert "\n" not in message


def test_a_standard_error_of_an_unknown_parameter_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "wrong.toml"
    entry = {"id": "coulomb", "F_c": 0.1, "stderr": {"F_x": 1.0}}
    Design.from_dict({"motor": MOTOR, "effects": [entry]}).write(path)
    with pytest.raises(DesignError) as caught:
        bound_effects(Design.read(path))
    expected = f"{path}: effects.coulomb.stderr.F_x: unknown parameter; did you mean 'F_c'? (known: F_c)"
    assert str(caught.value) == expected


@each_effect
def test_value_out_of_bounds_is_refused_with_file_and_field(effect: Effect, tmp_path: Path) -> None:
    path = tmp_path / "wrong.toml"
    for parameter in effect.parameters:
        for bound, beyond in ((parameter.lower, -1.0), (parameter.upper, 1.0)):
            if not math.isfinite(bound):
                continue
            value = bound + beyond * max(1.0, abs(bound))
            Design.from_dict({"motor": MOTOR}).with_effect(effect.id, {parameter.symbol: value}).write(path)
            with pytest.raises(DesignError) as caught:
                bound_effects(Design.read(path))
            message = str(caught.value)
            assert f"{path}: effects.{effect.id}.{parameter.symbol}" in message
            assert f"{value:g}" in message
            assert parameter.unit in message


@each_effect
def test_look_alikes_are_known_and_say_why(effect: Effect) -> None:
    for other, why in effect.look_alikes.items():
        assert other in AGREED | PARAMETERS, f"unknown look-alike '{other}'"
        assert other != effect.id
        assert len(why) > 10


@each_effect
def test_own_effect_must_not_take_a_used_id(effect: Effect) -> None:
    with pytest.raises(RequestError, match=effect.id):
        catalogue_with([effect])


def _own_effect(identifier: str = "magnet_brake") -> Effect:
    @kernel
    def term(omega: float, k: float) -> float:
        return k * omega

    return Effect(
        id=identifier, title="Brake", equation=r"k\,\omega", source="none", enters="torque",
        parameters=(Parameter("k", "N m s/rad", 0.0, 0.0, 1.0, "brake", linear=True),), term=term, needs="motion",
    )  # fmt: skip


def test_own_effect_works_beside_the_catalogue() -> None:
    own = _own_effect()
    design = Design.from_dict({"motor": MOTOR, "effects": [{"id": "magnet_brake", "k": 0.5}]})
    with pytest.raises(DesignError, match="magnet_brake"):
        bound_effects(design)
    carrying = design.with_own_effects(own)
    assert lookup("magnet_brake", catalogue_of(carrying)) is own
    assert bound_effects(carrying) == [(own, {"k": 0.5})]
    assert own.term(3.0, 0.5) == 1.5


def test_own_effects_stay_with_every_copy_of_a_design_and_with_nothing_else(tmp_path: Path) -> None:
    own, other = _own_effect(), _own_effect()
    plain = Design.from_dict({"motor": MOTOR})
    design = plain.with_own_effects(own)
    copies = (
        design.with_effect("magnet_brake", {"k": 0.5}), design.with_parameters(J=1.0), design.replace_effects(()),
        design.replace(sensor={"current_noise": 0.1}), design.model_copy(update={"name": "other"}),
    )  # fmt: skip
    assert all([e.id for e in copy.own_effects] == ["magnet_brake"] for copy in copies)
    assert plain.own_effects == ()
    assert design.with_own_effects(other).own_effects == (other,)  # edited and given again
    assert design == plain
    assert "magnet_brake" not in repr(design) + design.to_toml()
    assert Design.read(design.write(tmp_path / "axis.toml")).own_effects == ()
    for name in ("own_effects", "_own_effects"):
        with pytest.raises(DesignError, match=name):
            Design.from_dict({"motor": MOTOR, name: ["magnet_brake"]})


def test_unknown_effect_names_the_nearest() -> None:
    with pytest.raises(RequestError, match="did you mean 'coulomb'"):
        lookup("coulom")
    with pytest.raises(DesignError, match="did you mean 'coulomb'"):
        bound_effects(Design.from_dict({"motor": MOTOR}).with_effect("coulom"))


def test_term_with_an_unknown_argument_is_refused() -> None:
    def term(speed: float) -> float:
        return speed

    with pytest.raises(DesignError, match="speed"):
        Effect(id="x", title="x", equation="x", source="x", enters="torque", parameters=(), term=term, needs="x")


# Spot checks against numbers worked out by hand, so that the generic tests above cannot all agree on a wrong sign.
@pytest.mark.parametrize(
    ("identifier", "values", "expected"),
    [
        ("coulomb", {"direction": -1.0, "F_c": 0.0213}, -0.0213),
        ("viscous", {"omega": 200.0, "F_v": 0.000168}, 0.0336),
        ("constant_load", {"T_0": -3.16}, -3.16),
    ],
)
def test_terms_give_the_numbers_of_the_paper(identifier: str, values: dict[str, float], expected: float) -> None:
    effect = CATALOGUE[identifier]
    assert call(effect.term, effect, values)[0] == pytest.approx(expected, rel=1e-15)


@each_effect
def test_example_is_complete_and_inside_the_bounds(effect: Effect) -> None:
    assert set(effect.example) == {p.symbol for p in effect.parameters}
    assert effect.active(effect.values(EffectEntry(id=effect.id, parameters=dict(effect.example))))


def test_a_term_is_split_into_its_columns_and_what_is_none_of_theirs() -> None:
    """k abs(omega) omega beside F omega + T, whose k is searched: one column each for F and T, and a rest."""

    @kernel
    def term(omega: float, F: float, T: float, k: float) -> float:
        return F * omega + T + k * abs(omega) * omega

    unit = Parameter("F", "N m s/rad", 0.0, -1.0, 1.0, "slope", linear=True)
    effect = Effect(
        id="mine", title="t", equation="F", source="s", enters="torque", term=term, needs="n",
        parameters=(unit, Parameter("T", "N m", 0.0, -1.0, 1.0, "level", linear=True),
                    Parameter("k", "N m s^2/rad^2", 0.1, 0.0, 1.0, "drag")),
    )  # fmt: skip
    omega = np.linspace(-3.0, 3.0, 7)
    parts, rest = columns(effect, {"omega": omega}, {"F": 0.7, "T": 0.2, "k": 0.1})
    assert parts["F"] == pytest.approx(omega, abs=1e-12)
    assert parts["T"] == pytest.approx(1.0)
    assert rest == pytest.approx(0.1 * np.abs(omega) * omega, abs=1e-12)


@pytest.mark.parametrize("name", [name for name, one in CATALOGUE.items() if one.structure.splits_inertia])
def test_a_load_at_either_bound_can_be_simulated(name: str) -> None:
    effect, machine = CATALOGUE[name], SimpleNamespace(J=2e-4, period=1e-4)
    for symbol, bounds in effect.structure.bounds(effect, Known(J=machine.J), {}).items():
        for value in bounds:
            found = effect.structure.simulated(effect, {**effect.example, symbol: value}, machine, 0.0, effect.id)
            assert 0.0 < found[symbol] < machine.J


@pytest.mark.parametrize("effect", CATALOGUE.values(), ids=list(CATALOGUE))
def test_bounds_leave_room_whatever_a_fit_says_of_the_axis(effect: Effect) -> None:
    """Before a parameter is held at its bound, inertia and friction may come out below zero."""
    shape = effect.structure.shape(effect, effect.example)
    for J, F_c, dry in itertools.product((-1e-4, 0.0, 1e-4), (-0.01, 0.0, 0.01), (0.0, 0.01)):
        for low, high in effect.structure.bounds(effect, Known(J=J, F_c=F_c, dry=dry), shape).values():
            assert low < high


def test_an_unknown_effect_is_refused_at_once_with_close_matches() -> None:
    design = Design.from_dict({"motor": MOTOR})
    for change in (design.with_effect, design.add_effect):
        with pytest.raises(DesignError, match=r"unknown effect 'cogg'; did you mean 'cogging'\?"):
            change("cogg", {})
        with pytest.raises(DesignError, match=r"effects.cogging.ordr: unknown parameter; did you mean 'order'\?"):
            change("cogging", {"ordr": 6.0})


@pytest.mark.parametrize("effect", [pytest.param(e, id=e.id) for e in CATALOGUE.values() if e.order])
def test_an_order_of_a_turn_is_a_whole_number(effect: Effect, tmp_path: Path) -> None:
    design = Design.from_dict({"motor": MOTOR})
    message = rf"effects.{effect.id}.{effect.order}: found 2.5; a whole number"
    with pytest.raises(DesignError, match=message):
        design.with_effect(effect.id, {effect.order: 2.5})
    path = Design.from_dict({"motor": MOTOR, "effects": [{"id": effect.id, effect.order: 2.5}]}).write(
        tmp_path / "a.toml"
    )
    with pytest.raises(DesignError, match=message) as refused:
        bound_effects(Design.read(path))
    assert str(refused.value).startswith(f"{path}: ")
    line = Design.from_dict({"motion": "linear", "motor": {"J": 1.0, "K_t": 10.0}})  # an order is one of a metre
    assert bound_effects(line.with_effect(effect.id, {effect.order: 2.5}))

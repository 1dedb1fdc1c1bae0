"""An own effect whose function is no number somewhere is refused in one line, when loaded or on a log's values."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl.cli import app
from pmsm_ctrl.console import run
from pmsm_ctrl.design import Design
from pmsm_ctrl.effects import CATALOGUE, Effect, Parameter, bound_effects, catalogue_with, kernel
from pmsm_ctrl.effects.evaluate import column, columns
from pmsm_ctrl.effects.loading import load_effects
from pmsm_ctrl.effects.soundness import value_at
from pmsm_ctrl.errors import PmsmCtrlError, RequestError
from tests.unit.renamed import renamed

TEXT = """
import math

from pmsm_ctrl.effects import Effect, Parameter, kernel


@kernel
def drag(omega: float, direction: float, k: float) -> float:
    return {expression}


seal = Effect(
    id="seal_drag", title="Wiper seal", equation="", source="", enters="torque", term=drag, needs="steady motion",
    parameters=(Parameter("k", "N m", 0.0, 0.0, math.inf, "drag", linear=True),),
)
"""
WRONG = {
    "k * math.sqrt(omega) * direction": "fails at omega = -10, direction = -1, k = 1: math domain error",
    "k * omega**0.5": "fails at omega = -10, direction = -1, k = 1: a complex number",
    "k / omega": "fails at omega = 0, direction = -1, k = 1: float division by zero",
    "k * math.nan": "is not finite at omega = -10, direction = -1, k = 1: nan",
    "k * math.log(1.0 - omega)": "fails at omega = 10, direction = 1, k = 1: math domain error",
}


def written(folder: Path, expression: str) -> Path:
    path = folder / "seal.py"
    path.write_text(TEXT.replace("{expression}", expression), encoding="utf-8")
    return path


@pytest.mark.parametrize("expression", WRONG)
def test_a_file_is_refused_in_one_line(tmp_path: Path, expression: str) -> None:
    path = written(tmp_path, expression)
    with pytest.raises(RequestError) as refused:
        load_effects(path)
    assert str(refused.value) == f"{path}: effect 'seal_drag': function 'drag' {WRONG[expression]}"


@pytest.mark.parametrize("verb", ["simulate", "tune"])
def test_commands_leave_with_status_2(
    tmp_path: Path, designs: Path, verb: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path, "k * math.sqrt(omega)")
    text = (designs / "seed_motor.toml").read_text(encoding="utf-8") + '\n[[effects]]\nid = "seal_drag"\nk = 1e-3\n'
    (tmp_path / "axis.toml").write_text(text, encoding="utf-8")
    assert run(app, [verb, str(tmp_path / "axis.toml"), "--effects", str(path)]) == 2
    assert "seal.py: effect 'seal_drag': function 'drag' fails at omega = -10" in capsys.readouterr().err


def own(function: object, **parts: object) -> Effect:
    k = Parameter("k", "N m", 0.0, 0.0, math.inf, "drag", linear=True)
    return Effect(id="own_drag", title="", equation="", source="", enters="torque", parameters=(k,), needs="",
                  term=kernel(function), **parts)  # fmt: skip


def test_an_effect_that_comes_with_a_design_is_refused_where_it_is_bound(designs: Path) -> None:
    def drag(omega: float, k: float) -> float:
        return k * math.sqrt(omega)

    bad = own(drag)
    with pytest.raises(PmsmCtrlError, match=r"test_unsound_effects.py: effect 'own_drag': .* math domain error"):
        catalogue_with([bad])
    design = Design.read(designs / "seed_motor.toml")
    with pytest.raises(PmsmCtrlError, match="math domain error"):
        bound_effects(design.with_own_effects(bad))


def test_what_overflows_on_a_logs_own_values_says_where() -> None:
    def drag(omega: float, k: float) -> float:
        return k * math.exp(omega * omega)

    effect = own(drag)
    assert catalogue_with([effect])["own_drag"] is effect  # finite on the grid
    signals = {"omega": np.array([0.0, 5.0, 40.0])}
    with pytest.raises(RequestError, match=r"is not finite at omega = 40, k = 2: inf"):
        column(effect, signals, {"k": 2.0})
    with pytest.raises(RequestError, match=r"is not finite at omega = 40"):
        columns(effect, signals, {})
    with pytest.raises(RequestError, match=r"fails at omega = 40, k = 2: math range error"):
        value_at(effect, {"omega": 40.0, "k": 2.0})
    spoiled = {"omega": np.array([0.0, np.nan, 5.0])}  # a signal that is none is not the effect's fault
    assert np.isfinite(column(effect, spoiled, {"k": 2.0})).sum() == 2


# What the parameter says, what the function returns, and what is answered.
UNEVALUATED = {
    'linear=True': ("k * k * math.sqrt(abs(omega)) * direction", "function 'drag' is not linear in k as stated: at "),
    'linear = True': ("k * omega + 0.1 * direction", "function 'drag' is not linear in k as stated: at "),
    '': ("k * math.sqrt(abs(omega)) * direction", "no parameter multiplies its term, .* linear=True.* was expected"),
}  # fmt: skip


@pytest.mark.parametrize("stated", UNEVALUATED)
def test_a_term_that_no_regression_evaluates_as_stated_is_refused(tmp_path: Path, stated: str) -> None:
    expression, answer = UNEVALUATED[stated]
    path = written(tmp_path, expression)
    path.write_text(path.read_text(encoding="utf-8").replace("linear=True", stated), encoding="utf-8")
    with pytest.raises(RequestError, match=f"effect 'seal_drag': {answer}") as refused:
        load_effects(path)
    assert "\n" not in str(refused.value)


def test_linear_parameters_that_multiply_each_other_are_refused() -> None:
    def drag(omega: float, k: float, m: float) -> float:
        return k * m * omega

    first, second = (Parameter(name, "", 0.0, 0.0, 1.0, "", linear=True) for name in "km")
    with pytest.raises(RequestError, match="is not linear in k, m as stated"):
        catalogue_with([replace(own(lambda omega, k: k * omega), parameters=(first, second), term=kernel(drag))])


@pytest.mark.parametrize(
    ("right", "wrong", "answer"),
    [
        ('enters="torque"', 'enters="tork"', "enters = 'tork'; did you mean 'torque'? (accepted: torque, "),
        ('"N m", 0.0,', '"N m", -1.0,', "parameter 'k' starts at -1, but a start value should lie between"),
    ],
)  # fmt: skip
def test_a_wrong_field_of_an_effect_is_one_line(tmp_path: Path, right: str, wrong: str, answer: str) -> None:
    path = written(tmp_path, "k * omega")
    path.write_text(path.read_text(encoding="utf-8").replace(right, wrong), encoding="utf-8")
    with pytest.raises(RequestError) as refused:
        load_effects(path)
    assert str(refused.value).startswith(f"{path}: line 12: effect 'seal_drag': {answer}")


def test_effects_of_the_catalogue_under_other_names_are_sound() -> None:
    for effect in CATALOGUE.values():
        assert f"own_{effect.id}" in catalogue_with([renamed(effect)])


def test_a_folder_is_no_missing_file(tmp_path: Path) -> None:
    with pytest.raises(RequestError, match="it is a folder"):
        load_effects(tmp_path)

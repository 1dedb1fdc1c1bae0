"""A spring that states no damping: the catalogue allows it, and a fit may end there."""

from __future__ import annotations

from pathlib import Path

import pytest

from pmsm_ctrl import Design, compare, identify, simulate
from pmsm_ctrl.effects import CATALOGUE
from pmsm_ctrl.effects.structures.transmission import swings_damped


def test_a_log_is_fitted_with_a_spring_without_damping(designs: Path) -> None:
    """It was divided by the damping: identify, compare and diagnose ended with a ZeroDivisionError."""
    design = Design.read(designs / "geared_resonant.toml")
    spring = design.parameters("compliance") | {"d": 0.0}
    undamped = design.with_effect("compliance", spring)
    log = simulate(undamped, "reversal", seed=1)
    found = identify(undamped, log)
    assert found.estimates["J"].value == pytest.approx(design.J, rel=0.02)
    assert found.design.parameters("compliance")["d"] == 0.0
    assert compare(undamped, log).to_dict()["verdict"] == "consistent"


def test_a_spring_without_damping_is_shaped_like_one_that_hardly_is_damped() -> None:
    effect = CATALOGUE["compliance"]
    shape = effect.structure.shape(effect, {"J_load": 1e-4, "k": 10.0, "d": 0.0, "F_load": 0.0})
    assert 0.0 < swings_damped(shape) < 0.01
    assert effect.structure.straight_over(effect, shape, "(w_a)") > 0.0

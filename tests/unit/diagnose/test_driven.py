"""An axis that goes one way: what drives it is a load, and friction is told from a load by nothing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl import Design, add, compare, diagnose, identify
from pmsm_ctrl.log import Log
from tests.effort import seeds

F_C, F_V, J = 0.0213, 1.68e-4, 9e-5  # of the seed motor


@pytest.fixture
def design(designs: Path) -> Design:
    return Design.read(designs / "seed_motor.toml")


def going(load: float, seed: int, mean: float = 30.0, dry: float = F_C) -> Log:
    """Return 12 s of motion about a mean speed, rad/s, against a load, N m, in closed form."""
    t, w = 1e-3 * np.arange(12_000), 2.0 * np.pi * np.array([[0.4], [1.7]])
    swing, phase = np.array([[20.0], [8.0]]), np.array([[0.0], [1.0]])
    omega = mean + (swing * np.sin(w * t + phase)).sum(axis=0)
    alpha = (swing * w * np.cos(w * t + phase)).sum(axis=0)
    theta = mean * t - (swing / w * np.cos(w * t + phase)).sum(axis=0)
    torque = J * alpha + dry * np.sign(omega) + F_V * omega + load
    torque += np.random.default_rng(seed).normal(0.0, 3e-4, len(t))
    step = 2.0 * np.pi / 65536
    return Log({"t": t, "theta": step * np.round(theta / step), "torque": torque})


def dry_of(design: Design) -> float:
    return next(one for one in design.effects if one.id == "coulomb").parameters["F_c"]


@pytest.mark.parametrize("seed", seeds(3, 4))
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_load_that_drives_an_axis_one_way_has_its_name_and_its_size(design: Design, side: float, seed: int) -> None:
    """A lift that goes down: F_c was -0.0426 N m, a contradiction, and the log was implausible."""
    log = going(-3.0 * F_C * side, seed, mean=30.0 * side)
    found = diagnose(design, log, plan=False)
    assert [step.effect for step in found.steps] == ["constant_load"]
    assert found.steps[0].parameters["T_0"].value == pytest.approx(-3.0 * F_C * side, rel=2e-3)
    assert "driven_one_way" in [notice.code for notice in found.notices]
    assert dry_of(found.design) == F_C  # as stated
    assert compare(found.design, log).log.errors["torque"].relative < 5e-3
    added = next(one for one in add(design, log, "constant_load").effects if one.id == "constant_load")
    assert added.parameters["T_0"] == pytest.approx(-3.0 * F_C * side, rel=2e-3)


def test_the_sum_of_both_is_the_friction_of_an_axis_that_goes_one_way(design: Design) -> None:
    log = going(3.0 * F_C, 3)
    found = identify(design, log)
    assert found.estimates["F_c"].value == pytest.approx(4.0 * F_C, rel=1e-3)
    assert "one_direction" in [notice.code for notice in found.notices]
    answer = diagnose(design, log, plan=False)
    assert answer.verdict == "consistent"
    assert "one_direction" in [notice.code for notice in answer.notices]


def test_a_motion_both_ways_tells_both(design: Design) -> None:
    log = going(-3.0 * F_C, 3, mean=10.0)
    assert "one_direction" not in [notice.code for notice in identify(design, log).notices]
    found = diagnose(design, log, plan=False)
    assert [step.effect for step in found.steps] == ["constant_load"]
    assert "driven_one_way" not in [notice.code for notice in found.notices]
    assert dry_of(found.design) == pytest.approx(F_C, rel=0.01)


def test_without_a_load_among_the_candidates_it_stays_a_contradiction(design: Design) -> None:
    found = diagnose(design, going(-3.0 * F_C, 3), candidates=("stribeck", "cogging"), plan=False)
    assert found.verdict == "implausible"

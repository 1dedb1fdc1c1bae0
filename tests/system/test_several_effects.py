"""Several effects at once in worlds drawn at random: each is a minor part of what is left, and all of it together."""

from __future__ import annotations

import pytest

from pmsm_ctrl.diagnose import diagnose
from pmsm_ctrl.log import Log
from tests.benchmarks.worlds.hidden import simulate_world
from tests.benchmarks.worlds.several import matched
from tests.benchmarks.worlds.world import World, draw


def five() -> tuple[World, Log]:
    """Margins of 4 to 11: an unbalance, a load, two drags and an offset of the currents, in steps of the speed."""
    world = draw(12000014)
    return world, simulate_world(world, {
        "wave": 0.02837, "wave_order": 1.0, "wave_phase": 0.84655, "constant_load": 0.047605,
        "viscous_asymmetry": 0.0027031, "drag_gain": 0.049644, "drag_power": 0.6, "offset_a": 0.062419,
        "offset_b": 0.037451,
    })  # fmt: skip


FIVE = {"unbalance", "constant_load", "viscous_asymmetry", "viscous_power", "current_offset"}


def test_five_effects_are_named_and_a_sixth_one_loses_its_name() -> None:
    """One at a time it is the asymmetry, the offset and an eccentricity, and 14 % of the torque are left."""
    world, log = five()
    found = diagnose(world.design, log, plan=False, candidates=[*FIVE, "encoder_eccentricity"])
    assert {step.effect for step in found.steps} == FIVE
    assert found.errors["final"]["torque"]["relative"] < 0.002
    (said,) = [one for one in found.notices if one.code == "taken_together"]
    assert set(said.detail["effects"].split(", ")) == {"constant_load", "unbalance", "viscous_power"}
    values = {name: one for step in found.steps for name, one in step.parameters.items()}
    assert values["T_0"].value == pytest.approx(0.047605, rel=0.02)
    assert values["dF_v"].value == pytest.approx(0.0027031, rel=0.02)


@pytest.mark.slow
def test_five_effects_are_named_out_of_the_whole_catalogue() -> None:
    world, log = five()
    assert {step.effect for step in diagnose(world.design, log, plan=False).steps} == FIVE


@pytest.mark.slow
def test_four_effects_are_named_where_none_is_most_of_the_residual() -> None:
    world = draw(12000028)  # margins of 5 to 11, in torque steps; one at a time it is the ripple alone
    log = simulate_world(world, {
        "ripple": 0.05, "ripple_order": 6.0, "offset_a": 0.0022705, "offset_b": 0.0013624, "wave": 0.012149,
        "wave_order": 72.0, "wave_phase": 2.76805, "position_friction": 0.00072073, "position_phase": 4.52905,
    })  # fmt: skip
    found = diagnose(world.design, log, plan=False)
    wanted = {"torque_ripple", "current_offset", "cogging", "position_dependent_friction"}
    assert {step.effect for step in found.steps} == wanted


@pytest.mark.slow
def test_effects_that_were_taken_together_are_as_large_as_they_are() -> None:
    world = draw(12000012)  # margins of 5 to 10, in ramps; one at a time 26 % of the torque are left, now 3 %
    log = simulate_world(world, {
        "wave": 0.58779, "wave_order": 1.0, "wave_phase": 2.48801, "offset_a": 2.03513, "offset_b": 1.22107,
        "constant_load": 0.49986, "drag_gain": 0.00022528, "drag_power": 2.0,
    })  # fmt: skip
    found = diagnose(world.design, log, plan=False)
    assert {step.effect for step in found.steps} == {"current_offset", "unbalance", "constant_load", "quadratic_drag"}
    values = {name: one for step in found.steps for name, one in step.parameters.items()}
    assert values["T_0"].value == pytest.approx(0.49986, rel=0.05)
    assert values["k_2"].value == pytest.approx(0.00022528, rel=0.05)


def test_each_name_stands_for_one_effect_and_for_itself_first() -> None:
    hidden = ["stribeck", "quadratic_drag", "cogging"]
    named = [("quadratic_drag", "stribeck"), ("stribeck",), ("torque_ripple",), ("torque_ripple",)]
    assert matched(hidden, named) == (hidden, ["torque_ripple"])

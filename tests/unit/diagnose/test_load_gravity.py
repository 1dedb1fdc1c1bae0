"""Gravity on an arm behind a gear: in closed form, by no simulator of the package."""

from __future__ import annotations

import numpy as np
import pytest

from pmsm_ctrl import Design, Log, compare, diagnose
from pmsm_ctrl.diagnose.final_fit import not_beside_shapes
from pmsm_ctrl.diagnose.fit import Accepted
from pmsm_ctrl.diagnose.made_ready import condition
from pmsm_ctrl.diagnose.policy import POLICY
from pmsm_ctrl.diagnose.refusal import Reason
from pmsm_ctrl.diagnose.selection import name_of
from pmsm_ctrl.diagnose.shapes import with_shapes_fitted
from pmsm_ctrl.effects import CATALOGUE
from pmsm_ctrl.regression.balances import make_record
from tests.benchmarks.worlds.hidden import hidden_log
from tests.benchmarks.worlds.world import draw
from tests.effort import seeds, slow

RATIO, J, F_C, F_V = 20.0, 2e-4, 0.12, 8e-4
DESIGN = Design.from_dict(
    {
        "name": "arm",
        "motor": {"J": 1.04 * J, "K_t": 0.9},
        "effects": [{"id": "coulomb", "F_c": 1.2 * F_C}, {"id": "viscous", "F_v": 0.8 * F_V}],
    }
)


def arm(seed: int, turns: float, gravity: float, seconds: float = 24.0, rate: float = 1000.0, drag: float = 0.0) -> Log:
    """An arm that goes between places on this many turns of the load, by moves whose acceleration is a sine.

    Its drag, at 1 rad/s, rises with the power 0.6 of the speed.
    """
    rng = np.random.default_rng(seed)
    dt, speeds, at, length = 1.0 / rate, [], 0.0, 0
    while length < seconds * rate:
        goal = rng.uniform(-0.5, 0.5) * turns * RATIO * 2.0 * np.pi
        way = goal - at
        count = max(int(rate * max(abs(way) / 90.0, 0.15)), 10)
        speeds += [
            way * (1.0 - np.cos(2.0 * np.pi * np.arange(count) / count)) * rate / count,
            np.zeros(int(0.1 * rate)),
        ]
        at, length = goal, length + count + len(speeds[-1])
    omega = np.concatenate(speeds)
    theta = dt * (np.cumsum(omega) - 0.5 * omega)
    alpha = np.gradient(omega, dt)
    torque = J * alpha + F_C * np.sign(omega) + F_V * omega + gravity * np.cos(theta / RATIO + 0.3)
    torque += drag * np.sign(omega) * np.abs(omega) ** 0.6
    step = 2.0 * np.pi / 2**20
    return Log(
        {
            "t": dt * np.arange(omega.size),
            "theta": step * np.round(theta / step),
            "i_q": (torque + 0.01 * rng.standard_normal(omega.size)) / 0.9,
        }
    )


@pytest.mark.parametrize("turns", [0.6, slow(1.6), 6.0])
@pytest.mark.parametrize("seed", seeds(1, 2, 3))
def test_it_is_named_with_its_size_and_the_ratio_of_the_gear(turns: float, seed: int) -> None:
    """The answer was that most of the torque depends on no coordinate, and `compare` took all of it for noise."""
    log = arm(seed, turns, 0.15)
    found = diagnose(DESIGN, log, plan=False)
    (step,) = found.steps
    assert step.effect == "load_gravity"
    period, a_s, a_c = (step.parameters[name] for name in ("period", "a_s", "a_c"))
    assert period.value / (2.0 * np.pi) == pytest.approx(RATIO, rel=0.02 if turns > 1.0 else 0.25)
    if turns > 1.0:
        assert np.hypot(a_s.value, a_c.value) == pytest.approx(0.15, rel=0.03)
    bare = compare(DESIGN, log)
    assert bare.verdict == "unexplained"
    assert "position over several turns" in str(bare.summary()).replace("\n", " ")
    written = compare(found.design, log).log.errors["torque"]
    assert written.relative < 1.2 * found.errors["noise_floor"]["torque"]["relative"]


@pytest.mark.parametrize("turns", [0.6, 6.0])
@pytest.mark.parametrize("seed", seeds(4, 5, 6))
def test_nothing_is_named_without_one(turns: float, seed: int) -> None:
    found = diagnose(DESIGN, arm(seed, turns, 0.0), plan=False)
    assert (found.verdict, found.steps) == ("consistent", ())


@pytest.mark.parametrize("seed", seeds(7, 8))
def test_unbalance_of_the_motor_is_none_behind_a_gear(seed: int) -> None:
    log = arm(seed, 2.0, 0.0)
    log = log.with_channels(i_q=log["i_q"] + 0.06 / 0.9 * np.sin(log["theta"] + 0.4))
    assert [step.effect for step in diagnose(DESIGN, log, plan=False).steps] == ["unbalance"]


@pytest.mark.parametrize("zero", [slow(0.0), 50.0])
@pytest.mark.parametrize("seed", seeds(9, 11))
def test_two_records_keep_the_turns_between_their_positions(seed: int, zero: float) -> None:
    """The second record was shifted by whole turns of the motor, which are no turns of the load."""
    other = arm(seed + 1, 6.0, 0.15)
    found = diagnose(DESIGN, [arm(seed, 6.0, 0.15), other.with_channels(theta=other["theta"] + zero)], plan=False)
    (step,) = found.steps
    assert step.effect == "load_gravity"
    assert ("other_zero" in {notice.code for notice in found.notices}) == (zero != 0.0)
    assert step.parameters["period"].value / (2.0 * np.pi) == pytest.approx(RATIO, rel=1e-3)


def test_a_saturation_is_no_gravity_where_the_position_is_the_acceleration() -> None:
    """In slow sines a smooth function of one is one of the other: gravity explained a little more, by three values."""
    world = draw(19800012, log_rate=250.0)
    made = hidden_log(world, "torque_saturation", 5.37)
    assert made is not None
    assert [step.effect for step in diagnose(world.design, made[0], plan=False).steps] == ["torque_saturation"]


def test_what_a_saturated_torque_lacks_is_a_rival_of_gravity_on_a_rotary_axis() -> None:
    log = arm(1, 0.6, 0.1, seconds=4.0)
    record = make_record(DESIGN, log)
    gravity, torque = CATALOGUE["load_gravity"], record.signals["torque"]
    shape = {"period": 2.0 * np.pi * RATIO}
    rivals = [np.asarray(one["torque"]) for one in gravity.structure.rivals(gravity, shape, record)]
    saturated = torque * torque**2
    alike = [abs(np.corrcoef(one, saturated)[0, 1]) for one in rivals]
    assert max(alike) == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize("seed", seeds(1, 2))
def test_a_small_drag_is_named_beside_a_large_weight(seed: int) -> None:
    """It was refused as within the model error of the weight: a drag by the speed is no error of a wave of the way."""
    found = diagnose(DESIGN, arm(seed, 1.6, 0.8, drag=0.012), plan=False)
    assert {step.effect for step in found.steps} == {"load_gravity", "viscous_power"}
    drag = next(step for step in found.steps if step.effect == "viscous_power").parameters
    assert drag["n"].value == pytest.approx(0.6, abs=0.06)
    assert drag["k"].value == pytest.approx(0.012, rel=0.2)


def test_what_the_shape_of_another_effect_was_wrong_by_falls() -> None:
    """A constant load of (-1.0 +- 1.9)e-4 N m was named beside a weight whose period had been held a little wrong."""
    log = arm(1, 0.6, 0.8)
    case = condition(DESIGN, (log,), (), {one: CATALOGUE[one] for one in ("load_gravity", "constant_load")}, POLICY)
    fit = case.fit(())
    (weight,) = (one for one in fit.trials if name_of(one).startswith("load_gravity"))
    accepted = (Accepted(CATALOGUE["load_gravity"], weight.group.shape, weight.candidate.grid),)
    accepted = (*accepted, Accepted(CATALOGUE["constant_load"], {}, ({},)))
    shaped = with_shapes_fitted(case.design, case.fit(accepted))
    fallen = not_beside_shapes(shaped)
    assert fallen is not None
    assert fallen.reason is Reason.NOT_SIGNIFICANT
    assert not_beside_shapes(with_shapes_fitted(case.design, case.fit(accepted[:1]))) is None

"""A force that repeats along a linear axis, as of a linear motor's magnets: named with its period where it is."""

from __future__ import annotations

import numpy as np
import pytest

from pmsm_ctrl import compare, diagnose, simulate
from tests.effort import seeds, slow
from tests.linear_motors import linear_motor
from tests.slides import MOTIONS, slide

PERIOD = 0.024  # m


@pytest.mark.parametrize("motion", ["moves", slow("sines")])
@pytest.mark.parametrize("seed", seeds(1, 2, 3))
def test_it_is_named_with_period_and_size(motion: str, seed: int) -> None:
    one = slide(motion, seed, {PERIOD: (2.0, 0.0)})
    found = diagnose(one.design, one.log, plan=False)
    (step,) = found.steps
    assert step.effect == "detent_force"
    period, a_s, a_c = (step.parameters[name] for name in ("period", "a_s", "a_c"))
    assert period.value == pytest.approx(PERIOD, abs=4.0 * period.stderr)
    assert period.stderr < 1e-3 * PERIOD
    assert np.hypot(a_s.value, a_c.value) == pytest.approx(2.0, rel=0.05)
    written = compare(found.design, one.log).log.errors["torque"]
    assert written.relative == pytest.approx(found.errors["final"]["torque"]["relative"], rel=1e-3)
    assert written.relative < 1.2 * found.errors["noise_floor"]["torque"]["relative"]


@pytest.mark.slow
@pytest.mark.parametrize("motion", list(MOTIONS))
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_second_wave_is_named_beside_it(motion: str, seed: int) -> None:
    one = slide(motion, seed, {PERIOD: (3.0, 0.0), 0.5 * PERIOD: (0.8, 1.3)})
    periods = [step.parameters["period"].value for step in diagnose(one.design, one.log, plan=False).steps]
    assert periods == pytest.approx([PERIOD, 0.5 * PERIOD], rel=1e-3)


@pytest.mark.parametrize("seed", seeds(1, 2, 3))
def test_it_is_named_where_every_record_has_a_zero_of_its_own(seed: int) -> None:
    waves = {PERIOD: (2.0, 0.0)}
    one = slide("moves", seed, waves)
    logs = [one.log, slide("sines", 100 + seed, waves, one, 0.009).log]
    found = diagnose(one.design, logs, holdout=slide("moves", 200 + seed, waves, one, 0.004).log, plan=False)
    (step,) = found.steps
    assert step.effect == "detent_force"
    assert np.hypot(*(step.parameters[name].value for name in ("a_s", "a_c"))) == pytest.approx(2.0, rel=0.05)
    assert {notice.code for notice in found.notices} >= {"other_zero"}
    assert found.records[-1].after["torque"]["rms"] < 0.5 * found.records[-1].before["torque"]["rms"]
    written = compare(found.design, logs).log.errors["torque"].relative
    assert written == pytest.approx(found.errors["final"]["torque"]["relative"], rel=1e-6)


@pytest.mark.parametrize("motion", ["moves", slow("sines")])
@pytest.mark.parametrize("seed", seeds(4, 5, 6))
def test_nothing_is_named_without_one(motion: str, seed: int) -> None:
    one = slide(motion, seed, {})
    found = diagnose(one.design, one.log, plan=False)
    assert (found.verdict, found.steps) == ("consistent", ())


@pytest.mark.parametrize("period", [0.004, 0.002])
@pytest.mark.parametrize("seed", seeds(1, 2, 3))
def test_it_is_named_where_most_of_the_motion_is_too_fast_for_it(period: float, seed: int) -> None:
    """It passes the band at the ends of the moves: such logs were `consistent` at four times the error that is left."""
    one = slide("moves", seed, {period: (2.0, 0.0)})
    found = diagnose(one.design, one.log, plan=False)
    assert [step.effect for step in found.steps] == ["detent_force"]
    assert found.steps[0].parameters["period"].value == pytest.approx(period, rel=1e-3)


@pytest.mark.parametrize(("effect", "values"), [
    ("current_offset", {"o_alpha": 0.05, "o_beta": -0.03}), slow("current_gain", {"g_c": 0.03, "g_s": 0.01}),
    ("dead_time", {"dU": 6.0, "i_0": 0.05}),
])  # fmt: skip
def test_errors_of_current_and_voltage_are_found_on_a_linear_motor(effect: str, values: dict[str, float]) -> None:
    """Its electrical angle follows from the position and `p`: an offset was a detent force, and the others nothing."""
    design = linear_motor().design
    log = simulate(design, "identification", truth=design.with_effect(effect, values), seed=3)
    (step,) = diagnose(design, log, plan=False).steps
    assert step.effect == effect
    for name, value in values.items():
        assert step.parameters[name].value == pytest.approx(value, rel=0.2)

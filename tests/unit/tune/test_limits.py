"""Loops that the drive can run: a small step fits the voltage, and the encoder leaves the current to the motion."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pmsm_ctrl.compensate import baseline, run_trial, study_trials
from pmsm_ctrl.design import Design
from pmsm_ctrl.tune.current import tune_current
from pmsm_ctrl.tune.limits import SWAMPED, USABLE_STEP
from pmsm_ctrl.tune.requirements import Specification
from pmsm_ctrl.tune.tuning import tune
from tests.effort import seeds
from tests.unit.tuned import tuned

# A slow winding (6.8 ms) sampled at 100 kHz: the modulus optimum asks for 90 % of the voltage for 1 % of the current.
SLOW_WINDING = {
    "motor": {"R": 6.465, "L_d": 43.83e-3, "L_q": 43.83e-3, "J": 1.572e-5, "p": 3, "psi_f": 26.52e-3},
    "drive": {"u_dc": 97.3, "i_max": 3.46, "f_control": 1e5, "speed_divider": 2},
    "sensor": {"encoder_counts": 1 << 20, "current_noise": 7e-4, "log_divider": 100},
    "effects": [{"id": "coulomb", "F_c": 0.006}, {"id": "viscous", "F_v": 3e-6}],
}


def test_a_small_step_of_the_current_fits_the_voltage():
    design = Design.from_dict(SLOW_WINDING)
    found = tune(design, prove=False)
    voltage = design.drive.u_dc / math.sqrt(3.0)
    assert found.loops.current.K_p * USABLE_STEP * design.drive.i_max == pytest.approx(voltage)
    factor = tune_current(design).K_p / found.loops.current.K_p
    assert found.limited == pytest.approx({"voltage": factor})
    assert found.slowed["current"] == pytest.approx(factor)
    assert "limited_by_voltage" in {notice.code for notice in found.notices}
    assert f"slowed down {factor:.3g} times by the voltage limit" in found.summary(width=300)
    # With the gains of the rule the axis runs away to a third of a radian.
    trial = study_trials(found.design)["reversal 2 rad/s"]
    log = run_trial(baseline(found.design), trial)[0]
    assert np.abs(log["theta_ref"] - log["theta_true"]).max() < 1e-3


def test_a_table_names_what_slowed_a_loop_down() -> None:
    """It was said to be the margins, beside a warning that it is the encoder."""
    found = tune(Design.from_dict(SLOW_WINDING).replace(sensor={"encoder_counts": 8192}), prove=False)
    assert f"slowed down {found.slowed['speed']:.3g} times by the encoder's resolution" in found.summary(width=300)
    assert "to meet the margins" not in found.summary(width=300)


@pytest.mark.slow
def test_the_counts_of_the_encoder_do_not_take_the_current():
    design = Design.from_dict(SLOW_WINDING).replace(sensor={"encoder_counts": 8192})
    found = tune(design, prove=False)
    assert found.noise.encoder_ripple <= SWAMPED * design.drive.i_max
    assert found.limited["encoder"] > 1.5
    assert {"limited_by_encoder", "encoder_ripple"} <= {notice.code for notice in found.notices}
    assert found.margins_met


def test_what_was_asked_for_is_not_changed():
    design = Design.from_dict(SLOW_WINDING)
    asked = Specification(current="bandwidth", current_bandwidth=4000.0, speed="bandwidth", speed_bandwidth=400.0)
    found = tune(design, asked, prove=False)
    assert found.limited == {}
    assert found.margins["current"].crossover == pytest.approx(4000.0, rel=1e-3)
    assert found.margins["speed"].crossover == pytest.approx(400.0, rel=1e-3)


@pytest.mark.parametrize("name", seeds("seed_motor", "small_servo", "servo_2kw"))
def test_the_shipped_designs_are_within_their_limits(name):
    found = tuned(name)
    assert found.limited == {}
    assert set(found.slowed.values()) == {1.0}

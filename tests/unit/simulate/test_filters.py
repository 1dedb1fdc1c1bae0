"""Filters of the current reference in the simulated controller."""

import numpy as np
import pytest
from scipy import signal

from pmsm_ctrl import Design, simulate
from pmsm_ctrl.design import Filter
from pmsm_ctrl.simulate import Scenario
from pmsm_ctrl.simulate.compose import source
from pmsm_ctrl.simulate.controller_lines import SpeedParts

FILTERS = (
    Filter(kind="notch", frequency=300.0, width=120.0, depth=20.0),
    Filter(kind="low_pass", frequency=900.0, order=1),
    Filter(kind="lead", frequency=200.0, phase=30.0),
)


def with_filters(design, *filters, **speed):
    loops = design.loops
    return design.model_copy(
        update={
            "loops": loops.model_copy(update={"speed": loops.speed.model_copy(update={"filters": filters, **speed})})
        }
    )


def shaken(t):
    return {"i_q_add": 0.3 * np.sin(2.0 * np.pi * 170.0 * t) + 0.2 * np.sign(np.sin(2.0 * np.pi * 37.0 * t))}


@pytest.fixture(scope="module")
def design(designs):
    """The reference motor without friction, logged at the rate of its speed loop."""
    found = Design.read(designs / "seed_motor.toml").replace(sensor={"log_divider": 4})
    return found.replace_effects(())


@pytest.mark.parametrize("compiled", [True, False])
def test_the_controller_filters_as_scipy_does(design, compiled):
    """Without a speed gain the current reference is what is added, filtered."""
    motion = Scenario("shaken", 0.03, shaken)
    log = simulate(with_filters(design, *FILTERS, K_p=0.0), motion, compiled=compiled)
    expected = shaken(log.t)["i_q_add"]
    for one in FILTERS:
        b_0, b_1, b_2, a_1, a_2 = one.biquad.sampled(design.drive.speed_period)
        expected = signal.lfilter([b_0, b_1, b_2], [1.0, a_1, a_2], expected)
    np.testing.assert_allclose(log["i_q_ref"], expected, atol=1e-12)


def test_the_limit_acts_behind_the_filters(design):
    limited = with_filters(design.replace(drive={"i_max": 0.4}), *FILTERS, K_p=0.0)
    log = simulate(limited, Scenario("shaken", 0.03, shaken))
    assert np.abs(log["i_q_ref"]).max() == 0.4


def test_without_filters_the_kernel_is_that_of_a_drive_that_has_none():
    text = source((), (), SpeedParts())
    assert "passed" not in text
    assert "gains[15]" not in text
    filtered = source((), (), SpeedParts(filters=1)).splitlines()
    assert [
        line for line in text.splitlines() if line not in filtered and "memory" not in line and "return" not in line
    ] == []


def test_filters_work_beside_a_turning_compensation_and_an_observer(design):
    """Their memories stand side by side; a filter that passes everything changes nothing."""
    transparent = Filter(kind="notch", frequency=300.0, width=100.0, depth=1e-12)
    turning = {"source": "reference", "gain": 1.0, "ramp": 1e-3}
    observer = {"source": "observer", "gain": 1.0, "bandwidth": 80.0}
    motion = Scenario("turn", 0.03, lambda t: {"omega_ref": 20.0 * np.cos(200.0 * t)}, omega_0=20.0)
    for compensation in (turning, observer):
        drive = design.with_effect("coulomb", {"F_c": 0.02}).replace(compensation=compensation)
        plain, filtered = (
            simulate(one, motion, seed=3, compiled=False) for one in (drive, with_filters(drive, transparent))
        )
        np.testing.assert_allclose(filtered["i_q_ref"], plain["i_q_ref"], atol=1e-9)
        np.testing.assert_allclose(filtered["omega"], plain["omega"], atol=1e-9)

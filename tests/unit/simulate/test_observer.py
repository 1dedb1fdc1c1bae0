"""The disturbance observer in the simulated drive and in the linear loop, against its closed form."""

from __future__ import annotations

import math

import control as ct
import numpy as np
import pytest

from pmsm_ctrl.compensate import baseline, compensated
from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import DesignError
from pmsm_ctrl.simulate import Scenario, scenario, simulate
from pmsm_ctrl.tune.margins import response
from pmsm_ctrl.tune.observer import design_observer, loop_with_observer
from pmsm_ctrl.tune.sampled import frequencies

BANDWIDTH = 150.0  # rad/s


@pytest.fixture(scope="module")
def axis(request: pytest.FixtureRequest) -> Design:
    """Return a frictionless axis with ideal sensors, so that the drive is linear."""
    hand = Design.read(request.config.rootpath / "designs" / "hand_tuned.toml").replace_effects(())
    return hand.replace(sensor={"encoder_counts": 0, "current_noise": 0.0, "speed_filter": 0.5e-3})


def proportional(design: Design) -> tuple[Design, Design]:
    """Return a P speed controller with an observer, and the PI controller that it is in closed form."""
    T, K_p = design.drive.speed_period, 0.0274
    a = 1.0 - math.exp(-BANDWIDTH * T)
    damping = BANDWIDTH * design.J * (1.0 - a) / design.K_t
    observed = design.replace(
        loops={"speed": {"K_p": K_p, "T_n": 1e9}},
        compensation={"source": "observer", "gain": 1.0, "bandwidth": BANDWIDTH},
    )
    T_n = T * (K_p + damping) / (K_p * a)
    return observed, design.replace(loops={"speed": {"K_p": K_p + damping, "T_n": T_n}})


@pytest.mark.slow
def test_beside_a_p_controller_the_observer_is_a_pi_controller(axis: Design) -> None:
    """A load step while the speed reference rests: both currents are the same to rounding."""
    push = Scenario("push", 0.3, lambda t: {"T_load": np.where(t > 0.05, 0.02, 0.0)})
    logs = [simulate(design, push, keep_truth=True) for design in proportional(axis)]
    assert np.abs(logs[1]["i_q_ref"]).max() > 0.01
    assert logs[0]["i_q_ref"] == pytest.approx(logs[1]["i_q_ref"], abs=1e-6)  # T_n = 1e9 s stands for none
    assert logs[0]["omega_true"][-1] == pytest.approx(0.0, abs=0.05)


def test_the_linear_loop_has_the_same_closed_form(axis: Design) -> None:
    observed, pi = (design.replace(loops={"position": {"K_v": 0.0}}) for design in proportional(axis))
    grid = frequencies(axis.drive.speed_period, 1e-3, 50)
    one, two = response(loop_with_observer(observed, BANDWIDTH), grid), response(loop_with_observer(pi, 0.0), grid)
    assert one == pytest.approx(two, rel=1e-6)


def test_compiled_kernel_is_its_plain_twin(axis: Design) -> None:
    moved = compensated(axis.replace(compensation={"bandwidth": 200.0}), [], source="observer", gain=0.8)
    motion = Scenario("short", 0.03, scenario("reversal", axis, speed=2.0, frequency=10.0).references, "position")
    compiled, plain = (simulate(moved, motion, compiled=c) for c in (True, False))
    assert np.allclose(compiled["i_q_ref"], plain["i_q_ref"], rtol=1e-9, atol=1e-12)


def test_a_rotating_start_and_zero_gain_disturb_nothing(axis: Design) -> None:
    still = Scenario("still", 0.2, lambda t: {"omega_ref": np.full(t.shape, 30.0)}, omega_0=30.0)
    on = axis.replace(compensation={"source": "observer", "gain": 1.0, "bandwidth": 300.0})
    # the current loop's own transient, which the loops have without an observer as well
    errors = [np.abs(simulate(d, still, keep_truth=True)["omega_true"] - 30.0).max() for d in (on, axis)]
    assert errors[0] < 1.2 * errors[1]
    assert errors[1] < 0.1
    off = axis.replace(compensation={"source": "observer", "gain": 0.0, "bandwidth": 300.0})
    assert np.array_equal(simulate(off, still)["i_q"], simulate(axis, still)["i_q"])


def test_the_designed_bandwidth_keeps_the_sensitivity(request: pytest.FixtureRequest) -> None:
    for name in ("hand_tuned", "low_speed"):
        design = baseline(Design.read(request.config.rootpath / "designs" / f"{name}.toml"))
        found = design_observer(design)
        limit = max(2.0, 1.25 * found.before.sensitivity_peak)
        assert found.after.stable
        assert 0.97 * limit < found.after.sensitivity_peak < 1.01 * limit
        assert found.worst.speed.sensitivity_peak > found.worst_before.sensitivity_peak
        loop = loop_with_observer(design, found.bandwidth)
        assert np.all(np.abs(ct.feedback(loop, 1).poles()) < 1.0)


def test_an_observer_needs_a_bandwidth(axis: Design) -> None:
    lacking = axis.replace(compensation={"source": "observer", "gain": 1.0})
    with pytest.raises(DesignError, match=r"compensation.bandwidth: missing"):
        simulate(lacking, "sweep")

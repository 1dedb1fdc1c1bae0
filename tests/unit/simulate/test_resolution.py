"""The integration step follows the fastest mode of the drive: springs, windings, friction, dead time."""

from __future__ import annotations

import control as ct
import numpy as np
import pytest

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import DesignError
from pmsm_ctrl.simulate import Scenario, simulate
from pmsm_ctrl.simulate.resolution import MOST_STEPS, RESOLVED
from pmsm_ctrl.simulate.run import prepare
from pmsm_ctrl.tune.sampled import Cascade
from pmsm_ctrl.tune.steps import linear_step
from tests.unit.simulate.composed import SPRUNG, simulate_composed

J_LOAD, T_LOAD = 4e-5, 0.05
IDEAL = {"encoder_counts": 0, "current_noise": 0.0, "log_divider": 1}


@pytest.fixture
def bare(project_root):
    """The seed motor without friction and with ideal sensors."""
    return Design.read(project_root / "designs/seed_motor.toml").replace_effects(()).replace(sensor=IDEAL)


def twist(t, J, J_load, k, d, torque):
    """Closed form of the twist of two masses at rest when a load torque acts on the second one."""
    reduced = J_load * (J - J_load) / J
    delta, square = 0.5 * d / reduced, k / reduced - (0.5 * d / reduced) ** 2
    rest = torque / J_load * reduced / k
    if square > 0.0:
        w = np.sqrt(square)
        return rest * (1.0 - np.exp(-delta * t) * (np.cos(w * t) + delta / w * np.sin(w * t)))
    w = np.sqrt(-square)
    fast, slow = -delta - w, -(k / reduced) / (delta + w)  # without the cancellation of w - delta
    return rest * (1.0 - (fast * np.exp(slow * t) - slow * np.exp(fast * t)) / (fast - slow))


@pytest.mark.parametrize("d", [0.0, 1e-3, 0.3])
@pytest.mark.parametrize("k", [1.0, 1e2, 1e4, 4e4, 5e4, 7e4, 1e5, 3e5, 1e6, 1e7, 1e8, 1e9])
def test_a_spring_of_any_stiffness_swings_as_its_closed_form(bare, k, d):
    # A winding that lets no current flow leaves the two masses alone.
    alone = bare.replace(motor={"L_d": 1e12, "L_q": 1e12}, loops={"current": {"K_p": 1e-12, "T_n": 1e9}})
    design = alone.with_effect("compliance", {"J_load": J_LOAD, "k": k, "d": d})
    n = 160
    pull = Scenario("pull", n / 16000.0, lambda t: {"T_load": np.full(t.shape, T_LOAD)}, control="current")
    log = simulate(design, pull, keep_truth=True)
    t = log.t
    found = log["theta_true"] - log["theta_load"]
    expected = twist(t, design.J, J_LOAD, k, d, T_LOAD)
    rest = T_LOAD / k * (design.J - J_LOAD) / design.J
    together = -0.5 * T_LOAD * t**2 / design.J  # the centre of mass
    travel = together + J_LOAD / design.J * expected
    # Runge-Kutta errs by x^4 / 120 in the phase and x^5 / 144 in the amplitude, per radian: hard springs turn many.
    turned = np.sqrt(k * design.J / (J_LOAD * (design.J - J_LOAD))) * t
    error = 2.0 * np.minimum(turned * (RESOLVED**4 / 120.0 + RESOLVED**5 / 144.0), 2.0) * rest
    rounding = 1e-9 * abs(together[-1])
    assert np.all(np.abs(found - expected) <= error + rounding)
    assert np.all(np.abs(log["theta_true"] - travel) <= error + rounding)


@pytest.mark.parametrize("k", [1e3, 4e4, 5e4, 7e4, 1e5, 3e5, 1e6, 1e8, 1e9])
def test_a_speed_loop_on_a_hard_spring_answers_as_the_linear_model(bare, k):
    # python-control's exact discretisation of the same two masses
    design = bare.with_effect("compliance", {"J_load": J_LOAD, "k": k, "d": 0.01})
    loops = design.require_loops()
    speed, size, length = 50.0, 1.0, 0.02
    cascade = Cascade.of(design, loops.current, loops.speed, at=speed)
    t, expected = linear_step(cascade, "omega_ref", "omega", length)

    def speeds(step):
        def references(at):
            return {"omega_ref": np.where(at >= 0.02 - 1e-9, speed + step, speed)}

        motion = Scenario("step", 0.02 + length, references, omega_0=speed)
        log = simulate(design, motion, keep_truth=True)
        return log["omega_true"][log.t >= 0.02 - 1e-9][:: design.drive.speed_divider]

    found = speeds(size) - speeds(0.0)
    assert found == pytest.approx(size * expected[: len(found)], abs=0.002 * size)


@pytest.mark.slow
def test_with_friction_a_very_hard_spring_is_a_rigid_shaft(project_root):
    rigid = Design.read(project_root / "designs/seed_motor.toml").without_effect("viscous").replace(sensor=IDEAL)
    hard = rigid.with_effect("compliance", {"J_load": J_LOAD, "k": 3e6, "d": 0.01})
    motion = Scenario("sine", 0.2, lambda t: {"omega_ref": 5.0 * np.sin(40.0 * t)})
    one, two = simulate(rigid, motion, keep_truth=True), simulate_composed(hard, motion, composed=SPRUNG)
    assert two["omega_true"] == pytest.approx(one["omega_true"], abs=0.05)
    assert np.abs(two["i_q"]).max() < 0.2


@pytest.mark.parametrize("tau", [2e-6, 1e-5, 2.5e-5])
def test_a_fast_winding_answers_as_its_exact_discretisation(bare, tau):
    R = 0.5
    design = bare.replace(motor={"R": R, "L_d": R * tau, "L_q": R * tau, "J": 1.0, "psi_f": 1e-9})
    gains = {"current": {"K_p": 0.2, "T_n": 4e-4}}
    design = design.replace(loops=gains)
    step = Scenario("step", 0.002, lambda t: {"i_q_add": np.full(t.shape, 0.5)}, control="current")
    log = simulate(design, step)
    T = 1.0 / design.drive.f_control
    winding = ct.c2d(ct.ss([[-1.0 / tau]], [[1.0 / (R * tau)]], [[1.0]], [[0.0]]), T, "zoh")
    a, b = float(winding.A[0, 0]), float(winding.B[0, 0])
    i, integral, pending, expected = 0.0, 0.0, 0.0, []
    for _ in range(len(log)):
        expected.append(i)
        u = 0.2 * (0.5 - i) + integral
        integral += T / 4e-4 * 0.2 * (0.5 - i)
        i, pending = a * i + b * pending, u
    assert log["i_q"] == pytest.approx(np.array(expected), abs=1e-3)


def test_steps_follow_every_fast_mode(bare):
    motion = Scenario("rest", 0.1, lambda t: {})

    def steps(design):
        return prepare(design, motion).plant.steps

    assert steps(bare) == 1
    assert steps(bare.replace(drive={"plant_steps": 8})) == 8
    # L/R of 10 us: the period of 62.5 us holds 6.25 of them
    assert steps(bare.replace(motor={"L_d": 19e-5, "L_q": 19e-5})) == pytest.approx(6.25 / RESOLVED, abs=1.0)
    # dead time: dU / i_0 is a resistance around zero current
    lost = bare.replace(motor={"L_d": 1e-3, "L_q": 1e-3}).with_effect("dead_time", {"dU": 6.0, "i_0": 0.05})
    assert steps(lost) >= 120.0 / 1e-3 / 16000.0
    # the falling branch of Stribeck friction on a light shaft
    light = bare.replace(motor={"J": 1e-7}).with_effect("stribeck", {"dF_s": 0.01, "w_s": 0.1, "delta": 2.0})
    assert steps(light) >= 0.85 * 0.01 / 0.1 / 1e-7 / 16000.0 / RESOLVED
    # viscous friction that stops the shaft within microseconds
    assert steps(bare.with_effect("viscous", {"F_v": 9.0})) == pytest.approx(9.0 / 9e-5 / 16000.0 / RESOLVED, rel=0.2)
    # a contact is as hard as a spring
    contact = {"gap": 0.01, "J_load": J_LOAD, "k": 1e7, "d": 0.01}
    assert steps(bare.with_effect("backlash", contact)) >= np.sqrt(1e7 / J_LOAD) / 16000.0 / RESOLVED


def test_a_mode_too_fast_to_simulate_is_refused_in_one_line(bare):
    hard = bare.with_effect("compliance", {"J_load": 1e-12, "k": 1e9})
    with pytest.raises(DesignError, match=f"at most {MOST_STEPS} are possible; the spring is so stiff") as caught:
        simulate(hard, Scenario("rest", 0.1, lambda t: {}))
    assert "\n" not in str(caught.value)

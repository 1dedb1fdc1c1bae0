"""The bare drive: sticking, voltage limit, sampling, and an independent solver as the judge."""

import sys

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import DesignError, RequestError, SimulationError
from pmsm_ctrl.kernels.rotation import hexagon_scale
from pmsm_ctrl.simulate import Scenario, scenario, simulate

SEED = "designs/seed_motor.toml"
COUNT = 2 * np.pi / 131072


@pytest.fixture(scope="module")
def quiet(project_root):
    """The reference motor with ideal sensors."""
    design = Design.read(project_root / SEED)
    return design.replace(sensor={"encoder_counts": 0, "current_noise": 0.0})


@pytest.fixture(scope="module")
def seed_motor(project_root):
    return Design.read(project_root / SEED)


def hold(load, duration):
    return Scenario("hold", duration, lambda t: {"T_load": np.full(len(t), load)}, control="current")


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("steps", [1, 3])
def test_held_below_breakaway_does_not_creep_in_100_s(quiet, sign, steps):
    design = quiet.replace(drive={"plant_steps": steps}, sensor={"log_divider": 1600})
    log = simulate(design, hold(sign * 0.99 * 0.0213, 100.0), keep_truth=True)
    assert np.all(log["theta_true"] == 0.0)  # less than one count: not at all
    assert np.all(log["omega_true"] == 0.0)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.slow
def test_released_just_above_breakaway_it_moves_as_newton_says(quiet, sign):
    excess = 0.01 * 0.0213
    log = simulate(quiet.without_effect("viscous"), hold(-sign * (0.0213 + excess), 0.5), keep_truth=True)
    # A constant excess torque: theta = T t^2 / (2 J). The free shaft induces a current, which i_q = 0 control opposes.
    expected = sign * 0.5 * excess / 9e-5 * log.t[-1] ** 2
    assert log["theta_true"][-1] == pytest.approx(expected, rel=2e-3)
    assert abs(log["theta_true"][-1]) > COUNT


def test_comes_to_rest_at_the_closed_form_place_and_stays(quiet):
    """A coasting shaft with Coulomb and viscous friction stops after a closed-form time and angle."""
    F_c, F_v, J, start = 0.0213, 0.000168, 9e-5, 5.0
    coast = Scenario("coast", 0.05, lambda t: {}, control="current", omega_0=start)
    # Without magnets there is no induced current, and friction alone brakes.
    design = quiet.replace(sensor={"log_divider": 1}).with_parameters(psi_f=1e-9)
    log = simulate(design, coast, keep_truth=True)
    tau, level = J / F_v, F_c / F_v
    t_stop = tau * np.log1p(start / level)
    theta_stop = tau * start - level * t_stop
    moving = log["omega_true"] > 0.0
    assert log.t[~moving][0] == pytest.approx(t_stop, abs=1.01 / 16000)
    assert np.all(log["omega_true"][~moving] == 0.0)
    assert log["theta_true"][-1] == pytest.approx(theta_stop, rel=1e-3)


def test_open_loop_against_an_independent_adaptive_solver(quiet):
    """Locked gains, a voltage step through a near-open loop: scipy integrates the same equations of the textbook."""
    design = quiet.without_effect("coulomb").replace(
        loops={"current": {"K_p": 1e-9, "T_n": 1e9}, "speed": {"K_p": 0.0, "T_n": 1.0}},
        assumed={"K_t": 1e-12, "L_d": 1e-12, "L_q": 1e-12},
        sensor={"log_divider": 16},
    )
    spin = Scenario("spin", 0.05, lambda t: {}, control="current", omega_0=100.0)
    log = simulate(design, spin, keep_truth=True)

    def textbook(t, y):
        i_d, i_q, w, _ = y
        di_d = (-19.0 * i_d + 4 * w * 49.16e-3 * i_q) / 49.16e-3
        di_q = (-19.0 * i_q - 4 * w * (49.16e-3 * i_d + 0.172)) / 49.16e-3
        return [di_d, di_q, (1.5 * 4 * 0.172 * i_q - 0.000168 * w) / 9e-5, w]

    judge = solve_ivp(textbook, (0, 0.05), [0, 0, 100.0, 0], rtol=1e-11, atol=1e-12, t_eval=log.t)
    assert np.abs(log["omega_true"] - judge.y[2]).max() < 2e-6
    assert np.abs(log["theta_true"] - judge.y[3]).max() < 2e-7
    # The current is seen in the frame of an ideal encoder: it is the true one.
    assert np.abs(log["i_q"] - judge.y[1]).max() < 5e-6


def test_twin_in_plain_python_agrees_with_the_kernel(seed_motor):
    motion = scenario("sweep", speed_max=20.0, speed_step=20.0, dwell=0.02)
    fast = simulate(seed_motor, motion, seed=3)
    slow = simulate(seed_motor, motion, seed=3, compiled=False)
    for name in fast:
        assert np.allclose(fast[name], slow[name], rtol=1e-9, atol=1e-9), name


def test_chunks_do_not_show(seed_motor, monkeypatch):
    motion = scenario("sweep", speed_max=20.0, speed_step=20.0, dwell=0.1)
    whole = simulate(seed_motor, motion, seed=1)
    monkeypatch.setattr(sys.modules["pmsm_ctrl.simulate.run"], "CHUNK", 48)
    pieces = simulate(seed_motor, motion, seed=1)
    assert all(np.array_equal(whole[name], pieces[name]) for name in whole)


@pytest.mark.parametrize("degrees", [0, 10, 30, 45, 77, 200, 301])
def test_hexagon_limit_against_its_polygon(degrees):
    """The largest vector at an angle is the distance to the hexagon's edge: (u_dc/sqrt 3)/cos(offset)."""
    u_dc, angle = 560.0, np.deg2rad(degrees)
    offset = (angle % (np.pi / 3)) - np.pi / 6  # from the middle of an edge
    edge = u_dc / np.sqrt(3) / np.cos(offset)
    assert hexagon_scale(1000.0, 0.0, angle, u_dc) * 1000.0 == pytest.approx(edge, rel=1e-12)
    assert hexagon_scale(0.99 * edge, 0.0, angle, u_dc) == 1.0


def test_integrators_do_not_wind_up(quiet):
    """A speed step far beyond the current limit: the overshoot stays small because the integrator stops."""
    step = Scenario("step", 1.0, lambda t: {"omega_ref": np.full(len(t), 150.0)})
    log = simulate(quiet.replace(drive={"i_max": 0.3}), step)
    assert np.abs(log["i_q_ref"]).max() <= 0.3
    assert log["omega"].max() < 150.0 * 1.08
    assert log["omega"][-1] == pytest.approx(150.0, abs=0.2)


def test_controller_and_plant_are_different_objects(quiet):
    """The drive believes 1.0 N m/A: the shaft still turns by the plant's 1.032, and i_q shows it."""
    motion = scenario("sweep", speed_max=100.0, speed_step=200.0, dwell=0.5)
    believed = quiet.replace(assumed={"K_t": 1.0})
    log = simulate(believed, motion, truth=quiet)
    torque = (0.0213 + 0.000168 * 100.0) / 1.032
    assert log["i_q"][-1] == pytest.approx(torque, rel=1e-3)


def test_seeds_differ_and_repeat(seed_motor):
    motion = scenario("sweep", speed_max=20.0, speed_step=20.0, dwell=0.05)
    one, again, other = (simulate(seed_motor, motion, seed=s)["i_q"] for s in (1, 1, 2))
    assert np.array_equal(one, again)
    assert not np.array_equal(one, other)


def test_current_noise_has_the_asked_size(seed_motor):
    design = seed_motor.replace(loops={"speed": {"K_p": 0.0, "T_n": 1.0}, "current": {"K_p": 1e-6, "T_n": 1.0}})
    log = simulate(design, hold(0.0, 4.0), seed=5)
    assert np.std(log["i_q"]) == pytest.approx(0.004, rel=0.05)


def test_unstable_loop_says_where_and_when(quiet):
    design = quiet.replace(loops={"current": {"K_p": 1e5, "T_n": 1e-5}}, drive={"u_dc": 1e15})
    with pytest.raises(SimulationError, match=r"diverged at t = .* s"):
        simulate(design, "sweep")


def test_requests_that_cannot_be_met(project_root, quiet):
    with pytest.raises(RequestError, match="did you mean 'sweep'"):
        simulate(quiet, "swep")
    with pytest.raises(RequestError, match="unknown parameter 'dwel'; did you mean 'dwell'"):
        scenario("sweep", dwel=1.0)
    with pytest.raises(RequestError, match="should be positive"):
        scenario("sweep", dwell=0.0)
    with pytest.raises(DesignError, match="knows only K_t"):
        simulate(Design.read(project_root / "designs/emps.toml"), "sweep")
    with pytest.raises(DesignError, match="loops: missing"):
        simulate(quiet.model_copy(update={"loops": None}), "sweep")

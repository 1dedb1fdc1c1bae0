"""Feedforward and reference filter in position control: closed forms, and profiled moves promised and simulated."""

from __future__ import annotations

import control as ct
import numpy as np
import pytest

from pmsm_ctrl.design import Design
from pmsm_ctrl.sampling import filter_delay, speed_lag, time_constant
from pmsm_ctrl.simulate import Controller, scenario, simulate
from pmsm_ctrl.tune.moves import friction_load, moves
from pmsm_ctrl.tune.sampled import Cascade
from pmsm_ctrl.tune.tuning import tune
from tests.benchmarks.machines import machine
from tests.unit import tuned as shipped


@pytest.fixture(scope="module")
def tuned():
    return shipped.tuned("seed_motor")


def test_a_time_constant_is_the_inverse_of_its_delay():
    for tau in (1e-4, 0.3e-3, 5e-3, 1.0):
        assert time_constant(0.25e-3, filter_delay(0.25e-3, tau)) == pytest.approx(tau, rel=1e-9)
    assert time_constant(0.25e-3, 0.0) == 0.0


def test_the_reference_speed_is_delayed_as_the_measured_speed_lags(tuned):
    design = tuned.design
    period = design.drive.speed_period
    lag = speed_lag(period, design.sensor.speed_filter)
    assert filter_delay(period, tuned.loops.position.velocity_filter) == pytest.approx(lag, rel=1e-9)
    # in speed control the filter cancels the zero of the PI
    assert tuned.loops.speed.reference_filter == tuned.loops.speed.T_n
    filters = [Controller.of(design, control).reference_filter for control in ("position", "speed")]
    assert filters == pytest.approx([period / (period + lag), -np.expm1(-period / tuned.loops.speed.T_n)])


@pytest.mark.parametrize("tau", [None, 0.0, 2e-3, 4.796e-3])
def test_the_error_at_constant_acceleration_is_that_of_the_delays(tuned, tau):
    # e K_v = alpha (delay of the reference's filter - lag of the measured speed), and the integrator's input, by which
    # it follows the viscous friction: T_n / K_p times its rate
    cascade, alpha = tuned.cascade, 3000.0
    place = cascade.position
    if tau is not None:
        place = place.model_copy(update={"velocity_filter": tau})
    cascade = cascade.with_gains(position=place)
    period = cascade.period
    t = period * np.arange(2000)
    inertia = cascade.design.J / cascade.design.K_t
    inputs = np.array([0.5 * alpha * t**2, alpha * t, np.full_like(t, inertia * alpha)])
    system = cascade.system(("theta_ref", "omega_ref", "i_q_add"), ("theta",))
    theta = np.asarray(ct.forced_response(system, T=t, inputs=inputs).outputs).reshape(-1)
    lag = speed_lag(period, cascade.design.sensor.speed_filter)
    expected = alpha * (filter_delay(period, place.velocity_filter) - lag) / place.K_v
    viscous = cascade.design.parameters("viscous")["F_v"] * alpha / cascade.design.K_t
    expected += cascade.speed.T_n / cascade.speed.K_p * viscous / place.K_v
    assert inputs[0, -1] - theta[-1] == pytest.approx(expected, abs=2e-6)
    if tau == 4.796e-3:
        assert inputs[0, -1] - theta[-1] > 0.08  # the filter of speed control costs 85 mrad


@pytest.mark.parametrize(("profile", "distance"), [("trapezoid", 3.0), ("s_curve", 62.8)])
def test_a_move_of_the_tuned_axis_keeps_to_its_profile(tuned, profile, distance):
    motion = scenario(profile, tuned.design, distance=distance, cycles=1.0)
    log = simulate(tuned.design, motion, keep_truth=True)
    error = log["theta_ref"] - log["theta_true"]
    assert np.abs(error).max() < 3e-3  # friction included; 41 and 83 mrad with the filter of speed control
    _, start, stop = motion.segments[0]
    assert log["theta_true"][log.t < motion.segments[1][1]].max() - distance < 0.6e-3


def test_moves_are_as_promised(tuned):
    for move in moves(tuned.cascade, tuned.design):
        assert move.agrees
        assert not move.limited
        assert move.smooth_simulated.peak == pytest.approx(move.smooth_promised.peak, rel=0.005)
        assert move.smooth_simulated.settling == pytest.approx(move.smooth_promised.settling, abs=0.5e-3)
        assert move.simulated.peak == pytest.approx(move.promised.peak, rel=0.25)


def test_a_move_of_another_plant_is_not_as_promised(tuned):
    heavy = tuned.design.with_parameters(J=1.3 * tuned.design.J)
    assert not any(move.agrees for move in moves(tuned.cascade, heavy))


def test_friction_counts_once_with_its_level_in_motion(tuned):
    design = tuned.design.with_effect("stribeck", {"dF_s": 0.01, "w_s": 1.0, "delta": 2.0})
    assert friction_load(design) == pytest.approx(0.0213)
    assert friction_load(design.without_effect("coulomb")) == 0.0


def test_a_design_without_a_filter_of_its_own_keeps_that_of_the_speed_loop(tuned):
    loops = tuned.loops.model_copy(
        update={"position": tuned.loops.position.model_copy(update={"velocity_filter": None})}
    )
    design = tuned.design.model_copy(update={"loops": loops})
    assert Controller.of(design, "position").reference_filter == Controller.of(design, "speed").reference_filter
    again = Design.from_dict(tuned.design.to_dict())
    assert again.loops == tuned.loops
    explicit = design.replace(loops={"position": {"K_v": 10.0, "velocity_filter": 0.0}})
    assert explicit.require_loops().reference_filter(in_position=True) == 0.0
    assert Cascade.of(explicit, loops.current, loops.speed, explicit.loops.position).position.velocity_filter == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("seed", [14, 1097])
def test_moves_are_as_promised_where_the_rotor_turns_far_in_a_control_period(seed):
    # At 4 kHz and full speed the rotor turns by 0.7 and 0.9 rad of its electrical angle while the voltage is held.
    turning = tune(machine(seed), prove=False)
    assert all(move.agrees for move in moves(turning.cascade, turning.design))


@pytest.mark.slow
def test_moves_are_as_promised_where_the_decoupling_lags_the_speed():
    # The speed filter of 4 ms lets the decoupling lag by 29 rad/s, and i_d rises; its product with that lag drives i_q.
    slow = tune(machine(9125), prove=False)
    for move in moves(slow.cascade, slow.design):
        assert move.smooth_simulated.peak == pytest.approx(move.smooth_promised.peak, rel=0.015)

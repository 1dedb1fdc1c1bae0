"""The linear model against python-control's numerical one and against derivatives by hand."""

from __future__ import annotations

import math

import control as ct
import numpy as np
import pytest

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import DesignError, RequestError
from pmsm_ctrl.tune.linearise import (
    Linearisation,
    drive_system,
    linearise,
    operating_point,
    rigid,
    second_mass,
)


@pytest.fixture
def seed_motor(designs) -> Design:
    return Design.read(designs / "seed_motor.toml")


def deviation(design: Design, found: Linearisation) -> float:
    """Largest difference to what python-control finds from the nonlinear system, relative to the largest entry."""
    p = found.point
    system = drive_system(design, direction=math.copysign(1.0, p.speed))
    other = ct.linearize(system, [p.i_d, p.i_q, p.speed, 0.0], [p.u_d, p.u_q, p.load], eps=1e-6)
    pairs = ((found.A, other.A), (found.B, other.B))
    return max(float(np.abs(mine - theirs).max() / np.abs(theirs).max()) for mine, theirs in pairs)


def textbook(design: Design, found: Linearisation) -> np.ndarray:
    """The Jacobian of a machine with Coulomb and viscous friction by hand (Krishnan 2010, eq. 3.63 and following)."""
    m, w, i_q = design.motor, found.point.speed, found.point.i_q
    F_v = design.parameters("viscous")["F_v"]
    return np.array([
        [-m.R / m.L_d, m.p * w * m.L_q / m.L_d, m.p * m.L_q * i_q / m.L_d, 0.0],
        [-m.p * w * m.L_d / m.L_q, -m.R / m.L_q, -m.p * m.psi_f / m.L_q, 0.0],
        [1.5 * m.p * (m.L_d - m.L_q) * i_q / design.J, design.K_t / design.J, -F_v / design.J, 0.0],
        [0.0, 0.0, 1.0, 0.0],
    ])  # fmt: skip


@pytest.mark.parametrize("speed", [-150.0, -10.0, 25.0, 200.0])
@pytest.mark.parametrize("load", [0.0, 0.4])
def test_the_matrices_are_those_of_python_control_and_of_the_textbook(seed_motor, speed, load):
    found = linearise(seed_motor, speed, load)
    assert deviation(seed_motor, found) < 1e-8
    assert found.point.case == "sliding"
    np.testing.assert_allclose(found.A, textbook(seed_motor, found), rtol=1e-8, atol=1e-8)
    # u_d = -p w L_q i_q and u_q = R i_q + p w psi at i_d = 0
    i_q = (load + math.copysign(0.0213, speed) + 0.000168 * speed) / 1.032
    assert found.point.i_q == pytest.approx(i_q, rel=1e-9)
    assert found.point.u_d == pytest.approx(-4 * speed * 49.16e-3 * i_q, rel=1e-9)
    assert found.point.u_q == pytest.approx(19.0 * i_q + 4 * speed * 0.172, rel=1e-9)


def test_salient_machine(designs):
    design = Design.read(designs / "servo_2kw.toml")
    found = linearise(design, 60.0, 2.0)
    assert deviation(design, found) < 1e-8
    # d alpha / d i_d by the reluctance torque: 1.5 p (L_d - L_q) i_q / J, N m/A per kg m^2
    expected = 1.5 * 4 * (4.5e-3 - 5.5e-3) * found.point.i_q / design.J
    assert found.A[2, 0] == pytest.approx(expected, rel=1e-6)


def test_stuck_and_sliding_are_told_apart(seed_motor):
    stuck = linearise(seed_motor, 0.0, 0.01)
    assert stuck.point.case == "stuck"
    assert not stuck.A[2].any()
    assert not stuck.B[2].any()
    sliding = linearise(seed_motor, 1e-3)
    assert sliding.A[2, 2] == pytest.approx(-0.000168 / 9e-5, rel=1e-6)


def test_the_slope_of_stribeck_friction_is_negative(seed_motor):
    dF_s, w_s = 0.0187, 5.0
    design = seed_motor.with_effect("stribeck", {"dF_s": dF_s, "w_s": w_s, "delta": 2.0})
    for speed in (1.0, 3.0, -8.0):
        x = abs(speed) / w_s
        expected = 0.000168 - dF_s * 2.0 * x / w_s * math.exp(-x * x)
        assert linearise(design, speed).point.friction_slope == pytest.approx(expected, rel=1e-6), speed


def test_the_operating_point_is_an_equilibrium_for_python_control(seed_motor):
    point = operating_point(seed_motor, 80.0, 0.2)
    system = drive_system(seed_motor)
    x = np.array([point.i_d, point.i_q, 80.0, 0.0])
    rates = system.dynamics(0.0, x, np.array([point.u_d, point.u_q, 0.2]))
    np.testing.assert_allclose(rates[:3], 0.0, atol=1e-8)
    assert rates[3] == 80.0


def test_find_operating_point_lands_on_the_same_currents(seed_motor):
    point = operating_point(seed_motor, 80.0, 0.2)
    system = drive_system(seed_motor)
    guess = np.array([0.0, 0.1, 80.0, 0.0])
    found = ct.find_operating_point(
        system, guess, np.array([0.0, 50.0, 0.2]), ix=[2, 3], iu=[2], iy=[0], idx=[0, 1, 2],
        y0=[0.0, 0.0, 80.0, 0.0, 0.0],
    )  # fmt: skip
    assert found.states == pytest.approx([0.0, point.i_q, 80.0, 0.0], abs=1e-9)
    assert found.inputs == pytest.approx([point.u_d, point.u_q, 0.2], rel=1e-9)


@pytest.mark.parametrize("speed", [-60.0, 20.0])
def test_the_linear_model_is_the_small_signal_response_of_the_nonlinear_one(seed_motor, speed):
    # An adaptive solver on the nonlinear equations against the linear model: 20 mV more on u_q, 10 ms.
    found = linearise(seed_motor, speed, 0.1)
    point, t = found.point, np.linspace(0.0, 0.01, 101)
    system = drive_system(seed_motor, direction=math.copysign(1.0, speed))
    held = np.array([point.u_d, point.u_q, 0.1])
    start = np.array([point.i_d, point.i_q, speed, 0.0])
    tight = {"rtol": 1e-10, "atol": 1e-12, "max_step": 1e-4}
    runs = [
        ct.input_output_response(
            system, t, np.outer(held + kick, np.ones_like(t)), start, solve_ivp_kwargs=tight
        ).states
        for kick in (np.array([0.0, 0.02, 0.0]), np.zeros(3))
    ]
    kick = np.zeros((3, t.size))
    kick[1] = 0.02
    model = ct.ss(found.A, found.B, np.eye(4), np.zeros((4, 3)))
    linear = ct.forced_response(model, t, kick).outputs
    for k, name in enumerate(("i_d", "i_q", "omega")):
        scale = np.abs(linear[k]).max()
        np.testing.assert_allclose(runs[0][k] - runs[1][k], linear[k], atol=1e-3 * scale, err_msg=name)


def test_two_masses(designs):
    design = Design.read(designs / "geared_resonant.toml")
    found = linearise(design, 40.0)
    mass = second_mass(design)
    assert mass is not None
    mechanics = found.A[2:, 2:]
    poles = np.linalg.eigvals(np.delete(np.delete(mechanics, 1, 0), 1, 1))
    J_m = design.J - mass.J_load
    resonance = math.sqrt(mass.k * (1.0 / J_m + 1.0 / mass.J_load))
    assert np.abs(poles).max() == pytest.approx(resonance, rel=1e-3)
    # Momentum: what the spring takes from the motor it gives to the load.
    assert J_m * found.A[2, 5] == pytest.approx(-mass.J_load * found.A[4, 5])
    assert second_mass(rigid(design)) is None
    assert rigid(design).J == design.J


def test_a_load_as_large_as_the_total_is_refused(seed_motor):
    design = seed_motor.with_effect("compliance", {"J_load": 9e-5, "k": 100.0, "d": 0.0})
    with pytest.raises(RequestError, match=r"J_load = 9e-05 .* should be smaller than the total inertia"):
        linearise(design, 10.0)


def test_points_beyond_the_drive_are_refused(seed_motor):
    with pytest.raises(RequestError, match=r"needs 4\.8.* A, but the drive's limit i_max is 3 A"):
        operating_point(seed_motor, 10.0, 5.0)
    with pytest.raises(RequestError, match=r"a dc link of 560 V gives at most 323\.3 V"):
        operating_point(seed_motor, 600.0)
    slide = seed_motor.replace_effects(()).model_copy(update={"motion": "linear"})
    with pytest.raises(RequestError, match=r"operating point 600 m/s, 0 N: needs"):
        operating_point(slide, 600.0)


def test_a_plain_axis_has_no_electrical_model(designs):
    with pytest.raises(DesignError, match="only K_t"):
        linearise(Design.read(designs / "emps.toml"), 0.1)

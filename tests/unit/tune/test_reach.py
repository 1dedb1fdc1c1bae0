"""Moves that the drive can follow: voltage, current and stability of the current loop at speed, in closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pmsm_ctrl.design import CurrentLoop, Design, Filter, PositionLoop, SpeedLoop
from pmsm_ctrl.simulate.motions import Limits
from pmsm_ctrl.tune.bench import multisine
from pmsm_ctrl.tune.current import tune_current
from pmsm_ctrl.tune.moves import move_limits, moves
from pmsm_ctrl.tune.reach import RESERVE, highest_stable_speed, reachable, steady_voltage
from pmsm_ctrl.tune.sampled import Cascade
from pmsm_ctrl.tune.tuning import tune
from tests.benchmarks.machines import machine


@pytest.fixture(scope="module")
def design(request):
    return Design.read(request.config.rootpath / "designs/seed_motor.toml")


def test_the_voltage_at_speed_is_that_of_the_balance(design):
    m, fast = design.motor, design.replace(drive={"f_control": 1e6})
    u_d, u_q = steady_voltage(fast, 200.0, 0.7)
    assert u_d == pytest.approx(-m.p * 200.0 * m.L_q * 0.7, rel=1e-5)
    assert u_q == pytest.approx(m.R * 0.7 + m.p * 200.0 * m.psi_f, rel=1e-5)


@pytest.mark.parametrize("turn", [0.3, 1.0, 2.0])
def test_a_held_voltage_carries_the_flux_along_a_chord(design, turn):
    # Without resistance the stator's flux moves by T u in a period: the chord of an arc of x radians, 2 sin(x / 2).
    m, lossless = design.motor, design.replace(motor={"R": 1e-9})
    speed, i_q = turn * design.drive.f_control / m.p, 0.7
    arc = m.p * speed * math.hypot(m.psi_f, m.L_q * i_q)
    chord = math.sin(0.5 * turn) / (0.5 * turn) * arc
    assert np.hypot(*steady_voltage(lossless, speed, i_q)) == pytest.approx(chord, rel=1e-6)


@pytest.mark.parametrize("delay", [0, 1])
def test_the_current_loop_is_unstable_above_a_speed(design, delay):
    # One complex equation for both currents: (e^{jx} z - 1) z^d = e^{jx/2} (j x - K_p T/L (1 + T/T_n / (z - 1)))
    lossless = design.replace(motor={"R": 1e-9}, drive={"delay_periods": delay})
    L, T = design.motor.L_q, 1.0 / design.drive.f_control
    loop = CurrentLoop(K_p=L / (3.0 * T), T_n=30.0 * T)

    def radius(x: float) -> float:
        gain = np.exp(0.5j * x) * T / L
        u = np.array([-loop.K_p + 1j * x * L / T, loop.K_p - 1j * x * L / T - loop.K_p * T / loop.T_n])
        left = np.polymul([np.exp(1j * x), -1.0], [1.0, -1.0])
        if delay:
            left = np.polymul(left, [1.0, 0.0])
        return float(np.abs(np.roots(np.polysub(left, gain * u))).max())

    found = highest_stable_speed(lossless, loop) * design.motor.p * T
    assert radius(0.999 * found) < 1.0 < radius(1.001 * found)
    assert all(radius(x) < 1.0 for x in np.linspace(0.05, 0.98 * found, 40))
    assert highest_stable_speed(lossless, loop, 0.9 * found / (design.motor.p * T)) == math.inf


def test_a_move_stays_below_the_speed_at_which_the_position_loop_is_unstable():
    # L/R of 10 us at 4 kHz and 19 pole pairs: the current loop alone is stable up to 298 rad/s
    current, speed = CurrentLoop(K_p=0.2006, T_n=1.041e-5), SpeedLoop(K_p=0.06482, T_n=0.05863)
    cascade = Cascade.of(machine(1067), current, speed, PositionLoop(K_v=56.1), at=80.0)
    assert highest_stable_speed(cascade.design, current) == pytest.approx(298.0, abs=0.5)
    found = move_limits(cascade, "s_curve").speed
    largest = [float(np.abs(cascade.moving(share * found / RESERVE, 0.0).system(("angle_noise",), ("i_q_ref",)).poles())
               .max()) for share in (0.99, 1.01)]  # fmt: skip
    assert largest[0] < 1.0 < largest[1]
    assert found < 200.0


def test_a_motion_within_the_limits_stays_as_it_is(design):
    limits, loop = Limits.of(design), tune_current(design)
    assert reachable(design, loop, limits, jumps=False) == limits
    assert reachable(design, loop, limits, jumps=True) == limits


def test_a_slow_winding_takes_its_share_of_the_voltage(design):
    # hypot(p w L i, R i + p w psi + L di/dt) is brought to four fifths of the voltage; the profile keeps its times
    slow = design.replace(motor={"L_d": 2.0, "L_q": 2.0}, drive={"f_control": 1e6})
    limits, m = Limits.of(slow), slow.motor
    found = reachable(slow, CurrentLoop(K_p=20.0, T_n=0.1), limits, jumps=False)
    assert found.speed < 0.9 * limits.speed
    assert found.acceleration / limits.acceleration == pytest.approx(found.speed / limits.speed)
    assert found.jerk / limits.jerk == pytest.approx(found.speed / limits.speed)
    friction = sum(slow.parameters(name)[key] * by for name, key, by in
                   (("coulomb", "F_c", 1.0), ("viscous", "F_v", found.speed)))  # fmt: skip
    i_q = (slow.J * found.acceleration + friction) / slow.K_t
    omega_e = m.p * found.speed
    u_q = m.R * i_q + omega_e * m.psi_f + m.L_q * slow.J * found.jerk / slow.K_t
    needed = math.hypot(omega_e * m.L_q * i_q, u_q)
    assert needed == pytest.approx(RESERVE * slow.drive.u_dc / math.sqrt(3.0), rel=1e-4)


def test_a_jump_of_the_acceleration_takes_the_voltage_at_once(design):
    top, loop = design.drive.u_dc / math.sqrt(3.0), tune_current(design)
    by_jump = loop.K_p * design.J / design.K_t  # V per rad/s^2
    limits = Limits(speed=50.0, acceleration=1.5 * top / by_jump, jerk=1e6)
    found = reachable(design, loop, limits, jumps=True)
    held = design.motor.R * design.parameters("coulomb")["F_c"] / design.K_t
    assert by_jump * found.acceleration + held == pytest.approx(RESERVE * top, rel=1e-6)
    assert found.speed == limits.speed


def test_a_current_limit_is_kept_and_a_hopeless_one_left(design):
    limits, loop = Limits.of(design), tune_current(design)
    weak = design.replace(drive={"i_max": 0.2})
    found = reachable(weak, loop, limits, jumps=False)
    viscous = weak.parameters("viscous")["F_v"] * found.speed
    i_q = (weak.J * found.acceleration + weak.parameters("coulomb")["F_c"] + viscous) / weak.K_t
    assert i_q == pytest.approx(RESERVE * 0.2, rel=1e-6)
    stuck = design.replace(drive={"i_max": 0.02})
    assert reachable(stuck, loop, limits, jumps=False) == limits


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1040, 1051, 1067, 1121, 1148])
def test_a_machine_follows_the_moves_derived_for_it(seed):
    # 1121: slow winding, voltage p w L i; 1067: speed loop unstable before the current loop is; the others: 1 to
    # 2.5 rad per control period at full EMF
    tuned = tune(machine(seed), prove=False)
    for move in moves(tuned.cascade, tuned.design):
        assert not move.limited
        assert move.agrees


def test_a_test_signal_behind_a_low_pass_is_the_one_asked_for():
    period, low_pass = 0.25e-3, Filter(kind="low_pass", frequency=250.0)
    plain = multisine(period, 50.0, 1000.0)
    raised = plain.before((low_pass,))
    passed = raised.spectrum * low_pass.biquad.sampled_at(np.exp(2j * np.pi * plain.frequencies * period), period)
    share = passed / plain.spectrum
    assert share == pytest.approx(np.full(share.shape, share[0].real), rel=1e-9)
    assert np.abs(raised.samples).max() == pytest.approx(1.0)
    assert plain.before(()) is plain

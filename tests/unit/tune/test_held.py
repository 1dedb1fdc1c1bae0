"""A control period of the linear cascade against the machine in stator coordinates."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from pmsm_ctrl.design import CurrentLoop, Design
from pmsm_ctrl.tune.held import held_period
from pmsm_ctrl.tune.reach import steady_voltage
from pmsm_ctrl.tune.sampled import Cascade

TURN = 0.6  # rad (electrical) in a control period


@pytest.mark.parametrize(("tau", "i_d"), [(70e-6, 0.0), (3e-3, 0.0), (3e-3, 0.8)])
def test_a_control_period_at_speed_is_that_of_the_machine_in_the_stator_frame(designs, tau, i_d):
    # States: i_d, i_q, omega, theta, angle of the voltage ahead of the rotor; inputs: u_d, u_q, load.
    design = Design.read(designs / "seed_motor.toml")
    R, p, psi = design.motor.R, design.motor.p, design.motor.psi_f
    design = design.replace(motor={"L_d": R * tau, "L_q": R * tau}).replace_effects(())
    period, i_q = 1.0 / design.drive.f_control, 1.5
    speed = TURN / (p * period)
    cascade = Cascade.of(design, CurrentLoop(K_p=1.0, T_n=1e-3)).moving(speed, i_q, i_d)
    u_d, u_q = steady_voltage(design, speed, i_q, i_d)

    def after(d):
        rotor = np.exp(1j * p * d[3])
        start = (i_d + d[0] + 1j * (i_q + d[1])) * rotor
        u = (u_d + d[5] + 1j * (u_q + d[6])) * rotor * np.exp(1j * (0.5 * TURN + p * d[4]))

        def rates(t, y):
            flux, current = psi * np.exp(1j * p * y[3]), y[0] + 1j * y[1]
            change = (u - R * current - 1j * p * y[2] * flux) / (R * tau)
            torque = 1.5 * p * (np.conj(flux) * current).imag - design.K_t * i_q - d[7]
            return change.real, change.imag, torque / design.J, y[2]

        y = solve_ivp(
            rates, (0.0, period), [start.real, start.imag, speed + d[2], d[3]], method="DOP853", rtol=1e-9, atol=1e-10
        ).y[:, -1]
        seen, travel = (y[0] + 1j * y[1]) * np.exp(-1j * p * y[3]), y[3] - d[3] - speed * period
        return np.array([seen.real, seen.imag, y[2], d[3] + travel, d[4] - travel])

    sizes = np.array([0.1, 0.1, 2.0, 1e-3, 1e-3, 0.1, 0.1, 0.01])
    slopes = np.column_stack([(after(d) - after(-d)) / (2.0 * d.sum()) for d in np.diag(sizes)])
    found = np.hstack(cascade._discrete)[:, :8]
    scale = np.abs(slopes * sizes).max(axis=1, keepdims=True)  # of every row, for steps of these sizes
    assert np.abs((found - slopes) * sizes / scale).max() < 1e-3


@pytest.mark.parametrize("rate", [0.3, 3.0, 30.0, 300.0])  # one that needs no halving, two that do, and one too many
def test_parts_of_a_period_that_decay_and_turn_are_those_of_the_closed_form(rate: float) -> None:
    """``x' = -a x + u`` beside a rotation: over all parts a is their mean, and the angle is the sum."""
    decay, turn = rate * np.array([0.5, 1.0, 1.5, 2.0]), rate * np.array([1.0, -0.5, 0.25, 1.25])
    A = np.zeros((4, 3, 3))
    A[:, 0, 0], A[:, 1, 2], A[:, 2, 1] = -decay, -turn, turn
    carried, driven = held_period(A, np.zeros((4, 3, 2)), 0.0, 1.0)
    angle, expected = turn.mean(), np.zeros((3, 3))
    expected[0, 0] = np.exp(-decay.mean())
    expected[1:, 1:] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    np.testing.assert_allclose(carried, expected, rtol=1e-12, atol=1e-13)
    assert not driven.any()
    pushed = np.zeros((4, 1, 2))
    pushed[:, 0, 0] = 1.0
    held = held_period(np.full((4, 1, 1), -rate), pushed, 0.0, 1.0)[1]
    np.testing.assert_allclose(held, [[-np.expm1(-rate) / rate, 0.0]], rtol=1e-12, atol=1e-15)

"""Currents of an instant, under a rotor that turns while the voltage stands still in the stator."""

from __future__ import annotations

import numpy as np
import pytest

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose import diagnose
from pmsm_ctrl.log import Log
from tests.effort import seeds

RATE, P, PSI = 4000.0, 4, 0.05  # of the control, Hz; pole pairs; Wb
J, F_C, F_V, T_0 = 1e-3, 0.05, 2e-4, 0.6
DESIGN = Design.from_dict({
    "motor": {"J": J, "p": P, "psi_f": PSI, "R": 0.5, "L_d": 5e-3, "L_q": 5e-3},
    "drive": {"f_control": RATE},
    "effects": [
        {"id": "coulomb", "F_c": F_C}, {"id": "viscous", "F_v": F_V}, {"id": "constant_load", "T_0": T_0},
    ],
})  # fmt: skip


@pytest.mark.parametrize("speed", [50.0, 100.0, 200.0])  # rad/s of the shaft
def test_the_closed_form_is_what_a_winding_does(speed: float) -> None:
    """Steady state of L di/dt = u - j w (L i + psi) between two samples, by small steps of its exact solution."""
    w, T, L, i_q, steps = P * speed, 1.0 / RATE, 5e-3, 3.0, 4000
    mean = 1j * w * (L * 1j * i_q + PSI)  # what the period needs in the mean, in the frame of the rotor
    t = (np.arange(steps) + 0.5) * T / steps
    turned = np.exp(-1j * w * (t - 0.5 * T))
    swing = np.exp(1j * w * t) * (mean / turned.mean() * turned - 1j * w * PSI) / L  # its integral is i exp(j w t)
    inside = np.concatenate([[0.0], np.cumsum(swing) * T / steps])
    ends = np.exp(1j * w * np.linspace(0.0, T, steps + 1))
    start = inside[-1] / (ends[-1] - 1.0)  # after a period the current is what it was
    current = (start + inside) / ends
    between = 0.5 * (current[1:] + current[:-1])
    assert current[0].imag / between.mean().imag - 1.0 == pytest.approx((w * T) ** 2 / 12.0, rel=0.05)


@pytest.mark.parametrize("speed", [50.0, 100.0, 200.0])  # rad/s of the shaft
@pytest.mark.parametrize("R", [0.5, 4.0])
def test_what_the_back_emf_makes_of_it_is_what_a_winding_does(speed: float, R: float) -> None:
    """The same with a resistance and no current in the mean, in the frame of the rotor, by its exact solution."""
    w, T, L, steps = P * speed, 1.0 / RATE, 5e-3, 4000
    pole, h = -(R / L + 1j * w), T / steps  # L di/dt = u - R i - j w (L i + psi)
    middle = (np.arange(steps) + 0.5) * h - 0.5 * T
    held, decay = np.exp(-1j * w * middle) / L, np.exp(pole * h)
    rise = (decay - 1.0) / pole
    by_start, by_voltage, by_emf = (np.zeros(steps + 1, dtype=complex) for _ in range(3))
    by_start[0] = 1.0
    for k in range(steps):
        by_start[k + 1] = decay * by_start[k]
        by_voltage[k + 1] = decay * by_voltage[k] + rise * held[k]
        by_emf[k + 1] = decay * by_emf[k] - rise * 1j * w * PSI / L
    means = [np.trapezoid(one) / steps for one in (by_start, by_voltage, by_emf)]
    first, _ = np.linalg.solve([[1.0 - by_start[-1], -by_voltage[-1]], [means[0], means[1]]], [by_emf[-1], -means[2]])
    closed = -(PSI / L) * (R * T / L) * (w * T) ** 3 / 240.0
    assert first.imag == pytest.approx(closed, rel=0.1)


def running(seed: int, share: float) -> Log:
    """A small motor of 4 kHz without a load at many speeds, its currents this share of what an instant has."""
    t = np.arange(0.0, 20.0, 1e-3)
    omega = 290.0 * (0.6 * np.sin(2.0 * t) + 0.4 * np.sin(6.6 * t + 1.0))
    alpha, theta = np.gradient(omega, t), np.cumsum(omega) * 1e-3
    current = (3e-5 * alpha + 0.037 * np.sign(omega) + 5e-5 * omega) / SMALL.K_t_assumed
    turned = 5.0 * omega / RATE
    current *= 1.0 + share * turned**2 / 12.0
    current -= share * 0.0125 / 2e-4 * (0.3 / RATE / 2e-4) * turned**3 / 240.0
    return Log({"t": t, "theta": theta, "i_q": current + 2e-4 * np.random.default_rng(seed).normal(size=t.size)})


SMALL = Design.from_dict({
    "motor": {"J": 3.1e-5, "p": 5, "psi_f": 0.0125, "R": 0.3, "L_d": 2e-4, "L_q": 2e-4},
    "drive": {"f_control": RATE},
    "effects": [{"id": "coulomb", "F_c": 0.04}, {"id": "viscous", "F_v": 1e-4}],
})  # fmt: skip


@pytest.mark.parametrize("seed", seeds(1, 2, 3))
@pytest.mark.parametrize("share", [0.0, 1.0])
def test_it_is_no_drag(share: float, seed: int) -> None:
    """A quadratic drag and a Stribeck friction were named in two clean logs, and this one was unexplained."""
    found = diagnose(SMALL, running(seed, share), plan=False)
    assert (found.verdict, found.steps) == ("consistent", ())


def hoisting(seed: int, share: float) -> Log:
    """A weight that goes up and down at many speeds, its currents this share of what an instant has beyond a mean."""
    t = np.arange(0.0, 20.0, 1e-3)
    omega = 150.0 * (0.6 * np.sin(2.0 * t) + 0.4 * np.sin(6.6 * t + 1.0))
    alpha, theta = np.gradient(omega, t), np.cumsum(omega) * 1e-3
    torque = J * alpha + F_C * np.sign(omega) + F_V * omega + T_0
    torque *= 1.0 + share * (P * omega / RATE) ** 2 / 12.0
    current = torque / (1.5 * P * PSI)
    return Log({"t": t, "theta": theta, "i_q": current + 2e-3 * np.random.default_rng(seed).normal(size=t.size)})


@pytest.mark.parametrize("seed", seeds(1, 2, 3))
@pytest.mark.parametrize("share", seeds(0.0, 1.0))  # a mean of the converter over the period; an instant
def test_it_is_no_friction_by_direction(share: float, seed: int) -> None:
    found = diagnose(DESIGN, hoisting(seed, share), plan=False)
    assert [step.effect for step in found.steps] == []

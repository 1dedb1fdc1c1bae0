"""Margins and delay models against closed forms."""

from __future__ import annotations

import math

import control as ct
import numpy as np
import pytest

from pmsm_ctrl.design import CurrentLoop, Design
from pmsm_ctrl.sampling import smoothing
from pmsm_ctrl.tune.delays import compare_delay_models, delays
from pmsm_ctrl.tune.margins import first_crossing, margins, response
from pmsm_ctrl.tune.sampled import Cascade, current_loop, frequencies, pi, responses, speed_plant

OMEGA = np.geomspace(1e-2, 1e4, 6000)


@pytest.mark.parametrize(("gain", "tau", "delay"), [(3.0, 0.1, 0.02), (10.0, 1.0, 0.1), (2.0, 0.05, 0.01)])
def test_first_order_plant_with_delay(gain, tau, delay):
    s = 1j * OMEGA
    found = margins(ct.frd(gain * np.exp(-s * delay) / (1.0 + s * tau), OMEGA))
    crossover = math.sqrt(gain**2 - 1.0) / tau
    phase_margin = math.pi - math.atan(crossover * tau) - crossover * delay
    assert 2.0 * math.pi * found.crossover == pytest.approx(crossover, rel=1e-6)
    assert math.radians(found.phase_margin) == pytest.approx(phase_margin, rel=1e-6)
    assert found.delay_margin == pytest.approx(phase_margin / crossover, rel=1e-6)
    # The phase crossover solves arctan(w tau) + w delay = pi.
    w = 2.0 * math.pi * found.phase_crossover
    assert math.atan(w * tau) + w * delay == pytest.approx(math.pi, rel=1e-6)
    assert found.gain_margin == pytest.approx(math.hypot(1.0, w * tau) / gain, rel=1e-6)
    assert found.stable is None


@pytest.mark.parametrize("crossover", [1.0, 10.0, 100.0])
def test_integrator_with_delay(crossover):
    delay = 0.3 / crossover
    s = 1j * OMEGA
    found = margins(ct.frd(crossover / s * np.exp(-s * delay), OMEGA))
    assert found.phase_margin == pytest.approx(90.0 - math.degrees(0.3), rel=1e-6)
    assert found.gain_margin == pytest.approx(math.pi / 2.0 / 0.3, rel=1e-6)
    assert found.gain_reduction == 0.0


@pytest.mark.parametrize("share", [0.02, 0.1, 0.3])
def test_sampled_integrator_with_one_period_of_delay(share):
    # L = k T / (z (z - 1)): abs(L) = kT / (2 sin(wT/2)), phase -90 deg - 3/2 wT.
    T = 1e-3
    gain = 2.0 * math.sin(share)
    found = margins(ct.ss(ct.tf([gain], [1.0, -1.0, 0.0], T)))
    assert 2.0 * math.pi * found.crossover == pytest.approx(2.0 * share / T, rel=1e-6)
    assert found.phase_margin == pytest.approx(90.0 - math.degrees(3.0 * share), rel=1e-5)
    assert found.gain_margin == pytest.approx(2.0 * math.sin(math.pi / 6.0) / gain, rel=1e-5)
    assert found.stable


def test_margins_of_points_are_those_of_python_control():
    """Of a loop that crosses 1 three times: the same spline, evaluated without its overhead."""
    s = 1j * np.geomspace(0.3, 300.0, 400)
    given = ct.frd(4.0 / s * 400.0 / (s * s + 1.2 * s + 400.0) * np.exp(-0.02 * s), s.imag)
    gain, phase, _, at_phase, at_gain, _ = ct.stability_margins(given, returnall=True)
    found = margins(given)
    assert len(at_gain) == 3
    assert found.phase_margin == pytest.approx(min(phase, key=abs), rel=1e-7)
    assert found.crossover == pytest.approx(at_gain.min() / (2.0 * math.pi), rel=1e-9)
    where = at_gain[np.argmin(np.abs(phase))] / (2.0 * math.pi)
    assert where > 1.5 * found.crossover
    assert found.phase_margin_crossover == pytest.approx(where, rel=1e-9)
    beyond = gain > 1.0
    assert found.gain_margin == pytest.approx(gain[beyond].min(), rel=1e-7)
    assert found.gain_reduction == pytest.approx(gain[~beyond].max(), rel=1e-7)
    assert found.phase_crossover == pytest.approx(at_phase[beyond][np.argmin(gain[beyond])] / (2.0 * math.pi), rel=1e-9)


def test_margins_agree_with_python_controls_polynomial_method():
    loop = ct.tf([25.0], [1.0, 10.0, 10.0, 10.0])
    gm, pm, sm, wpc, wgc, _ = ct.stability_margins(loop)
    found = margins(loop, OMEGA)
    assert found.gain_margin == pytest.approx(gm, rel=1e-6)
    assert found.phase_margin == pytest.approx(pm, rel=1e-6)
    assert 1.0 / found.sensitivity_peak == pytest.approx(sm, rel=1e-4)
    assert (2 * math.pi * found.phase_crossover, 2 * math.pi * found.crossover) == pytest.approx((wpc, wgc))
    assert found.disk_margin == pytest.approx(ct.disk_margins(ct.ss(loop), OMEGA)[0], rel=1e-12)


def test_bandwidth_of_a_first_order_loop():
    found = margins(ct.tf([20.0], [1.0, 0.0]), OMEGA)
    assert 2.0 * math.pi * found.bandwidth == pytest.approx(20.0, rel=1e-4)
    assert found.bandwidth * 2.0 * math.pi == pytest.approx(ct.bandwidth(ct.tf([20.0], [1.0, 20.0])), rel=1e-2)
    assert found.phase_margin == pytest.approx(90.0)
    assert math.isinf(found.gain_margin)
    assert math.isnan(first_crossing(OMEGA, np.ones_like(OMEGA), 0.5))


def test_an_unstable_loop_is_told():
    assert margins(ct.ss(ct.tf([3.0], [1.0, -1.0, 0.0], 1e-3))).stable is False


def test_the_discrete_pi_is_the_recursion_that_runs():
    K_p, T_n, T = 2.0, 0.05, 0.01
    rng = np.random.default_rng(3)
    e = rng.standard_normal(50)
    integrator, u = 0.0, []
    for value in e:
        u.append(K_p * value + integrator)
        integrator += T / T_n * K_p * value
    _, y = ct.forced_response(pi(K_p, T_n, T), T * np.arange(50), e)
    np.testing.assert_allclose(y, u, atol=1e-12)


def test_the_sampled_winding_has_the_closed_form(designs):
    design = Design.read(designs / "seed_motor.toml")
    loop = current_loop(design, CurrentLoop(K_p=100.0, T_n=3e-3))
    T, R, L = 1.0 / 16000.0, 19.0, 49.16e-3
    pole = math.exp(-R * T / L)
    for f in (10.0, 500.0, 4000.0):
        z = np.exp(2j * math.pi * f * T)
        expected = (1.0 - pole) / R / (z - pole) / z * 100.0 * (1.0 + T / 3e-3 / (z - 1.0))
        assert complex(loop(z)) == pytest.approx(expected, rel=1e-9)


def test_delays_are_counted_by_name(designs):
    design = Design.read(designs / "seed_motor.toml")
    T = 1.0 / 16000.0
    budget = delays(design, CurrentLoop(K_p=49.16e-3 / (3.0 * T), T_n=49.16e-3 / 19.0))
    assert budget.current == pytest.approx(1.5 * T)
    assert budget.current_loop == pytest.approx(3.0 * T)
    assert budget.difference_quotient == pytest.approx(2.0 * T)
    # The exact discrete filter delays by T / (exp(T/tau) - 1), a little less than its time constant.
    assert budget.speed_filter == pytest.approx(4.0 * T / math.expm1(4.0 * T / 0.5e-3))
    assert smoothing(1e-3, 0.0) == 1.0


def test_the_sum_of_small_time_constants_is_what_the_sampled_plant_shows(designs):
    design = Design.read(designs / "seed_motor.toml")
    current = CurrentLoop(K_p=262.0, T_n=2.587e-3)
    # Measured on the full cascade with EMF and its feedforward; the sum knows neither.
    cascade = Cascade.of(design, current, at=40.0)
    w = np.array([0.02, 0.04]) / cascade.period
    mechanics = ct.tf([cascade.truth.K_t], [cascade.truth.J, cascade.model.point.friction_slope])
    lag = -np.angle(response(speed_plant(cascade), w) / response(mechanics, w)) / w
    assert lag.mean() == pytest.approx(delays(design, current).speed, rel=0.03)


def test_pade_approaches_the_exact_delay(designs):
    design = Design.read(designs / "seed_motor.toml")
    models = compare_delay_models(design, CurrentLoop(K_p=262.0, T_n=2.587e-3), orders=(1, 2, 3, 4))
    sampled, exact, free, *pade = models.values()
    errors = [abs(m.phase_margin - exact.phase_margin) for m in pade]
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] < 0.01
    gains = [abs(m.gain_margin_db - exact.gain_margin_db) for m in pade]
    assert gains[0] > 1.5  # first order promises 2 dB that are not there
    assert gains[-1] < 0.05
    assert free.phase_margin == pytest.approx(90.0, abs=0.1)
    # Exact continuous against what runs: the sampling itself costs little at a twentieth of the rate.
    assert sampled.phase_margin == pytest.approx(exact.phase_margin, abs=0.5)


def test_all_frequencies_at_once_are_those_of_python_control_one_by_one(designs):
    """Responses that fall by ten decades; without a second solution of what is left they would be off by 2e-8."""
    design = Design.read(designs / "seed_motor.toml")
    system = Cascade.of(design, CurrentLoop(K_p=20.0, T_n=2e-3), at=1e-3).system(("T_load",), ("theta", "i_d"))
    omega = frequencies(system.dt, points=200)
    one_by_one = system(np.exp(1j * omega * system.dt), squeeze=False)[:, 0]
    assert responses(system, omega) == pytest.approx(one_by_one, rel=1e-9, abs=0.0)

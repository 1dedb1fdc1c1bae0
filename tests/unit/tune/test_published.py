"""Published design rules and examples, with the numbers their authors printed."""

from __future__ import annotations

import math

import control as ct
import numpy as np
import pytest

from pmsm_ctrl.tune.current import modulus_optimum, pole_cancellation
from pmsm_ctrl.tune.margins import margins
from pmsm_ctrl.tune.speed import symmetrical_optimum

K_T, J, T_SIGMA = 1.032, 9e-5, 0.8e-3


def speed_loop(a: float):
    """PI by the symmetrical optimum around an integrator with one small time constant."""
    K_p, T_n = symmetrical_optimum(K_T, J, T_SIGMA, a)
    controller = ct.tf([K_p * T_n, K_p], [T_n, 0.0])
    return controller * ct.tf([K_T], [J, 0.0]) * ct.tf([1.0], [T_SIGMA, 1.0]), T_n


def step_figures(system):
    """Overshoot in %, first time at the final value and settling to 2 %, times in units of T_sigma."""
    t = np.linspace(0.0, 60.0 * T_SIGMA, 12001)
    _, y = ct.step_response(system, t)
    outside = np.flatnonzero(np.abs(y - 1.0) > 0.02)
    return 100.0 * (y.max() - 1.0), t[np.argmax(y >= 1.0)] / T_SIGMA, t[outside[-1] + 1] / T_SIGMA


def test_symmetrical_optimum_of_the_textbook():
    # Schroeder, Elektrische Antriebe 2 / Umland and Safiuddin 1990, a = 2: overshoot 43.4 %, rise 3.1 T_sigma,
    # settling 16.5 T_sigma; with the reference filter 8.1 %, 7.6 T_sigma, 13.3 T_sigma.
    loop, T_n = speed_loop(2.0)
    closed = ct.feedback(loop, 1)
    overshoot, rise, settling = step_figures(closed)
    assert overshoot == pytest.approx(43.4, abs=0.05)
    assert rise == pytest.approx(3.1, abs=0.05)
    assert settling == pytest.approx(16.5, abs=0.1)
    overshoot, rise, settling = step_figures(closed * ct.tf([1.0], [T_n, 1.0]))
    assert overshoot == pytest.approx(8.1, abs=0.05)
    assert rise == pytest.approx(7.6, abs=0.05)
    assert settling == pytest.approx(13.3, abs=0.1)


@pytest.mark.parametrize(("beta", "phase_margin"), [(4.0, 36.87), (9.0, 53.13), (16.0, 61.93)])
def test_extended_symmetrical_optimum_phase_margins(beta, phase_margin):
    # Preitl and Precup, Automatica 35 (1999) 1731, beta = a^2: 36, 53 and 61 deg in their table;
    # arctan((beta - 1) / (2 sqrt(beta))) gives the decimals.
    loop, _ = speed_loop(math.sqrt(beta))
    omega = np.geomspace(1.0, 1e5, 4000)
    found = margins(loop, omega)
    assert found.phase_margin == pytest.approx(phase_margin, abs=0.01)
    assert 2.0 * math.pi * found.crossover == pytest.approx(1.0 / (math.sqrt(beta) * T_SIGMA), rel=1e-5)
    assert found.stable


def test_modulus_optimum_of_the_textbook():
    # Kessler's Betragsoptimum, in Schroeder and in Leonhard: overshoot 4.3 %, rise 4.7 T_sigma,
    # settling 8.4 T_sigma, phase margin 65.5 deg.
    R, L = 19.0, 49.16e-3
    K_p, T_n = modulus_optimum(R, L, T_SIGMA)
    loop = ct.tf([K_p * T_n, K_p], [T_n, 0.0]) * ct.tf([1.0], [L, R]) * ct.tf([1.0], [T_SIGMA, 1.0])
    overshoot, rise, settling = step_figures(ct.minreal(ct.feedback(loop, 1), verbose=False))
    assert overshoot == pytest.approx(4.3, abs=0.05)
    assert rise == pytest.approx(4.7, abs=0.05)
    assert settling == pytest.approx(8.4, abs=0.1)
    found = margins(loop, np.geomspace(1.0, 1e5, 4000))
    assert found.phase_margin == pytest.approx(65.5, abs=0.05)


def test_internal_model_control_of_harnefors_and_nee():
    # IEEE Trans. Ind. Appl. 34 (1998) 133: the closed loop is alpha/(s + alpha), 10-90 % rise time ln 9 / alpha.
    R, L, bandwidth = 0.5, 4e-3, 400.0
    K_p, T_n = pole_cancellation(R, L, bandwidth)
    closed = ct.minreal(ct.feedback(ct.tf([K_p * T_n, K_p], [T_n, 0.0]) * ct.tf([1.0], [L, R]), 1), verbose=False)
    alpha = 2.0 * math.pi * bandwidth
    assert closed.poles() == pytest.approx([-alpha])
    rise = ct.step_info(closed, T=np.linspace(0.0, 10.0 / alpha, 20001))["RiseTime"]
    assert rise == pytest.approx(math.log(9.0) / alpha, rel=1e-3)


def test_margins_of_the_disk_margin_lecture():
    # Seiler, Packard, Gahinet, IEEE Control Systems 40(5) (2020) 78, and MathWorks' allmargin and diskmargin pages
    # for L = 25/(s^3 + 10 s^2 + 10 s + 10): gain margin 3.6000 at 3.1623 rad/s, phase margin 29.1104 deg at
    # 1.7844 rad/s, delay margin 0.2847 s, disk margin 0.46.
    found = margins(ct.tf([25.0], [1.0, 10.0, 10.0, 10.0]), np.geomspace(1e-2, 1e3, 4000))
    assert found.gain_margin == pytest.approx(3.6000, abs=1e-4)
    assert 2.0 * math.pi * found.phase_crossover == pytest.approx(3.1623, abs=1e-4)
    assert found.phase_margin == pytest.approx(29.1104, abs=1e-3)
    assert 2.0 * math.pi * found.crossover == pytest.approx(1.7844, abs=1e-4)
    assert found.delay_margin == pytest.approx(0.2847, abs=1e-4)
    assert found.disk_margin == pytest.approx(0.46, abs=0.005)
    assert found.stable

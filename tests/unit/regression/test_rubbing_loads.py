"""A load that hangs on a spring and rubs, followed along the motion of its shaft, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from pmsm_ctrl.kernels.springs import rubbing_loads

PERIOD = 1e-3
W, V = 2.0 * np.pi * 20.0, 3.0  # rad/s


def followed(omega: np.ndarray, zeta: float, f: float, steps: int = 8) -> np.ndarray:
    theta = np.concatenate([[0.0], np.cumsum(0.5 * PERIOD * (omega[1:] + omega[:-1]))])
    out = np.empty((1, len(omega)))
    rubbing_loads(theta, omega, PERIOD, steps, np.array([[W, zeta, f]]), out)
    return out[0]


@pytest.mark.parametrize("f", [50.0, 400.0])
def test_a_load_at_rest_is_torn_off_where_the_spring_pulls_by_its_friction(f: float) -> None:
    """The shaft turns on at a constant speed: the spring is wound up, then f + v w sin(w (t - f / (w^2 v)))."""
    omega = np.full(400, V)
    omega[0] = 0.0
    got, t = followed(omega, 1e-6, f), PERIOD * (np.arange(400) - 0.5)  # the first step is half a period of speed
    torn = f / (W**2 * V)
    exact = np.where(t < torn, W**2 * V * t, f + V * W * np.sin(W * (t - torn)))
    assert np.max(np.abs(got - exact)[1:]) < 0.02 * V * W


def test_each_half_swing_loses_twice_the_way_of_the_friction() -> None:
    """Behind a shaft that stops the peaks fall by 2 f in a half swing, until the load stays."""
    f = 60.0
    omega = np.zeros(4000)
    omega[:40] = V
    got = followed(omega, 1e-6, f)
    free = got[40:]
    peaks = np.abs(free[1:-1][(np.abs(free[1:-1]) > np.abs(free[:-2])) & (np.abs(free[1:-1]) >= np.abs(free[2:]))])
    falls = -np.diff(peaks[peaks > f])
    assert len(falls) == 2
    assert falls == pytest.approx(np.full(len(falls), 2.0 * f), rel=0.05)
    assert np.ptp(got[-500:]) == 0.0
    assert abs(got[-1]) <= f


@pytest.mark.parametrize("zeta", [0.02, 0.2])
def test_without_friction_it_is_the_response_of_a_spring(zeta: float) -> None:
    """T_s / J_load is the load's acceleration: (2 zeta w s + w^2) / (s^2 + 2 zeta w s + w^2) times the shaft's."""
    t = PERIOD * np.arange(6000)
    omega = V * np.sin(2.0 * np.pi * 7.0 * t)
    s = 2j * np.pi * 7.0
    response = s * (2.0 * zeta * W * s + W**2) / (s**2 + 2.0 * zeta * W * s + W**2)
    exact = V * np.imag(response * np.exp(s * t))
    late = t > 4.0
    assert np.max(np.abs(followed(omega, zeta, 0.0) - exact)[late]) < 0.01 * np.abs(exact).max()

"""A log whose every channel is known in closed form: the speed is a sum of sines."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl import Design
from pmsm_ctrl.log import Log

Array = NDArray[np.float64]


def analytic(
    design: Design, seed: int, speed: float, waves: Sequence[tuple[float, float]], noise: float = 1e-5
) -> tuple[Log, Array]:
    """Return a log at 1 kHz, with noise of 1e-5 in each channel but the angle, and its i_q without it.

    Waves of the speed in Hz and rad/s, about a mean of `speed`, rad/s; `noise` of i_q in A.
    """
    motor, K_t = design.motor, design.K_t_assumed
    assert motor.p is not None
    assert motor.psi_f is not None
    assert motor.L_q is not None
    assert motor.R is not None
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 8.0, 1e-3)
    theta, omega, alpha, jerk = speed * t, np.full_like(t, speed), np.zeros_like(t), np.zeros_like(t)
    for frequency, size in waves:
        w, at = 2.0 * np.pi * frequency, 2.0 * np.pi * frequency * t + rng.uniform(0.0, 6.0)
        theta, omega = theta - size / w * np.cos(at), omega + size * np.sin(at)
        alpha, jerk = alpha + size * w * np.cos(at), jerk - size * w**2 * np.sin(at)
    i_q = (design.J * alpha + 0.0213 + 1.68e-4 * omega) / K_t
    di_q = (design.J * jerk + 1.68e-4 * alpha) / K_t
    u_d = -motor.p * omega * motor.L_q * i_q
    u_q = motor.R * i_q + motor.L_q * di_q + motor.p * omega * motor.psi_f
    channels = {"i_d": np.zeros_like(t), "u_d": u_d, "u_q": u_q}
    noisy = {name: values + 1e-5 * rng.standard_normal(len(t)) for name, values in channels.items()}
    return Log({"t": t, "theta": theta, "i_q": i_q + noise * rng.standard_normal(len(t)), **noisy}), i_q

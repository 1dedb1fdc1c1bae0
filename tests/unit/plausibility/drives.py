"""A drive in closed form: a drawn motion, and the torque, currents and voltages that it needs."""

from __future__ import annotations

import functools
import math
from typing import Any

import numpy as np

from pmsm_ctrl.design import Design
from pmsm_ctrl.log import Log

R, L, P, PSI, J, F_C, F_V = 2.0, 6e-3, 4, 0.09, 4e-4, 0.05, 4e-4
K_T = 1.5 * P * PSI


def believed(**motor: Any) -> Design:
    """The design of the drive, with changes."""
    data = {"R": R, "L_d": L, "L_q": L, "p": P, "psi_f": PSI, "J": J} | motor
    return Design.from_dict({
        "motor": data,
        "drive": {"u_dc": 320.0, "i_max": 8.0},
        "effects": [{"id": "coulomb", "F_c": F_C}, {"id": "viscous", "F_v": F_V}],
    })  # fmt: skip


@functools.cache
def drawn(seed: int, seconds: float = 16.0, rate: float = 1000.0, noise: float = 0.01) -> Log:
    """A log of a motion of five drawn sines, with the noise of a current sensor and the steps of an encoder."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds * rate)) / rate
    theta, omega, alpha = np.zeros_like(t), np.zeros_like(t), np.zeros_like(t)
    for f in rng.uniform(0.2, 3.0, 5):
        a, phase, w = 60.0 / (2.0 * math.pi * f) * rng.uniform(0.4, 1.0), rng.uniform(0.0, 6.0), 2.0 * math.pi * f
        theta += a * np.sin(w * t + phase)
        omega += a * w * np.cos(w * t + phase)
        alpha -= a * w * w * np.sin(w * t + phase)
    i_q = (J * alpha + F_C * np.sign(omega) + F_V * omega) / K_T
    i_d = 0.05 * np.sin(2.0 * math.pi * 0.9 * t)
    electrical = P * omega
    u_d = R * i_d - electrical * L * i_q
    u_q = R * i_q + electrical * (L * i_d + PSI) + L * np.gradient(i_q, t)
    count = 2.0 * math.pi / 2**16
    measured = {"i_d": i_d + noise * rng.standard_normal(t.size), "i_q": i_q + noise * rng.standard_normal(t.size)}
    return Log({
        "t": t, "theta": np.round(theta / count) * count, "omega_ref": omega + 0.3, "u_d": u_d, "u_q": u_q,
    } | measured)  # fmt: skip

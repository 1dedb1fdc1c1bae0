"""A bare motor under steps of a torque command, stepped in plain Python: nothing of it is the package's."""

from __future__ import annotations

import math

import numpy as np

from pmsm_ctrl.design import Design
from pmsm_ctrl.log import Log

__all__ = ["BARE", "J", "torque_steps"]

J, K_T, F_C, F_V = 1.25e-4, 1.032, 0.0213, 1.68e-4
BARE = Design.from_dict({
    "name": "bare motor",
    "motor": {"R": 19.0, "L_d": 0.049, "L_q": 0.049, "p": 4, "psi_f": 0.172, "J": J},
    "drive": {"f_control": 8000.0, "speed_divider": 4},
    "effects": [{"id": "coulomb", "F_c": F_C}, {"id": "viscous", "F_v": F_V}],
})  # fmt: skip


def torque_steps(
    seed: int,
    *,
    bits: int = 12,
    noise: float = 0.02,
    levels: tuple[float, ...] = (),
    amplitude: tuple[float, float] = (1.3, 5.0),
    stay: float = 0.15,
    shaken: float = 0.0,
    stribeck: float = 0.0,
    wave: tuple[float, int] = (0.0, 0),
    duration: float = 20.0,
) -> Log:
    """Return a log of 1 kHz: the angle of so many bits, and the measured current with white noise, A rms.

    The current steps between `levels`, in multiples of the friction, or is drawn from a range of them, and turns round
    before 100 rad/s. Noise of `shaken`, A rms, turns the shaft and is not logged; `stribeck` adds so much of F_c at low
    speed, `wave` an amplitude, N m, and its order.
    """
    rng = np.random.default_rng(seed)
    fast, top = 4000, 100.0
    h, n = 1.0 / fast, round(duration * fast)
    shaking = (K_T * shaken * np.random.default_rng([seed, 1]).standard_normal(n)).tolist()
    size, order = wave
    current, theta = np.empty(n), np.empty(n)
    omega = angle = amount = 0.0
    sign, left = 1.0, 0
    dry = (F_C + F_V * 0.3 * top) / K_T
    for k in range(n):
        if left == 0 or omega * sign > top:
            sign = -sign if rng.random() < 0.7 or abs(omega) > 0.8 * top else sign
            amount = dry * (rng.choice(levels) if levels else rng.uniform(*amplitude))
            left = max(40, int(rng.exponential(stay) * fast))
        left -= 1
        current[k], theta[k] = sign * amount, angle + 0.5 * h * omega  # both in the middle of a step
        level = F_C * (1.0 + stribeck * math.exp(-abs(omega) / 5.0)) * h / J
        push = K_T * sign * amount + shaking[k] - F_V * omega + size * math.sin(order * angle)
        free = omega + h * push / J
        new = 0.0 if abs(free) <= level else free - math.copysign(level, free)
        angle += 0.5 * h * (omega + new)
        omega = new
    step = fast // 1000
    count = 2.0 * math.pi / 2**bits
    measured = current[::step] + noise * rng.standard_normal(n // step)
    return Log({"t": np.arange(n // step) / 1000.0, "theta": np.floor(theta[::step] / count) * count, "i_q": measured})

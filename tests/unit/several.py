"""Short records of one axis in closed form: each with its own friction, constant torque, rate and zero of the angle."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pmsm_ctrl.design import Design
from pmsm_ctrl.log import Log, Provenance

J, F_C, F_V = 1e-4, 0.02, 2e-4
DESIGN = Design.from_dict(
    {
        "name": "axis",
        "motor": {"J": 1.05e-4, "K_t": 1.0},
        "effects": [{"id": "coulomb", "F_c": 0.025}, {"id": "viscous", "F_v": 1e-4}],
    }
)


def record(
    number: int, seconds: float = 4.0, rate: float = 1000.0, *, dF_c: float = 0.0, dF_v: float = 0.0,
    offset: float = 0.0, inertia: float = J, noise: float = 1e-3, wave: float = 0.0, zero: float = 0.0,
    ripple: float = 0.0, unbalance: float = 0.0,
) -> Log:  # fmt: skip
    """Return a record: two sines of the speed whose angle is known in closed form, its torque and white noise."""
    rng = np.random.default_rng([number, 77])
    t = np.arange(round(seconds * rate)) / rate
    a, f, phase = rng.uniform([30, 30], [80, 60]), rng.uniform([0.4, 0.9], [0.8, 1.6]), rng.uniform(0, 6, 2)
    w = 2.0 * np.pi * f
    omega = sum(x * np.sin(y * t + z) for x, y, z in zip(a, w, phase, strict=True))
    alpha = sum(x * y * np.cos(y * t + z) for x, y, z in zip(a, w, phase, strict=True))
    theta = sum(x / y * (np.cos(z) - np.cos(y * t + z)) for x, y, z in zip(a, w, phase, strict=True))
    torque = inertia * alpha + (F_C + dF_c) * np.sign(omega) + (F_V + dF_v) * omega + offset
    torque = torque + wave * np.sin(8.0 * theta + 1.0) + unbalance * np.sin(theta + 0.3)
    torque = torque / (1.0 - ripple * np.sin(6.0 * theta + 0.5)) + rng.normal(0.0, noise, len(t))
    channels = {"t": t, "theta": theta + zero, "torque": torque}
    return Log(channels, provenance=Provenance(f"record_{number}.csv"))


def records(deviations: Sequence[dict[str, float]], **same: float) -> list[Log]:
    """Return one record for each set of deviations."""
    return [record(k, **{**same, **own}) for k, own in enumerate(deviations, start=1)]

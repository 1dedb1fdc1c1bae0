"""An arm whose weight is most of the torque: what drives it explains little of the acceleration, and is its own."""

from __future__ import annotations

import numpy as np
import pytest

from pmsm_ctrl.design import Design
from pmsm_ctrl.log import Log
from pmsm_ctrl.plausibility import examine
from tests.effort import seeds

J, F_C, F_V = 2e-4, 0.01, 1e-4
DESIGN = Design.from_dict({
    "motor": {"J": J, "K_t": 0.3},
    "effects": [{"id": "coulomb", "F_c": F_C}, {"id": "viscous", "F_v": F_V}],
})  # fmt: skip


def thrown(seed: int, weight: float) -> Log:
    """Return a log of an arm under steps of the torque, 12 s at 1 kHz; weight in N m."""
    rng = np.random.default_rng(seed)
    drive = np.repeat(rng.uniform(-0.06, 0.06, 60), 200)
    theta, omega, period = np.zeros(len(drive)), np.zeros(len(drive)), 1e-3
    for k in range(1, len(drive)):
        position, speed = theta[k - 1], omega[k - 1]
        for _ in range(20):
            balance = drive[k - 1] - weight * np.sin(position) - F_C * np.tanh(speed / 0.05) - F_V * speed
            speed += balance / J * period / 20
            position += speed * period / 20
        theta[k], omega[k] = position, speed
    torque = drive + rng.normal(0.0, 1e-3, len(drive))
    return Log({"t": period * np.arange(len(drive)), "theta": theta, "torque": torque})


@pytest.mark.parametrize("seed", seeds(1, 2, 3))
def test_the_torque_is_not_that_of_another_axis(seed: int) -> None:
    log = thrown(seed, weight=0.2)
    assert not examine(DESIGN, log).contradictions


@pytest.mark.parametrize("seed", seeds(2, 3, 4))
def test_that_of_another_axis_is_still_told(seed: int) -> None:
    log = thrown(seed, weight=0.2).with_channels(torque=thrown(seed + 10, weight=0.2)["torque"])
    assert [one.code for one in examine(DESIGN, log).contradictions] == ["unrelated_torque"]

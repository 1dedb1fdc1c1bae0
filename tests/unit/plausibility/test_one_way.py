"""An axis that runs one way needs no torque of either sign: a design without friction does not know that."""

from __future__ import annotations

import numpy as np
import pytest

from pmsm_ctrl.design import Design
from pmsm_ctrl.log import Log
from pmsm_ctrl.plausibility import examine


def recorded(seed: int) -> Log:
    """Return a log of levels of the speed; dry friction that changes within a turn slows the axis a little."""
    rng = np.random.default_rng(seed)
    t = np.arange(20_000) * 1e-3
    levels = rng.uniform(2.0, 8.0, 20)
    wanted = np.convolve(np.repeat(levels, 1000), np.hanning(300) / np.hanning(300).sum(), "same")
    theta, omega = np.zeros_like(t), np.zeros_like(t)
    for k in range(1, len(t)):
        omega[k] = wanted[k] * (1.0 - 0.05 * np.cos(theta[k - 1]))
        theta[k] = theta[k - 1] + omega[k] * 1e-3
    dry = 0.1 + 0.02 * np.cos(theta + 1.0)
    torque = 8e-5 * np.gradient(omega, t) + dry * (omega > 0.0) + 1e-4 * omega + rng.normal(0.0, 1e-4, t.size)
    return Log({"t": t, "theta": theta, "torque": torque})


def codes(log: Log, **friction: float) -> list[str]:
    effects = [{"id": "coulomb", **friction}] if friction else []
    design = Design.from_dict({"motor": {"J": 8e-5, "K_t": 0.07}, "effects": effects})
    return [one.code for one in examine(design, log).contradictions]


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_its_torque_has_one_sign(seed: int) -> None:
    assert codes(recorded(seed)) == []
    assert codes(recorded(seed), F_c=0.1) == []

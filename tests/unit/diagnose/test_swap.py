"""Effects that a later one replaces."""

from __future__ import annotations

import numpy as np
import pytest

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose import diagnose
from pmsm_ctrl.log import Log
from tests.effort import slow

ARM = Design.from_dict({
    "name": "arm", "motor": {"J": 0.02, "K_t": 1.0}, "effects": [{"id": "coulomb", "F_c": 1.0}],
})  # fmt: skip


def arm(seed: int, reach: float) -> Log:
    """A horizontal arm that swings over a small angle: its weight is a constant load, and a little more."""
    rng, t = np.random.default_rng(seed), np.arange(10_000) / 500.0
    theta, omega, alpha = np.zeros((3, t.size))
    for size, w, phase in zip((reach, 0.5 * reach), (1.9, 0.7), rng.uniform(0.0, 6.0, 2), strict=True):
        theta += size * np.sin(w * t + phase)
        omega += size * w * np.cos(w * t + phase)
        alpha -= size * w**2 * np.sin(w * t + phase)
    torque = 0.02 * alpha + np.sign(omega) + 3.0 * np.cos(theta) + 0.02 * rng.standard_normal(t.size)
    return Log({"t": t, "theta": theta + 1e-5 * rng.standard_normal(t.size), "torque": torque})


@pytest.mark.parametrize("seed", [1, slow(2), slow(3)])
@pytest.mark.parametrize("reach", [0.4, slow(0.6)])
def test_a_first_effect_of_which_nothing_is_left_beside_a_later_one_has_no_name(reach: float, seed: int) -> None:
    found = diagnose(ARM, arm(seed, reach), plan=False)
    (step,) = found.steps
    assert step.effect == "unbalance"
    assert step.parameters["a_c"].value == pytest.approx(3.0, abs=5.0 * step.parameters["a_c"].stderr)

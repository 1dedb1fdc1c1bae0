"""The inertia over the cutoff: noise in the motion shrinks it as the band grows, and the answer says so."""

from __future__ import annotations

import numpy as np
import pytest

from pmsm_ctrl import Design, Log, identify
from pmsm_ctrl.regression.conditioning import Processing
from tests.effort import seeds

AXIS = Design.from_dict(
    {
        "motor": {"J": 1e-4, "K_t": 1.0},
        "effects": [{"id": "coulomb", "F_c": 0.02}, {"id": "viscous", "F_v": 2e-4}],
        "log": {"sampling": "instant"},
    }
)


def log(noise: float, seed: int) -> Log:
    """Torque of the axis in closed form; white noise in the measured speed, rad/s."""
    rng = np.random.default_rng(seed)
    t = np.arange(0, 12, 1e-3)
    omega = 80 * np.sin(2 * np.pi * 0.5 * t) + 40 * np.sin(2 * np.pi * 1.3 * t + 1)
    alpha = 80 * np.pi * np.cos(2 * np.pi * 0.5 * t) + 40 * 2.6 * np.pi * np.cos(2 * np.pi * 1.3 * t + 1)
    torque = 1e-4 * alpha + 0.02 * np.sign(omega) + 2e-4 * omega + rng.normal(0, 1e-3, t.size)
    return Log({"t": t, "omega": omega + rng.normal(0, noise, t.size), "torque": torque})


@pytest.mark.parametrize("seed", seeds(1, 2, 3))
def test_noise_of_the_acceleration_is_seen_over_the_cutoff(seed: int) -> None:
    """Attenuation by white noise of the speed: J / (1 + noise/signal), the ratio growing with the cube of the band."""
    found = identify(AXIS, log(2.0, seed), processing=Processing(cutoff=100.0), check_cutoff=True)
    values = [estimate.value for estimate in found.over_cutoff.values()]
    assert list(found.over_cutoff) == [25.0, 50.0, 100.0, 200.0]
    assert values == sorted(values, reverse=True)
    assert values[2] < 0.8e-4
    assert values[0] == pytest.approx(1e-4, rel=0.05)
    (notice,) = (one for one in found.notices if one.code == "inertia_over_cutoff")
    assert "--cutoff" in notice.text
    told = found.to_dict()["inertia_over_cutoff"]
    assert [one["cutoff"] for one in told] == [25.0, 50.0, 100.0, 200.0]


@pytest.mark.parametrize("seed", seeds(1, 2, 3, 4))
def test_a_right_model_has_one_inertia(seed: int) -> None:
    found = identify(AXIS, log(0.0, seed), check_cutoff=True)
    assert len(found.over_cutoff) >= 3
    assert not {"inertia_over_cutoff"} & {notice.code for notice in found.notices}
    assert not identify(AXIS, log(0.0, seed)).over_cutoff

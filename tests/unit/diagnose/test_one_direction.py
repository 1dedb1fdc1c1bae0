"""Dry friction below zero contradicts a design only where the log is explained worse without it."""

from __future__ import annotations

import numpy as np
import pytest

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose import diagnose
from pmsm_ctrl.log import Log
from tests.effort import seeds

J, F_C, F_V, T_0 = 1.4e-5, 5e-4, 4e-6, 7e-3


def turned_back_once(seed: int, doubtful: float, noise: float) -> Log:
    """Return a minute in one direction but for 0.2 s, in which the torque is off by something else."""
    t = np.arange(30000) / 500.0
    omega = 30.0 + 20.0 * np.sin(2.0 * np.pi * 0.21 * t) + 8.0 * np.sin(2.0 * np.pi * 0.73 * t)
    omega -= 55.0 * np.exp(-(((t - 30.2) / 0.25) ** 2))
    torque = J * np.gradient(omega, t) + F_C * np.sign(omega) + F_V * omega + T_0
    torque += doubtful * (omega < 0.0) + noise * np.random.default_rng(seed).standard_normal(t.size)
    return Log({"t": t, "theta": np.cumsum(omega) / 500.0, "torque": torque})


@pytest.mark.parametrize("seed", seeds(1, 2))
@pytest.mark.parametrize(("noise", "verdict"), [(2.5e-3, "inconclusive"), (1e-4, "implausible")])
def test_a_load_in_one_direction_hides_dry_friction(noise: float, verdict: str, seed: int) -> None:
    """A few samples, of which noise hides what they are, made the log implausible."""
    effects = [{"id": "coulomb", "F_c": F_C}, {"id": "viscous", "F_v": F_V}, {"id": "constant_load", "T_0": T_0}]
    design = Design.from_dict({"name": "axis", "motor": {"J": J, "K_t": 1.0}, "effects": effects})
    found = diagnose(design, turned_back_once(seed, 5e-3, noise), candidates=("stribeck", "cogging"), plan=False)
    assert found.verdict == verdict
    assert found.base["F_c"].value == 0.0

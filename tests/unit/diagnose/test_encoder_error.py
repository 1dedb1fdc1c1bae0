"""An error of the angle becomes one of the torque by the inertia that the axis has, not by that of the design."""

from __future__ import annotations

import numpy as np
import pytest

from pmsm_ctrl import Design, add
from pmsm_ctrl.compare import compare
from pmsm_ctrl.diagnose import diagnose
from pmsm_ctrl.log import Log
from tests.effort import seeds, slow

J, F_C, F_V, E_S = 9e-5, 0.0213, 1.68e-4, 0.004


def log_of(seed: int) -> Log:
    """Seven sines of the speed, in closed form; the encoder errs by E_S sin(theta)."""
    t = np.arange(12000) / 1000.0
    f, a = np.array([0.05, 0.11, 0.37, 0.83, 1.7, 3.1, 5.3]), np.array([40.0, 90.0, 60.0, 30.0, 15.0, 8.0, 4.0])
    x = 2.0 * np.pi * np.outer(t, f) + seed + np.arange(7.0)
    theta, omega = (-a / (2.0 * np.pi * f) * np.cos(x)).sum(1), (a * np.sin(x)).sum(1)
    torque = J * (a * 2.0 * np.pi * f * np.cos(x)).sum(1) + F_C * np.sign(omega) + F_V * omega
    noise = 1e-5 * np.random.default_rng(seed).normal(size=t.size)
    return Log({"t": t, "theta": theta + E_S * np.sin(theta), "torque": torque + noise})


@pytest.mark.parametrize("seed", seeds(1, 2, 3))
@pytest.mark.parametrize("believed", [slow(7.8e-5), 1.03e-4])
def test_its_size_is_right_whatever_inertia_the_design_has(seed: int, believed: float) -> None:
    dry = [{"id": "coulomb", "F_c": 0.02}, {"id": "viscous", "F_v": 1.8e-4}]
    design, log = Design.from_dict({"motor": {"J": believed, "K_t": 1.0, "p": 4}, "effects": dry}), log_of(seed)
    found = diagnose(design, log, plan=False)
    assert [step.effect for step in found.steps] == ["encoder_eccentricity"]
    assert found.steps[0].parameters["e_s"].value == pytest.approx(E_S, rel=2e-3)  # was off by the error of J
    for written in (found.design, add(design, log, "encoder_eccentricity")):
        error = compare(written, log).log.errors["torque"].relative
        assert error == pytest.approx(found.errors["final"]["torque"]["relative"], rel=1e-2)

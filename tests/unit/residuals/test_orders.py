"""Orders of a turn on motions that pass only a part of it."""

from __future__ import annotations

import numpy as np
import pytest

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose import diagnose
from pmsm_ctrl.evidence.waves import PASSED
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.conditioning import Processing, prepare
from pmsm_ctrl.residuals import policy
from pmsm_ctrl.residuals.orders import order_spectrum
from tests.effort import seeds

ORDER, SIZE = 12, 0.04  # three of its periods are passed
J, F_C, F_V = 1e-3, 0.11, 2e-3
FRICTION = [{"id": "coulomb", "F_c": 1.4 * F_C}, {"id": "viscous", "F_v": 0.7 * F_V}]
DESIGN = Design.from_dict({"motor": {"J": 1.05 * J, "K_t": 1.0}, "effects": FRICTION})


def swinging(seed: int, wave: float = SIZE) -> Log:
    """A sine of the speed over a quarter of a turn, the torque in closed form; no drive."""
    t = np.arange(0.0, 24.0, 5e-4)
    rate = 2.0 * np.pi * 1.9
    theta = 0.5 - 0.84 * np.cos(rate * t)
    omega, alpha = 0.84 * rate * np.sin(rate * t), 0.84 * rate**2 * np.cos(rate * t)
    torque = J * alpha + F_C * np.sign(omega) + F_V * omega + wave * np.sin(ORDER * theta + 0.4)
    noise = np.random.default_rng(seed).normal(size=t.size)
    step = 2.0 * np.pi / 2**14
    return Log({"t": t, "theta": np.floor(theta / step) * step, "torque": torque + 2e-3 * noise})


@pytest.mark.parametrize("seed", seeds(1, 2, 3))
def test_an_order_that_is_slow_enough_at_few_angles_is_not_judged(seed: int) -> None:
    """Near the reversals any smooth curve is a part of one of its periods, however often the axis comes there."""
    axis = prepare(DESIGN, swinging(seed), Processing(cutoff=40.0))
    theta = axis.signals["theta"][axis.keep]
    residual = np.sin(ORDER * theta + 0.4) + 0.02 * np.random.default_rng(seed).normal(size=theta.size)
    score = order_spectrum(axis, residual, np.full(theta.size, True), np.ones(theta.size), 600, friction=False)[1]
    assert int(np.argmax(score)) + 1 == ORDER
    passed = np.abs(axis.signals["omega"][axis.keep]) * 300.0 < 2.0 * np.pi * 40.0 * PASSED
    assert np.sum(passed) > policy.FEWEST  # of order 300 enough samples are slow enough, within a seventh of a period
    assert np.all(score[299:] == 0.0)


@pytest.mark.parametrize("seed", seeds(1, 2, 3))
def test_a_cogging_is_named_on_a_quarter_of_a_turn(seed: int) -> None:
    found = diagnose(DESIGN, swinging(seed), plan=False)
    assert [(step.effect, step.parameters["order"].value) for step in found.steps] == [("cogging", ORDER)]
    size = np.hypot(*(found.steps[0].parameters[name].value for name in ("a_s", "a_c")))
    assert size == pytest.approx(SIZE, rel=0.02)

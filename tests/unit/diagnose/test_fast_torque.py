"""A saturation that is made of a torque whose edges the log missed: the measured torque is on both sides of the fit."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from pmsm_ctrl import Design, Log, diagnose
from pmsm_ctrl.diagnose.refusal import Reason
from pmsm_ctrl.diagnose.same_size import same_inside
from tests.effort import seeds

J, F_C, F_V = 0.06, 0.4, 0.02
FINE, EVERY = 50e-6, 40  # s; steps of the simulation for a sample of the log, 2 ms
DESIGN = Design.from_dict({
    "motor": {"J": J, "K_t": 1.0},
    "effects": [{"id": "coulomb", "F_c": F_C}, {"id": "viscous", "F_v": F_V}],
})  # fmt: skip


def switched(seed: int, saturation: float = 0.0) -> Log:
    """Return a log of a torque that switches between two levels, in instants that are 1.2 ms late; 30 s at 500 Hz."""
    rng = np.random.default_rng(seed)
    n = round(30.0 / FINE)
    clock = round(rng.uniform(0.006, 0.02) / FINE)
    level = np.repeat(rng.choice([-1.2, 1.2], n // clock + 1), clock)[:n]
    t = FINE * np.arange(n)
    command = level + 0.9 * np.sin(2.0 * np.pi * 0.25 * t)
    torque = lfilter([FINE / 3e-4], [1.0, FINE / 3e-4 - 1.0], command)  # the current loop
    omega = 0.0
    speed = np.empty(n)
    effective = (torque * (1.0 - saturation * np.abs(torque))).tolist()
    for k, drive in enumerate(effective):
        balance = drive - F_V * omega
        omega += (balance - F_C * np.tanh(omega / 0.01)) / J * FINE
        speed[k] = omega
    theta = np.cumsum(speed) * FINE
    late = round(1.2e-3 / FINE)
    at = np.arange(EVERY, n - EVERY, EVERY)
    return Log({
        "t": FINE * (at - at[0]), "theta": theta[at], "torque": torque[at + late] + rng.normal(0.0, 0.005, len(at)),
    })  # fmt: skip


@pytest.mark.parametrize("seed", seeds(1, 2, 3))
def test_missed_edges_are_no_saturation(seed: int) -> None:
    found = diagnose(DESIGN, switched(seed), candidates=["torque_saturation"], plan=False)
    assert found.steps == ()


def test_a_saturation_keeps_its_name() -> None:
    (step,) = diagnose(DESIGN, switched(1, saturation=0.06), candidates=["torque_saturation"], plan=False).steps
    assert step.parameters["k_s"].value == pytest.approx(0.06, rel=0.3)


@pytest.mark.parametrize(
    ("left", "stderr", "passes"),
    [(1.0, 0.1, True), (0.3, 0.02, False), (0.45, 0.05, True), (-0.07, 0.39, False), (0.5, 0.3, False)],
)
def test_the_amount_inside_the_band_is_surely_there(left: float, stderr: float, passes: bool) -> None:
    found = same_inside(left, stderr)
    assert (None if found is None else found.reason) == (None if passes else Reason.FAST_TORQUE)

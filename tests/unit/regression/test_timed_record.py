"""The band in which a log is judged: narrower where noise of the acceleration is what is left, and not otherwise."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pmsm_ctrl.design import Design
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression import timed_record as rule
from pmsm_ctrl.regression.base_fit import base_fit
from pmsm_ctrl.regression.drive_timing import UNDELAYED
from pmsm_ctrl.regression.timed_record import timed_record
from tests.effort import seeds

J, F_C, F_V = 9e-5, 0.02, 2e-4
DESIGN = Design.from_dict(
    {"name": "axis", "motor": {"J": J, "K_t": 1.0},
     "effects": [{"id": "coulomb", "F_c": F_C}, {"id": "viscous", "F_v": F_V}]}
)  # fmt: skip


def swinging(counts: int, seed: int) -> Log:
    """Return a swing that is known exactly, its angle counted by an encoder of so many steps."""
    t = np.arange(20000) / 1000.0
    rate = 2.0 * np.pi * np.array([[0.4], [1.3]])
    size = np.array([[12.0], [3.0]])
    theta, omega = np.sum(size * np.sin(rate * t), axis=0), np.sum(size * rate * np.cos(rate * t), axis=0)
    alpha = -np.sum(size * rate**2 * np.sin(rate * t), axis=0)
    rng = np.random.default_rng(seed)
    torque = J * alpha + F_C * np.sign(omega) + F_V * omega + 2e-4 * rng.standard_normal(t.size)
    step = 2.0 * np.pi / counts
    return Log({"t": t, "theta": step * np.floor(theta / step + rng.random()), "torque": torque})


@pytest.mark.parametrize("seed", seeds(1, 2))
def test_a_coarse_encoder_narrows_the_band_and_a_fine_one_does_not(seed: int) -> None:
    coarse, fine = (timed_record(DESIGN, swinging(2**bits, seed)) for bits in (9, 20))
    assert fine.cutoff == 40.0
    assert coarse.cutoff in (10.0, 20.0)
    for record in (coarse, fine):
        assert base_fit(DESIGN, record).value("J")[0] == pytest.approx(J, rel=0.02)
        assert base_fit(DESIGN, record).value("F_c")[0] == pytest.approx(F_C, rel=0.02)


@pytest.mark.parametrize(
    ("usual", "in_wide_band", "wider"),
    [(0.01, 0.02, True), (0.01, 0.04, False), (0.06, 0.09, True), (0.06, 0.11, False), (0.19, 0.39, False)],
)
def test_no_wider_band_where_its_noise_hides_what_is_in_the_usual_one(
    usual: float, in_wide_band: float, wider: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A drag was called consistent in a band of 180 Hz with 39 % of noise, and found in 40 Hz with 19 % (440196)."""
    narrow, wide = (
        SimpleNamespace(cutoff=cutoff, age=None, timing=UNDELAYED, prepared=SimpleNamespace(rate=4000.0),
                        acceleration=lambda: None)
        for cutoff in (40.0, 180.0)
    )  # fmt: skip
    made: Any = SimpleNamespace(log=None, record=lambda *given: wide)
    fit: Any = SimpleNamespace(value=lambda name: (0.0, 1e-7))
    monkeypatch.setattr(rule, "signal_band", lambda log: 180.0)
    monkeypatch.setattr(rule, "noise_share", lambda record, alpha: 0.0)
    monkeypatch.setattr(rule, "_noise", lambda fit: usual)
    monkeypatch.setattr(rule, "_noise_floor", lambda design, record: in_wide_band)
    record: Any = narrow
    assert rule._widened(DESIGN, made, record, fit) is (wide if wider else narrow)

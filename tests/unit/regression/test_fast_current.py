"""A voltage that bends over the current: its column at a current that is faster than the low-pass, and noisy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from pmsm_ctrl import Design
from pmsm_ctrl.effects.catalogue import CATALOGUE
from pmsm_ctrl.effects.evaluate import columns
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.balances import make_record
from pmsm_ctrl.regression.base_fit import base_fit
from pmsm_ctrl.regression.columns import effect_group
from tests.effort import amount

SLOW = ((0.7, 60.0), (2.3, 20.0))  # Hz and rad/s
I_0 = 0.05  # A
Array = NDArray[np.float64]


@pytest.fixture(scope="module")
def design(project_root: Path) -> Design:
    return Design.read(project_root / "designs" / "seed_motor.toml")


def analytic(design: Design, seed: int, fast: tuple[float, float], noise: float) -> tuple[Log, Array]:
    """Return a log at 1 kHz of a speed that is a sum of sines, in closed form, and its current without the noise."""
    motor, K_t = design.motor, design.K_t_assumed
    assert motor.p is not None
    assert motor.psi_f is not None
    assert motor.L_q is not None
    assert motor.R is not None
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 8.0, 1e-3)
    theta, omega, alpha, jerk = 130.0 * t, np.full_like(t, 130.0), np.zeros_like(t), np.zeros_like(t)
    for frequency, size in (*SLOW, fast):
        w, at = 2.0 * np.pi * frequency, 2.0 * np.pi * frequency * t + rng.uniform(0.0, 6.0)
        theta, omega = theta - size / w * np.cos(at), omega + size * np.sin(at)
        alpha, jerk = alpha + size * w * np.cos(at), jerk - size * w**2 * np.sin(at)
    i_q = (design.J * alpha + 0.0213 + 1.68e-4 * omega) / K_t
    di_q = (design.J * jerk + 1.68e-4 * alpha) / K_t
    u_d = -motor.p * omega * motor.L_q * i_q
    u_q = motor.R * i_q + motor.L_q * di_q + motor.p * omega * motor.psi_f
    channels = {"i_d": np.zeros_like(t), "u_d": u_d, "u_q": u_q}
    noisy = {name: values + 1e-5 * rng.standard_normal(len(t)) for name, values in channels.items()}
    return Log({"t": t, "theta": theta, "i_q": i_q + noise * rng.standard_normal(len(t)), **noisy}), i_q


# Hz and rad/s of a wave of the speed, 60 mA of current; A of noise
@pytest.mark.parametrize(("fast", "noise"), [((150.0, 0.73), 1e-4), ((150.0, 0.73), 0.008), ((7.0, 0.0), 0.008)])
def test_the_column_of_a_dead_time_is_that_of_the_true_current(
    design: Design, fast: tuple[float, float], noise: float
) -> None:
    effect = CATALOGUE["dead_time"]
    for seed in range(1, 1 + amount(2, 6)):
        log, i_q = analytic(design, seed, fast, noise)
        record = base_fit(design, make_record(design, log)).record
        row = record.channels.index("u_q")
        made = effect_group(record, effect, {"i_0": I_0}).values[row, :, 0][record.mask]
        known = {"theta": log["theta"], "p": float(design.motor.p or 0), "i_d": np.zeros_like(i_q), "i_q": i_q}
        true = record.shaped(columns(effect, known, {"i_0": I_0})[0]["dU"][1])[record.mask]
        per_volt = float(true @ made) / float(made @ made)
        assert per_volt == pytest.approx(1.0, abs=3e-3)

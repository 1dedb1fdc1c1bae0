"""The voltages hold products of speed and current: what lies beyond the band of one comes back into it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl import Design
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.balances import make_record
from pmsm_ctrl.regression.base_fit import base_fit
from tests.effort import amount

# Hz and rad/s: two waves in the band, two beyond its 40 Hz whose product is slow
SLOW, FAST = ((0.7, 60.0), (7.0, 6.0)), ((46.0, 1.5), (49.0, 1.5))


@pytest.fixture(scope="module")
def design(project_root: Path) -> Design:
    return Design.read(project_root / "designs" / "seed_motor.toml")


def analytic(design: Design, seed: int) -> Log:
    """Return a log at 1 kHz of a speed that is a sum of sines, every channel in closed form, noise of 1e-5 in each."""
    motor, K_t = design.motor, design.K_t_assumed
    assert motor.p is not None
    assert motor.psi_f is not None
    assert motor.L_q is not None
    assert motor.R is not None
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 8.0, 1e-3)
    theta, omega, alpha, jerk = 120.0 * t, np.full_like(t, 120.0), np.zeros_like(t), np.zeros_like(t)
    for frequency, size in (*SLOW, *FAST):
        w, at = 2.0 * np.pi * frequency, 2.0 * np.pi * frequency * t + rng.uniform(0.0, 6.0)
        theta, omega = theta - size / w * np.cos(at), omega + size * np.sin(at)
        alpha, jerk = alpha + size * w * np.cos(at), jerk - size * w**2 * np.sin(at)
    i_q = (design.J * alpha + 0.0213 + 1.68e-4 * omega) / K_t
    di_q = (design.J * jerk + 1.68e-4 * alpha) / K_t
    u_d = -motor.p * omega * motor.L_q * i_q
    u_q = motor.R * i_q + motor.L_q * di_q + motor.p * omega * motor.psi_f
    channels = {"i_q": i_q, "i_d": np.zeros_like(t), "u_d": u_d, "u_q": u_q}
    noisy = {name: values + 1e-5 * rng.standard_normal(len(t)) for name, values in channels.items()}
    return Log({"t": t, "theta": theta, **noisy})


def test_a_current_beyond_the_band_is_in_the_voltages(design: Design) -> None:
    for seed in range(1, 1 + amount(2, 6)):
        fit = base_fit(design, make_record(design, analytic(design, seed)))
        record = fit.record
        assert record.cutoff < FAST[0][0]
        left = (record.target - fit.estimate.predicted())[:, record.mask]
        size = record.target[:, record.mask]
        row = record.channels.index("u_d")
        assert np.std(left[row]) < 1e-3 * np.std(size[row])
        value, _ = fit.value("L_q")
        assert value == pytest.approx(design.motor.L_q, rel=1e-3)

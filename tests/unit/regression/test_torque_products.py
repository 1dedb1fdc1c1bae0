"""A saturation is a product of two fast signals: what lies beyond the band of either comes back into it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl.design import Design
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.balances import STANDSTILL, make_record
from pmsm_ctrl.regression.base_fit import base_fit
from pmsm_ctrl.regression.conditioning import Processing
from tests.effort import seeds

RATE, FINER = 4000.0, 10
BAND = 20.0  # Hz
PEAK, LASTS = 0.3, 0.012  # A, s: half a period of what the band of 20 Hz holds, and less
SATURATION = 0.5  # 1/A
DRY, VISCOUS = 0.004, 2e-4  # N m, N m s/rad


def speed_steps(design: Design, seed: int) -> Log:
    """Return the exact motion by short currents there and back, forwards all the time, with friction."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(15.0 * RATE) * FINER) / (RATE * FINER)
    short, start, sign = np.zeros_like(t), 0.3, 1.0
    while start < 14.5:
        size = rng.uniform(0.3, 1.0) * PEAK
        for _ in range(2):
            inside = (t >= start) & (t < start + LASTS)
            short[inside] = sign * size * np.sin(np.pi * (t[inside] - start) / LASTS) ** 2
            start, sign = start + rng.uniform(0.15, 0.35), -sign
    K, J = design.K_t_assumed, design.motor.J or 0.0
    omega = 40.0 + np.cumsum(K * short * (1.0 - SATURATION * np.abs(short)) / J) / (RATE * FINER)
    # what the friction takes is a current more, which saturates as well
    asked, current = short * (1.0 - SATURATION * np.abs(short)) + (DRY + VISCOUS * omega) / K, short
    for _ in range(20):
        current = asked / (1.0 - SATURATION * np.abs(current))
    theta = np.cumsum(omega) / (RATE * FINER)
    noise = 1e-3 * rng.normal(size=len(t) // FINER)
    return Log({"t": t[::FINER], "theta": theta[::FINER], "i_q": current[::FINER] + noise})


@pytest.mark.parametrize("seed", seeds(1, 2))
@pytest.mark.parametrize("channels", [("i_q",), ("torque",), ("torque", "i_q")])
def test_a_saturation_in_peaks_shorter_than_the_band(designs: Path, channels: tuple[str, ...], seed: int) -> None:
    design = Design.read(designs / "seed_motor.toml").add_effect("torque_saturation", {"k_s": 0.1})
    log = speed_steps(design, seed)
    drive = {"i_q": log["i_q"], "torque": design.K_t_assumed * log["i_q"]}  # as a drive computes it
    log = Log({"t": log.t, "theta": log["theta"]} | {name: drive[name] for name in channels})
    record = make_record(design, log, Processing(standstill=STANDSTILL, cutoff=BAND))
    fit = base_fit(design, record)
    for name, true in (("J", design.motor.J), ("F_c", DRY), ("F_v", VISCOUS), ("k_s", SATURATION)):
        value, stderr = fit.value(name)
        assert value == pytest.approx(true, abs=3.0 * stderr), name
    # by the signals in the band, or in 2.5 times of it, 0.92 +- 0.05 and 0.67 +- 0.02 /A, and an inertia 2 to 3 % off
    assert fit.value("k_s")[1] < 0.03 * SATURATION
    assert fit.value("J")[1] < 0.003 * (design.motor.J or 0.0)

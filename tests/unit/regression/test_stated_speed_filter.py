"""A speed whose filter is stated twice, of the drive and of the channel, has passed it once."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from pmsm_ctrl.design import Design
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.drive_timing import in_time

DESIGN = Design.read(Path(__file__).resolve().parents[3] / "designs" / "seed_motor.toml")
FILTER, RATE = 2e-3, 1000.0


def behind_the_filter() -> tuple[np.ndarray, Log]:
    """Return a slow speed, and the log of it behind the filter."""
    t = np.arange(0.0, 4.0, 1.0 / RATE)
    omega = 50.0 * np.sin(2.0 * np.pi * t)
    kept = float(np.exp(-1.0 / (RATE * FILTER)))
    return omega, Log({"t": t, "omega": lfilter([1.0 - kept], [1.0, -kept], omega), "torque": np.zeros_like(t)})


@pytest.mark.parametrize("sensor", [0.0, FILTER])
def test_what_is_stated_of_the_channel_is_all_of_it(sensor: float) -> None:
    true, log = behind_the_filter()
    design = DESIGN.replace(sensor={"speed_filter": sensor}, log={"sampled": {"omega": {"filter": FILTER}}})
    error = in_time(design, log)["omega"][100:-100] - true[100:-100]
    assert np.sqrt(np.mean(error**2)) < 0.006 * 50.0  # 0.1 rad/s; undone twice: 0.54

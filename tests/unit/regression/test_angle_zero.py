"""Records whose angle has another zero, with a wave of a turn in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from pmsm_ctrl.log import Log
from pmsm_ctrl.plausibility import doubts_about
from pmsm_ctrl.regression.made import Made
from pmsm_ctrl.regression.timed_record import timed_record
from tests.unit.several import DESIGN, records

PERIOD = 2.0 * np.pi / 8.0


def shifts(zeros: list[float], wave: float) -> tuple[tuple[float, float], ...]:
    logs = records([{"zero": zero} for zero in zeros], wave=wave)
    return timed_record(DESIGN, doubts_about(DESIGN, logs).log).shifts


def test_other_zeros_are_found_from_the_waves() -> None:
    zeros = [0.0, 0.2, 0.0, -0.15]
    found = shifts(zeros, 0.004)
    assert len(found) == 4
    relative = np.array([angle for angle, _ in found]) + zeros
    relative -= relative[0]
    error = (relative + 0.5 * PERIOD) % PERIOD - 0.5 * PERIOD
    assert error == pytest.approx(np.zeros(4), abs=0.01)
    assert all(0.0 < stderr < 0.01 for angle, stderr in found if angle)


@pytest.mark.parametrize("wave", [0.0, 0.004])
def test_one_zero_is_left_alone(wave: float) -> None:
    assert shifts([0.0, 0.0, 0.0], wave) == ()


@pytest.mark.parametrize("speed_alone", [False, True])
def test_a_zero_does_not_hang_on_the_band_nor_on_the_channel(speed_alone: bool) -> None:
    """Records of a speed alone each begin at an angle of zero: where they began in truth is told by their waves."""
    logs = records([{"zero": zero} for zero in (0.0, 0.2, -0.15)], wave=0.004)
    if speed_alone:
        logs = [
            Log({name: log[name] for name in log if name != "theta"} | {"omega": np.gradient(log["theta"], log.t)})
            for log in logs
        ]
    joined = doubts_about(DESIGN, logs).log
    made = Made.kept(joined)
    whole = timed_record(DESIGN, joined, made)
    assert any(angle for angle, _ in whole.shifts)
    assert timed_record(DESIGN, joined, made, 0.5 * whole.cutoff).shifts == whole.shifts

"""A channel that is held for several samples is read in the middle of them: its mean delay is none of the drive."""

from __future__ import annotations

import numpy as np
import pytest

from pmsm_ctrl import Log, diagnose
from tests.effort import seeds
from tests.unit.several import DESIGN, J, record


def held(number: int, samples: int) -> Log:
    log = record(number, 12.0)
    return log.with_channels(torque=log["torque"][samples * (np.arange(len(log)) // samples)])


@pytest.mark.parametrize("number", seeds(1, 2, 3))
@pytest.mark.parametrize("samples", [7, 10])
def test_a_hold_is_no_delay(number: int, samples: int) -> None:
    found = diagnose(DESIGN, held(number, samples), plan=False)
    assert found.steps == ()
    codes = {notice.code for notice in found.notices}
    assert "held_channel" in codes
    assert not codes & {"not_synchronous", "drive_signal_late", "drive_signal_filtered"}
    assert abs(found.timing.late) < 1e-3  # of a mean delay of 3 and 4.5 ms
    assert found.base["J"].value == pytest.approx(J, rel=0.02)

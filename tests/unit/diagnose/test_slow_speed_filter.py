"""A speed without a position behind a slow filter of the drive: the filter is undone, and nothing is named for it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from pmsm_ctrl import Log, diagnose
from tests.effort import seeds, slow
from tests.unit.several import DESIGN, F_C, J, record


def filtered(number: int, tau: float) -> Log:
    log = record(number, 12.0)
    speed, pole = np.gradient(log["theta"], log.t), np.exp(-log.period / tau)
    behind = lfilter([1.0 - pole], [1.0, -pole], speed, zi=[pole * speed[0]])[0]
    return Log({"t": log.t, "omega": behind, "torque": log["torque"]})


@pytest.mark.parametrize("number", seeds(1, 2))
@pytest.mark.parametrize("tau", [slow(0.008), slow(0.012), 0.02, slow(0.04)])
def test_a_slow_filter_of_the_speed_is_no_delay_and_no_spring(tau: float, number: int) -> None:
    """At the end of the band 20 ms turn the phase by 79 degrees: two moments describe a tenth of that."""
    found = diagnose(DESIGN, filtered(number, tau), plan=False)
    assert found.steps == ()
    assert "not_synchronous" not in {notice.code for notice in found.notices}
    assert found.base["J"].value == pytest.approx(J, rel=0.025)
    assert found.base["F_c"].value == pytest.approx(F_C, rel=0.01)
    if tau < 0.015:
        assert found.verdict == "consistent"

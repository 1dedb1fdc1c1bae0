"""A friction that steps in a short log of many moves, which a smooth function of the motion nearly imitates."""

from __future__ import annotations

import numpy as np
import pytest

from pmsm_ctrl import diagnose
from tests.effort import seeds
from tests.slides import slide


@pytest.mark.parametrize("seed", seeds(1, 2, 3, 4))
def test_it_is_a_change_at_its_time_and_no_drift(seed: int) -> None:
    """Each of these logs was called a thermal drift: a tenth of the step at most is none of the motion's."""
    one, at = slide("moves", seed, {}), 6.0
    theta = np.pad(one.log["theta"], 4, mode="edge")
    speed = np.gradient(np.convolve(theta, np.ones(9) / 9.0, mode="valid"), one.log.t)
    step = 0.8 * one.true["F_c"]
    more = step * np.sign(speed) * ((np.abs(speed) > 2e-3) & (one.log.t > at))
    found = diagnose(one.design, one.log.with_channels(torque=one.log["torque"] + more), plan=False)
    assert found.steps == ()
    (event,) = found.events
    assert event.notice.code == "event_friction_step"
    assert event.start == pytest.approx(at, abs=0.15)
    assert event.size == pytest.approx(step, rel=0.05)

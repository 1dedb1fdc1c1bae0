"""Reversals of a log whose torque is late by less than sampling can make it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl.design import Design
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.timed_record import timed_record
from pmsm_ctrl.simulate import simulate
from tests.effort import seeds


@pytest.mark.parametrize("seed", seeds(1, 2))
def test_a_current_one_sample_old_is_in_time_at_reversals(seed: int, project_root: Path) -> None:
    """On a field bus of 0.5 ms it left four times the torque of one in time, which a presliding took."""
    design = Design.read(project_root / "designs" / "seed_motor.toml").replace(
        drive={"f_control": 8000.0, "speed_divider": 1}, sensor={"log_divider": 4, "encoder_counts": 1 << 20}
    )
    log = simulate(design, "trapezoid", seed=seed)
    channels = {name: log[name] for name in ("t", "theta", "i_q")}
    assert timed_record(design, Log(channels)).timing.reversals == 0.0
    late = np.concatenate([channels["i_q"][:1], channels["i_q"][:-1]])
    record = timed_record(design, Log({**channels, "i_q": late}))
    assert record.timing.reversals == pytest.approx(1.0 / log.rate, rel=0.1)

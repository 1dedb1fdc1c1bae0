"""Currents that are later than sampling can make them, on axes of the fourth simulator."""

from __future__ import annotations

from pathlib import Path

import pytest

from pmsm_ctrl import Design, diagnose, read_log
from tests.benchmarks.fourth.axis import gcc
from tests.benchmarks.fourth.cases import build
from tests.benchmarks.fourth.recorder import write
from tests.effort import slow

needs_gcc = pytest.mark.skipif(gcc() is None, reason="GCC ABSENT: the fourth simulator cannot be compiled")


@pytest.mark.slow
@needs_gcc
@pytest.mark.parametrize(
    ("seed", "delay"),
    [
        slow(2001438, 2.0e-3),  # a speed alone: a filter makes it late, never early
        slow(2001318, 6.5e-3),
        slow(2001618, 16.5e-3),
        slow(2001798, 4.625e-3),
        slow(2001538, 3.5e-3),  # a slow motion: nowhere does the torque change faster than its noise
        slow(2001598, 4.0e-3),
        slow(2001518, 4.25e-3),
        slow(2001158, 1.75e-3),
        (2001758, 2.9375e-3),  # by least squares it would be a filter, by the reference it is none
    ],
)
def test_a_current_that_is_late_is_named_with_its_delay(tmp_path: Path, seed: int, delay: float) -> None:
    case = build(seed)
    assert case is not None
    design_file, log_file = write(case.world, case.log, tmp_path / "axis")
    design = Design.read(design_file)
    found = diagnose(design, read_log(log_file, design), plan=False)
    assert [step.effect for step in found.steps] == ["delay"]
    period = 1.0 / case.world.log_rate
    assert abs(found.steps[0].parameters["tau"].value - delay) < period  # what the drive's own sampling may add

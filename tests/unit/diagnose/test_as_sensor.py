"""A constant load and an offset of the sensor are the same in every log: both readings are said."""

from __future__ import annotations

import pytest

from pmsm_ctrl import diagnose
from tests.unit.several import DESIGN, record


@pytest.mark.parametrize("number", [1, 2])
def test_a_constant_load_may_be_an_offset_of_the_sensor(number: int) -> None:
    found = diagnose(DESIGN, record(number, 12.0, offset=0.004), plan=False)
    (step,) = found.steps
    assert step.parameters["T_0"].value == pytest.approx(0.004, rel=0.05)
    (said,) = (notice for notice in found.notices if notice.code == "as_sensor")
    assert "offset of the current or torque sensor" in said.text

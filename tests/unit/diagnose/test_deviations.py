"""What is said of parameters beside the design's numbers, from fits that are written down by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from pmsm_ctrl.diagnose.deviations import deviation_notices
from pmsm_ctrl.diagnose.result import Deviation
from tests.unit.plausibility.drives import believed


@pytest.mark.parametrize(("p", "ratio", "other"), [(5, 0.8, 4), (5, 0.78, 4), (4, 0.8, 3), (4, 1.27, 5)])
def test_a_torque_constant_of_other_pole_pairs_is_told_with_them(p: int, ratio: float, other: int) -> None:
    assert f"a motor with {other} pole pairs in place of {p} shows the same" in told(p, ratio)


@pytest.mark.parametrize(("p", "ratio"), [(5, 0.89), (4, 0.87), (1, 0.8), (4, 0.93)])
def test_a_torque_constant_between_pole_pairs_is_one_alone(p: int, ratio: float) -> None:
    assert "in place of" not in told(p, ratio)


def told(p: int, ratio: float) -> str:
    design = believed(p=p, tolerance={"psi_f": 0.07})
    deviation = Deviation("K_t", 1.0, ratio, 1e-3, "N m/A", True, True)
    fit: Any = SimpleNamespace(record=SimpleNamespace(design=design, age=None))
    (notice,) = deviation_notices((deviation,), fit)
    return notice.text

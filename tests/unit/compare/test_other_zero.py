"""A log whose position has another zero than the design's waves: said by how much, and what the error would be."""

from __future__ import annotations

import pytest

from pmsm_ctrl import Design, compare
from pmsm_ctrl.result import Verdict
from tests.effort import seeds
from tests.slides import slide
from tests.unit.several import F_C, F_V, J, record


def with_cogging(a_s: float, a_c: float) -> Design:
    cogging = {"id": "cogging", "a_s": a_s, "a_c": a_c, "order": 8}
    friction = [{"id": "coulomb", "F_c": F_C}, {"id": "viscous", "F_v": F_V}]
    return Design.from_dict({"name": "axis", "motor": {"J": J, "K_t": 1.0}, "effects": [*friction, cogging]})


AS_LOGGED = 0.008 * 0.540302, 0.008 * 0.841471  # of sine and cosine: sin(8 theta + 1)


@pytest.mark.parametrize("number", seeds(1, 2, 3))
@pytest.mark.parametrize("zero", [0.1, -0.25])
def test_another_zero_is_said_with_the_error_that_it_makes(zero: float, number: int) -> None:
    """A wave that is faster than the band most of the time is noise to every curve over the position."""
    found = compare(with_cogging(*AS_LOGGED), record(number, wave=0.008, zero=zero))
    assert found.verdict is Verdict.UNEXPLAINED
    reason = found.reasons[0]
    assert reason.code == "other_zero_than_design"
    assert reason.detail["shift"] == pytest.approx(-zero, abs=0.02)
    assert reason.detail["before"] == pytest.approx(100.0 * found.log.errors["torque"].relative)
    assert reason.detail["after"] < 0.4 * reason.detail["before"]
    assert "The position has another zero" in found.summary().replace("\n", " ")


@pytest.mark.parametrize("number", seeds(1, 2, 3, 4))
@pytest.mark.parametrize("wave", [0.008, 0.0])
def test_nothing_is_said_of_the_same_zero_nor_of_a_wave_that_the_log_lacks(wave: float, number: int) -> None:
    found = compare(with_cogging(*AS_LOGGED), record(number, wave=wave))
    assert "other_zero_than_design" not in {reason.code for reason in found.reasons}


def test_it_is_said_of_a_linear_axis() -> None:
    one = slide("moves", 1, {})
    design = one.design.with_effect("detent_force", {"a_s": 3.0, "a_c": 0.0, "period": 0.024})
    other = slide("sines", 51, {0.024: (3.0, 0.0)}, one, 0.004).log
    reason = compare(design, other).reasons[0]
    assert reason.code == "other_zero_than_design"
    assert reason.detail["shift"] == pytest.approx(-0.004, abs=2e-4)
    assert reason.detail["unit"] == "m"

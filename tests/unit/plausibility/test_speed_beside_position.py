"""A speed beside the position is read by no fit; one that is another speed is said all the same."""

from __future__ import annotations

import numpy as np
import pytest

from pmsm_ctrl import Log, diagnose
from pmsm_ctrl.plausibility import doubts_about
from tests.unit.several import DESIGN, record


def with_speed(number: int, change: str) -> Log:
    log = record(number)
    speed = np.gradient(log["theta"], log.t)
    changed = {"as it is": speed, "magnitude": np.abs(speed), "rpm": speed * 30.0 / np.pi, "reversed": -speed}
    return log.with_channels(omega=changed[change])


@pytest.mark.parametrize("number", [1, 2, 3])
@pytest.mark.parametrize(
    ("change", "code", "words"),
    [
        ("magnitude", "speed_magnitude", "magnitudes"),
        ("rpm", "speed_factor", "rpm"),
        ("reversed", "speed_factor", "opposite signs"),
    ],
)
def test_another_speed_is_a_doubt(number: int, change: str, code: str, words: str) -> None:
    (doubt,) = doubts_about(DESIGN, with_speed(number, change)).doubts
    assert doubt.code == code
    assert words in doubt.text


@pytest.mark.parametrize("number", [1, 2, 3])
def test_the_speed_of_the_position_is_none(number: int) -> None:
    assert doubts_about(DESIGN, with_speed(number, "as it is")).doubts == ()


def test_no_log_with_another_speed_is_consistent() -> None:
    found = diagnose(DESIGN, with_speed(1, "magnitude"), plan=False)
    assert (found.verdict, found.steps) == ("inconclusive", ())
    assert found.reasons[0].code == "speed_magnitude"

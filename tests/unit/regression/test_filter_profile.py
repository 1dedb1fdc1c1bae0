"""Which of several filters of the drive signal is taken: by the errors behind each, made up here."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from pmsm_ctrl.regression.drive_timing import UNDELAYED, DriveTiming
from pmsm_ctrl.regression.filter_profile import by_profile

PERIOD = 4e-3


def least_at(lag: float, least: float = 0.1, delayed: float = 1.0) -> Callable[[DriveTiming], float]:
    """Return an error that is least behind a filter of this time constant, and one behind every delay."""
    return lambda timing: (
        delayed if timing.late > 0.0 else (least**2 + (1.0 - least**2) * ((timing.lag - lag) / lag) ** 2) ** 0.5
    )


@pytest.mark.parametrize("lag", [0.6, 1.2, 1.6, 2.1])
def test_the_filter_with_the_least_error_is_taken(lag: float) -> None:
    """Between the time constants that are tried, where the square of the error is a parabola."""
    found = by_profile(UNDELAYED, PERIOD, least_at(lag * PERIOD))
    assert (found.late, found.lag) == (0.0, pytest.approx(lag * PERIOD, rel=1e-6))


@pytest.mark.parametrize(
    "error",
    [
        pytest.param(least_at(1.2 * PERIOD, least=0.95), id="hardly less"),
        pytest.param(least_at(1.2 * PERIOD, delayed=0.05), id="a delay explains more"),
        pytest.param(least_at(5.0 * PERIOD), id="beyond what is tried"),
        pytest.param(lambda timing: float("inf"), id="no fit"),
    ],
)
def test_nothing_else_is_a_filter(error: Callable[[DriveTiming], float]) -> None:
    known = DriveTiming(1e-3, 0.0)
    assert by_profile(known, PERIOD, error) is known

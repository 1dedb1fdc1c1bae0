"""Which source and gain is recommended: the sweep below an unsafe first step, the choice, and its half."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pytest

from pmsm_ctrl.compensate.notices import safe_gain
from pmsm_ctrl.compensate.recommendation import recommended, swept_window
from pmsm_ctrl.compensate.window import GainWindow, sweep_gains
from pmsm_ctrl.design_parts import Compensation


class Axis:
    """An axis that is safe up to a gain, whose error falls in a straight line to `least` there."""

    def __init__(self, source: str, limit: float, least: float) -> None:
        self.source, self.limit, self.least = source, limit, least
        self.tried: set[float] = set()

    def __call__(self, *, gains: Iterable[float]) -> GainWindow:
        swept = np.array(sorted({0.0, *gains}))
        self.tried |= set(swept.tolist())
        rms = 1.0 - (1.0 - self.least) * swept / max(self.limit, 1e-9)
        good = swept <= self.limit
        safe = float(swept[good][-1])
        best = float(swept[int(np.argmin(np.where(good, rms, 9.0)))])
        return GainWindow(self.source, swept, rms, rms, rms, np.where(good, 0.0, 1e-3), safe, best)


@pytest.mark.parametrize(
    ("limit", "safe", "said"),
    [
        (0.0, 0.0, "below 10 % (smallest gain of the sweep)"),
        (0.33, 0.3, "30 %"),
        (0.4, 0.4, "40 %"),
        (0.7, 0.5, "50 %"),
    ],
)
def test_a_first_step_that_is_not_safe_is_not_printed_as_0(limit: float, safe: float, said: str) -> None:
    axis = Axis("measured", limit, 0.5)
    window = swept_window(axis, sweep_gains(0.5))
    assert (window.safe, safe_gain(window)) == (safe, said)
    assert max(axis.tried - {0.5, 1.0, 1.5}) <= safe + 0.1 + 1e-9  # no further than the first unsafe one


def test_a_sweep_without_a_finer_step_says_below_which_gain() -> None:
    window = swept_window(Axis("measured", 0.0, 0.5), sweep_gains(0.05))
    assert safe_gain(window) == "below 5 % (smallest gain of the sweep)"


def windows_of(axes: Iterable[Axis]) -> dict[str, GainWindow]:
    return {axis.source: swept_window(axis, sweep_gains(0.5)) for axis in axes}


@pytest.mark.parametrize(
    ("least", "wanted"),
    [((0.5, 0.3), "commanded"), ((0.5, 0.5), "reference"), ((0.5, 0.498), "reference"), ((0.2, 0.3), "reference")],
)
def test_the_least_error_at_a_safe_gain_is_recommended_and_of_equals_what_closes_no_loop(
    least: tuple[float, float], wanted: str
) -> None:
    axes = {name: Axis(name, 1.0, one) for name, one in zip(("reference", "commanded"), least, strict=True)}
    windows = windows_of(axes.values())
    found = recommended(windows, ("coulomb",), Compensation(dead_zone=0.1), axes)
    assert found is not None
    assert (found.compensation.source, found.gain, found.compensation.effects) == (wanted, 1.0, ("coulomb",))
    assert found.compensation.dead_zone == 0.1  # what else the design states stays
    assert found.rms == pytest.approx(least[("reference", "commanded").index(wanted)])


def test_no_more_than_all_of_the_friction_is_recommended() -> None:
    """Up to 130 % may be safe, and leave less where the parameters are 20 % low; of right ones it overcompensates."""
    axes = {"reference": Axis("reference", 1.5, 0.1)}
    found = recommended(windows_of(axes.values()), ("coulomb",), Compensation(), axes)
    assert found is not None
    assert found.gain == 1.0


def test_half_of_the_gain_is_tried_as_an_export_does() -> None:
    """A gain is exported only where half of it is safe as well."""
    axis = Axis("reference", 0.5, 0.6)
    windows = windows_of([axis])
    found = recommended(windows, ("coulomb",), Compensation(), {"reference": axis})
    assert found is not None
    assert found.gain == 0.5
    assert 0.25 in windows["reference"].gains


def test_nothing_is_recommended_where_no_safe_gain_lowers_the_error() -> None:
    axes = {"reference": Axis("reference", 1.0, 1.0), "measured": Axis("measured", 0.0, 0.5)}
    assert recommended(windows_of(axes.values()), ("coulomb",), Compensation(), axes) is None


def test_an_adaptive_compensation_stays_adaptive() -> None:
    """It is judged by the reference speed."""
    axes = {"reference": Axis("reference", 1.0, 0.2)}
    found = recommended(windows_of(axes.values()), ("coulomb",), Compensation(source="adaptive", gain=1.0), axes)
    assert found is not None
    assert found.compensation.source == "adaptive"

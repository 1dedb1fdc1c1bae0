"""Which source and gain is recommended: the sweep below an unsafe first step, the choice, and its half."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest

from pmsm_ctrl.compensate.doubt import DRIFT, Doubt, doubt_of
from pmsm_ctrl.compensate.metrics import Metrics
from pmsm_ctrl.compensate.notices import safe_gain
from pmsm_ctrl.compensate.recommendation import recommended, swept_window
from pmsm_ctrl.compensate.window import GainWindow, gain_window, sweep_gains
from pmsm_ctrl.design import Design
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


def left_by(factors: Iterable[float] = (0.8, 1.0, 1.2)) -> GainWindow:
    """Return the window of a friction that is known: what is left is what the parameters are off by.

    On the assumed plant the error grows to 150 %, which is below a count.
    """

    def run(gain: float, factor: float, name: str) -> Metrics:
        rms = 0.4 * (1.0 + 0.5 * gain) if name == "assumed" else 100.0 * abs(1.0 - gain * factor)
        return Metrics(rms, 10.0 * rms, 10.0 * rms, 0.0, 0.0, 0.0, 0.1, 0.01)

    given = {"gains": (0.5, 1.0), "resolution": 1.0, "assumed": ["assumed"]}
    return gain_window(run, ["own", "assumed"], "reference", factors=factors, **given)  # type: ignore[arg-type]


def test_the_assumed_plant_decides_what_is_safe_and_not_what_is_best() -> None:
    """At full gain 20 % are left of the friction that the design states, where 150 % was said to be left."""
    window = left_by()
    assert window.safe == 1.0
    assert window.rms.tolist() == pytest.approx([1.0, 0.6, 0.2])
    assert window.assumed_rms.tolist() == pytest.approx([1.0, 1.25, 1.5])
    assert (window.best, window.worst[-1]) == (1.0, "own")
    found = recommended({"reference": window}, ("coulomb",), Compensation(), {"reference": lambda gains: window})
    assert found is not None
    assert (found.gain, found.rms) == (1.0, pytest.approx(0.2))


def test_of_equals_the_one_that_leaves_less_on_the_assumed_plant() -> None:
    axes = {name: Axis(name, 1.0, 0.3) for name in ("reference", "commanded")}
    windows = windows_of(axes.values())
    for source, left in (("reference", 0.9), ("commanded", 0.5)):
        windows[source] = replace(windows[source], assumed=np.full(windows[source].gains.shape, left))
    found = recommended(windows, ("coulomb",), Compensation(), axes)
    assert found is not None
    assert found.compensation.source == "commanded"


def test_parameters_known_well_are_not_taken_to_be_20_percent_off() -> None:
    """What is safe is judged for 20 % all the same."""
    known, unknown = left_by((0.94, 1.0, 1.06)), left_by()
    assert known.rms[-1] == pytest.approx(0.06)
    assert known.safe == unknown.safe
    assert known.judged.tolist() == unknown.judged.tolist()


@pytest.mark.parametrize(
    ("stderr", "wanted"),
    [
        ({"coulomb": {"F_c": 2e-5}, "viscous": {"F_v": 1e-6}}, Doubt(DRIFT, stated=True)),  # friction drifts
        ({"coulomb": {"F_c": 2e-5}, "viscous": {"F_v": 1e-5}}, Doubt(0.1, stated=True)),
        ({"coulomb": {"F_c": 2e-5}, "viscous": {"F_v": 1e-4}}, Doubt(0.2, stated=True)),
        ({"coulomb": {"F_c": 2e-5}, "viscous": {}}, Doubt()),
    ],
)
def test_two_standard_errors_of_the_parameter_known_worst(stderr: dict[str, dict[str, float]], wanted: Doubt) -> None:
    effects = [
        {"id": "coulomb", "F_c": 0.02, "stderr": stderr["coulomb"]},
        {"id": "viscous", "F_v": 2e-4, "stderr": stderr["viscous"]},
        {"id": "constant_load", "T_0": 0.01},  # is not compensated
    ]
    design = Design.from_dict({"motor": {"J": 1e-4, "K_t": 1.0}, "effects": effects})
    found = doubt_of(design, ("coulomb", "viscous"))
    assert (found.share, found.stated) == (pytest.approx(wanted.share), wanted.stated)
    assert found.factors("observer") == (0.8, 1.0, 1.2)

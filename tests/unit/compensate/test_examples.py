"""The examples of a study show what its metrics say, where physics puts it: where an axis turns."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl import Design
from pmsm_ctrl.compensate.examples import Example, examples_of
from pmsm_ctrl.compensate.figures import circle, reversal
from pmsm_ctrl.compensate.metrics import measure, measure_contour
from pmsm_ctrl.compensate.motions import CIRCLE, RADIUS, study_trials
from pmsm_ctrl.compensate.runs import baseline, compensated, run_trial


@pytest.fixture(scope="module")
def design() -> Design:
    return Design.read(Path(__file__).resolve().parents[3] / "designs" / "low_speed.toml")


@pytest.fixture(scope="module")
def found(design: Design) -> tuple[Example, Example]:
    base = baseline(design)
    return examples_of(base, design, compensated(base, [entry.id for entry in design.effects]), 3)


def test_a_reversal_shows_the_peak_that_is_measured(design: Design, found: tuple[Example, Example]) -> None:
    base, shown = baseline(design), found[0]
    trial = study_trials(design)[shown.motion]
    drives = base, compensated(base, [entry.id for entry in design.effects])
    for drive, error in zip(drives, (shown.without, shown.compensated), strict=True):
        whole = measure(run_trial(drive, trial, seed=3)[0])
        after = (shown.t > 0.0) & (shown.t < 0.1)
        assert np.max(np.abs(error[after])) <= 1.001 * whole.reversal_peak
        assert np.max(np.abs(error[after])) > 0.5 * whole.reversal_peak, "all reversals of a sine are alike"
    assert np.max(np.abs(shown.without[shown.t < -0.02])) < 0.2 * np.max(np.abs(shown.without)), "friction turns at 0"
    assert np.interp(0.0, shown.t, shown.speed * np.sign(shown.speed[-1])) == pytest.approx(0.0, abs=0.02)


def test_a_circle_errs_where_an_axis_turns(design: Design, found: tuple[Example, Example]) -> None:
    base, shown = baseline(design), found[1]
    assert shown.angle is not None
    assert shown.radius == RADIUS
    assert np.ptp(shown.angle) == pytest.approx(2.0 * np.pi, abs=0.02)
    whole = measure_contour(*run_trial(base, study_trials(design)[CIRCLE], seed=3), RADIUS)
    assert np.max(np.abs(shown.without)) == pytest.approx(whole.reversal_peak, rel=0.2)
    large = np.abs(shown.without) > 0.5 * np.max(np.abs(shown.without))
    behind = np.mod(shown.angle[large], np.pi / 2.0)  # rad after the last end of a diameter, at half a turn a second
    assert np.all(behind < np.pi * 0.1), "within 0.1 s after an axis turned"
    assert len(set(np.round(shown.angle[large] // (np.pi / 2.0)))) == 4, "in all four quadrants"
    assert np.max(np.abs(shown.compensated)) < 0.2 * np.max(np.abs(shown.without))


def test_the_circle_is_drawn_magnified_but_not_beyond_half_its_radius(found: tuple[Example, Example]) -> None:
    axes = circle(found[1], "rad").axes[0]
    radii = [np.hypot(line.get_xdata(), line.get_ydata()) for line in axes.lines[1:3]]
    factor = float(axes.get_title().split("magnified ")[1].split()[0])
    assert radii[0] - RADIUS == pytest.approx(factor * found[1].without, abs=1e-9)
    assert 0.15 * RADIUS < np.max(np.abs(radii[0] - RADIUS)) < 0.5 * RADIUS
    labels = [panel.get_ylabel() for panel in reversal(found[0], "rad").axes]
    assert labels == ["position error [mrad]", "reference\nspeed [rad/s]"]

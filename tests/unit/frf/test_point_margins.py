"""Margins from measured points: against those of the true axis, with bands that hold what they promise."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl import Design, frf, simulate
from pmsm_ctrl.effects.structures import SecondMass
from pmsm_ctrl.frf import Response
from pmsm_ctrl.frf.point_margins import point_margins
from pmsm_ctrl.simulate.scenarios import chirp
from pmsm_ctrl.tune.linearise import mobility
from pmsm_ctrl.tune.margins import margins, measured
from tests.effort import amount, seeds

FREQUENCY = np.geomspace(5.0, 900.0, 3000)
SPRING = SecondMass(J_load=4e-5, k=15.0, d=0.02)


def axis(frequency: np.ndarray, mass: SecondMass | None, J: float = 9e-5) -> np.ndarray:
    return mobility(2j * math.pi * frequency, J, 2e-4, mass)


def controller(frequency: np.ndarray) -> np.ndarray:
    """Return a PI with 0.6 ms of delay."""
    s = 2j * math.pi * frequency
    return 0.045 * (1.0 + 1.0 / (5e-3 * s)) * np.exp(-0.6e-3 * s)


@pytest.mark.slow
@pytest.mark.parametrize("mass", seeds(SPRING, None))
def test_bands_hold_the_margins_of_the_true_axis(rng: np.random.Generator, mass: SecondMass | None) -> None:
    """The fitted axis is 5 % off: that does not matter."""
    f = np.geomspace(5.0, 900.0, 120)
    true = margins(measured(axis(FREQUENCY, mass) * controller(FREQUENCY), 2.0 * math.pi * FREQUENCY))
    clean, fitted = axis(f, mass), axis(f, mass, 9.45e-5)
    loop = axis(FREQUENCY, mass, 9.45e-5) * controller(FREQUENCY)
    names, error = ("phase_margin", "gain_margin_db", "crossover", "sensitivity_peak"), 0.02
    away: dict[str, list[float]] = {name: [] for name in names}
    for _ in range(amount(100, 1000)):
        noise = (rng.normal(size=len(f)) + 1j * rng.normal(size=len(f))) / math.sqrt(2.0)
        size = error * np.abs(clean)
        points = Response("plant", f, clean + size * noise, size, np.ones(len(f)), "", 1.0)
        found = point_margins(points, fitted, FREQUENCY, loop)
        for name in names:
            value, stderr = found[name]
            away[name].append((value - getattr(true, name)) / stderr)
    for name in names:
        held = np.mean(np.abs(away[name]) < 1.96)
        assert 0.90 <= held <= 0.99, (name, held)


def test_what_was_not_measured_has_no_margin() -> None:
    f = np.linspace(5.0, 20.0, 30)
    points = Response("plant", f, axis(f, None), 0.01 * np.abs(axis(f, None)), np.ones(30), "", 1.0)
    loop = axis(FREQUENCY, None) * controller(FREQUENCY)
    assert (
        not {"phase_margin", "gain_margin_db", "crossover"}
        & point_margins(points, axis(f, None), FREQUENCY, loop).keys()
    )


def test_a_margin_that_lies_beyond_the_points_is_not_that_within_them() -> None:
    """A resonance of 131 Hz decides phase margin and peak; points up to 90 Hz see the first crossover alone."""
    mass = SecondMass(J_load=4e-5, k=15.0, d=0.002)
    loop = axis(FREQUENCY, mass) * controller(FREQUENCY)
    true = margins(measured(loop, 2.0 * math.pi * FREQUENCY))

    def found(high: float) -> Mapping[str, tuple[float, float]]:
        f = np.geomspace(5.0, high, 120)
        clean = axis(f, mass)
        points = Response("plant", f, clean, 1e-3 * np.abs(clean), np.ones(120), "", 1.0)
        return point_margins(points, clean, FREQUENCY, loop)

    assert found(90.0).keys() == {"crossover"}
    whole = found(900.0)
    assert whole["phase_margin"][0] == pytest.approx(true.phase_margin, abs=0.3)
    assert whole["sensitivity_peak"][0] == pytest.approx(true.sensitivity_peak, rel=0.02)
    assert whole["crossover"][0] == pytest.approx(found(90.0)["crossover"][0], rel=1e-3)


def test_points_that_are_worse_than_the_axis_count() -> None:
    """The fitted axis is rigid; the points have a resonance, whose margin decides."""
    f = np.geomspace(5.0, 900.0, 400)
    mass = SecondMass(J_load=4e-5, k=15.0, d=0.02)
    clean = axis(f, mass)
    points = Response("plant", f, clean, 1e-3 * np.abs(clean), np.ones(400), "", 1.0)
    true = margins(measured(axis(FREQUENCY, mass) * controller(FREQUENCY), 2.0 * math.pi * FREQUENCY))
    found = point_margins(points, axis(f, None), FREQUENCY, axis(FREQUENCY, None) * controller(FREQUENCY))
    assert found["sensitivity_peak"][0] == pytest.approx(true.sensitivity_peak, rel=0.05)
    assert found["phase_margin"][0] == pytest.approx(true.phase_margin, abs=2.0)


def test_points_and_axis_of_a_log_agree(designs: Path) -> None:
    """The crossover and the margins lie within the range of the default chirp; bands of single points are wider."""
    design = Design.read(designs / "seed_motor.toml")
    result = frf(design, simulate(design, chirp(design=design), seed=5))
    assert result.point_margins.keys() >= {"phase_margin", "crossover", "sensitivity_peak"}
    for name, one in result.point_margins.items():
        fitted, _ = result.margins[name]
        assert abs(one.value - fitted.value) < 4.0 * one.stderr
        assert one.stderr > fitted.stderr
    assert "measured points" in result.summary()


def test_the_phase_margin_says_at_which_crossing_it_is(designs: Path) -> None:
    """Of a loop that a resonance takes through 1 again, the margin is beside a crossover that is not its own."""
    mass = SecondMass(J_load=4e-5, k=15.0, d=0.002)
    loop, f = axis(FREQUENCY, mass) * controller(FREQUENCY), np.geomspace(5.0, 900.0, 120)
    true = margins(measured(loop, 2.0 * math.pi * FREQUENCY))
    points = Response("plant", f, axis(f, mass), 1e-3 * np.abs(axis(f, mass)), np.ones(120), "", 1.0)
    found = point_margins(points, axis(f, mass), FREQUENCY, loop)
    assert true.phase_margin_crossover > 1.5 * true.crossover
    assert found["phase_margin_crossover"][0] == pytest.approx(true.phase_margin_crossover, rel=1e-3)
    design = Design.read(designs / "seed_motor.toml")
    rigid = frf(design, simulate(design, chirp(design=design, duration=2.5), seed=1))
    assert "phase_margin_crossover" in rigid.to_dict()["margins"]
    assert "found at" not in rigid.summary()
    other = (rigid.margins["crossover"][0], 2.0 * rigid.margins["crossover"][1])
    assert "found at" in replace(rigid, margins={**rigid.margins, "phase_margin_crossover": other}).summary()

"""A linear axis is simulated with the encoder that its design states, and moves as far and as fast as it can."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pmsm_ctrl.design import Design
from pmsm_ctrl.identify import identify, sweep
from pmsm_ctrl.simulate import SCENARIOS, scenario, simulate
from pmsm_ctrl.simulate.motions import Limits
from tests import effort
from tests.linear_motors import linear_motor

DRAWN = [0, *range(1, 6)]
# Scenarios in which only a current or nothing is prescribed.
WITHOUT_MOTION = {"breakaway", "hold"}


@pytest.mark.parametrize("counts", [1_000_000, 50_000, 123_457])
def test_the_encoder_steps_by_a_metre_over_its_counts(counts: int) -> None:
    design = linear_motor().design.replace(sensor={"encoder_counts": counts})
    log = simulate(design, scenario("reversal", design, cycles=1.0), seed=1, keep_truth=True)
    steps = log["theta"] * counts
    assert np.abs(steps - np.round(steps)).max() < 1e-6
    assert set(np.diff(np.unique(np.round(steps)))) >= {1.0}
    assert design.encoder_step == 1.0 / counts
    assert np.abs(log["theta"] - log["theta_true"]).max() <= (0.5 + 1e-6) / counts
    assert np.std(log["theta"] - log["theta_true"]) == pytest.approx(1.0 / counts / math.sqrt(12.0), rel=0.1)


def test_the_encoder_of_a_shaft_steps_by_a_turn_over_its_counts(designs) -> None:
    design = Design.read(designs / "seed_motor.toml").replace(sensor={"encoder_counts": 10_000})
    log = simulate(design, scenario("reversal", design, cycles=1.0), seed=1, keep_truth=True)
    assert np.abs(log["theta"] - log["theta_true"]).max() <= (1.0 + 1e-6) * math.pi / 10_000
    assert design.encoder_step == 2.0 * math.pi / 10_000
    assert design.replace(sensor={"encoder_counts": 0}).encoder_step == 0.0


@pytest.mark.parametrize("name", sorted(set(SCENARIOS) - WITHOUT_MOTION))
@pytest.mark.parametrize("seed", DRAWN)
def test_scenarios_are_within_what_the_motor_can_do(name: str, seed: int) -> None:
    """Speeds below the EMF's limit and accelerations below the force's; the way is that of a slide, not of a shaft."""
    axis = linear_motor(seed)
    motion = scenario(name, axis.design)
    t = np.arange(0.0, motion.duration, 1e-3)
    place, speed, change = motion.inputs(t)[:, :3].T
    if motion.control != "position":
        place = np.cumsum(speed) * 1e-3
    assert np.abs(speed).max() <= 0.5 * axis.fastest
    if name != "sweep":  # whose speed steps
        steps = np.abs(np.diff(speed)) / 1e-3
        assert steps.max() <= 0.25 * axis.strongest
    assert np.abs(change).max() <= 0.25 * axis.strongest
    way = np.ptp(place)
    assert 1e-3 < way < 0.25 * axis.fastest  # m: no more than a quarter of a second at the highest speed
    if seed == 0:
        assert 0.03 < way < 1.1


@pytest.mark.parametrize("name", ["trapezoid", "s_curve", "triangle", "reversal", "identification"])
def test_scenarios_are_followed_below_the_current_limit(name: str) -> None:
    design = linear_motor().design
    log = simulate(design, scenario(name, design), seed=1)
    assert np.abs(log["i_q_ref"]).max() < 0.5 * design.drive.i_max
    moving = log["omega_ref"] != 0.0
    assert np.std(log["omega"][moving] - log["omega_ref"][moving]) < 0.1 * np.std(log["omega_ref"])


@pytest.mark.parametrize("seed", effort.seeds(0, 1, 2, 3))
def test_the_identification_run_tells_mass_and_friction(seed: int) -> None:
    axis = linear_motor(seed)
    found = identify(axis.design, simulate(axis.design, scenario("identification", axis.design), seed=seed + 1))
    assert found.estimates["J"].value == pytest.approx(axis.design.J, rel=0.02)
    assert found.estimates["F_c"].value == pytest.approx(axis.F_c, rel=0.01)
    F_v = found.estimates["F_v"]
    assert F_v.value == pytest.approx(axis.F_v, abs=4.0 * F_v.stderr)


@pytest.mark.parametrize("seed", effort.seeds(0, 1, 2, 3))
def test_a_speed_sweep_is_at_no_whole_numbers_of_counts(seed: int) -> None:
    """At round speeds the log takes the ripple of the encoder's steps at one place: F_v was 7 % off, F_c 2 %."""
    axis = linear_motor(seed)
    found = sweep(axis.design, repeats=1, seed=seed).estimates
    for name, true in (("F_c", axis.F_c), ("F_v", axis.F_v)):
        assert found[name].value == pytest.approx(true, abs=4.0 * found[name].stderr)
    if seed == 0:
        assert found["F_c"].value == pytest.approx(axis.F_c, rel=0.01)
        assert found["F_v"].value == pytest.approx(axis.F_v, rel=0.03)


def test_names_of_segments_have_the_unit_of_the_axis(designs) -> None:
    shaft, slide = Design.read(designs / "seed_motor.toml"), linear_motor().design
    for name, unit in (("sweep", "/s"), ("creep", "/s"), ("positioning", "")):
        for design, length in ((shaft, "rad"), (slide, "m")):
            assert {one.split()[-1] for one, _, _ in scenario(name, design).segments} == {length + unit}


def test_lengths_are_those_of_the_slowest_limit() -> None:
    """A turn of the reference motor's motions is a round length: 200 lengths/s and 100 lengths/s^2 are allowed."""
    fast = linear_motor().design
    assert Limits.of(fast).speed == 2.0  # 0.43 of 5.7 m/s, one digit
    assert 2.0 * math.pi * Limits.of(fast).length == pytest.approx(0.06)  # 2 m/s / 200 = 10 mm, of which 2 pi
    heavy = fast.with_parameters(J=100.0 * fast.J)
    assert Limits.of(heavy).acceleration == pytest.approx(0.06)
    assert 2.0 * math.pi * Limits.of(heavy).length == pytest.approx(0.003)  # 0.06 m/s^2 / 100 = 0.6 mm
    plain = Design.from_dict({"motion": "linear", "motor": {"J": 1.0, "K_t": 1.0}})
    assert Limits.of(plain).speed <= 2.0
    assert Limits.of(plain).length < 0.011

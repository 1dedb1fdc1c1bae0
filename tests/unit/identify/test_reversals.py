"""Reversals with sticking, and the band of least squares, against closed forms."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import LogError
from pmsm_ctrl.identify import Processing, identify
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.bandwidth import _shrinkage, regression_problem
from pmsm_ctrl.regression.conditioning import prepare
from pmsm_ctrl.regression.drive_timing import SYNCHRONOUS
from pmsm_ctrl.regression.inverse_dynamics import build_problem
from pmsm_ctrl.regression.least_squares import solve
from pmsm_ctrl.simulate import scenario, simulate
from tests.benchmarks.identification import cases, exogenous_log
from tests.effort import seeds

J, F_C, F_V = 0.01, 0.4, 0.02
PLAIN = (
    Design.from_dict({"motor": {"J": J, "K_t": 1.0}})
    .with_effect("coulomb", {"F_c": F_C})
    .with_effect("viscous", {"F_v": F_V})
)


def sticking_log(stick: float, rate: float = 1000.0, half: float = 0.6, top: float = 20.0) -> Log:
    """Half sines of speed in turn, and between them rests during which the torque runs from one friction to the other.

    Position, speed and acceleration are written down, not integrated.
    """
    t = np.arange(round(12.0 * rate)) / rate + 0.11
    turn, at = np.divmod(t, half + stick)
    sign = np.where(turn % 2 == 0, 1.0, -1.0)
    w = np.pi / half
    inside = at < half
    phase = w * np.minimum(at, half)
    speed = np.where(inside, sign * top * np.sin(phase), 0.0)
    travel = 2.0 * top / w * (turn % 2)
    theta = travel + sign * top / w * (1.0 - np.cos(phase))
    torque = J * top * w * np.cos(phase) * sign + F_C * sign + F_V * speed
    rest = (at - half) / stick if stick else np.zeros_like(at)
    before, after = sign * (F_C - J * top * w), -sign * (F_C + J * top * w)
    # at rest any torque below breakaway is balanced: here straight from where it was to where it will be
    torque = np.where(inside, torque, np.clip(before + rest * (after - before), -F_C, F_C))
    return Log({"t": t - t[0], "theta": theta, "torque": torque})


def worst(log: Log, processing: Processing) -> float:
    found = identify(PLAIN, log, processing=processing).estimates
    return max(abs(found[name].value / value - 1.0) for name, value in (("J", J), ("F_c", F_C), ("F_v", F_V)))


@pytest.mark.parametrize("stick", seeds(0.012, 0.005, 0.02))
def test_friction_at_rest_does_not_reach_its_neighbours(stick: float) -> None:
    log = sticking_log(stick, rate=4000.0)
    blanked, left_out_afterwards = (worst(log, Processing(cutoff=40.0, blank=blank)) for blank in (True, False))
    assert blanked < 2e-3
    assert left_out_afterwards > 5.0 * blanked


def test_both_sides_are_blanked_alike() -> None:
    log = sticking_log(0.012)
    prepared = prepare(PLAIN, log, Processing(blank=True))
    assert prepared.weight is not None
    resting = prepared.weight == 0.0
    assert set(np.unique(prepared.weight)) == {0.0, 1.0}
    assert np.all(np.abs(prepared.signals["omega"][~resting]) > 0.0)
    torque = prepared.signals["torque"]
    expected = prepared.smooth(np.where(resting, 0.0, torque))
    np.testing.assert_allclose(build_problem(PLAIN, prepared).target, expected, rtol=1e-12, atol=1e-15)
    # 18 rests of 12 ms and of what the 250 Hz before them round off
    assert 0.010 * 18 < resting.mean() * 12.0 < 0.030 * 20


def test_others_than_identify_blank_nothing() -> None:
    log = sticking_log(0.012)
    assert prepare(PLAIN, log).weight is None
    assert prepare(PLAIN, log, Processing(blank=False)).weight is None
    assert identify(PLAIN, log, processing=Processing(blank=False)).problem.target == pytest.approx(
        build_problem(PLAIN, log).target
    )


def test_nothing_is_blanked_where_noise_turns_the_axis() -> None:
    log = sticking_log(0.012)
    step = 2.0 * np.pi / 100.0
    coarse = log.with_channels(theta=np.round(log["theta"] / step) * step)
    assert prepare(PLAIN, coarse, Processing(blank=True)).weight is None


def test_an_encoder_of_a_step_a_turn_keeps_the_usual_band() -> None:
    t = np.arange(3000) / 1000.0
    theta = np.round(20.0 * (1.0 - np.cos(4.0 * t)) / 5.0) * 5.0
    log = Log({"t": t, "theta": theta, "torque": F_C * np.sign(np.sin(4.0 * t)) + 5.0 * J * np.cos(4.0 * t)})
    with pytest.raises(LogError, match="too short a time"):
        prepare(PLAIN, log, Processing(cutoff=100.0, blank=True))
    assert regression_problem(PLAIN, log, Processing(blank=True)).cutoff == 40.0


def test_the_error_that_is_told_is_that_of_reversals_as_well() -> None:
    log = sticking_log(0.012)
    result = identify(PLAIN, log, processing=Processing(sampling=SYNCHRONOUS))
    plain = build_problem(PLAIN, log)
    values = np.array([result.estimates[name].value for name in plain.names])
    left = (plain.target - plain.matrix() @ values)[plain.mask]
    assert result.relative_error == pytest.approx(np.linalg.norm(left) / np.linalg.norm(plain.torque[plain.mask]))


@pytest.mark.slow
def test_least_squares_takes_the_band_that_the_log_asks_for() -> None:
    motions, triangle, *_, slow = cases()
    blank = Processing(blank=True)

    def bands(case, counts: int | None = None, processing: Processing = blank) -> tuple[float, float | None]:
        truth = case.truth if counts is None else case.truth.replace(sensor={"encoder_counts": counts})
        log = simulate(case.believed(), case.motion, truth=truth, seed=1)
        problem = regression_problem(case.believed(), log, processing)
        return problem.cutoff, problem.inertia_cutoff

    assert bands(motions) == (100.0, None)  # short ramps: a quarter of what is known of J lies beyond 40 Hz
    assert bands(triangle) == (40.0, None)
    assert bands(slow) == (250.0, 20.0)  # dF_s gains, but the drive's answer to its noise would shrink J
    assert bands(motions, counts=4096) == (40.0, None)  # noise of the angle would shrink J
    assert bands(motions, processing=replace(blank, cutoff=60.0)) == (60.0, None)


def test_an_inertia_from_a_narrow_band_is_not_shrunk_by_noise_beyond_it(designs: Path) -> None:
    seed_motor = Design.read(designs / "hand_tuned.toml")
    motion = scenario("triangle", seed_motor, speed=150.0, period=2.0, cycles=4.0)
    log = exogenous_log(seed_motor, motion, 3, 3e-4, 2e-3)
    whole, narrow = (
        identify(seed_motor, log, processing=Processing(cutoff=150.0, inertia_cutoff=band)) for band in (None, 40.0)
    )
    assert whole.estimates["J"].value / seed_motor.J < 0.96
    assert narrow.estimates["J"].value == pytest.approx(seed_motor.J, rel=0.005)
    assert "the inertia from 40 Hz" in " ".join(narrow.summary().split())
    assert narrow.to_dict()["inertia_cutoff"] == 40.0


def test_shrinkage_is_that_of_errors_in_a_column(designs: Path) -> None:
    seed_motor = Design.read(designs / "hand_tuned.toml")
    motion = scenario("triangle", seed_motor, speed=150.0, period=2.0, cycles=4.0)
    # 17 bits would add noise of their own: there is none here
    band, told, seen = Processing(cutoff=120.0), [], []
    for seed in range(6):
        noisy = exogenous_log(seed_motor, motion, seed, 2e-4, 1e-4)
        quiet = exogenous_log(seed_motor, motion, seed, 0.0, 1e-4)
        problems = [build_problem(seed_motor, log, processing=band) for log in (noisy, quiet)]
        fits = [solve(problem) for problem in problems]
        told.append(_shrinkage(seed_motor, noisy, problems[0]) * fits[0].stderr["J"])
        seen.append(fits[1].values["J"] - fits[0].values["J"])
    assert np.mean(told) == pytest.approx(np.mean(seen), rel=0.1)

"""Reversals against closed forms: dry friction turned by a constant torque, or by a ramp that lets the shaft stick."""

from __future__ import annotations

import numpy as np
import pytest

from pmsm_ctrl import Design
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.balances import STANDSTILL, make_record
from pmsm_ctrl.regression.conditioning import Processing
from pmsm_ctrl.regression.drive_timing import DriveTiming
from pmsm_ctrl.regression.filters import derivative, low_pass
from pmsm_ctrl.regression.reversals import left_rest, reversals, through, timed_sign
from pmsm_ctrl.regression.reversals import turned as followed

J = 1.0 / 200.0  # inertia over the level of friction, s^2
WIDE = 100.0  # Hz, the low-pass before differentiation


def turned(t: np.ndarray, theta: np.ndarray, torque: np.ndarray, resting: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the direction by the smoothed speed alone, and by running through the reversal."""
    rate = 1.0 / (t[1] - t[0])
    smooth = low_pass(theta, rate, WIDE)
    omega = derivative(smooth, 1.0 / rate)
    plain = timed_sign(omega)
    through = plain.copy()
    reversals(through, resting, omega, (omega, smooth), torque, J, 1.0 / rate, round(rate / WIDE))
    return plain, through


def moment(t: np.ndarray, direction: np.ndarray) -> float:
    """When a direction that falls from 1 to -1 does so, by its area."""
    near = np.abs(t) < 0.05
    dt = t[1] - t[0]
    return float(t[near][0] - 0.5 * dt + 0.5 * dt * np.sum(1.0 + direction[near]))


@pytest.mark.parametrize("rate", [1000.0, 2000.0])
@pytest.mark.parametrize("drive", [-1.5, -2.0, -4.0])
@pytest.mark.parametrize("crossing", [0.0, 0.3e-3])
def test_constant_torque(rate: float, drive: float, crossing: float) -> None:
    # J domega/dt = T - sgn(omega): (T - 1) / J before the reversal, (T + 1) / J after it
    t = np.arange(-round(0.4 * rate), round(0.4 * rate) + 1) / rate
    since = t - crossing
    theta = 0.5 * np.where(since < 0.0, drive - 1.0, drive + 1.0) / J * since**2
    plain, through = turned(t, theta, np.full(t.size, drive), np.zeros(t.size, dtype=bool))
    late, error = moment(t, plain) - crossing, moment(t, through) - crossing
    assert late > 0.15e-3  # what the smoothed speed says
    assert abs(error) < 0.05e-3
    assert abs(error) < 0.2 * late


@pytest.mark.parametrize("crossing", [0.0, 0.13e-3, -4.71e-3])
@pytest.mark.parametrize(("drive", "level", "missing"), [(-2.0, 1.0, 0.0), (-4.0, 1.7, 0.3), (3.0, 0.6, -0.4)])
def test_speed_and_travel_give_the_moment_the_level_and_what_is_missing(
    crossing: float, drive: float, level: float, missing: float
) -> None:
    # as above, of friction that is not as large as usual, and with a torque that is measured wrongly
    t, way = np.arange(-10, 11) * 1e-3 - crossing, np.sign(drive)
    accel = np.where(t < 0.0, drive + way * level, drive - way * level) / J
    share = np.empty(t.size)
    assert followed(accel * t, 0.5 * accel * t**2, np.full(t.size, drive - missing), J, 1e-3, share)
    before, after = -t[0], t[-1]
    assert np.sum(share) * 1e-3 == pytest.approx(way * (after - before), abs=1e-9)
    assert share[2:4] == pytest.approx(-way, abs=1e-9)


def test_at_rest_friction_balances_the_torque() -> None:
    # comes to rest at t = 0 under a torque that falls by 50 levels a second, and leaves backward at minus the level
    t, ramp = np.arange(-10, 51) * 1e-3, 50.0
    torque = 0.5 - ramp * t
    before, away = np.minimum(t, 0.0), np.maximum(t - 1.5 / ramp, 0.0)
    omega = -(0.5 * before + 0.5 * ramp * before**2 + 0.5 * ramp * away**2) / J
    theta = -(0.25 * before**2 + ramp * before**3 / 6.0 + ramp * away**3 / 6.0) / J
    share = np.empty(t.size)
    assert followed(omega, theta, torque, J, 1e-3, share)
    friction = np.where(t < 0.0, 1.0, np.maximum(torque, -1.0))
    friction[10] = 0.5 * (1.0 + 0.5 - 0.25 * ramp * 1e-3)  # half a sample of either
    friction[40] += 0.125 * ramp * 1e-3  # it leaves in the middle
    assert share[1:-1] == pytest.approx(friction[1:-1], abs=1e-6)


def test_a_push_that_moves_a_resting_shaft_within_a_sample_lets_it_stop_again() -> None:
    # 1.2 levels at first, none a sample later: it stops after a third of the sample, and friction balances the torque
    share, moves = np.empty(2), 2.0 * 0.2 / 1200.0
    speed, travel = through(0.0, np.array([1.2, 0.0]), 0.0, 1.0, 1.0, J, 1e-3, share)
    assert (speed, travel) == (0.0, pytest.approx(0.2 * moves**2 / 6.0 / J, rel=1e-12))
    assert share == pytest.approx([1.0 / 3.0 + 0.7 / 6.0, 0.15], rel=1e-12)


@pytest.mark.parametrize("missing", [0.0, 0.1])
def test_a_shaft_that_sticks_in_between(missing: float) -> None:
    # the torque falls by 100 levels of friction a second, from 0.5 where the shaft comes to rest to -1 where it leaves
    rate, ramp = 1000.0, 100.0
    t = np.arange(-400, 401) / rate
    torque = 0.5 - ramp * np.clip(t, 0.0, 0.03)
    rest, away = 0.0, 1.5 / ramp
    before, after = np.minimum(t - rest, 0.0), np.maximum(t - away, 0.0)
    held = np.minimum(after, 0.015)  # the torque stays at -2.5 from 30 ms on
    theta = 0.5 * (0.5 - 1.0) / J * before**2
    theta -= ramp / J * (held**3 / 6.0 + (after - held) * held**2 / 2.0 + held * (after - held) ** 2 / 2.0)
    friction = np.where(t < rest, 1.0, np.where(t < away, torque, -1.0))
    resting = (t >= rest) & (t < away)
    _, through = turned(t, theta, torque - missing, resting)  # the torque is measured too low
    # half a level of friction falls at once where the shaft comes to rest: one sample may be between
    wrong = np.abs(through - friction)
    assert np.sum(wrong[np.abs(t) < 0.1]) < 1.0 + 15.0 * missing
    assert np.median(wrong[resting]) < 0.03 + missing


def test_a_shaft_that_stops_and_goes_on_has_no_direction_there() -> None:
    # at rest for 60 ms; what the smoothing rings, and the encoder's noise, changes the sign of the speed in between
    rate = 1000.0
    t = np.arange(-400, 401) / rate
    theta = 0.5 * 300.0 * (np.minimum(t, 0.0) ** 2 * -1.0 + np.maximum(t - 0.06, 0.0) ** 2)
    theta += 1e-5 * np.sin(2.0 * np.pi * 40.0 * t) * ((t > -0.01) & (t < 0.07))
    omega = derivative(theta, 1.0 / rate)
    assert np.count_nonzero(np.diff(np.sign(omega))) > 1
    direction = timed_sign(omega)
    found = reversals(
        direction, np.zeros(t.size, dtype=bool), omega, (omega, theta), np.full(t.size, -0.5), J, 1e-3, 10
    )
    unknown = [piece for pieces in found for piece in pieces]
    assert len(unknown) == 1
    assert t[unknown[0].start] < 0.0
    assert t[unknown[0].stop - 1] > 0.06


def test_what_moves_less_than_a_count_in_the_filters_memory_rests() -> None:
    # half a second of creep, at 20 counts a second of an encoder of 512, between turns: at 40 Hz that is half a count
    t, count = np.arange(0.0, 10.0, 1e-3), 2.0 * np.pi / 512.0
    creep = np.abs(np.mod(t, 2.0) - 1.5) < 0.25
    omega = np.where(creep, 20.0 * count, 30.0 * np.sin(np.pi * np.mod(t, 2.0) / 1.25) * (np.mod(t, 2.0) < 1.25))
    theta = np.cumsum(omega) * 1e-3
    design = Design.from_dict({"name": "made", "motor": {"J": 1e-3, "K_t": 1.0}})
    design = design.with_effect("coulomb", {"F_c": 0.05}).with_effect("viscous", {"F_v": 1e-3})
    torque = 1e-3 * np.gradient(omega, t) + 0.05 * np.sign(omega) + 1e-3 * omega
    fine, coarse = (
        make_record(design, Log({"t": t, "theta": angle, "torque": torque}))
        for angle in (theta, np.floor(theta / count) * count)
    )
    middle = np.abs(np.mod(fine.t, 2.0) - 1.5) < 0.1
    inside = middle & (fine.t > 1.0) & (fine.t < 9.0)
    assert fine.mask[inside].all()
    assert not coarse.mask[inside].any()


@pytest.mark.parametrize("rate", [1000.0, 2000.0])
@pytest.mark.parametrize("creep", [0.0, 1e-3, 2e-2])
def test_what_the_shaft_creeps_at_rest_does_not_move_its_start(rate: float, creep: float) -> None:
    # held by half a level for 0.2 s, in which it creeps; the torque falls by 200 levels a second, it leaves at -1
    ramp, start = 200.0, 1.5 / 200.0
    t = np.arange(-round(0.6 * rate), round(0.4 * rate) + 1) / rate
    torque = 0.5 - ramp * np.clip(t, 0.0, 3.0 / ramp)
    before, away = np.minimum(t + 0.2, 0.0), np.maximum(t - start, 0.0)
    held = np.minimum(away, 1.5 / ramp)
    theta = -ramp / J * (held**3 / 6.0 + (away - held) * held**2 / 2.0 + held * (away - held) ** 2 / 2.0)
    theta += creep * np.clip(t / 0.2 + 1.0, 0.0, 1.0) - 0.25 / J * before**2
    omega = derivative(low_pass(theta, rate, WIDE), 1.0 / rate)
    resting = np.abs(omega) < 0.004 * np.quantile(np.abs(omega), 0.99)
    direction = timed_sign(omega)
    direction[resting] = np.clip(torque, -1.0, 1.0)[resting]
    smooth = low_pass(theta, rate, WIDE)
    reversals(direction, resting, omega, (omega, smooth), torque, J, 1.0 / rate, round(rate / WIDE))
    wrong = np.abs(direction - np.maximum(torque, -1.0))[np.abs(t - start) < 0.03]
    assert np.sum(wrong) / rate < 0.02e-3  # with a level and a missing torque as two unknowns 2.3 ms


@pytest.mark.parametrize("level", [0.8, 1.3, 2.0])
def test_an_axis_that_leaves_at_another_level_is_balanced_until_it_does(level: float) -> None:
    # at rest the friction is the torque, whatever the level at which it gives way; then its sign is all that counts
    rate, ramp = 1000.0, 100.0
    t = np.arange(61) / rate
    torque, start = 0.1 + ramp * t, (level - 0.1) / ramp
    share = np.empty(t.size)
    assert left_rest(0.5 * ramp * (t[-1] - start) ** 2 / J, torque, J, 1.0 / rate, share)
    resting = t < start - 1.0 / rate
    assert share[resting][1:] == pytest.approx(torque[resting][1:], abs=1e-4)
    assert share[t > start + 1.0 / rate][:-1] == pytest.approx(1.0, abs=1e-6)


def test_no_friction_lets_an_axis_leave_backward_under_a_torque_that_drives_it_forward() -> None:
    assert not left_rest(-5.0, np.full(50, 1.5), J, 1e-3, np.empty(50))


def test_of_many_turns_in_a_row_nobody_knows_which_way_the_shaft_goes() -> None:
    # half a second of a vibration of 20 Hz between two moves: five turns a filter's memory
    rate = 1000.0
    t = np.arange(-1000, 1001) / rate
    shakes = np.abs(t) < 0.25
    omega = np.where(shakes, 0.2 * np.sin(2.0 * np.pi * 20.0 * (t - 3e-4)), np.sign(t) * (np.abs(t) - 0.25) * 50.0)
    theta = np.cumsum(omega) / rate
    rests = np.zeros(t.size, dtype=bool)
    _, unknown = reversals(timed_sign(omega), rests, omega, (omega, theta), np.full(t.size, -0.5), J, 1e-3, 20)
    covered = np.zeros(t.size, dtype=bool)
    for piece in unknown:
        covered[piece] = True
    assert covered[np.abs(t) < 0.24].all()
    assert not covered[np.abs(t) > 0.3].any()


@pytest.mark.parametrize("load", [0.0, 0.2])
def test_dry_friction_of_an_axis_that_runs_one_way_holds_its_load(load: float) -> None:
    # moves of 1 s with rests of 1 s between them, at which a third of the friction holds the drive's torque
    t = np.arange(0.0, 20.0, 1e-3)
    phase = np.mod(t, 2.0)
    ramp = np.interp(phase, [0.0, 0.1, 0.9, 1.0], [0.0, 1.0, 1.0, 0.0])
    omega = np.where(phase < 1.0, 20.0 * (1.0 + 0.5 * np.floor(t / 2.0) / 10.0) * ramp, 0.0)
    theta, alpha = np.cumsum(omega) * 1e-3, np.gradient(omega, t)
    torque = 1e-3 * alpha + np.where(phase < 1.0, 0.3 + load, 0.1) + 1e-3 * omega
    torque += 1e-3 * np.random.default_rng(1).standard_normal(t.size)
    design = Design.from_dict({"name": "made", "motor": {"J": 1e-3, "K_t": 1.0}})
    design = design.with_effect("coulomb", {"F_c": 0.3}).with_effect("viscous", {"F_v": 1e-3})
    record = make_record(design, Log({"t": t, "theta": theta, "omega": omega, "torque": torque}))
    assert record.dry == pytest.approx(0.3 + load, rel=0.02)


def shaken(rate: float, half: float, mean: bool) -> tuple[Log, np.ndarray, Design]:
    """Return a log of a shaft that torque steps of four levels of friction turn to and fro, its friction and design.

    Exact but for steps of 20 us. The friction is the mean of each sample, over its level of 0.01 N m; the torque, if
    `mean`, that of the period before.
    """
    fine, inertia, level = 2e-5, 4e-6, 0.01
    steps = round(1.0 / rate / fine)
    t = np.arange(round(8.0 / fine)) * fine
    # halves of the swing that are uneven, so that steps and reversals fall anywhere between the samples
    ends = np.cumsum(half * (1.0 + 0.2 * np.sin(np.arange(round(10.0 / half)))))
    drive = 4.0 * level * np.where(np.searchsorted(ends, t) % 2, -1.0, 1.0)
    omega, theta, friction = np.zeros(t.size), np.zeros(t.size), np.zeros(t.size)
    w = -4.0 * level / inertia * half / 2.0
    for k in range(1, t.size):
        friction[k] = level * np.sign(w)
        w += fine * (drive[k] - friction[k]) / inertia
        omega[k] = w
    theta = np.cumsum(omega) * fine
    at = np.arange(2 * steps, t.size - 2 * steps, steps)
    torques, frictions = np.cumsum(drive), np.cumsum(friction)
    logged = (torques[at] - torques[at - steps]) / steps if mean else drive[at]
    share = (frictions[at + steps // 2] - frictions[at - steps // 2]) / steps / level
    design = Design.from_dict({"name": "made", "motor": {"J": inertia, "K_t": 0.05}})
    design = design.with_effect("coulomb", {"F_c": level}).with_effect("viscous", {"F_v": 1e-6})
    return Log({"t": np.arange(at.size) / rate, "theta": theta[at], "torque": logged}), share, design


def off(found: np.ndarray, true: np.ndarray, rate: float) -> np.ndarray:
    """By how long each reversal is off, s, by the area of the friction around it."""
    turns = np.flatnonzero(np.diff(np.sign(true)) != 0)
    turns = turns[(turns > 20) & (turns < len(found) - 20)]
    true = true[: len(found)]
    return np.array([np.sum((found - true)[k - 3 : k + 5]) for k in turns]) / (2.0 * rate)


@pytest.mark.parametrize("half", [0.024, 0.04])
def test_turns_that_are_close_together(half: float) -> None:
    # 5 to 12 samples apart; followed two at a time, one of both was off by up to 8 ms
    log, share, design = shaken(250.0, half, mean=False)
    record = make_record(design, log)
    assert record.turning == 0.0
    wrong = np.abs(off(record.signals["direction"], share, 250.0))
    assert np.median(wrong) < 0.5e-3
    assert np.max(wrong) < 2e-3


def test_a_mean_of_the_torque_makes_no_reversal_late() -> None:
    log, share, design = shaken(250.0, 0.08, mean=True)
    usual = Processing(standstill=STANDSTILL)
    records = [make_record(design, log, usual, timing=DriveTiming(reversals=late)) for late in (0.0, 2e-3)]
    late, in_time = (np.median(np.abs(off(one.signals["direction"], share, 250.0))) for one in records)
    assert in_time < 0.1e-3 < 0.3e-3 < late
    np.testing.assert_array_equal(records[0].target, records[1].target)  # it has a column still

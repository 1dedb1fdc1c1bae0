"""The mean torque of a ripple of both currents, by a simulation of the d-axis, and what a diagnosis makes of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import StateSpace, lsim

from pmsm_ctrl.design import Design
from pmsm_ctrl.design_parts import LogMap
from pmsm_ctrl.diagnose import diagnose
from pmsm_ctrl.diagnose.refusal import Reason
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.balances import STANDSTILL, make_record
from pmsm_ctrl.regression.conditioning import Processing
from pmsm_ctrl.regression.reluctance import holds_ripple, logged_ripple_torques, ripple_torques
from tests.effort import seeds

Array = NDArray[np.float64]

R, L_D, L_Q, P, PSI_F = 0.65, 4.5e-3, 6.5e-3, 4, 0.18
J, F_C, F_V = 4e-3, 0.16, 1.1e-3
HOLD = 2e-3  # s between two steps of the reference
CURVES = ("viscous_power", "quadratic_drag", "stribeck", "rising_friction")


def design(L_q: float = L_Q) -> Design:
    motor = {"R": R, "L_d": L_D, "L_q": L_q, "p": P, "psi_f": PSI_F, "J": J}
    effects = [{"id": "coulomb", "F_c": F_C}, {"id": "viscous", "F_v": F_V}]
    return Design.from_dict({"name": "salient", "motor": motor, "effects": effects})


def drag_of_ripple(omega: float, ripple: float) -> float:
    """Mean braking torque, N m, of a square ripple of i_q, A, that omega L_q couples into the d-axis."""
    t = np.arange(0.0, 0.2, HOLD / 100.0)
    i_q = ripple * np.where((t / HOLD).astype(int) % 2, 1.0, -1.0)
    _, i_d, _ = lsim(StateSpace(-R / L_D, 1.0 / L_D, 1.0, 0.0), P * omega * L_Q * i_q, t, interp=False)
    settled = t > 0.1
    return float(-1.5 * P * (L_D - L_Q) * np.mean((i_d * i_q)[settled]))


def test_the_drag_grows_with_speed_and_with_the_square_of_the_ripple() -> None:
    one = drag_of_ripple(50.0, 0.5)
    assert one > 0.0
    assert drag_of_ripple(100.0, 0.5) == pytest.approx(2.0 * one, rel=1e-6)
    assert drag_of_ripple(-50.0, 0.5) == pytest.approx(-one, rel=1e-6)
    assert drag_of_ripple(50.0, 1.5) == pytest.approx(9.0 * one, rel=1e-6)


def log_of(seed: int, shown: float = 0.0, period: float = 2e-3, swings_at: float | None = None) -> tuple[Log, Array]:
    """Sines of the speed, a torque without the ripple's part, and that part.

    `shown` is the share of the ripple of i_q that the samples hold; the loops may swing at a speed, excited by the
    lines of an encoder.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 12.0, period)
    waves = [(60.0, 0.31, 0.3), (40.0, 0.83, 1.9)]
    omega, alpha, theta = np.zeros_like(t), np.zeros_like(t), np.zeros_like(t)
    for size, frequency, phase in waves:
        w = 2.0 * np.pi * frequency
        omega += size * np.sin(w * t + phase)
        alpha += size * w * np.cos(w * t + phase)
        theta -= size / w * np.cos(w * t + phase)
    ripple, wave = 0.002 * alpha + 0.05 * omega, np.where((t / HOLD).astype(int) % 2, 1.0, -1.0)
    if swings_at is not None:
        ripple, wave = 6.0 / np.hypot(1.0, (np.abs(omega) - swings_at) / 20.0), np.sin(np.pi * t / HOLD)
    drag = drag_of_ripple(1.0, 1.0) * omega * ripple**2
    torque = J * alpha + F_C * np.sign(omega) + F_V * omega + drag
    samples = shown * 1.5 * P * PSI_F * ripple * wave
    return Log({"t": t, "theta": theta, "torque": torque + samples + rng.normal(0.0, 2e-4, len(t))}), drag


def test_its_terms_span_the_drag_of_a_held_reference() -> None:
    log, drag = log_of(1)
    record = make_record(design(), log, Processing(standstill=STANDSTILL, cutoff=40.0))
    columns = np.array(ripple_torques(record)).T
    inside = slice(250, -250)  # the filter's ends
    factors, left, *_ = np.linalg.lstsq(columns[inside], drag[inside], rcond=None)
    assert np.all(factors >= 0.0)
    assert float(left[0]) < 1e-4 * float(drag[inside] @ drag[inside])
    current = float(np.max(np.abs(record.target[0][record.mask]))) / (1.5 * P * PSI_F)
    fastest = 1.5 * P * (L_Q - L_D) * current**2
    assert np.max(np.abs(columns[:, 2])) == pytest.approx(fastest, rel=1e-3), "a ripple as large as the largest current"
    assert ripple_torques(replace(record, design=design(L_D))) == []


@pytest.mark.parametrize("shown", [1.0, 0.1])
def test_it_follows_from_what_the_log_shows_of_the_ripple(shown: float) -> None:
    log, drag = log_of(1, shown, period=0.5e-3)
    assert holds_ripple(log)
    record = make_record(design(), log, Processing(standstill=STANDSTILL, cutoff=40.0))
    seen, there = np.array(logged_ripple_torques(record, log)).T, np.interp(record.prepared.t, log.t, drag)
    factors, *_ = np.linalg.lstsq(seen, there, rcond=None)
    inside = slice(500, -500)
    assert float(np.sum((there - seen @ factors)[inside] ** 2)) < 1e-2 * float(there[inside] @ there[inside])
    assert 0.0 < np.min(factors) <= np.max(factors) < 1.0, "less than a ripple as large as the largest current"


@pytest.mark.parametrize("seed", seeds(1, 2))
def test_loops_that_swing_at_a_speed_make_no_drag(seed: int) -> None:
    """World 10000071: their ripple has a peak over the speed, and follows no power of it."""
    log, _ = log_of(seed, 0.7, 0.5e-3, swings_at=40.0)
    found = diagnose(design(), log, plan=False, candidates=CURVES)
    assert not found.steps
    assert "like_ripple" in {one.refusal.reason.value for one in found.ranking if one.refusal is not None}


def test_instants_of_both_currents_hold_it() -> None:
    log, _ = log_of(1)
    log = Log(
        {"t": log.t, "theta": log["theta"], "i_q": log["torque"] / (1.5 * P * PSI_F), "i_d": np.zeros(len(log.t))}
    )
    for sampling, terms in (("unknown", 3), ("mean", 3), ("instant", 0)):
        stated = design().model_copy(update={"log": LogMap(sampling=sampling)})
        assert len(ripple_torques(make_record(stated, log))) == terms


@pytest.mark.slow
@pytest.mark.parametrize("seed", seeds(1, 2))
def test_a_salient_motor_has_no_drag_that_a_ripple_explains_as_well(seed: int) -> None:
    """Friction curves in clean logs of salient motors were this, and gone with L_d = L_q (worlds 720137, 740007)."""
    log, _ = log_of(seed)
    found = diagnose(design(), log, plan=False, candidates=CURVES)
    assert not found.steps
    reasons = {one.effect: one.refusal.reason for one in found.ranking if one.refusal is not None}
    assert Reason.LIKE_RIPPLE in (reasons["viscous_power"], reasons["quadratic_drag"])
    assert found.verdict != "consistent"
    assert diagnose(design(L_D), log, plan=False, candidates=CURVES).steps, "without saliency it is a drag"


@pytest.mark.parametrize("seed", seeds(1, 2))
@pytest.mark.parametrize("shown", seeds(0.0, 0.1))
def test_a_fast_log_tells_a_ripple_from_a_drag(seed: int, shown: float) -> None:
    """Two samples a millisecond: where they show no ripple, there is none (worlds 2500442, 2500277, 1901308)."""
    log, _ = log_of(seed, shown, period=0.5e-3)
    found = diagnose(design(), log, plan=False, candidates=CURVES)
    assert bool(found.steps) == (not shown)
    reasons = {one.refusal.reason for one in found.ranking if one.refusal is not None}
    assert (Reason.LIKE_RIPPLE in reasons) == bool(shown)

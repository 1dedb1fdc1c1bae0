"""What a sample is worth: less around edges faster than the sampling, and around reversals."""

from __future__ import annotations

import numpy as np
import pytest

from pmsm_ctrl.design import Design
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.balances import make_record
from pmsm_ctrl.regression.conditioning import Prepared, prepare
from pmsm_ctrl.regression.drive_timing import UNDELAYED
from pmsm_ctrl.regression.edges import edge_error, steep
from pmsm_ctrl.regression.joining import thinned
from pmsm_ctrl.regression.weights import at_given_rate, reversal_weight, torque_noise
from pmsm_ctrl.simulate import scenario, simulate


@pytest.fixture(scope="module")
def log(designs) -> Log:
    design = Design.read(designs / "seed_motor.toml")
    return simulate(design, scenario("triangle", design, speed=50.0, period=2.0, cycles=4.0), seed=1)


@pytest.fixture(scope="module")
def prepared(designs, log: Log) -> Prepared:
    return prepare(Design.read(designs / "seed_motor.toml"), log)


@pytest.mark.parametrize("height", [0.5, 2.0])
def test_an_edge_takes_the_weight_of_the_samples_that_it_rings_into(prepared: Prepared, height: float) -> None:
    t = prepared.t
    raw = np.sin(t) + 0.01 * np.random.default_rng(1).standard_normal(t.size)
    middle = 0.5 * (t[0] + t[-1])
    raw[t > middle] += height
    weight = steep(edge_error(raw, prepared))
    away = np.abs(t[prepared.keep] - middle)
    assert weight[away < 1.0 / prepared.cutoff].max() < (0.2 if height < 1.0 else 0.001)
    assert weight[away > 20.0 / prepared.cutoff].min() > 0.99


@pytest.mark.parametrize("times", [1, 3, 4])
def test_the_edges_of_a_long_log_are_told_a_few_samples_at_a_time(
    prepared: Prepared, times: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    random = np.random.default_rng(2)
    raw = 0.01 * random.standard_normal(times * prepared.t.size)
    for place in (len(raw) // 3, 700 * times + 1):
        raw[place:] += random.uniform(0.5, 2.0)
    at_once = edge_error(raw, prepared)
    monkeypatch.setattr("pmsm_ctrl.regression.edges.PART", 700)
    assert at_once.max() > 0.0
    assert edge_error(raw, prepared) == pytest.approx(at_once, rel=1e-9, abs=1e-12)


def test_an_edge_at_the_very_end_is_a_step_to_the_filter(prepared: Prepared) -> None:
    t = prepared.t
    raw = np.sin(t) + 0.01 * np.random.default_rng(3).standard_normal(t.size)
    raw[-1] += 2.0  # mirrored, what comes after it is higher by 4
    weight = steep(edge_error(raw, prepared))
    left = (t[-1] - t[prepared.keep]) * prepared.cutoff
    assert weight[left < 2.0].max() < 0.01
    assert weight[left > 20.0].min() > 0.99


def test_an_edge_of_a_fast_log_is_late_by_a_part_of_the_grid_alone(prepared: Prepared) -> None:
    """A log of eight times the rate places an edge eight times as well, beside a noise of the same density."""
    t, middle = prepared.t, 0.5 * (prepared.t[0] + prepared.t[-1])
    weights = []
    for times in (1, 8):
        fine = t[0] + np.arange(times * len(t)) / (times * prepared.rate)
        raw = np.sin(fine) + 0.01 * np.sqrt(times) * np.random.default_rng(1).standard_normal(len(fine))
        raw[fine > middle] += 0.5
        weights.append(steep(edge_error(raw, prepared)).min())
    assert weights[0] < 0.2 < 0.9 < weights[1]


def test_what_a_fast_log_resolves_is_no_edge() -> None:
    """A burst of 300 Hz lies above a quarter of the 1 kHz to which a log of 8 kHz is thinned, and not above its own."""
    t = np.arange(80_000) / 8000.0
    omega, alpha = 50.0 * np.sin(4.0 * t) + 80.0, 200.0 * np.cos(4.0 * t)
    burst = np.where(np.abs(t - 5.0) < 0.03, 0.2 * np.sin(2.0 * np.pi * 300.0 * t), 0.0)
    torque = 1e-3 * alpha + 0.1 + 1e-3 * omega + burst + 3e-3 * np.random.default_rng(1).standard_normal(len(t))
    design = Design.from_dict({"name": "axis", "motor": {"J": 1e-3, "K_t": 1.0}})
    record = make_record(design, Log({"t": t, "theta": 80.0 * t - 12.5 * np.cos(4.0 * t), "torque": torque}))
    assert record.weight[0][record.mask].min() > 0.9


def test_a_smooth_signal_keeps_its_weight(prepared: Prepared) -> None:
    raw = np.sin(prepared.t) + 0.01 * np.random.default_rng(2).standard_normal(prepared.t.size)
    assert steep(edge_error(raw, prepared)).min() > 0.95


def test_a_reversal_counts_the_less_the_more_friction_turns_there(log: Log, prepared: Prepared) -> None:
    signals = {**prepared.signals, "torque_meas": log["i_q"] * 1.032, "i_q_meas": log["i_q"]}
    noise = torque_noise(log, prepared, signals)
    turn = np.flatnonzero(np.diff(np.sign(prepared.signals["omega"])) != 0)
    away = np.min(np.abs(prepared.keep[:, None] - turn), axis=1) / prepared.rate
    at = [reversal_weight(prepared, signals, (level, 9e-5), noise) for level in (0.0, 0.02, 0.06)]
    assert (at[0] == 1.0).all()
    near = away < 0.5 / prepared.cutoff
    assert at[2][near].mean() < at[1][near].mean() < 0.5
    assert min(weight[away > 3.0 / prepared.cutoff].min() for weight in at) == 1.0


def test_weights_for_another_error_are_those_of_a_record_made_with_it(designs, log: Log) -> None:
    design = Design.read(designs / "seed_motor.toml")
    record, other = (make_record(design, log, wrong=wrong) for wrong in (0.02, 0.004))
    assert record.weighing is not None
    weight, mask = record.weighing.weights(0.004, 1.0)
    assert (weight < record.weight).any()
    np.testing.assert_array_equal(weight, other.weight)
    np.testing.assert_array_equal(mask, other.mask)


def test_a_channel_at_the_given_rate_is_the_same_in_parts(designs, monkeypatch: pytest.MonkeyPatch) -> None:
    design = Design.read(designs / "seed_motor.toml").replace(sensor={"log_divider": 4})
    log = simulate(design, scenario("triangle", design, speed=50.0, period=0.5, cycles=2.0), seed=2)
    thin = thinned(log)
    assert len(thin) < len(log)
    found = []
    for part in (10**9, 1000):
        monkeypatch.setattr("pmsm_ctrl.regression.weights.PART", part)
        found.append(at_given_rate(log, thin, UNDELAYED, prepare(design, thin), "i_q"))
    np.testing.assert_array_equal(*found)
    assert found[0][: len(log)] == pytest.approx(log["i_q"], abs=1e-6 * float(np.ptp(log["i_q"])))

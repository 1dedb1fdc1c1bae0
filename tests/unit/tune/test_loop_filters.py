"""Filters of the current reference in the loops: predicted, measured on the simulated drive, taken where they pay."""

import math
from dataclasses import replace

import control as ct
import numpy as np
import pytest

from pmsm_ctrl import Design
from pmsm_ctrl.design import Filter
from pmsm_ctrl.simulate.feedforward import observer_share
from pmsm_ctrl.tune import Specification, prove, tune
from pmsm_ctrl.tune.bench import Bench, multisine
from pmsm_ctrl.tune.delays import delays
from pmsm_ctrl.tune.margins import margins, response
from pmsm_ctrl.tune.observer import loop_with_observer
from pmsm_ctrl.tune.proof import OBSERVED
from pmsm_ctrl.tune.sampled import Cascade, frequencies, pi
from pmsm_ctrl.tune.speed import open_loop
from tests.effort import slow

FILTERS = (
    Filter(kind="notch", frequency=300.0, width=120.0, depth=20.0),
    Filter(kind="low_pass", frequency=900.0, order=1),
    Filter(kind="lead", frequency=200.0, phase=30.0),
)


NOTCH = {"kind": "notch", "frequency": 300.0, "width": 200.0}
LOW_PASS = {"kind": "low_pass", "frequency": 600.0}  # the test signal needs no lines close together


@pytest.fixture(scope="module")
def filtered(designs):
    """The reference motor without friction, and three filters."""
    design = Design.read(designs / "seed_motor.toml").replace_effects(()).replace(sensor={"current_noise": 0.0})
    loops = design.loops
    speed = loops.speed.model_copy(update={"filters": FILTERS})
    return design.model_copy(update={"loops": loops.model_copy(update={"speed": speed})})


def stiff_coupling(designs, k=3000.0, damping=0.01):
    """The geared axis with a stiffer shaft: its resonance, at 925 Hz, is ten times the crossover of the rigid axis."""
    design = Design.read(designs / "geared_resonant.toml")
    load, reduced = 2.0e-4, 1.0 / (1.0 / 2.0e-4 + 1.0 / 1.6e-4)
    spring = {"J_load": load, "k": k, "d": 2.0 * damping * math.sqrt(k * reduced)}
    return design.with_effect("compliance", spring)


def test_the_open_loop_is_plant_controller_and_filters(filtered):
    loops = filtered.loops
    cascade = Cascade.of(filtered, loops.current, loops.speed, loops.position, at=60.0)
    w = np.geomspace(20.0, 6000.0, 50)
    z = np.exp(1j * w * cascade.period)
    bare = cascade.speed_plant * ct.ss(pi(loops.speed.K_p, loops.speed.T_n, cascade.period))
    expected = response(bare, w)
    for one in FILTERS:
        theirs = ct.sample_system(
            ct.tf(np.trim_zeros(one.biquad.numerator, "f"), np.trim_zeros(one.biquad.denominator, "f")),
            cascade.period, "bilinear", prewarp_frequency=2.0 * math.pi * one.frequency,
        )  # fmt: skip
        expected = expected * theirs(z)
    np.testing.assert_allclose(response(open_loop(cascade, loops.speed), w), expected, rtol=1e-8)
    # The cascade that is simulated step by step has the same loop: S = 1/(1 + L) from what is added to what is sent.
    sent = response(cascade.with_gains(position=None).system(("i_q_add",), ("i_q_ref",)), w)
    passed = expected / response(bare, w)
    np.testing.assert_allclose(sent, passed / (1.0 + expected), rtol=1e-6)
    # The loop at the motor's current: position controller and observer ask through the same filters F, and the observer
    # sees the current behind them: F (1 - H) / (1 - F H) times the loop without, H = a / (z - 1 + a) from this current.
    a = observer_share(filtered, 50.0)
    known = a / (z - 1.0 + a)
    ratio = loop_with_observer(filtered, 50.0)
    bare_design = filtered.model_copy(
        update={"loops": loops.model_copy(update={"speed": loops.speed.model_copy(update={"filters": ()})})}
    )
    np.testing.assert_allclose(
        response(ratio, w) / response(loop_with_observer(bare_design, 50.0), w),
        passed * (1.0 - known) / (1.0 - passed * known),
        rtol=1e-6,
    )


@pytest.mark.parametrize(
    ("filters", "gain"),
    [((LOW_PASS,), 0.7), slow((), 1.0), slow((), 0.7), slow((NOTCH,), 1.0), slow((NOTCH,), 0.7)],
)
def test_the_proof_holds_the_loop_with_a_disturbance_observer(designs, filters, gain):
    """Without an observer of its own the proof failed by 5 deg; the prediction with filters was 3 to 5 deg off."""
    design = Design.read(designs / "seed_motor.toml")
    speed = {**design.loops.speed.model_dump(), "filters": list(filters)}
    observed = design.replace(
        loops={"speed": speed, "position": {"K_v": 0.0}},
        compensation={"source": "observer", "gain": gain, "bandwidth": 301.0},
    )
    proof = prove(observed)
    assert not proof.failed
    loop, alone = proof.loops[OBSERVED], proof.loops["speed"]
    assert loop.margins.phase_margin == pytest.approx(loop.predicted_margins.phase_margin, abs=0.3)
    assert loop.margins.crossover == pytest.approx(loop.predicted_margins.crossover, rel=0.005)
    assert loop.margins.phase_margin < alone.margins.phase_margin - 4.0
    assert {check.subject for check in proof.checks} >= {"speed loop", OBSERVED}


@pytest.mark.slow
def test_the_simulated_drive_has_the_loop_that_is_predicted(filtered):
    loops, speed = filtered.loops, 60.0
    cascade = Cascade.of(filtered, loops.current, loops.speed, at=speed)
    signal = multisine(cascade.period, 20.0, 1500.0)
    signal = replace(signal, periods=4)
    ideal = filtered.replace(sensor={"encoder_counts": 0})
    frequency, found = Bench(ideal, ideal, speed).measure_loop("speed", signal, 0.1)
    expected = response(open_loop(cascade, loops.speed), 2.0 * math.pi * frequency)
    # what is measured is 1 + L, so that its errors count beside that
    assert np.abs((found - expected) / (1.0 + expected)).max() < 3e-4


def test_the_delay_of_a_filter_is_a_small_time_constant(filtered):
    found = delays(filtered, filtered.loops.current, FILTERS)
    slow = 1e-4 / filtered.drive.speed_period  # rad/s
    z = np.exp(1j * slow * filtered.drive.speed_period)
    lag = -sum(np.angle(one.biquad.sampled_at(z, filtered.drive.speed_period)) for one in FILTERS) / slow
    assert found.current_filters == pytest.approx(lag, rel=1e-6)
    assert found.speed - delays(filtered, filtered.loops.current).speed == pytest.approx(lag, rel=1e-6)
    assert "filters of the current" in found.explain_speed()


def test_the_peak_of_a_narrow_resonance_is_not_stepped_over(designs):
    design = stiff_coupling(designs, damping=1e-3)
    cascade = Cascade.of(design, design.loops.current, at=40.0)
    loop = open_loop(cascade, design.loops.speed.model_copy(update={"K_p": 0.01, "T_n": 0.1}))
    coarse = frequencies(cascade.period, 1e-3, 400)
    fine = 2.0 * math.pi * np.linspace(915.0, 935.0, 4001)
    truth = np.abs(1.0 / (1.0 + response(loop, fine))).max()
    assert np.abs(1.0 / (1.0 + response(loop, coarse))).max() < 0.95 * truth
    assert margins(loop, coarse).sensitivity_peak == pytest.approx(truth, rel=0.02)


@pytest.mark.slow
def test_a_filter_is_taken_where_it_pays_and_keeps_its_promise(designs):
    """Rigid gains are unstable on this axis; without a filter the loop is three times slower."""
    design = stiff_coupling(designs)
    found = tune(design)
    bare = tune(design, Specification(filters=False), prove=False)
    (one,) = found.loops.speed.filters
    assert one.kind == "notch"
    assert one.frequency == pytest.approx(found.resonance.resonance)
    assert found.resonance.unfiltered == pytest.approx(bare.margins["speed"].crossover, rel=1e-3)
    assert found.margins["speed"].crossover > 2.0 * bare.margins["speed"].crossover
    assert found.stiffness.position_dynamic > 3.0 * bare.stiffness.position_dynamic
    assert found.defended
    assert not bare.loops.speed.filters
    # The resonance a tenth away, the load's inertia 15 % off.
    for apart, there in found.resonance.moved.items():
        assert not found.requirements.missed(there), apart
    # On a drive whose spring is softer than the design's the loop runs as it is predicted for that.
    softer = stiff_coupling(designs, k=2400.0).model_copy(update={"loops": found.loops})
    proof = prove(softer, speed=found.cascade.model.point.speed)
    assert proof.passed
    text = found.summary(width=1000)
    assert "A filter of the current reference is part of the loop: notch 924.6 Hz" in text
    assert found.to_dict()["resonance"]["used"]["kind"] == "notch"


@pytest.mark.slow
def test_over_all_tolerances_the_geared_axis_takes_its_notch(designs):
    found = tune(Design.read(designs / "geared_resonant.toml"), Specification(robust=True), prove=False)
    assert found.loops.speed.filters
    assert not found.robustness.missed
    assert found.margins["speed"].crossover > 1.1 * found.resonance.unfiltered

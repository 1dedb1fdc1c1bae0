"""Output error in open loop: the axis alone, driven by the logged torque, from motion and current alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import butter, lfilter

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose import diagnose, polish
from pmsm_ctrl.diagnose.adding import added
from pmsm_ctrl.errors import LogError
from pmsm_ctrl.identify import identify
from pmsm_ctrl.identify.open_loop import open_loop
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.filters import low_pass
from pmsm_ctrl.simulate import scenario, simulate
from tests.effort import seeds, slow

TRUE = {"J": 9e-5, "F_c": 0.0213, "F_v": 0.000168}


@pytest.fixture(scope="module")
def design(designs: Path) -> Design:
    return Design.read(designs / "seed_motor.toml")


@pytest.fixture(scope="module")
def believed(design: Design) -> Design:
    """Everything off by 30 %."""
    off = design.with_parameters(J=1.3 * TRUE["J"]).with_effect("coulomb", {"F_c": 0.7 * TRUE["F_c"]})
    return off.with_effect("viscous", {"F_v": 1.3 * TRUE["F_v"]})


def recorded(design: Design, seed: int, truth: Design | None = None) -> Log:
    """A log without references, as a recorder beside the drive has it."""
    log = simulate(design, scenario("triangle", design, speed=150.0, period=2.0), truth=truth, seed=seed)
    return Log({name: log[name] for name in ("t", "theta", "i_q")})


@pytest.mark.parametrize("seed", seeds(1, 2, 4))
def test_a_log_without_references(design: Design, believed: Design, seed: int) -> None:
    result = identify(believed, recorded(design, seed), method="output_error")
    assert [note.code for note in result.remarks] == ["open_loop"]
    assert "Simulation of the axis" in result.summary()
    assert result.improved
    for name, true in TRUE.items():
        estimate = result.estimates[name]
        assert abs(estimate.value - true) < 3.5 * estimate.stderr, name
        assert estimate.stderr < 0.03 * true
    assert result.estimates["J"].nominal == believed.J


def test_several_logs_and_a_plain_axis(design: Design, believed: Design) -> None:
    plain = Design.from_dict({"name": "plain", "motor": {"J": 1.1e-4, "K_t": design.K_t}})
    plain = plain.with_effect("coulomb", {"F_c": 0.03}).with_effect("viscous", {"F_v": 1e-4})
    logs = [recorded(design, seed) for seed in (11, 12)]
    one = identify(plain, logs[0], method="output_error")
    both = identify(plain, logs, method="output_error")
    assert len(both.records) == 2
    for name, true in TRUE.items():
        assert abs(both.estimates[name].value - true) < 3.5 * both.estimates[name].stderr, name
    assert both.estimates["J"].stderr < one.estimates["J"].stderr


def test_a_bristle_with_all_of_its_parameters(design: Design) -> None:
    """Its simulation is corrected at every sample; the inertia is that of the regression."""
    bristle = {"z_s": 0.004, "z_b": 0.5, "tau_z": 1e-3}
    start = design.with_effect("presliding", {"z_s": 0.003, "z_b": 0.4, "tau_z": 1.5e-3})
    motion = scenario("triangle", design, speed=20.0, period=0.5, cycles=5.0)
    quiet = design.replace(sensor={"encoder_counts": 0, "current_noise": 1e-3})
    log = simulate(start, motion, truth=quiet.with_effect("presliding", bristle), seed=1)
    result = identify(start, Log({name: log[name] for name in ("t", "theta", "i_q")}), method="output_error")
    for name, true in {**TRUE, **bristle}.items():
        assert abs(result.estimates[name].value - true) < 3.5 * result.estimates[name].stderr, name
    assert result.estimates["z_s"].stderr < 0.2 * bristle["z_s"]


@pytest.mark.slow
def test_the_shape_of_an_effect(design: Design) -> None:
    stribeck = {"dF_s": 0.01, "w_s": 12.0, "delta": 2.0}
    truth = design.with_effect("stribeck", stribeck)
    start = design.with_effect("stribeck", {"dF_s": 0.006, "w_s": 20.0, "delta": 1.6})
    motion = scenario("triangle", design, speed=80.0, period=6.0, cycles=2.0)
    log = simulate(start, motion, truth=truth, seed=1)
    result = identify(start, Log({name: log[name] for name in ("t", "theta", "i_q")}), method="output_error")
    for name, true in {**stribeck, "F_c": TRUE["F_c"]}.items():
        assert abs(result.estimates[name].value - true) < 3.5 * result.estimates[name].stderr, name
    assert result.estimates["w_s"].stderr < 3.0


@pytest.mark.slow
def test_noise_of_the_torque_sets_the_standard_error(design: Design) -> None:
    """White noise of the torque on a known motion: no estimate of a mean knows it better than sigma / sqrt(n)."""
    t = np.arange(20000) / 1000.0
    omega = 40.0 + 30.0 * np.sin(2.0 * t)  # one direction: friction is a constant
    torque = 1e-4 * 60.0 * np.cos(2.0 * t) + 0.02 + 2e-4 * omega
    theta = 40.0 * t - 15.0 * (np.cos(2.0 * t) - 1.0)
    axis = Design.from_dict({"name": "made", "motor": {"J": 1.2e-4, "K_t": 1.0}, "log": {"sampling": "instant"}})
    axis = axis.with_effect("coulomb", {"F_c": 0.025}).with_effect("viscous", {"F_v": 1e-4})
    scores = []
    for seed in range(8):
        noise = 0.004 * np.random.default_rng([seed, 77]).normal(size=len(t))
        result = identify(axis, Log({"t": t, "theta": theta, "torque": torque + noise}), method="output_error")
        columns = np.column_stack([60.0 * np.cos(2.0 * t), np.ones(len(t)), omega])
        bound = 0.004 * np.sqrt(np.diag(np.linalg.inv(columns.T @ columns)))
        for name, true, least in zip(("J", "F_c", "F_v"), (1e-4, 0.02, 2e-4), bound, strict=True):
            estimate = result.estimates[name]
            assert 0.85 * least < estimate.stderr < 1.5 * least
            scores.append((estimate.value - true) / estimate.stderr)
    assert np.sqrt(np.mean(np.square(scores))) == pytest.approx(1.0, abs=0.45)


def moved_by_noise(seed: int, rms: float) -> Log:
    """A log of an axis that noise of its current sensor turns against the logged torque, above a loop of 25 Hz."""
    rng, period = np.random.default_rng([seed, 91]), 1e-3
    t = period * np.arange(12000)
    levels = np.repeat(rng.uniform(20.0, 60.0, 16), 750)
    alpha = low_pass(np.gradient(low_pass(levels, 1e3, 5.0)) / period, 1e3, 20.0)
    noise = rms * rng.standard_normal(len(t))
    moved = alpha - lfilter(*butter(1, 25.0, "high", fs=1e3), noise) / TRUE["J"]
    omega = levels[0] + period * np.cumsum(moved)
    theta = period * (np.cumsum(omega) - 0.5 * omega)
    torque = TRUE["J"] * moved + TRUE["F_c"] + TRUE["F_v"] * omega
    return Log({"t": t, "theta": theta, "torque": torque + noise})


@pytest.mark.parametrize("seed", seeds(10, 30, 50))
@pytest.mark.parametrize("count", [1, slow(2)])
def test_noise_that_moves_the_axis_does_not_bias_the_inertia(seed: int, count: int) -> None:
    """Of one log and of several: least squares is off by many standard errors, always to the same side."""
    axis = Design.from_dict({"name": "made", "motor": {"J": 1.1e-4, "K_t": 1.0}})
    axis = axis.with_effect("coulomb", {"F_c": 0.025}).with_effect("viscous", {"F_v": 1e-4})
    scores = []
    for first in range(seed, seed + 4 * count, count):
        logs = [moved_by_noise(number, 3e-3) for number in range(first, first + count)]
        found = identify(axis, logs, method="output_error").estimates["J"]
        scores.append((found.value - TRUE["J"]) / found.stderr)
    assert abs(np.mean(scores)) < 1.5, scores
    assert np.sqrt(np.mean(np.square(scores))) < 2.0, scores


NOISY_DRIVE = pytest.mark.xfail(
    reason="noise of the logged torque swings the simulated spring at its resonance of 131 Hz; a fit takes that down "
    "by damping and by the sampling's variance: with 2 mA of noise k is 33 in place of 15, at 4 mA it does not converge"
)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("k", "noise", "least"),
    # the regression alone was off by more than 0.4 at 15 N m/rad as well, while edges counted next to nothing
    [(18.0, 0.0, 0.4), (15.0, 0.0, 0.15), pytest.param(15.0, 4e-3, 0.4, marks=NOISY_DRIVE)],
)
def test_a_spring_is_polished_where_left_out_stretches_gain(
    design: Design, k: float, noise: float, least: float
) -> None:
    spring = {"J_load": 4e-5, "k": k, "d": 2e-3}
    sensed = design.replace(sensor={"current_noise": noise})
    motion = scenario("identification", sensed, duration=12.0)
    log = simulate(sensed, motion, truth=sensed.with_effect("compliance", spring), seed=7)
    plain = added(sensed, log, "compliance")
    better = added(sensed, log, "compliance", polish=True)
    assert "polished" in [notice.code for notice in better.remarks]
    assert better.parameters["k"].value == better.design.parameters("compliance")["k"]
    off = [abs(one.parameters["k"].value / spring["k"] - 1.0) for one in (plain, better)]
    assert off[1] < 0.1 < least < off[0]


def test_what_gains_nothing_stays(design: Design, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(polish, "SURE", 100.0)  # no gain is sure
    log = simulate(design, scenario("triangle", design, speed=150.0, period=2.0), seed=3)
    plain, polished = (
        diagnose(design, log, candidates=("stribeck",), plan=False, polish=wanted) for wanted in (False, True)
    )
    assert [note.code for note in polished.remarks] == ["not_polished"]
    assert polished.design == plain.design
    assert polished.to_dict()["notes"] == [note.text for note in polished.remarks]


def test_a_log_with_holes_alone_cannot_be_simulated(design: Design) -> None:
    log = recorded(design, 1)
    kept = np.arange(len(log)) % 500 > 20
    with pytest.raises(LogError, match="without gaps"):
        open_loop(design, Log({name: values[kept] for name, values in log.channels.items()}))

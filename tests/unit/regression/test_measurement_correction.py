"""Measurement effects of the design are taken out of a log before its balances are made."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl import Design
from pmsm_ctrl.compare import compare
from pmsm_ctrl.frf import frf
from pmsm_ctrl.identify import evaluate_sweep, identify
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.balances import make_record
from pmsm_ctrl.regression.measurement_correction import undone
from pmsm_ctrl.simulate import scenario, simulate
from tests.effort import amount, seeds
from tests.unit.simulate.composed import DELAYED, TERMS, simulate_composed

KNOWN = {
    "delay": {"tau": 1e-3},
    "current_offset": {"o_alpha": 0.012, "o_beta": -0.008},
    "current_gain": {"g": 0.0, "g_c": 0.02, "g_s": 0.015},
    "encoder_eccentricity": {"e_s": 2e-3, "e_c": 1e-3},
}


@pytest.fixture(scope="module")
def design(project_root: Path) -> Design:
    return Design.read(project_root / "designs" / "seed_motor.toml")


def spoiled(design: Design, effect: str, seed: int) -> tuple[Design, Log]:
    truth = design.with_effect(effect, KNOWN[effect])
    # two kernels that other tests have compiled as well
    composed = DELAYED if effect == "delay" else TERMS
    motion = scenario("identification", design, duration=15.0)
    return truth, simulate_composed(design, motion, truth, composed=composed, seed=seed)


def test_a_delay_is_undone_exactly(design: Design) -> None:
    t = np.arange(0.0, 1.0, 1e-3)
    wave = lambda at: np.sin(2.0 * np.pi * 20.0 * at)  # noqa: E731
    channels = {"theta": 3.0 * t, "i_q": wave(t - 0.0023), "i_d": np.zeros_like(t)}
    now, notes = undone(design.with_effect("delay", {"tau": 0.0023}), t, channels)
    inside = slice(10, -10)
    assert notes == ()
    assert now["i_q"][inside] == pytest.approx(wave(t)[inside], abs=1e-5)
    assert now["theta"] == pytest.approx(channels["theta"], abs=0.0)


def test_offsets_are_those_of_the_phases(design: Design) -> None:
    # Clarke and Park by hand: an offset of one ampere along phase a is i_d at zero angle, and -i_q a quarter turn on
    assert design.motor.p is not None
    t = np.arange(4) * 1e-3
    theta = np.array([0.0, 0.5, 1.0, 1.5]) * np.pi / design.motor.p
    channels = {"theta": theta, "i_d": np.array([1.0, 0.0, -1.0, 0.0]), "i_q": np.array([0.0, -1.0, 0.0, 1.0])}
    now, _ = undone(design.with_effect("current_offset", {"o_alpha": 1.0, "o_beta": 0.0}), t, channels)
    assert now["i_d"] == pytest.approx(np.zeros(4), abs=1e-12)
    assert now["i_q"] == pytest.approx(np.zeros(4), abs=1e-12)


def test_what_cannot_be_undone_is_said(design: Design) -> None:
    t = np.arange(4) * 1e-3
    channels = {"omega": np.ones(4), "torque": np.ones(4)}
    now, notes = undone(design.with_effect("current_offset", {"o_alpha": 1.0, "o_beta": 0.0}), t, channels)
    assert now["torque"] == pytest.approx(channels["torque"])
    assert [note.code for note in notes] == ["measurement_effect_left_in"]
    assert notes[0].text.startswith("current_offset is not corrected")


def test_sweep_and_frequency_response_say_it_as_well(design: Design) -> None:
    known = design.with_effect("current_offset", {"o_alpha": 0.01, "o_beta": 0.0})
    for verb, motion in ((evaluate_sweep, "sweep"), (frf, "identification")):
        log = simulate(design, motion, seed=3)
        torque = 1.5 * design.motor.p * design.motor.psi_f * log["i_q"]
        logged = {name: values for name, values in log.channels.items() if name not in ("i_d", "i_q")}
        codes = {
            name: [note.code for note in verb(known, one).notices]
            for name, one in (("torque", Log({**logged, "torque": torque})), ("currents", log))
        }
        assert "measurement_effect_left_in" in codes["torque"]
        assert "measurement_effect_left_in" not in codes["currents"]


@pytest.mark.parametrize("effect", seeds("delay", "encoder_eccentricity", "current_offset", "current_gain"))
def test_identification_and_comparison_know_it(design: Design, effect: str) -> None:
    for seed in range(1, 1 + amount(1, 2)):
        truth, log = spoiled(design, effect, seed)
        found = identify(truth, log)
        assert found.notices == ()
        for name, value in {"J": truth.J, "F_c": 0.0213, "F_v": 1.68e-4}.items():
            estimate = found.estimates[name]
            assert abs(estimate.value - value) < 4.0 * estimate.stderr, name
        # a small delay is sampling unless the log says how it was sampled
        told = (known.replace(log={"sampling": "instant"}) for known in (truth, design))
        with_it, without = (compare(known, log).log.errors["torque"] for known in told)
        assert with_it.rms < without.rms
        assert with_it.rms < 1.03 * with_it.floor


def test_a_known_scale_of_the_current_is_taken_off(design: Design) -> None:
    """No column has it, as no torque tells it from the torque constant: it was left out without a word."""
    truth = design.with_effect("current_gain", {"g": 0.1, "g_c": 0.0, "g_s": 0.0})
    log = simulate(truth, "identification", seed=3)
    with_it, without = (compare(known, log).log.errors["torque"] for known in (truth, design))
    assert with_it.rms < 1.03 * with_it.floor
    assert without.rms > 2.0 * with_it.rms
    found = identify(truth, log)
    assert found.notices == ()
    assert found.estimates["J"].value == pytest.approx(truth.J, rel=0.005)


def test_a_known_delay_leaves_the_reversals_where_they_are(design: Design) -> None:
    truth, late = spoiled(design, "delay", 1)
    steps, inside = round(KNOWN["delay"]["tau"] / late.period), slice(1000, -1000)
    ahead = {name: np.append(late[name][steps:], np.full(steps, late[name][-1])) for name in ("i_d", "i_q")}
    logs = {"known": (truth, late), "in time": (design, late.with_channels(**ahead)), "left in": (design, late)}
    turning = {name: make_record(*one).signals["direction"][inside] for name, one in logs.items()}
    assert turning["known"] == pytest.approx(turning["in time"], abs=1e-3)
    assert np.max(np.abs(turning["known"] - turning["left in"])) > 0.5

"""Samples that no shaft can produce are named with their place; a clean motion raises no doubt."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pmsm_ctrl.design import Design
from pmsm_ctrl.importers import check
from pmsm_ctrl.importers.lost import freezes, jumps, lost_samples, spikes
from pmsm_ctrl.log import Log

T = np.arange(3000) * 1e-3
OMEGA = 80 * np.sin(2 * np.pi * 0.7 * T) + 30 * np.sin(2 * np.pi * 2.1 * T + 1)
# the closed-form integral
THETA = -80 / (1.4 * np.pi) * np.cos(2 * np.pi * 0.7 * T) - 30 / (4.2 * np.pi) * np.cos(2 * np.pi * 2.1 * T + 1)


def record(rng: np.random.Generator, **changed: np.ndarray) -> Log:
    i_q = 0.1 * np.sign(OMEGA) + rng.normal(0, 0.004, T.size)
    return Log({"t": T, "theta": THETA, "omega": OMEGA, "i_q": i_q} | changed)


@pytest.fixture
def design(designs) -> Design:
    return Design.read(designs / "seed_motor.toml")


def test_a_clean_motion_raises_no_doubt(rng: np.random.Generator) -> None:
    assert lost_samples(record(rng)) == []
    counts = 2 * np.pi / 1000  # a coarse encoder, so that most steps are one count or none
    assert lost_samples(record(rng, theta=np.round(THETA / 20 / counts) * counts, omega=OMEGA / 20)) == []


@pytest.mark.parametrize("height", [2 * math.pi, -2 * math.pi, 1e4])
def test_a_position_that_jumps(rng: np.random.Generator, height: float) -> None:
    log = record(rng, theta=THETA + height * (T > 1.5))
    at, found = jumps(log.t, log["theta"])
    assert at.tolist() == [1500]
    assert found[0] == pytest.approx(height, abs=0.12)  # less what the shaft moves in a sample
    (found,) = lost_samples(log)
    assert (found.code, found.detail["at"]) == ("position_jumps", pytest.approx(1.501))


def test_a_gap_in_time_is_no_jump(rng: np.random.Generator) -> None:
    keep = (T < 1.2) | (T > 1.6)
    log = Log({name: values[keep] for name, values in record(rng).channels.items()})
    assert lost_samples(log) == []


@pytest.mark.parametrize(("turn", "words"), [(2 * math.pi / 4, "pole pairs, p = 4"), (3.0, "it may wrap there")])
def test_an_angle_that_wraps_elsewhere(rng: np.random.Generator, design: Design, turn: float, words: str) -> None:
    log = record(rng, theta=np.mod(THETA, turn))
    wraps = np.count_nonzero(np.diff(np.floor(THETA / turn)))
    at, height = jumps(log.t, log["theta"])
    # where the axis turns round just at the wrap, the neighbours are as large
    assert wraps - 3 <= at.size <= wraps
    assert np.median(np.abs(height)) == pytest.approx(turn, rel=1e-2)
    (found,) = lost_samples(log, design)
    assert words in found.text
    assert found in check(log, design)


@pytest.mark.parametrize("samples", [1, 2, 3])
def test_a_speed_that_spikes(rng: np.random.Generator, samples: int) -> None:
    omega = OMEGA.copy()
    omega[700 : 700 + samples] += 300.0
    assert spikes(omega).tolist() == [700]
    (found,) = lost_samples(record(rng, omega=omega))
    assert (found.code, found.detail["at"]) == ("speed_spikes", pytest.approx(0.7))


def test_a_step_of_the_speed_is_no_spike() -> None:
    assert spikes(np.where(T > 1.0, 50.0, 0.0)).size == 0
    assert spikes(np.zeros(100)).size == 0
    assert spikes(np.where(np.arange(3000) % 2, 50.0, -50.0)).size == 0  # alternating is not lost, it is another thing


def frozen(i_q: np.ndarray, *stretches: tuple[int, int]) -> np.ndarray:
    held = i_q.copy()
    for start, samples in stretches:
        held[start : start + samples + 1] = held[start]
    return held


def test_a_channel_that_freezes(rng: np.random.Generator) -> None:
    log = record(rng)
    held = frozen(log["i_q"], (1000, 100))
    assert freezes(held, log["omega"]) == [(1000, 100)]
    (found,) = lost_samples(record(rng, i_q=held))
    assert found.code == "frozen_channel"
    assert (found.detail["duration"], found.detail["at"]) == (pytest.approx(0.1), pytest.approx(1.0))


@pytest.mark.parametrize("samples", [300, 1200, 1999])
def test_a_channel_that_freezes_for_long(rng: np.random.Generator, samples: int) -> None:
    (found,) = lost_samples(record(rng, i_q=frozen(record(rng)["i_q"], (1000, samples))))
    assert (found.code, found.detail["count"]) == ("frozen_channel", 1)
    assert found.detail["duration"] == pytest.approx(samples * 1e-3)


def test_a_channel_that_freezes_several_times(rng: np.random.Generator) -> None:
    (found,) = lost_samples(record(rng, i_q=frozen(record(rng)["i_q"], (400, 100), (1200, 300), (2000, 500))))
    assert (found.detail["count"], found.detail["total"]) == (3, pytest.approx(0.9))
    assert "for 0.1 s from t = 0.4 s; 3 times, 0.9 s in all" in found.text


def test_what_rests_or_is_held_or_coarse_or_switched_off_is_not_frozen(rng: np.random.Generator) -> None:
    i_q = record(rng)["i_q"]
    assert lost_samples(record(rng, i_q=np.round(i_q, 2))) == []
    assert lost_samples(record(rng, i_q=0.1 * np.sign(OMEGA))) == []  # a command
    assert lost_samples(record(rng, i_q=np.where(T < 2.0, i_q, 0.0))) == []  # the axis coasts
    rests = np.where(T < 2.0, OMEGA, rng.normal(0.0, 0.01, T.size))
    assert lost_samples(record(rng, omega=rests, i_q=frozen(i_q, (2000, 999)))) == []


@pytest.mark.parametrize("samples", [4, 10, 30])
@pytest.mark.parametrize("channel", ["i_q", "theta", "omega"])
def test_a_channel_that_is_held_was_recorded_at_a_lower_rate(
    rng: np.random.Generator, channel: str, samples: int
) -> None:
    values = record(rng)[channel][samples * (np.arange(T.size) // samples)]
    (found,) = [notice for notice in lost_samples(record(rng, **{channel: values})) if "jump" not in notice.code]
    assert (found.code, found.detail["channel"], found.detail["periods"]) == ("held_channel", channel, samples)


def test_a_command_of_a_speed_loop_is_no_held_channel(rng: np.random.Generator) -> None:
    assert lost_samples(record(rng, i_q=record(rng)["i_q"][2 * (np.arange(T.size) // 2)])) == []
    log = record(rng, i_q=record(rng)["i_q"][8 * (np.arange(T.size) // 8)])
    assert lost_samples(log.with_channels(t=0.125 * T)) == []  # 1 ms, at 8 kHz


@pytest.mark.parametrize("scenario", ["sweep", "chirp", "reversal", "positioning"])
def test_simulated_motions_raise_no_doubt(designs, scenario: str) -> None:
    from pmsm_ctrl.simulate import simulate

    design = Design.read(designs / "seed_motor.toml")
    assert lost_samples(simulate(design, scenario), design) == []

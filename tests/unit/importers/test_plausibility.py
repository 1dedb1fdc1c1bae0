"""Plausibility: a good log raises no doubt, each lie is named with its factor."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl.design import Design
from pmsm_ctrl.importers import check, read_log
from pmsm_ctrl.importers.notices import FEW_SAMPLES
from pmsm_ctrl.importers.plausibility import torque_factor
from pmsm_ctrl.importers.relations import drive_balance
from pmsm_ctrl.importers.timebase import growing_steps, longest_run, quantum, saturated_share, time_base
from pmsm_ctrl.log import Log

J, F_C, F_V, K_T = 9e-5, 0.0213, 0.000168, 1.032
SI_FACTOR_RPM = 0.10471975511965977


@pytest.fixture(scope="module")
def design() -> Design:
    return Design.from_dict({
        "motor": {"J": J, "p": 4, "psi_f": 0.172, "R": 19.0, "L_d": 0.049, "L_q": 0.049},
        "drive": {"i_max": 3.0},
    })  # fmt: skip


def axis(rng: np.random.Generator, n: int = 8000, period: float = 1e-3) -> dict[str, np.ndarray]:
    """A moving axis by closed form: theta, its exact derivatives, and the torque they need."""
    t = np.arange(n) * period
    theta = 40.0 * (1 - np.cos(2 * np.pi * 0.5 * t)) + 3.0 * np.sin(2 * np.pi * 3 * t)
    omega = 40.0 * np.pi * np.sin(np.pi * t) + 18 * np.pi * np.cos(6 * np.pi * t)
    alpha = 40.0 * np.pi**2 * np.cos(np.pi * t) - 108 * np.pi**2 * np.sin(6 * np.pi * t)
    torque = J * alpha + F_C * np.sign(omega) + F_V * omega
    current = torque / K_T + rng.normal(0, 0.004, n)
    step = 2 * np.pi / 131072
    return {"t": t, "theta": np.round(theta / step) * step, "omega": omega + rng.normal(0, 0.3, n), "i_q": current}


def test_a_good_log_raises_no_doubt(rng: np.random.Generator, design: Design) -> None:
    channels = axis(rng)
    assert check(Log(channels), design) == ()
    assert check(Log(channels)) == ()
    torque = K_T * channels["i_q"] + rng.normal(0, 0.001, 8000)
    assert check(Log(channels | {"torque": torque, "omega_ref": channels["omega"]}), design) == ()


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (1.99, "1.99 times omega"),
        (1.66, "1.66 times omega"),
        (SI_FACTOR_RPM, "omega looks like rpm read as rad/s"),
        (1 / SI_FACTOR_RPM, "omega looks like rad/s read as rpm"),
        (-1.0, "opposite signs"),
        (0.25, "omega looks electrical (p = 4)"),
        (math.pi / 180, "omega looks like deg/s read as rad/s"),
    ],
)
def test_speed_against_position(rng: np.random.Generator, design: Design, factor: float, words: str) -> None:
    channels = axis(rng)
    found = check(Log(channels | {"omega": channels["omega"] / factor}), design)
    assert any(words in warning.text for warning in found), found
    value = found[0].detail["factor"]
    assert found[0].code == "speed_factor"
    assert value == pytest.approx(factor, rel=0.005)


def test_unrelated_speed(rng: np.random.Generator) -> None:
    channels = axis(rng)
    found = check(Log(channels | {"omega": channels["omega"][::-1] ** 2}))
    assert any("omega is not proportional to dtheta/dt" in warning.text for warning in found)


def test_speed_against_reference_without_position(rng: np.random.Generator) -> None:
    channels = axis(rng)
    del channels["theta"]
    found = check(Log(channels | {"omega_ref": channels["omega"] * SI_FACTOR_RPM}))
    assert any("omega looks like rpm read as rad/s" in warning.text for warning in found), found


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (math.sqrt(2), "i_q looks like A rms read as A peak"),
        (1 / math.sqrt(2), "K_t looks like N m per A rms read as per A peak"),
        (1000.0, "a prefix milli was lost"),
        (1.3, "torque is 1.3"),
    ],
)
def test_torque_against_current(rng: np.random.Generator, design: Design, factor: float, words: str) -> None:
    channels = axis(rng)
    found = check(Log(channels | {"torque": factor * K_T * channels["i_q"]}), design)
    assert any("times K_t i_q" in warning.text and words in warning.text for warning in found), found


@pytest.mark.parametrize("without", ["theta", "omega"])
def test_torque_of_the_wrong_sign(rng: np.random.Generator, design: Design, without: str) -> None:
    channels = axis(rng)
    del channels[without]
    found = check(Log(channels | {"i_q": -channels["i_q"]}))
    assert any("i_q has the opposite sign of the acceleration" in warning.text for warning in found), found


def test_inertia_that_is_far_off(rng: np.random.Generator, design: Design) -> None:
    channels = axis(rng)
    found = check(Log(channels | {"i_q": channels["i_q"] * 0.1}), design)
    warning = next(w for w in found if w.code == "unlikely_inertia")
    assert warning.detail["factor"] == pytest.approx(0.1, rel=0.05)


def test_jitter_and_gaps(rng: np.random.Generator) -> None:
    channels = axis(rng)
    t = channels["t"] + rng.uniform(-3e-4, 3e-4, 8000)
    found = check(Log(channels | {"t": t}))
    assert any("jitter" in warning.text for warning in found)
    keep = np.r_[0:3000, 3050:8000]
    found = check(Log({name: values[keep] for name, values in channels.items()}))
    assert not any("jitter" in warning.text for warning in found)  # a gap was called a jitter of 196 %
    assert any("gaps in the time stamps: 1, the longest 51 ms at t = 2.999 s" in warning.text for warning in found), (
        found
    )


def test_time_base_by_hand() -> None:
    base = time_base(np.array([0.0, 1.0, 2.0, 3.25, 4.0, 9.0]))
    assert (base.period, base.gaps, base.longest_gap, base.longest_gap_at) == (1.0, 1, 5.0, 4.0)
    assert base.jitter_max == 0.25
    assert base.jitter_rms == pytest.approx(math.sqrt((0.25**2 + 0.25**2) / 4))


def test_saturation(rng: np.random.Generator, design: Design) -> None:
    channels = axis(rng)
    found = check(Log(channels | {"i_q": np.clip(channels["i_q"], -0.1, 0.1)}))
    assert any("i_q is at its limit of 0.1 A" in warning.text for warning in found), found
    found = check(Log(channels | {"i_q": channels["i_q"] * 40}), design)
    assert any("times the design's i_max: A rms" in warning.text for warning in found)
    counts = np.round(channels["i_q"] * 40 / (20 / 32768))
    (notice,) = (one for one in check(Log(channels | {"i_q": counts}), design) if one.code == "current_beyond_limit")
    assert "whole numbers, so raw counts may be read as A; --map i_q='FACTOR * COLUMN [A]'" in notice.text


def test_quantisation_is_found_and_named(rng: np.random.Generator) -> None:
    channels = axis(rng)
    assert quantum(channels["theta"]) == pytest.approx(2 * np.pi / 131072, rel=1e-6)
    assert quantum(rng.normal(size=5000)) == 0.0
    assert quantum(np.round(rng.normal(size=5000) * 10, 3)) == pytest.approx(1e-3, rel=1e-6)
    assert math.isnan(quantum(np.ones(10)))
    found = check(Log(channels | {"omega": np.round(channels["omega"] / 20) * 20}))
    assert any("omega is quantised to 20 rad/s" in warning.text for warning in found), found


def test_an_angle_of_few_digits_has_steps_that_grow() -> None:
    theta = 300.0 * np.sin(np.linspace(0.0, 20.0, 20000))
    five = np.array([float(f"{angle:.5g}") for angle in theta])
    assert growing_steps(five) == pytest.approx(0.01, rel=1e-6)
    assert growing_steps(np.deg2rad(five)) == pytest.approx(math.radians(0.01), rel=1e-6)
    for even in (theta, np.round(theta, 3), np.round(theta / 1.5e-3) * 1.5e-3 + 0.4, np.ones(10)):
        assert growing_steps(even) == 0.0
    found = check(Log({"t": np.arange(20000) * 1e-3, "theta": five}))
    assert any("few digits: its resolution falls with its size, to 0.01 rad" in warning.text for warning in found), (
        found
    )


@pytest.mark.parametrize("digits", [5, 9])
@pytest.mark.parametrize("turn", [False, True])
def test_either_cure_of_few_digits_silences_the_doubt(tmp_path: Path, digits: int, turn: bool) -> None:
    """The doubt advises more digits, or the angle within one turn."""
    t = np.arange(20000) * 1e-3
    theta = 300.0 * np.sin(0.7 * t)
    shown = np.mod(theta, 2 * np.pi) if turn else theta
    rows = "".join(f"{a:.5f},{b:.{digits}g},{c:.5g}\n" for a, b, c in zip(t, shown, np.cos(t), strict=True))
    path = tmp_path / "a.csv"
    path.write_text("t [s],theta [rad],i_q [A]\n" + rows, encoding="utf-8")
    log = read_log(path)
    assert ("few_digits" in [one.code for one in log.provenance.notices]) == (digits == 5 and not turn)
    assert "theta" in log  # it is doubted, not thrown away
    np.testing.assert_allclose(log["theta"] - log["theta"][0], theta - theta[0], atol=6e-3)


@pytest.mark.parametrize("seed", range(4))
def test_a_constant_speed_is_no_step(seed: int) -> None:
    rng = np.random.default_rng(seed)
    t = np.arange(20000) * 1e-3
    for speed in (3.0, 40.0, 200.0):
        # the angle advances by about speed * 1 ms, which is the resolution of nothing
        theta = speed * t + 1e-3 * speed * 0.02 * np.cumsum(rng.standard_normal(t.size)) / 100.0
        assert growing_steps(theta) == 0.0
        assert growing_steps(np.concatenate([0.05 * theta, theta])) == 0.0


def test_runs_and_shares_by_hand() -> None:
    assert longest_run(np.array([0, 1, 1, 0, 1, 1, 1, 0], dtype=bool)) == 3
    assert longest_run(np.zeros(4, dtype=bool)) == 0
    ramp = np.linspace(0, 2, 200)
    assert saturated_share(np.minimum(ramp, ramp[99])) == pytest.approx(101 / 200)
    assert saturated_share(ramp) == 0.0


def test_a_standing_axis_and_short_logs() -> None:
    t = np.arange(100) * 1e-3
    found = check(Log({"t": t, "theta": np.ones(100), "i_q": np.sin(t)}))
    assert "theta is constant (1 rad)" in [notice.text for notice in found]
    assert check(Log({"t": [0.0], "theta": [0.0], "i_q": [0.0]})) == (FEW_SAMPLES(count=1),)


@pytest.mark.parametrize("scale", [1e-300, 1e300, 5e-324])
def test_extreme_numbers_do_not_break_the_checks(rng: np.random.Generator, design: Design, scale: float) -> None:
    channels = axis(rng, 400)
    scaled = {name: values * scale if name != "t" else values for name, values in channels.items()}
    check(Log({name: np.nan_to_num(values) for name, values in scaled.items()}), design)


def test_real_files_raise_only_true_doubts(measured, designs) -> None:
    from pmsm_ctrl.importers import read_log

    emps = Design.read(designs / "emps.toml")
    for name in ("emps/DATA_EMPS.mat", "emps/DATA_EMPS_PULSES.mat"):
        assert read_log(measured(name), emps).provenance.warnings == ()
    # the shipped design maps every record of this bench and states the units that its files lack
    laas = Design.read(designs / "laas_mn4004.toml")
    for name in ("acc_current", "speed_test1", "speed_test", "speed_test_old", "rolling_data1", "rolling_data2"):
        log = read_log(measured(f"laas_mn4004/{name}.txt"), laas)
        warnings = log.provenance.warnings
        assert "jitter" in warnings[0]
        assert "gaps" in warnings[1]
        # one record repeats a row for 4 ms, and then its angle jumps
        assert len(warnings) == (3 if name == "speed_test" else 2)
        assert set(log) == {"t", "theta", "i_q"}
    assert read_log(measured("laas_mn4004/acc_current.txt")).provenance.notices[0].code == "unit_assumed"


@pytest.mark.parametrize("seed", [11, 12, 13])
@pytest.mark.parametrize("noise", [0.3, 3.0, 30.0])
def test_the_noise_of_the_speed_makes_no_inertia_smaller(seed: int, noise: float) -> None:
    rng = np.random.default_rng(seed)
    channels = axis(rng)
    speed = channels["omega"] + rng.normal(0, noise, 8000)
    found = drive_balance(channels["t"], K_T * channels["i_q"], speed=speed)
    assert abs(found.inertia / J - 1.0) < 0.02 + 3.0 * found.stderr / J
    assert found.stderr < 0.1 * J


@pytest.mark.parametrize("seconds", [600, 3600])
def test_the_inertia_of_a_long_log_of_positions_is_the_same(seconds: int, design: Design) -> None:
    # blocks of a fixed number would be longer than the motion
    n = 100 * seconds
    t = 0.01 * np.arange(n)
    rates = 2 * np.pi * np.array([0.11, 0.37, 0.83])
    theta, alpha = (sum(a * r**k * np.sin(r * t) for a, r in zip((90, 13, 4), rates, strict=True)) for k in (0, 2))
    omega = sum(a * r * np.cos(r * t) for a, r in zip((90, 13, 4), rates, strict=True))
    torque = -J * alpha + F_C * np.sign(omega) + F_V * omega
    found = drive_balance(t, torque, position=theta)
    assert found.inertia == pytest.approx(J, rel=0.05)  # means at the edges round the fastest motion off
    assert check(Log({"t": t, "theta": theta, "i_q": torque / K_T}), design) == ()


@pytest.mark.parametrize("noise", [0.02, 0.1])
def test_the_noise_of_a_current_makes_no_torque_smaller(rng: np.random.Generator, design: Design, noise: float) -> None:
    channels = axis(rng)
    noisy = channels["i_q"] + rng.normal(0, noise, 8000)
    torque = K_T * channels["i_q"] + rng.normal(0, 0.02, 8000)
    log = Log(channels | {"i_q": noisy, "torque": torque})
    assert torque_factor(log, design)[0] == pytest.approx(1.0, abs=0.05)
    assert not [one for one in check(log, design) if one.code in ("torque_factor", "torque_unrelated")]

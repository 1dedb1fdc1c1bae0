"""Errors by the steps of an angle, against the Fourier series of a sawtooth and the spectrum of rounding noise."""

from __future__ import annotations

import numpy as np
import pytest

from pmsm_ctrl import Design
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.balances import make_record
from pmsm_ctrl.regression.conditioning import Prepared, Processing
from pmsm_ctrl.regression.encoder_steps import angle_step, angle_steps, errors_by_steps, rough_acceleration
from pmsm_ctrl.regression.weights import uneven_weight

RATE, STEP = 1000.0, 2.0 * np.pi / 512.0
CUTOFF = 40.0  # Hz; the angle is smoothed at 2.5 times as much


def prepared(theta: np.ndarray) -> Prepared:
    t = np.arange(len(theta)) / RATE
    nothing = np.zeros(len(t))
    signals = {"theta": theta, "omega": nothing, "torque": nothing}
    alpha = np.random.default_rng(1).standard_normal(len(t))
    return Prepared(t, signals, alpha, np.ones(len(t), dtype=bool), np.arange(0, len(t), 10), RATE, CUTOFF, "rotary")


def test_slow_steps_pass_the_band_as_the_first_wave_of_a_sawtooth() -> None:
    # 30 steps a second: the second wave, at 60 Hz, is below the smoothing but above the band
    slow = 30.0
    theta = slow * STEP * np.arange(20_000) / RATE
    found = errors_by_steps(prepared(theta), STEP)
    assert found is not None
    # rounding is a sawtooth of amplitude step / 2: its first wave has step / pi
    wave = STEP / np.pi * (2.0 * np.pi * slow) ** 2 / np.sqrt(2.0)
    assert np.median(found.filtered[100:-100]) == pytest.approx(wave, rel=0.02)


def test_fast_steps_are_white_noise() -> None:
    # B. Widrow, I. Kollar, Quantization Noise, ch. 5: variance step^2 / 12, even up to half the rate
    theta = STEP * np.cumsum(np.random.default_rng(4).uniform(1.0, 9.0, 60_000))
    found = errors_by_steps(prepared(theta), STEP)
    assert found is not None
    f = np.linspace(0.0, 0.5 * RATE, 5000)
    passed = 1.0 / (1.0 + (f / (2.5 * CUTOFF)) ** 8)  # of a Butterworth of fourth order, run twice
    density = STEP**2 / 12.0 / (0.5 * RATE)
    speed = np.sqrt(np.trapezoid(density * (2.0 * np.pi * f * passed) ** 2, f))
    assert np.sqrt(np.mean(found.speed[1000:-1000] ** 2)) == pytest.approx(speed, rel=0.05)
    # the band of the balance: its filter is steep
    filtered = np.sqrt(np.mean(found.filtered[100:-100] ** 2))
    assert filtered == pytest.approx(rough_acceleration(STEP, RATE, CUTOFF), rel=0.05)


def test_the_noise_of_the_acceleration_is_that_of_a_rounded_angle() -> None:
    step, t = 2.0 * np.pi / 2**12, np.arange(40_000) / RATE
    theta = 60.0 * t - 15.0 / (2.0 * np.pi * 0.3) * np.cos(2.0 * np.pi * 0.3 * t)
    alpha = 15.0 * 2.0 * np.pi * 0.3 * np.cos(2.0 * np.pi * 0.3 * t)
    log = Log({"t": t, "theta": step * np.round(theta / step), "torque": 1e-3 * alpha + 0.1})
    design = Design.from_dict({"name": "axis", "motor": {"J": 1e-3, "K_t": 1.0}})
    record = make_record(design, log, Processing(cutoff=CUTOFF))
    left = (record.acceleration() - record.shaped(alpha))[record.mask]
    assert np.std(left) == pytest.approx(rough_acceleration(step, RATE, CUTOFF), rel=0.15)
    assert record.rough == pytest.approx(rough_acceleration(step, RATE, CUTOFF), rel=1e-6)


def test_the_steps_of_an_angle_with_few_digits_grow_with_it() -> None:
    """Five significant digits: 1e-3 rad from 10 rad on, 1e-4 below; the error is that of the rounded motion."""
    t = np.arange(60_000) / RATE
    theta = 30.0 * np.sin(2.0 * np.pi * 0.05 * t) + 0.3 * np.sin(2.0 * np.pi * 1.7 * t)
    written = np.array([float(f"{value:.5g}") for value in theta])
    smallest, largest = angle_steps(Log({"t": t, "theta": written, "torque": t}))
    assert largest == pytest.approx(1e-3, rel=1e-3)
    found, shaped = errors_by_steps(prepared(theta), smallest, largest), prepared(theta)
    assert found is not None
    error = shaped.column(np.gradient(np.gradient(written - theta, 1.0 / RATE), 1.0 / RATE))
    size = np.abs(theta[shaped.keep])
    for far in (size > 12.0, (size > 1.5) & (size < 9.0)):
        assert np.sqrt(np.mean(found.filtered[far] ** 2)) == pytest.approx(np.std(error[far]), rel=0.2)


def test_a_fine_encoder_has_none() -> None:
    assert errors_by_steps(prepared(np.linspace(0.0, 100.0, 20_000)), 1e-9) is None


def test_the_step_is_that_of_the_encoder_and_not_of_rounded_numbers() -> None:
    counts = np.cumsum(np.random.default_rng(2).integers(-3, 4, 5000))
    theta = counts * STEP + 1e-13 * np.random.default_rng(3).standard_normal(5000)
    t = np.arange(5000) / RATE
    assert angle_step(Log({"t": t, "theta": theta, "torque": t})) == pytest.approx(STEP)
    assert angle_step(Log({"t": t, "omega": theta, "torque": t})) == 0.0


@pytest.mark.parametrize("bits", [12, 0])
def test_what_a_shaft_advances_in_a_sample_is_no_step(bits: int) -> None:
    """A fan that never stops: the smallest step between two samples is its slowest advance, 0.1 rad."""
    t = np.arange(5000) * 1e-3
    theta = 120.0 * t - 20.0 / (2.0 * np.pi * 0.7) * np.cos(2.0 * np.pi * 0.7 * t)
    step = 2.0 * np.pi / 2**bits
    log = Log({"t": t, "theta": np.round(theta / step) * step if bits else theta, "torque": np.zeros_like(t)})
    assert angle_step(log) == pytest.approx(step if bits else 0.0, rel=1e-6, abs=1e-6)


def test_samples_count_by_their_noise() -> None:
    error = np.array([1.0, 1.0, 1.0, 3.0, 0.0])
    used = np.ones(5, dtype=bool)
    # no other noise: the inverse of the error beside the usual one, and never more than that
    assert uneven_weight(error, 1.0, used) == pytest.approx([1.0, 1.0, 1.0, 1.0 / 3.0, 1.0])
    # much other noise: all samples alike
    assert uneven_weight(error, 100.0, used) == pytest.approx(np.ones(5), abs=1e-3)


@pytest.mark.parametrize("slow", [1.5, 3.0])
def test_direction_turns_in_time_in_a_narrow_band(slow: float) -> None:
    # J domega/dt = T - F sgn(omega) on a sine: the torque rises by 2 F at once, and smoothed it rises too early
    t = np.arange(0.0, 12.0, 1.0 / RATE)
    J, F = 1e-3, 0.05
    rate = 2.0 * np.pi * 0.7
    omega = slow * F / J / rate * np.sin(rate * t)  # `slow` times the jump of the acceleration by friction alone
    theta = -slow * F / J / rate**2 * np.cos(rate * t)
    torque = slow * F * np.cos(rate * t) + F * np.sign(omega)
    design = Design.from_dict({"name": "made", "motor": {"J": J, "K_t": 1.0}}).with_effect("coulomb", {"F_c": F})
    log = Log({"t": t, "theta": theta, "torque": torque})
    record = make_record(design, log, Processing(cutoff=10.0, standstill=0.0005))
    around = np.linspace(-0.1, 0.1, 2001)
    late = []
    for turn in np.pi / rate * np.arange(2, 15):
        told = np.interp(turn + around, record.prepared.t, record.signals["direction"])
        late.append(-0.5 * np.trapezoid(told * np.sign(np.sin(rate * (turn + 0.05))), around))
    # the torque was sampled once before and once after its jump: half a period between them is not known
    assert np.abs(np.mean(late)) < 0.5 / RATE
    assert np.max(np.abs(late)) < 1.0 / RATE

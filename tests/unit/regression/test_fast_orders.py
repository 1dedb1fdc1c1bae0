"""Orders of a turn above the bandwidth are said, not lost in the low-pass."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pmsm_ctrl.compare import compare
from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose import diagnose
from pmsm_ctrl.identify import identify
from pmsm_ctrl.kernels.orders import apart_sums
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.fast_orders import beyond_band, orders_beyond
from pmsm_ctrl.regression.joining import thinning
from tests.effort import slow

HARMONIC = Design.from_dict({
    "name": "harmonic drive",
    "motor": {"J": 0.02, "K_t": 1.0},
    "effects": [{"id": "coulomb", "F_c": 8.0}, {"id": "viscous", "F_v": 0.05}],
})  # fmt: skip
CODE = "orders_beyond_band"


def turning(seed: int, top: float, wave: float, order: int = 202, rate: float = 1000.0) -> Log:
    rng, t = np.random.default_rng(seed), np.arange(round(20.0 * rate)) / rate
    phase = rng.uniform(0.0, 6.0, 2)
    omega = top * (np.sin(1.26 * t + phase[0]) + 0.3 * np.sin(3.3 * t + phase[1]))
    theta = np.cumsum(omega) / rate
    torque = 0.02 * np.gradient(omega, t) + 8.0 * np.sign(omega) + 0.05 * omega + wave * np.sin(order * theta)
    return Log({"t": t, "theta": theta, "torque": torque + 0.3 * rng.standard_normal(t.size)})


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize(("top", "rate"), [(10.0, 1000.0), (30.0, 1000.0), (30.0, 4000.0)])
def test_an_order_above_the_bandwidth_is_said(top: float, rate: float, seed: int) -> None:
    (notice,) = orders_beyond(HARMONIC, turning(seed, top, 2.6, rate=rate), 40.0)
    assert notice.code == CODE
    assert notice.detail["orders"] == "202"
    assert notice.detail["amplitude"] == pytest.approx(2.6, rel=0.15)
    assert notice.detail["percent"] > 90.0


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_noise_and_orders_inside_the_band_are_none(seed: int) -> None:
    assert orders_beyond(HARMONIC, turning(seed, 30.0, 0.0), 40.0) == ()
    assert orders_beyond(HARMONIC, turning(seed, 10.0, 2.6, order=12), 40.0) == ()


@pytest.mark.parametrize("seed", [1, 2])
def test_a_vibration_at_one_speed_is_no_order(seed: int) -> None:
    rng, t = np.random.default_rng(seed), np.arange(20000) / 1000.0
    omega = np.select([t < 5.0, t < 10.0, t < 15.0], [10.0, 25.0, -17.0], -31.0)
    theta = np.cumsum(omega) / 1000.0
    shaking = np.where(omega == 25.0, 2.0 * np.sin(25.0 * 20.0 * t), 0.0)
    log = Log({"t": t, "theta": theta, "torque": 8.0 * np.sign(omega) + shaking + 0.3 * rng.standard_normal(t.size)})
    assert orders_beyond(HARMONIC, log, 40.0) == ()


def driven(seed: int, wave: float, order: int, rate: float = 2000.0, top: float = 16.0) -> Log:
    """A drive too slow to answer a wave: the axis moves by it, and the torque does not show it."""
    rng, steps = np.random.default_rng(seed), 5
    J, F_c, dt = 0.02, 1.0, 1.0 / (rate * steps)
    t = np.arange(round(20.0 * rate)) / rate
    wanted, omega, angle, total = top * np.sin(0.63 * t + rng.uniform(0.0, 6.0)), 0.0, 0.0, 0.0
    theta, torque = np.empty_like(t), np.empty_like(t)
    for k, target in enumerate(wanted.tolist()):
        total += 15.0 * (target - omega) / rate
        drive = 1.5 * (target - omega) + total
        theta[k], torque[k] = angle, drive
        for _ in range(steps):
            free = omega + dt * (drive - wave * math.sin(order * angle)) / J
            omega = math.copysign(max(abs(free) - dt * F_c / J, 0.0), free)  # dry friction, by implicit steps
            angle += dt * omega
    return Log({"t": t, "theta": theta + 2e-6 * rng.standard_normal(t.size), "torque": torque})


DRIVEN = Design.from_dict({
    "name": "driven", "motor": {"J": 0.02, "K_t": 1.0}, "effects": [{"id": "coulomb", "F_c": 1.0}],
})  # fmt: skip


@pytest.mark.parametrize("seed", [1, slow(2), slow(3)])
def test_a_wave_that_no_loop_answers_is_named_in_a_band_that_holds_it(seed: int) -> None:
    log = driven(seed, 0.5, 120)
    (notice,) = orders_beyond(DRIVEN, log, 40.0)
    assert notice.detail["orders"] == "120"
    found = diagnose(DRIVEN, log, plan=False)
    assert [step.effect for step in found.steps] == ["cogging"]
    wave = found.steps[0].parameters
    assert wave["order"].value == 120.0
    assert wave["a_s"].value == pytest.approx(0.5, rel=0.05)
    assert "wider_band" in [one.code for one in found.notices]
    assert CODE not in [one.code for one in found.notices]
    written = compare(found.design, log).log.errors["torque"].relative
    assert written == pytest.approx(found.errors["final"]["torque"]["relative"], rel=1e-3)


def test_the_band_fits_the_rate_at_which_a_fast_log_is_evaluated() -> None:
    """A log of 4 kHz is evaluated at 1 kHz: the band of its own rate was refused there, and nothing was named."""
    found = beyond_band(DRIVEN, driven(1, 0.5, 120, rate=4000.0, top=60.0), 40.0)
    assert found is not None
    assert found.orders == (120,)
    assert found.band == pytest.approx(0.3 * 1000.0)
    assert [thinning(rate, 10_000) for rate in (999.0, 2000.0 - 1e-4, 4300.0)] == [1, 2, 4]


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_line_of_the_encoder_is_no_order_of_the_torque(seed: int) -> None:
    log = driven(seed, 0.0, 120)
    lined = log.with_channels(theta=log["theta"] + 2e-4 * np.sin(120.0 * log["theta"]))
    assert orders_beyond(DRIVEN, lined, 40.0) == ()


def test_sums_of_an_order_bin_by_bin(rng: np.random.Generator) -> None:
    theta, x = rng.uniform(0.0, 4.0, 90), rng.standard_normal(90)
    odd = rng.integers(0, 2, 90).astype(float)
    edges = np.array([[10, 40, 90], [5, 5, 60], [0, 20, 33]])
    sums, span = np.empty((3, 2, 2, 2)), np.empty(3)
    apart_sums(theta, x * np.stack([odd, 1.0 - odd]), edges, np.inf, sums, span)
    for k, row in enumerate(edges):
        wave = x * np.exp(-1j * (k + 1) * theta)
        for b in range(2):
            inside = slice(row[b], row[b + 1])
            expected = [np.sum((wave * piece)[inside]) for piece in (odd, 1.0 - odd)]
            assert sums[k, b] == pytest.approx(np.array([[z.real, z.imag] for z in expected]), abs=1e-12)
        assert span[k] == np.ptp(theta[row[0] : row[2]])
    apart_sums(theta, x * np.stack([odd, 1.0 - odd]), edges, 1.0, sums, span)
    assert (span >= 1.0).all()


def test_every_verb_says_it() -> None:
    log = turning(1, 30.0, 2.6)
    for result in (identify(HARMONIC, log), compare(HARMONIC, log), diagnose(HARMONIC, log, candidates=(), plan=False)):
        assert [n.code for n in result.notices].count(CODE) == 1

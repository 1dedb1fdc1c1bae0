"""Derivatives, filter, time base and masks, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import LogError, RequestError
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.conditioning import Processing, prepare
from pmsm_ctrl.regression.filters import derivative, low_pass
from pmsm_ctrl.regression.timing import ending_steadily, punctual, uniform

PLAIN = Design.from_dict({"motor": {"J": 0.01, "K_t": 1.0}})


def sine_log(n: int = 4000, rate: float = 1000.0, frequency: float = 1.0) -> Log:
    t = np.arange(n) / rate
    return Log({"t": t, "theta": np.sin(2 * np.pi * frequency * t), "torque": np.cos(t)})


@pytest.mark.parametrize(("method", "loss"), [("nine_point", 1e-7), ("central", 0.0060)])
def test_gain_of_the_derivative_at_30_hz(method: str, loss: float) -> None:
    # central: sin(x)/x with x = 2 pi 30/1000 loses 0.59 %; an acceleration loses it twice
    t = np.arange(4000) / 1000.0
    w = 2 * np.pi * 30.0
    inner = slice(500, -500)
    got = derivative(np.sin(w * t), 1e-3, method)[inner]
    assert np.max(np.abs(got / w - np.cos(w * t)[inner])) < loss
    if method == "central":
        assert np.max(np.abs(got / w)) == pytest.approx(np.sin(w / 1000) / (w / 1000), abs=2e-5)


@pytest.mark.parametrize(("method", "reach"), [("central", 1), ("nine_point", 4)])
def test_ends_of_a_derivative_are_numpys_gradient(rng: np.random.Generator, method: str, reach: int) -> None:
    x = rng.standard_normal(30)
    found, ends = derivative(x, 0.01, method), np.r_[0:reach, 30 - reach : 30]
    np.testing.assert_allclose(found[ends], np.gradient(x, 0.01)[ends], rtol=1e-14)


@pytest.mark.parametrize("method", ["nine_point", "central"])
def test_derivative_of_a_straight_line(method: str) -> None:
    np.testing.assert_allclose(derivative(3.0 * np.arange(200) * 0.01 + 7.0, 0.01, method), 3.0, rtol=1e-9)


def test_nine_points_are_exact_to_degree_eight() -> None:
    x = np.linspace(-1.0, 1.0, 101)
    np.testing.assert_allclose(derivative(x**8, x[1] - x[0])[4:-4], 8 * x[4:-4] ** 7, atol=1e-11)


def test_unknown_derivative() -> None:
    with pytest.raises(RequestError, match="nine_point, central"):
        derivative(np.zeros(20), 1.0, "best")


@pytest.mark.parametrize("steep", [False, True])
def test_low_pass_has_no_phase_and_passes_the_band(steep: bool) -> None:
    t = np.arange(8000) / 1000.0
    inner = slice(1000, -1000)
    slow = np.sin(2 * np.pi * 3.0 * t)
    assert np.max(np.abs(low_pass(slow, 1000.0, 40.0, steep) - slow)[inner]) < 0.012
    assert np.max(np.abs(low_pass(np.sin(2 * np.pi * 200.0 * t), 1000.0, 40.0, steep))[inner]) < 1e-3


def test_the_same_filter_stands_on_both_sides() -> None:
    # y = 0.01 alpha + 0.3 omega exactly, in band and out of band alike
    t = np.arange(20000) / 1000.0
    phases = np.random.default_rng(1).uniform(0, 2 * np.pi, 6)
    theta = sum(
        np.sin(2 * np.pi * f * t + a) / f for f, a in zip((0.3, 1.1, 4.0, 13.0, 29.0, 47.0), phases, strict=True)
    )
    omega, alpha = derivative(theta, 1e-3), derivative(derivative(theta, 1e-3), 1e-3)
    prepared = prepare(PLAIN, Log({"t": t, "theta": theta, "torque": 0.01 * alpha + 0.3 * omega}))
    y = prepared.column(prepared.signals["torque"])
    model = 0.01 * prepared.column(prepared.alpha) + 0.3 * prepared.column(prepared.signals["omega"])
    error, top, kept = np.abs(y - model), np.max(np.abs(y)), prepared.t[prepared.keep]
    assert np.max(error[(kept > 1.5) & (kept < 18.5)]) < 1e-10 * top
    # the ends of the record, where the filters guess what came before, fade within the cut edge to this
    assert np.max(error[prepared.mask]) < 5e-3 * top


def test_jittered_time_is_resampled_and_said() -> None:
    rng = np.random.default_rng(2)
    t = np.arange(3000) / 1000.0 + rng.uniform(-2e-4, 2e-4, 3000)
    grid, channels, good, notes = uniform(Log({"t": t, "theta": np.sin(5 * t), "torque": np.cos(3 * t)}))
    assert np.ptp(np.diff(grid)) < 1e-12
    np.testing.assert_allclose(channels["theta"], np.sin(5 * grid), atol=1e-6)
    assert good.all()
    assert notes[0].code == "resampled"


def test_stamps_that_jitter_alone_are_not_believed() -> None:
    rng = np.random.default_rng(2)
    t = np.arange(3000) / 1000.0
    theta = np.unwrap(np.angle(np.exp(1j * 30.0 * np.sin(5 * t))))
    wrapped = np.mod(theta, 2.0 * np.pi)
    late = t + rng.uniform(-2e-4, 2e-4, 3000)
    grid, channels, good, notes = uniform(Log({"t": late, "theta": wrapped, "torque": np.cos(3 * t)}))
    assert np.max(np.abs(grid - t)) < 2e-5
    np.testing.assert_allclose(channels["theta"] - channels["theta"][0], theta - theta[0], atol=1e-9)
    assert good.all()
    assert notes[0].code == "equal_steps"


def test_a_gap_is_marked() -> None:
    t = np.concatenate([np.arange(2000), np.arange(2300, 5000)]) / 1000.0
    log = Log({"t": t, "theta": np.sin(5 * t), "torque": np.cos(3 * t)})
    prepared = prepare(PLAIN, log)
    assert "gaps" in [note.code for note in prepared.notes]
    assert not prepared.moving[(prepared.t > 2.0) & (prepared.t < 2.299)].any()


def test_a_rest_is_masked_with_its_neighbours_and_a_reversal_is_not() -> None:
    t = np.arange(10000) / 1000.0
    speed = np.where((t > 4) & (t < 6), 0.0, np.sin(2 * np.pi * 0.5 * t))
    log = Log({"t": t, "omega": speed, "torque": speed})
    prepared = prepare(PLAIN, log, Processing(standstill=0.01))
    assert not prepared.moving[(t > 3.98) & (t < 6.02)].any()
    assert prepared.moving[(t > 0.9) & (t < 1.1)].mean() > 0.9  # reversal at 1 s


def test_a_wrapped_angle_is_unwrapped() -> None:
    t = np.arange(4000) / 1000.0
    log = Log({"t": t, "theta": (10.0 * t) % (2 * np.pi), "torque": np.ones(4000)})
    assert prepare(PLAIN, log).signals["omega"][500:-500] == pytest.approx(10.0, rel=1e-6)


@pytest.mark.parametrize(
    ("channels", "message"),
    [
        ({"torque": 1.0}, "neither theta nor omega"),
        ({"theta": 1.0}, "neither torque nor i_q"),
    ],
)
def test_a_missing_channel(channels: dict[str, float], message: str) -> None:
    t = np.arange(500) / 1000.0
    with pytest.raises(LogError, match=message):
        prepare(PLAIN, Log({"t": t} | {name: np.sin(9 * t) for name in channels}))


def test_too_short_and_never_moving() -> None:
    with pytest.raises(LogError, match="at least 100"):
        prepare(PLAIN, sine_log(50))
    t = np.arange(2000) / 1000.0
    with pytest.raises(LogError, match="stands still"):
        prepare(PLAIN, Log({"t": t, "omega": 0 * t, "torque": 0 * t}))
    with pytest.raises(RequestError, match="half the log's rate"):
        prepare(PLAIN, sine_log(), Processing(cutoff=600.0))


@pytest.mark.parametrize("cutoff", [20.0, 40.0, 60.0, 100.0, 130.0, 160.0, 200.0, 250.0])
def test_a_band_is_thinned_to_a_grid_that_it_fills(cutoff: float) -> None:
    rate = prepare(PLAIN, sine_log(), Processing(cutoff=cutoff)).thinned_rate
    assert 2.0 <= rate / cutoff <= 2.8


@pytest.mark.parametrize("rate", [250.0, 1000.0])
@pytest.mark.parametrize("share", [0.003, 0.05, 0.2])
def test_lost_samples_do_not_slow_the_clock(rate: float, share: float) -> None:
    """The samples that are left keep their times and values: nothing is interpolated but what was lost."""
    t = np.arange(2000) / rate
    keep = np.random.default_rng(7).random(len(t)) >= share
    keep[[0, -1]] = True
    torque = np.sign(np.sin(3.0 * t))  # held values, which a spline between samples would ring at
    grid, channels, good, notes = uniform(Log({"t": t[keep], "theta": (t**2)[keep], "torque": torque[keep]}))
    np.testing.assert_allclose(grid, t, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(channels["torque"][keep], torque[keep], atol=1e-6)
    assert good.all()
    assert not notes


def test_late_stamps_are_no_lost_samples() -> None:
    """A stamp that is late by 1.5 periods has an early one behind it: the mean step is the period."""
    t = np.arange(2000) / 1000.0
    t[100::50] += 1.5e-3
    t[101::50] += 0.7e-3
    grid, _, _, _ = uniform(Log({"t": np.sort(t), "torque": np.random.default_rng(3).standard_normal(2000)}))
    assert len(grid) == 2000
    assert grid[1] - grid[0] == pytest.approx(1e-3, rel=1e-3)


def test_a_hole_stays_out_where_single_samples_are_lost_everywhere() -> None:
    rng = np.random.default_rng(3)
    t = np.concatenate([np.arange(4000), np.arange(6000, 10000)]) / 1000.0
    t = t[rng.random(t.size) > 0.02]
    log = Log({"t": t, "theta": np.sin(5 * t), "torque": np.cos(3 * t)})
    grid = np.arange(t[0], t[-1], 1e-3)
    good = punctual(log, grid, 40.0, jumps=False)
    assert not good[(grid > 4.0) & (grid < 5.99)].any()
    assert good[grid < 3.8].all()


@pytest.mark.parametrize("side", [1, -1])
def test_a_log_that_ends_in_an_edge_is_cut_before_it(side: int) -> None:
    t = np.arange(4000) / 4000.0
    torque = np.cos(3 * t) + 0.01 * np.random.default_rng(4).standard_normal(t.size)
    log = Log({"t": t, "theta": np.sin(5 * t), "torque": torque})
    assert ending_steadily(log) is log
    switched = torque.copy()
    switched[::-side][:5] += np.array([30.0, 32.0, 31.0, 24.0, 12.0])
    cut = ending_steadily(log.with_channels(torque=switched))
    assert len(cut) == len(log) - 5
    np.testing.assert_array_equal(cut["torque"], torque[:-5] if side == 1 else torque[5:])

"""How the drive signal was sampled: filters undone, moments, decisions; and what a diagnosis makes of late channels."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

from pmsm_ctrl.compare import compare
from pmsm_ctrl.design import Design
from pmsm_ctrl.design_parts import LogMap
from pmsm_ctrl.diagnose import Diagnosis, diagnose
from pmsm_ctrl.effects.catalogue import CATALOGUE
from pmsm_ctrl.identify import identify
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression import timed_record
from pmsm_ctrl.regression.balances import make_record
from pmsm_ctrl.regression.drive_timing import LATENESS, SPREAD, UNDELAYED, DriveTiming, filter_behind, in_time
from pmsm_ctrl.regression.model import base_groups
from pmsm_ctrl.regression.notices import sampling_text
from pmsm_ctrl.simulate import simulate
from tests.effort import amount, seeds, slow

J, K_T, F_C, F_V = 0.01, 1.3, 0.4, 0.02
PERIOD, FINE = 1e-3, 50  # s, and steps of the made-up torque in it
SAMPLING = PERIOD


def believed(F_c: float = F_C, F_v: float = F_V) -> Design:
    drive = Design.from_dict({"name": "made", "motor": {"J": J, "K_t": K_T}})
    return drive.with_effect("coulomb", {"F_c": F_c}).with_effect("viscous", {"F_v": F_v})


@cache
def made(
    seed: int, *, late: float = 0.0, mean: bool = False, lag: float = 0.0, pieces: int = 1, wave: float = 0.0,
    samples: int = 12_000, further: tuple[tuple[float, float], ...] = (), every: int = 1,
) -> Log:  # fmt: skip
    """Return a log of sines of speed, its current late, a mean over the period before, or filtered, in closed form.

    `wave` is a torque once a turn, N m; `further` sines of the speed in rad/s. Of the samples every so many stay.
    """
    rng = np.random.default_rng(seed)
    parts = ((14.0, 2.1), (6.0, 5.3), (0.8, 41.0), (0.3, 77.0), *further)
    phases = rng.uniform(0.0, 6.28, len(parts))

    def motion(t: np.ndarray) -> list[np.ndarray]:
        """Return speed, acceleration and angle."""
        return [
            sum(f(a, w, w * t + p) for (a, w), p in zip(parts, phases, strict=True))
            for f in (
                lambda a, w, x: a * np.sin(x), lambda a, w, x: a * w * np.cos(x), lambda a, w, x: -a / w * np.cos(x)
            )
        ]  # fmt: skip

    clock = PERIOD * np.arange(samples)
    speed, _, theta = motion(clock)
    step, before = PERIOD / FINE, 200 * FINE
    fine = step * np.arange(-before, FINE * len(clock)) if mean or lag > 0.0 else clock
    at, alpha, angle = motion(fine - late)
    torque = J * alpha + F_C * np.sign(at) + F_V * at + wave * np.sin(angle + 1.0)
    if mean:
        torque = lfilter(np.full(FINE, 1.0 / FINE), 1.0, torque)
    if lag > 0.0:
        share = 1.0 - np.exp(-step / lag)
        torque = lfilter([share], [1.0, share - 1.0], torque, zi=[(1.0 - share) * torque[0]])[0]
    if fine is not clock:
        torque = torque[before::FINE]
    torque = torque + 0.02 * rng.normal(size=len(clock))
    if pieces > 1:  # runs one after the other, seconds apart
        clock = clock + 4.0 * np.floor(pieces * clock / (samples * PERIOD))
    channels = {"t": clock, "theta": theta, "omega": speed, "i_q": torque / K_T}
    return Log({name: values[::every] for name, values in channels.items()})


# ---- closed forms -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("timing", [DriveTiming(0.4e-3, 0.0), DriveTiming(0.0, 3e-3), DriveTiming(-0.7e-3, 2e-3)])
@pytest.mark.parametrize("frequency", [3.0, 20.0])
def test_a_late_and_filtered_sine_is_undone(timing: DriveTiming, frequency: float) -> None:
    t, w = np.arange(2000) * PERIOD, 2.0 * np.pi * frequency
    response = np.exp(-1j * w * timing.late) / (1.0 + 1j * w * timing.lag)
    sine = {"t": t, "theta": t, "i_q": np.imag(response * np.exp(1j * w * t)), "u_q": np.sin(w * t)}
    undone = timing.undone(Log(sine))
    inside = slice(50, -50)
    assert np.max(np.abs(undone["i_q"] - np.sin(w * t))[inside]) < 2e-4
    assert np.array_equal(undone["u_q"], sine["u_q"])  # the voltage has an age of its own
    assert np.array_equal(undone["theta"], t)


def test_nothing_is_done_to_a_log_that_is_not_late() -> None:
    log = made(1)
    assert UNDELAYED.undone(log) is log


@pytest.mark.parametrize(("late", "lag"), [(0.5e-3, 0.0), (0.2e-3, 3e-3)])
def test_moments_are_those_of_the_impulse_response(late: float, lag: float) -> None:
    timing, t = DriveTiming(late, lag), np.linspace(0.0, 0.1, 200_001)
    if lag == 0.0:
        assert (timing.delay, timing.spread) == (late, 0.0)
        return
    response = np.exp(-t / lag) / lag
    mean = np.trapezoid(t * response, t)
    assert timing.delay == pytest.approx(late + mean, rel=1e-4)
    assert timing.spread == pytest.approx(0.5 * np.trapezoid((t - mean) ** 2 * response, t), rel=1e-4)


@pytest.mark.parametrize(
    ("delay", "spread", "expected"),
    [
        (0.9e-3, (0.0, 1e-8), None),  # within what sampling can do: nothing is to be undone
        (5e-3, (0.0, 1e-7), None),  # a dead time: no filter without a spread
        (5e-3, (7.0e-6, 0.3e-6), None),  # 8e-6 at least is that of a filter of 4 ms
        (5e-3, (7.8e-6, 0.3e-6), DriveTiming(1e-3, 4e-3)),  # which it has to have where sampling does the rest
        (3.4e-3, (0.5 * 3e-3**2, 1e-7), DriveTiming(0.4e-3, 3e-3)),
        (3e-3, (0.5 * 4e-3**2, 1e-7), DriveTiming(0.0, 3e-3)),  # not earlier than the position
    ],
)
def test_a_filter_is_told_from_a_delay_by_its_spread(
    delay: float, spread: tuple[float, float], expected: DriveTiming | None
) -> None:
    found = filter_behind(delay, spread, SAMPLING)
    if expected is None:
        assert found is None
    else:
        assert found is not None
        assert (found.late, found.lag) == pytest.approx((expected.late, expected.lag), abs=1e-9)
        assert found.delay == pytest.approx(delay)


@pytest.mark.parametrize(("stderr", "sure"), [(0.3e-6, True), (2.5e-6, True), (2.7e-6, False)])
def test_a_filter_whose_spread_is_not_significant_may_be_a_delay(stderr: float, sure: bool) -> None:
    found = filter_behind(5e-3, (8.0e-6, stderr), SAMPLING)
    assert found is not None
    assert found.sure is sure


@pytest.mark.parametrize(("stderr", "lag"), [(1e-5, 1.2e-3), (0.4e-3, 0.0)])
def test_a_delay_within_its_uncertainty_is_no_filter(
    monkeypatch: pytest.MonkeyPatch, stderr: float, lag: float
) -> None:
    """Stribeck friction that the design lacks made a delay of (1.2 +- 0.4) ms, which was told as a filter of 1.2 ms."""
    found = {LATENESS: (1.2e-3, stderr), SPREAD: (0.5 * 1.2e-3**2, 1e-7)}
    fit = fake_fit(found)
    monkeypatch.setattr(timed_record, "base_fit", lambda *_, **__: fit)
    monkeypatch.setattr(timed_record, "by_reference", lambda *_: None)
    record: Any = SimpleNamespace(timing=UNDELAYED, sampling=1e-3)
    assert timed_record._filter(believed(), record, fit).lag == pytest.approx(lag)


def fake_fit(found: dict[str, tuple[float, float]]) -> Any:
    weights = SimpleNamespace(sigma=[1.0])
    return SimpleNamespace(
        level=lambda name: found[name][0], value=found.__getitem__, record=None, model=None, weights=weights
    )


@pytest.mark.parametrize("undone", [0.0, 1e-3])
@pytest.mark.parametrize(
    ("spread", "filtered"),
    [((0.0, 1e-7), False), ((7.5e-6, 1e-7), False), ((7.5e-6, 0.3e-6), True), ((20e-6, 1e-7), True)],
)
def test_of_two_spreads_the_smaller_one_tells_a_filter(
    monkeypatch: pytest.MonkeyPatch, spread: tuple[float, float], filtered: bool, undone: float
) -> None:
    """Noise that the controller responds to makes the one by least squares too large, not the one by the reference."""
    timing = DriveTiming(0.0, undone)
    fit = fake_fit({LATENESS: (5e-3 - undone, 1e-5), SPREAD: (9e-6 - timing.spread, 1e-7)})
    monkeypatch.setattr(timed_record, "base_fit", lambda *_, **__: fit)
    by_reference = SimpleNamespace(spread=(spread[0] - timing.spread, spread[1]))
    monkeypatch.setattr(timed_record, "by_reference", lambda *_: by_reference)
    record: Any = SimpleNamespace(timing=timing, sampling=1e-3, period=1e-3)
    found = timed_record._filter(believed(), record, fit)
    assert (found.lag > 0.0) is filtered


# ---- what a diagnosis makes of it -------------------------------------------------------------------------------


def names(found: Diagnosis) -> list[str]:
    return [step.effect for step in found.steps]


@pytest.mark.parametrize("seed", seeds(1, 2))
@pytest.mark.parametrize(
    ("sampled", "delay"),
    [slow({"late": 0.5e-3}, 0.5e-3), slow({"mean": True}, 0.5e-3), ({"late": 0.25e-3, "mean": True}, 0.75e-3)],
)  # fmt: skip
def test_what_sampling_can_do_is_no_effect_and_is_reported(seed: int, sampled: dict, delay: float) -> None:
    log = made(seed, **sampled, samples=amount(12_000, 24_000))
    found = diagnose(believed(), log, plan=False)
    assert (found.verdict, names(found)) == ("consistent", [])
    assert found.timing.lag == 0.0
    assert found.timing.late == pytest.approx(delay, rel=0.05)
    assert "drive_signal_filtered" not in found.to_dict()["warning_codes"]
    assert json.loads(json.dumps(found.to_dict()))["timing"]["late"] == found.timing.late


@pytest.mark.parametrize("lag", [2e-3, slow(3e-3)])
def test_a_filter_of_the_current_is_no_effect_and_its_time_constant_is_reported(lag: float) -> None:
    found = diagnose(believed(), made(1, lag=lag, samples=24_000), plan=False)
    assert (found.verdict, names(found)) == ("consistent", [])
    assert found.timing.delay == pytest.approx(lag, rel=0.05)
    assert found.timing.lag == pytest.approx(lag, rel=0.05)
    assert "drive_signal_filtered" in found.to_dict()["warning_codes"]
    assert f"about {1e3 * found.timing.lag:.2g} ms" in found.summary()


@pytest.mark.slow
@pytest.mark.parametrize("lag", [5e-3, slow(2e-3)])
def test_a_filter_is_found_beside_an_effect_that_hides_it_at_first(lag: float) -> None:
    offered = ("unbalance", "cogging", "position_dependent_friction", "encoder_eccentricity", "compliance", "delay")
    found = diagnose(believed(), made(3, lag=lag, wave=1.5), candidates=offered, plan=False)
    assert [step.effect for step in found.steps] == ["unbalance"]


def test_a_filter_that_the_log_states_is_not_said_again() -> None:
    design = believed().replace(log={"sampling": "instant", "filter": 3e-3})
    found = diagnose(design, made(1, lag=3e-3), plan=False)
    assert "drive_signal_filtered" not in found.to_dict()["warning_codes"]


@pytest.mark.slow
@pytest.mark.parametrize("seed", seeds(1, 2, 3))
@pytest.mark.parametrize("lag", [slow(4e-3), 6.3e-3])
def test_a_filter_that_reaches_into_the_band_of_a_slow_log_is_found(seed: int, lag: float) -> None:
    """Two moments do not describe it: the angle of its response is more than one at the end of the band."""
    log = made(seed, lag=lag, samples=48_000, further=((0.3, 120.0), (0.25, 170.0)), every=4)
    found = diagnose(believed(), log, plan=False)
    assert (found.verdict, names(found)) == ("consistent", [])
    assert found.timing.lag == pytest.approx(lag, rel=0.1)


@pytest.mark.parametrize("seed", seeds(1, 2, 3))
def test_a_delay_of_a_slow_log_is_no_filter(seed: int) -> None:
    found = diagnose(believed(), made(seed, late=9e-3, samples=amount(12_000, 48_000), every=4), plan=False)
    assert names(found) == ["delay"]
    assert found.steps[0].parameters["tau"].value == pytest.approx(9e-3, rel=0.04)


@pytest.mark.slow
@pytest.mark.parametrize("seed", seeds(1, 2))
def test_a_delay_that_no_filter_explains_is_one(seed: int) -> None:
    found = diagnose(believed(), made(seed, late=5e-3), plan=False)
    assert names(found) == ["delay"]
    assert found.steps[0].parameters["tau"].value == pytest.approx(5e-3, rel=0.04)


@pytest.mark.parametrize(("late", "whole"), [(None, True), (0.0, True), (1e-3, True), (-2e-3, False)])
def test_only_an_early_torque_is_judged_where_it_changes_faster_than_noise(late: float | None, whole: bool) -> None:
    """The controller answers noise at once: noise and the slope of the torque look like a torque that is early."""
    slopes = np.array([[[0.5], [-3.0], [4.5], [-8.0]]])
    balances: Any = SimpleNamespace(late=late, noise_of=lambda part: 1.0)
    judged = CATALOGUE["delay"].structure.judged(balances, CATALOGUE["delay"], slopes, {})
    assert judged[0, :, 0].tolist() == ([0.5, -3.0, 4.5, -8.0] if whole else [0.0, 0.0, 4.5, -8.0])
    assert slopes[0, 0, 0] == 0.5


def of_speed_alone(log: Log, lag: float = 0.0) -> Log:
    """Leave out the angle; the speed has passed a filter of first order, s."""
    share = 1.0 - np.exp(-PERIOD / lag) if lag > 0.0 else 1.0
    omega = lfilter([share], [1.0, share - 1.0], log["omega"], zi=[(1.0 - share) * log["omega"][0]])[0]
    return Log({"t": log.t, "omega": omega, "i_q": log["i_q"]})


@pytest.mark.slow
@pytest.mark.parametrize("seed", seeds(1, 2, 3))
def test_a_current_later_than_a_speed_is_a_delay(seed: int) -> None:
    """A filter makes a speed too late, never too early."""
    found = diagnose(believed(), of_speed_alone(made(seed, late=5e-3)), plan=False)
    assert names(found) == ["delay"]
    assert found.steps[0].parameters["tau"].value == pytest.approx(5e-3, rel=0.04)
    assert "speed_lag" not in found.to_dict()["warning_codes"]


@pytest.mark.parametrize("age", [UNDELAYED, DriveTiming(1e-3, 2e-3), None])
def test_a_held_out_speed_is_as_old_as_that_of_the_log(age: DriveTiming | None) -> None:
    """A log with a position says nothing of the age of a speed."""
    log = made(1)
    assert make_record(believed(), log, age=age).age_elsewhere == UNDELAYED
    assert make_record(believed(), of_speed_alone(log), age=age).age_elsewhere == age


@pytest.mark.parametrize("seed", seeds(1, 2, 3))
@pytest.mark.parametrize(("lag", "filtered"), [(0.0, False), (2e-3, True), (6e-3, True)])
def test_the_filter_of_a_speed_is_undone(seed: int, lag: float, filtered: bool) -> None:
    """With its mean delay alone corrected, a gap or a spring explained the rest of a filter."""
    found = diagnose(believed(), of_speed_alone(made(seed), lag), plan=False)
    assert (found.verdict, names(found)) == ("consistent", [])
    age = found.record.age
    assert age is not None
    assert (age.lag > 0.0) is filtered
    # the filter in steps of a period answers half a period earlier than that of continuous time
    assert age.lag == pytest.approx(lag, rel=0.1)
    assert age.delay == pytest.approx(lag - (0.5 * PERIOD if filtered else 0.0), abs=0.1e-3)
    assert any("passed a filter" in text for text in found.warnings) is filtered
    assert found.errors["final"]["torque"]["relative"] == pytest.approx(
        compare(found.design, of_speed_alone(made(seed), lag)).log.errors["torque"].relative, rel=1e-3
    )


@pytest.mark.parametrize("seed", seeds(1, 2, 3))
@pytest.mark.parametrize(("late", "lag", "speed"), [(0.0, 0.0, 3e-3), (0.0, 5e-3, 0.0), (0.5e-3, 0.0, 0.0)])
def test_filters_and_sampling_beside_a_speed_are_no_delay(seed: int, late: float, lag: float, speed: float) -> None:
    found = diagnose(believed(), of_speed_alone(made(seed, late=late, lag=lag), speed), plan=False)
    assert names(found) == []
    assert ("speed_filtered" in found.to_dict()["warning_codes"]) is (speed > 0.0)
    assert found.timing.lag == pytest.approx(lag, rel=0.1)


@pytest.mark.parametrize("seed", seeds(1, 2))
def test_a_current_that_is_not_late_has_no_lateness(seed: int) -> None:
    found = diagnose(believed(), made(seed), plan=False)
    assert (found.verdict, names(found)) == ("consistent", [])
    assert found.timing.late == pytest.approx(0.0, abs=0.03e-3)


@pytest.mark.parametrize("seed", seeds(1, 2))
def test_runs_joined_with_gaps_name_nothing(seed: int) -> None:
    found = diagnose(believed(), made(seed, pieces=3), plan=False)
    assert names(found) == []
    assert found.timing.lag == 0.0


@pytest.mark.parametrize("factor", seeds(3.0, 0.5, 1.5))
def test_friction_that_is_not_the_designs_is_no_effect(factor: float) -> None:
    # as much larger as a drag of the iron makes it: nothing in one log tells the two apart
    found = diagnose(believed(F_C / factor, F_V / factor), made(1), plan=False)
    assert names(found) == []
    assert found.design.parameters("coulomb")["F_c"] == pytest.approx(F_C, rel=0.01)


# ---- what the design states of the log ------------------------------------------------------------------------------


def stating(f_control: float | None = None, **log: object) -> Design:
    drive = {} if f_control is None else {"drive": {"f_control": f_control}}
    return Design.from_dict({**believed().to_dict(), **drive, "log": log})


@pytest.mark.parametrize("seed", seeds(3, 4))
def test_a_stated_mean_over_the_period_is_undone(seed: int) -> None:
    found = diagnose(stating(sampling="mean"), made(seed, mean=True), plan=False)
    assert found.steps == ()
    assert found.timing.delay == pytest.approx(0.5 * PERIOD, rel=0.1)


@pytest.mark.parametrize("seed", seeds(3, 4))
def test_a_stated_mean_is_one_of_samples_of_the_control(seed: int) -> None:
    """The mean of four samples of a 4 kHz control is half a period of that earlier than the mean over the period."""
    log = made(seed, late=-0.125e-3, mean=True)
    found = diagnose(stating(sampling="mean", f_control=4e3), log, plan=False)
    assert (found.verdict, names(found)) == ("consistent", [])
    found = diagnose(stating(sampling="mean", f_control=20e3), log, plan=False)
    assert names(found) == ["delay"]
    tau = found.steps[0].parameters["tau"]  # the mean of this log is one of 50 samples, half of their 0.02 ms early too
    assert abs(tau.value + 0.135e-3) < 3.0 * tau.stderr < 0.1e-3


@pytest.mark.slow
@pytest.mark.parametrize("seed", seeds(3, 4))
def test_beside_a_stated_sampling_half_a_period_is_a_delay(seed: int) -> None:
    log = made(seed, late=0.5 * PERIOD)
    assert diagnose(believed(), log, plan=False).steps == ()
    found = diagnose(stating(sampling="instant"), log, plan=False)
    assert [step.effect for step in found.steps] == ["delay"]
    assert found.steps[0].parameters["tau"].value == pytest.approx(0.5 * PERIOD, rel=0.1)
    assert diagnose(stating(sampling="instant", late=0.5 * PERIOD), log, plan=False).steps == ()


@pytest.mark.parametrize("seed", seeds(3, 4))
def test_a_stated_sampling_beside_a_speed_of_which_nothing_is_stated_is_no_delay(seed: int) -> None:
    """A speed without a position may lead the currents, as that of an observer does; stated as well it does not."""
    log = of_speed_alone(made(seed, late=0.5 * PERIOD))
    found = diagnose(stating(sampling="instant"), log, plan=False)
    assert (found.verdict, names(found)) == ("consistent", [])
    both = stating(sampling="instant", sampled={"omega": {"sampling": "instant"}})
    found = diagnose(both, log, plan=False)
    assert names(found) == ["delay"]
    assert found.steps[0].parameters["tau"].value == pytest.approx(0.5 * PERIOD, rel=0.1)


def test_a_stated_command_alone_holds_the_back_emf(project_root: Path) -> None:
    design = Design.read(project_root / "designs" / "seed_motor.toml")
    log = simulate(design, "identification", seed=1)
    names = [
        base_groups(one, make_record(one, log))[0].names
        for one in (design.model_copy(update={"log": LogMap(sampling=how)}) for how in ("command", "instant", "mean"))
    ]
    assert ["tau_emf" in found for found in names] == [True, False, False]


@pytest.mark.parametrize("frequency", [3.0, 20.0])
def test_channels_are_brought_to_their_stamps_each_by_what_is_stated_of_it(frequency: float) -> None:
    t, w = np.arange(2000) * PERIOD, 2.0 * np.pi * frequency
    clean = np.sin(w * t)
    mean = np.sin(w * (t - 0.5 * PERIOD)) * np.sinc(frequency * PERIOD)  # over the period before, in closed form
    log = Log({"t": t, "theta": np.sin(w * (t - 2e-3)), "i_q": clean, "u_d": clean, "u_q": mean})
    design = stating(sampled={"theta": {"late": 2e-3}, "u_q": {"sampling": "mean"}})
    brought = in_time(design, log)
    inside = slice(50, -50)
    for name in ("theta", "u_q"):
        assert np.max(np.abs(brought[name] - clean)[inside]) < 2e-4, name
    for name in ("i_q", "u_d"):
        assert np.array_equal(brought[name], clean), name


def test_torque_and_currents_are_stated_apart() -> None:
    design = stating(sampling="instant", sampled={"torque": {"sampling": "mean", "filter": 2e-3}})
    assert design.log.of("i_q").sampling == design.log.of("i_d").sampling == "instant"
    assert (design.log.of("torque").sampling, design.log.of("torque").filter) == ("mean", 2e-3)
    assert not design.log.of("u_q").stated
    assert Design.from_dict(design.to_dict()) == design
    log = made(1)
    told = make_record(design, log)
    assert told.timing == UNDELAYED  # this log has currents
    torque = Log({"t": log.t, "theta": log["theta"], "torque": K_T * log["i_q"]})
    assert make_record(design, torque).timing.delay == pytest.approx(0.5 * PERIOD + 2e-3)


def test_a_command_is_early_and_never_late() -> None:
    record = make_record(stating(sampling="command"), made(1))
    assert record.sampling < 0.1 * PERIOD < PERIOD < record.early
    assert not record.sampling_stated


@pytest.mark.parametrize("seed", seeds(5, 6))
@pytest.mark.parametrize(
    ("sampled", "delay"), [slow({"late": 0.5e-3}, 0.5e-3), ({"mean": True}, 0.5e-3), ({"lag": 3e-3}, 3e-3)]
)
def test_identify_is_not_biased_by_when_the_current_was_sampled(seed: int, sampled: dict, delay: float) -> None:
    found = identify(believed(), made(seed, **sampled))
    for name, true in (("J", J), ("F_c", F_C), ("F_v", F_V)):
        low, high = found.intervals[name]
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        assert abs(middle - true) < 2.0 * half, name
        assert half < 0.05 * true, name
    assert found.timing.delay == pytest.approx(delay, rel=0.1)
    assert found.to_dict()["timing"]["late"] == found.timing.late
    assert "later than the position" in found.summary() or "was filtered" in found.summary()


@pytest.mark.parametrize("seed", seeds(5, 6))
def test_compare_sees_no_structure_in_what_sampling_does(seed: int) -> None:
    found = compare(believed(), made(seed, late=0.5e-3))
    assert found.verdict == "consistent"
    assert found.log.timing.late == pytest.approx(0.5e-3, rel=0.1)
    assert found.to_dict()["timing"]["late"] == found.log.timing.late


@pytest.mark.parametrize(("late", "stderr", "said"), [
    (-4.94e-4, 0.0, "is 0.494 ms earlier"), (-4.94e-4, 1e-4, "is 0.49 ± 0.10 ms earlier"), (3e-4, 2e-4, None),
    (5e-6, 0.0, None),
])  # fmt: skip
def test_sampling_is_said_with_its_error(late: float, stderr: float, said: str | None) -> None:
    """Half a millisecond stood there with three digits, of a log in which nothing was late."""
    text = sampling_text(DriveTiming(late), "torque", stderr)
    assert said in text if said and text else text is said
    doubted = sampling_text(DriveTiming(late), "torque", stderr, lacking=True)
    doubt = "; an effect that the model lacks may look like it"
    assert doubted == (text.replace(").", f"{doubt}).") if text else None)

"""What must not upset the tracker, and that filterpy's filter and the compiled twin do the same."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import LogError, RequestError
from pmsm_ctrl.log import Log
from pmsm_ctrl.section import Table
from pmsm_ctrl.simulate import Scenario, scenario, simulate
from pmsm_ctrl.track import FrictionTracker, Settings, model, track
from pmsm_ctrl.track.inputs import Samples, samples_of
from pmsm_ctrl.track.settings import numbers
from pmsm_ctrl.track.tracking import filter_samples
from pmsm_ctrl.tune import tune
from tests.benchmarks.machines import machine
from tests.unit.simulate.composed import simulate_composed
from tests.unit.track.tracking_axes import step_of_F_c, with_known_effects

F_C, F_V = 0.0213, 0.000168


@pytest.fixture(scope="module")
def design(request: pytest.FixtureRequest) -> Design:
    return Design.read(request.config.rootpath / "designs" / "seed_motor.toml")


@pytest.fixture(scope="module")
def log(design: Design) -> Log:
    return simulate(design, scenario("triangle", design, speed=150.0, period=1.0, cycles=4.0), seed=1)


def positive_definite(P: np.ndarray) -> bool:
    scale = np.sqrt(np.diag(P))
    return bool(np.array_equal(P, P.T) and np.linalg.eigvalsh(P / np.outer(scale, scale)).min() > 0.0)


def feed(tracker: FrictionTracker, log: Log) -> list:
    names = ("t", "omega", "i_q", "theta", "i_d")
    rows = zip(*(log[name].tolist() for name in names), strict=True)
    return [tracker.update(t, omega, i_q, theta=theta, i_d=i_d) for t, omega, i_q, theta, i_d in rows]


def damaged(samples: Samples, rng: np.random.Generator) -> Samples:
    """Return samples with NaN, lost samples, a jump of the angle, a time that stands and a hole."""
    z, torque, t = samples.z.copy(), samples.torque.copy(), samples.t.copy()
    z[rng.integers(10, t.size, 20)] = np.nan
    torque[rng.integers(10, t.size, 20)] = np.nan
    z[2000:] += 0.7
    t[1500] = t[1499]
    t[3000:] += 0.5
    keep = rng.random(t.size) > 0.01
    return Samples(t[keep], z[keep], torque[keep], samples.known[keep])


@pytest.mark.parametrize("measure", ["theta", "omega"])
@pytest.mark.parametrize("estimate", [(), ("J",), ("T_load", "J")])
def test_twin_agrees_with_filterpy(design: Design, log: Log, measure: str, estimate: tuple[str, ...]) -> None:
    chosen, log = Settings(measure=measure, estimate=estimate), log.slice(0, 2000)
    readings = feed(FrictionTracker(design, chosen), log)
    found = track(design, log, chosen)
    for name, values in (("F_c", found.history["F_c"]), ("F_v", found.history["F_v"]), ("omega", found.omega)):
        assert np.allclose([getattr(r, name) for r in readings], values, rtol=1e-9, atol=1e-12)
    assert np.allclose([r.stderr_F_c for r in readings], found.stderr["F_c"], rtol=1e-9)
    assert np.allclose([r.stderr_F_v for r in readings], found.stderr["F_v"], rtol=1e-9)
    assert np.allclose([r.nis for r in readings], found.nis, rtol=1e-6, atol=1e-9, equal_nan=True)
    assert [r.event for r in readings] == [model.EVENTS[e] for e in found.events]


@pytest.mark.parametrize("measure", ["theta", "omega"])
def test_twin_agrees_with_filterpy_on_damaged_samples(
    design: Design, log: Log, rng: np.random.Generator, measure: str
) -> None:
    chosen = Settings(measure=measure)
    samples = damaged(samples_of(design, log, measure), rng)
    out = filter_samples(design, chosen, numbers(design, chosen, log.period), samples)
    tracker = FrictionTracker(design, chosen)
    rows = zip(samples.t.tolist(), samples.z.tolist(), samples.torque.tolist(), samples.known.tolist(), strict=True)
    readings = [tracker.step(*row) for row in rows]
    assert np.allclose([r.F_c for r in readings], out.estimates[:, 1], rtol=1e-9)
    assert np.allclose([r.F_v for r in readings], out.estimates[:, 2], rtol=1e-9)
    assert {"invalid", "gap"} <= {r.event for r in readings}
    if measure == "theta":
        assert "implausible" in {r.event for r in readings}


def test_twin_agrees_with_filterpy_through_a_change_and_constant_speed(design: Design) -> None:
    def references(t: np.ndarray) -> dict[str, np.ndarray]:
        return {"omega_ref": np.where(t < 2.0, 80.0 * np.sin(4.0 * t), 80.0 * np.sin(8.0))}

    truth = design.with_own_effects(step_of_F_c).with_effect("step_of_F_c", {"dF_c": 0.012, "t_0": 1.2})
    log = simulate(design, Scenario("both", 9.2, references), truth=truth, seed=4)
    for measure in ("theta", "omega"):
        chosen = Settings(measure=measure)
        found = track(design, log, chosen)
        assert {"change", "constant speed"} <= set(found.counts)
        readings = feed(FrictionTracker(design, chosen), log)
        assert np.allclose([r.F_c for r in readings], found.history["F_c"], rtol=1e-9)
        assert np.allclose([r.stderr_F_c for r in readings], found.stderr["F_c"], rtol=1e-9)
        assert [r.event for r in readings] == [model.EVENTS[e] for e in found.events]


def test_twin_agrees_with_filterpy_through_known_effects(design: Design) -> None:
    full = with_known_effects(design)
    log = simulate_composed(full, scenario("triangle", design, speed=60.0, period=1.0, cycles=2.0), full, seed=2)
    readings = feed(FrictionTracker(full), log)
    assert np.allclose([r.F_c for r in readings], track(full, log, Settings()).history["F_c"], rtol=1e-9)


def test_a_stream_is_corrected_for_the_errors_of_its_sensors_as_a_log_is(design: Design) -> None:
    """An offset and a mismatch of the current sensors and an eccentric encoder, each sample by itself."""
    truth = (
        design.with_effect("current_offset", {"o_alpha": 0.02, "o_beta": -0.01})
        .with_effect("current_gain", {"g": 0.1, "g_c": 0.02, "g_s": 0.01})
        .with_effect("encoder_eccentricity", {"e_s": 0.002, "e_c": 0.001})
    )
    log = simulate(design, scenario("triangle", design, speed=60.0, period=1.0, cycles=4.0), truth=truth, seed=2)
    tracker = FrictionTracker(truth)
    corrected = feed(tracker, log)[-1].F_c
    assert corrected == pytest.approx(float(track(truth, log, Settings()).history["F_c"][-1]), rel=1e-6)
    assert corrected == pytest.approx(F_C, rel=0.02)
    assert feed(FrictionTracker(design), log)[-1].F_c > 1.05 * F_C  # a current that reads a tenth too large
    assert not tracker.notices


@pytest.mark.parametrize(
    ("effect", "values", "measure", "left_in"),
    [
        ("delay", {"tau": 0.002}, "theta", True),
        ("encoder_eccentricity", {"e_s": 0.002}, "omega", True),
        ("encoder_eccentricity", {"e_s": 0.002}, "theta", False),
    ],
)
def test_a_stream_says_what_it_is_not_corrected_for(
    design: Design, effect: str, values: dict[str, float], measure: str, left_in: bool
) -> None:
    tracker = FrictionTracker(design.with_effect(effect, values), Settings(measure=measure))
    assert [notice.code for notice in tracker.notices] == ["measurement_effect_in_stream"] * left_in


def test_noise_that_is_twice_as_large_is_found_while_the_axis_runs(design: Design) -> None:
    """The filter raises its torque noise itself, sample by sample: a log and a live stream get the same."""
    loud = design.replace(sensor={"current_noise": 2.0 * design.sensor.current_noise})
    log = simulate(loud, scenario("triangle", design, speed=150.0, period=2.0, cycles=10.0), seed=7)
    found, told, deaf = track(design, log), track(loud, log), track(design, log, adapt=False)
    assert found.torque_noise == pytest.approx(told.torque_noise, rel=0.1)
    assert "unmodelled_torque" in [notice.code for notice in found.notices]
    late = log.t > 5.0
    error, best, worst = (np.sqrt(np.mean((one.history["F_c"][late] - F_C) ** 2)) for one in (found, told, deaf))
    assert error < 1.25 * best < worst


def test_currents_one_sample_late_hardly_move_the_friction(design: Design) -> None:
    """Where the torque changes in one direction over many samples, the late one errs in one direction as well."""
    log = simulate(design, scenario("triangle", design, speed=150.0, period=2.0, cycles=10.0), seed=5)
    late = Log({name: part[:-1] if name in ("i_d", "i_q") else part[1:] for name, part in log.channels.items()})
    moved = {
        name: float(
            np.mean(track(design, late).history[name][5000:]) / np.mean(track(design, log).history[name][5001:])
        )
        for name in ("F_c", "F_v")
    }
    assert moved == pytest.approx({"F_c": 1.0, "F_v": 1.0}, abs=0.006)  # F_v 1.012 without that in the noise


def test_a_torque_that_the_log_does_not_follow_is_said() -> None:
    # 16 kHz speed loop, 16 bit: its answers to the encoder's steps are twice F_c, and a log of 1 kHz has some of them.
    stiff = tune(machine(9043), prove=False).design
    found, fast = (
        track(one, simulate(one, scenario("triangle", one, speed=100.0, period=2.0, cycles=3.0), seed=1))
        for one in (stiff, stiff.replace(sensor={"log_divider": stiff.drive.speed_divider}))
    )
    said = {notice.code: notice for notice in found.notices}
    assert "16000 Hz" in said["torque_undersampled"].text
    assert "torque_undersampled" not in {notice.code for notice in fast.notices}
    error = fast.history["F_c"][-1] / stiff.parameters("coulomb")["F_c"] - 1.0
    assert abs(error) < 0.01


def test_covariance_stays_positive_definite_whatever_comes(design: Design, log: Log, rng: np.random.Generator) -> None:
    samples = damaged(samples_of(design, log, "theta"), rng)
    tracker = FrictionTracker(design, Settings(estimate=("T_load", "J")))
    stop = 2500
    rows = (samples.t, samples.z, samples.torque, samples.known)
    for row in zip(*(values[:stop].tolist() for values in rows), strict=True):
        tracker.step(*row)
        assert positive_definite(tracker.P)


@settings(max_examples=40, deadline=None)
@given(
    st.lists(
        st.tuples(
            st.floats(0.0, 0.01),
            st.floats(-400.0, 400.0) | st.just(math.nan) | st.just(math.inf),
            st.floats(-3.0, 3.0) | st.just(math.nan),
        ),
        min_size=1,
        max_size=60,
    )
)
def test_garbage_leaves_the_covariance_positive_definite(rows: list[tuple[float, float, float]]) -> None:
    motor = {"J": 9e-5, "K_t": 1.0}
    tracker = FrictionTracker(
        Design.from_dict(
            {
                "motor": motor,
                "sensor": {"encoder_counts": 4096, "current_noise": 0.01},
                "effects": [{"id": "coulomb", "F_c": 0.02}, {"id": "viscous", "F_v": 1e-4}],
            }
        ),
        Settings(measure="omega", interval=0.003),
    )
    t = 0.0
    for step, omega, i_q in rows:
        t += step
        tracker.update(t, omega, i_q)
        assert positive_definite(tracker.P)
        assert math.isfinite(tracker.state["F_c"])


def test_a_sample_that_is_not_a_number_changes_nothing(design: Design, log: Log) -> None:
    tracker = FrictionTracker(design)
    feed(tracker, log.slice(0, 500))
    before, P = tracker.state, tracker.P
    t = float(log.t[500])
    for bad in ({"theta": math.nan, "i_q": 0.1}, {"theta": 1.0, "i_q": math.nan}, {"theta": math.inf, "i_q": 0.0}):
        assert tracker.update(t, 0.0, **bad).event == "invalid"
    assert tracker.update(math.nan, 0.0, 0.0, theta=1.0).event == "invalid"
    assert tracker.update(float(log.t[499]), 0.0, 0.0, theta=1.0).event == "invalid"
    assert tracker.state == before
    assert np.array_equal(tracker.P, P)
    assert feed(tracker, log.slice(500, 1500))[-1].F_c == pytest.approx(F_C, rel=0.03)


@pytest.mark.slow
def test_an_hour_at_standstill(design: Design, log: Log) -> None:
    first = samples_of(design, log, "theta")
    n = 3_600_000
    rng = np.random.default_rng(1)
    counts = 2.0 * math.pi / 131072
    pieces = [
        (first.t, first.z, first.torque),
        (first.t[-1] + 0.001 * np.arange(1, n + 1), first.z[-1] + counts * (rng.random(n) < 0.01),
         0.004 * rng.standard_normal(n) + 0.01),
    ]  # fmt: skip
    pieces.append((first.t + pieces[1][0][-1] + 0.001, first.z - first.z[0] + first.z[-1], first.torque))
    t, z, torque = (np.concatenate(column) for column in zip(*pieces, strict=True))
    chosen = Settings()
    s = numbers(design, chosen, 0.001)
    out = filter_samples(design, chosen, s, Samples(t, z, torque, np.zeros(t.size)))
    moved, stood = len(first.t), len(first.t) + n
    for k in (1, 2):
        # all the while the estimates are where they were; the deviation says how long that is ago
        assert np.ptp(out.estimates[moved + 20 : stood - 1, k]) == 0.0
        assert out.variances[stood - 1, k] == pytest.approx(s[model.PRIOR + k], rel=1e-6)
        assert out.variances[:, k].max() <= s[model.PRIOR + k] * (1.0 + 1e-12)
        assert out.variances[-1, k] < 0.05 * s[model.PRIOR + k]
    assert out.estimates[-1, 1] == pytest.approx(F_C, rel=0.03)
    assert positive_definite(out.P[np.ix_(chosen.active, chosen.active)])


@pytest.mark.parametrize("jump", [2.0 * math.pi / 131072 * 40, 0.02, 1.0, -300.0])
def test_an_encoder_jump_is_rejected(design: Design, log: Log, jump: float) -> None:
    theta = log["theta"].copy()
    theta[2137:] += jump
    clean, hurt = track(design, log), track(design, log.with_channels(theta=theta))
    for name in ("F_c", "F_v"):
        difference = np.abs(hurt.history[name] - clean.history[name])
        assert difference.max() < 2.5 * clean.stderr[name][2137]
        assert difference[-1] < 0.5 * clean.stderr[name][-1]


def test_dropped_samples_are_bridged(design: Design, log: Log, rng: np.random.Generator) -> None:
    keep = rng.random(len(log)) > 0.03
    thinned = Log({name: values[keep] for name, values in log.channels.items()})
    clean, hurt = track(design, log), track(design, thinned)
    for name in ("F_c", "F_v"):
        assert abs(hurt.history[name][-1] - clean.history[name][-1]) < 0.8 * clean.stderr[name][-1]


def test_angle_that_wraps_at_a_turn(design: Design, log: Log) -> None:
    wrapped = log.with_channels(theta=np.mod(log["theta"], 2.0 * np.pi))
    assert track(design, wrapped).history["F_c"][-1] == pytest.approx(track(design, log).history["F_c"][-1], rel=1e-6)


def test_result_renders(design: Design, log: Log) -> None:
    found = track(design, log)
    assert "F_c [N m]" in found.summary()
    assert found.to_dict()["schema"] == "pmsm-ctrl/tracking/1"
    assert found.to_dict()["warning_codes"] == [notice.code for notice in found.notices]
    tables = [block for block in found.section().blocks if isinstance(block, Table)]
    assert [len(table.rows) for table in tables] == [4, 12]  # F_c, F_v, T_load and J
    axes = found.plot().axes
    assert all(axis.get_ylabel() for axis in axes)
    assert found.design_at(1e9).parameters("coulomb")["F_c"] == found.history["F_c"][-1]
    assert found.design_at(-1.0).effects[-1].stderr


def test_bad_requests_are_told(design: Design, log: Log) -> None:
    with pytest.raises(RequestError, match="accepted: theta, omega"):
        Settings(measure="speed")  # type: ignore[arg-type]
    with pytest.raises(RequestError, match="accepted: T_load, J"):
        Settings(estimate=("F_s",))
    with pytest.raises(RequestError, match="prior_F_v"):
        track(design.without_effect("viscous"), log)
    with pytest.raises(LogError, match="no channel 'theta'"):
        track(design, Log({"t": log.t, "omega": log["omega"], "i_q": log["i_q"]}), Settings(measure="theta"))
    with pytest.raises(LogError, match="neither torque nor i_q"):
        track(design, Log({"t": log.t, "omega": log["omega"]}))
    with pytest.raises(LogError, match="at least 3"):
        track(design, log.slice(0, 2))


def test_a_log_without_motion_gives_the_design_back(design: Design) -> None:
    log = simulate(design, scenario("hold", design, duration=1.0), seed=1)
    found = track(design, log)
    assert found.history["F_c"][-1] == F_C
    assert [notice.code for notice in found.notices] == ["not_moved"]


def test_settings_can_start_without_friction(design: Design, log: Log) -> None:
    bare = design.without_effect("coulomb").without_effect("viscous")
    found = track(bare, log, replace(Settings(), prior_F_c=0.05, prior_F_v=1e-3))
    assert found.history["F_c"][-1] == pytest.approx(F_C, rel=0.1)


@pytest.mark.slow
def test_twin_is_as_fast_as_compiled_code_should_be(
    request: pytest.FixtureRequest, design: Design, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At most twice the time of the exported C, and hundreds of times faster than filterpy; the best of three tries.

    Processor time in alternating pairs, so that a busy machine slows all alike.
    """
    monkeypatch.syspath_prepend(str(request.config.rootpath))
    from tests.benchmarks.tracking import exported, speeds

    log = simulate(design, scenario("triangle", design, speed=150.0, period=2.0, cycles=5.0), seed=1)
    found = [(*speeds(design, log), exported(design, log)[0]) for _ in range(3)]
    assert max(fast / slow for slow, fast, _ in found) > 350.0
    assert min(1e9 / fast / in_c for _, fast, in_c in found) < 2.0


@pytest.mark.data
def test_measured_axis_is_tracked_to_what_its_authors_identified(request: pytest.FixtureRequest, measured) -> None:  # type: ignore[no-untyped-def]
    """EMPS: F_c within a fifth, F_v between the two directions' values, and the unmodelled torque is named."""
    from pmsm_ctrl.importers import read_log

    axis = Design.read(request.config.rootpath / "designs" / "emps.toml")
    found = track(axis, read_log(measured("emps/DATA_EMPS.mat"), axis))
    late = found.t > 5.0
    assert np.median(found.history["F_c"][late]) == pytest.approx(20.39, rel=0.2)
    assert 166.7 < np.median(found.history["F_v"][late]) < 240.4
    assert "unmodelled_torque" in [notice.code for notice in found.notices]

"""Measured frequency responses: against the design that was simulated, and python-control's own responses."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import control as ct
import numpy as np
import pytest

from pmsm_ctrl import Design, Log, frf, simulate
from pmsm_ctrl.cli import app, main
from pmsm_ctrl.console import run
from pmsm_ctrl.effects.structures import SecondMass
from pmsm_ctrl.errors import LogError, NotExcitedError
from pmsm_ctrl.evidence.local_polynomial import Local
from pmsm_ctrl.frf import FrequencyResponse, Response
from pmsm_ctrl.frf.fit import Axis, fit_axis
from pmsm_ctrl.frf.frf import _judged, _nonlinear
from pmsm_ctrl.frf.measured import _beside, _passive, _ratio, counted, measured_axis
from pmsm_ctrl.frf.notices import NOISE_ANSWERED
from pmsm_ctrl.frf.present import _range
from pmsm_ctrl.frf.recorder import recorded
from pmsm_ctrl.frf.stretches import stretches, without_steps
from pmsm_ctrl.result import Estimate
from pmsm_ctrl.simulate import Scenario, scenario
from pmsm_ctrl.simulate.motions import binary_signal
from pmsm_ctrl.simulate.scenarios import chirp, multisine, noise
from pmsm_ctrl.tune.linearise import linearise, mobility
from pmsm_ctrl.tune.sampled import Cascade
from tests.benchmarks.responses import motion as excitation_motion
from tests.effort import seeds, slow

SPRING = {"J_load": 4e-5, "k": 15.0, "d": 0.002}
ANTIRESONANCE = math.sqrt(15.0 / 4e-5) / (2.0 * math.pi)
RESONANCE = math.sqrt(15.0 * (1.0 / 4e-5 + 1.0 / 5e-5)) / (2.0 * math.pi)


@pytest.fixture(scope="module")
def seed(designs: Path) -> Design:
    return Design.read(designs / "seed_motor.toml")


@pytest.fixture(scope="module")
def sprung(seed: Design) -> Log:
    return simulate(seed, multisine(design=seed), truth=seed.with_effect("compliance", SPRING), seed=7)


@pytest.fixture(scope="module")
def found(seed: Design, sprung: Log) -> FrequencyResponse:
    return frf(seed, sprung)


def test_mobility_is_what_python_control_makes_of_the_matrices(seed: Design) -> None:
    axis = seed.with_effect("compliance", SPRING)
    model = linearise(axis, 50.0)
    mechanics = ct.ss(model.A[2:, 2:], model.A[2:, [1]] / axis.K_t, np.eye(4)[[0]], 0.0)
    omega = np.geomspace(10.0, 3000.0, 40)
    mass = SecondMass(J_load=4e-5, k=15.0, d=0.002)
    closed = mobility(1j * omega, axis.J, model.point.friction_slope, mass)
    np.testing.assert_allclose(closed, mechanics(1j * omega, squeeze=True), rtol=1e-6)


def test_a_flat_deviation_is_one_band(seed: Design) -> None:
    """An inertia 5 % off was "from 7 to 6.999 Hz and 179 to 179 Hz": third octaves a little above and below 5 %."""
    log = simulate(seed, chirp(design=seed), seed=5)
    result = frf(seed.with_parameters(J=1.05 * (seed.motor.J or 0.0)), log)
    assert len(result.bands) == 1
    band, plant = result.bands[0], result.responses["plant"]
    assert band.high - band.low > 0.8 * (plant.frequency[-1] - plant.frequency[0])
    assert _range(6.9996, 6.999) == "at 7 Hz"
    assert _range(7.0, 179.2) == "from 7 to 179 Hz"


def test_without_excitation_no_design_is_written(
    seed: Design, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The help promises status 1 where --output is given; it was 2."""
    monkeypatch.chdir(tmp_path)
    seed.write("d.toml")
    simulate(seed, scenario("hold", seed, duration=2.0), seed=1).write_csv("l.csv")
    for words, status in ((["--output", "x.toml"], 1), ([], 2)):
        with pytest.raises(SystemExit) as left:
            main(["frf", "l.csv", "--design", "d.toml", *words])
        assert left.value.code == status
    assert "x.toml: not written" in capsys.readouterr().err
    assert not Path("x.toml").exists()
    assert counted(1) == "1 frequency"
    assert counted(2) == "2 frequencies"


def test_a_rigid_axis_agrees_with_its_design(seed: Design) -> None:
    result = frf(seed, simulate(seed, chirp(design=seed), seed=5))
    assert result.estimates["J"].value == pytest.approx(9e-5, rel=0.01)
    assert abs(result.estimates["delay"].value) < 6e-6
    assert not result.bands
    assert "resonance" not in result.estimates
    assert result.warnings == ()
    assert "no third octave deviates significantly by 5 % or more" in str(result.section().blocks[0])


def test_two_masses_are_measured_through_the_closed_loop(found: FrequencyResponse) -> None:
    values = {name: one.value for name, one in found.estimates.items()}
    assert values["J"] == pytest.approx(9e-5, rel=0.01)
    assert values["antiresonance"] == pytest.approx(ANTIRESONANCE, rel=0.005)
    assert values["resonance"] == pytest.approx(RESONANCE, rel=0.005)
    assert values["damping"] == pytest.approx(0.002, rel=0.2)
    assert values["stiffness"] == pytest.approx(15.0, rel=0.01)
    assert abs(values["delay"]) < 4e-6
    assert found.misfit == pytest.approx(1.0, abs=0.35)
    assert [one.code for one in found.notices] == ["frf_resonance_not_in_design"]


def test_without_noise_nothing_is_left_of_recorder_and_window(seed: Design) -> None:
    """The spring shows in the EMF, and so in the current between the samples: by 1e-4 of the stiffness."""
    truth = seed.with_effect("compliance", SPRING).replace(sensor={"encoder_counts": 0, "current_noise": 0.0})
    result = frf(seed, simulate(seed, chirp(design=seed), truth=truth))
    values = {name: one.value for name, one in result.estimates.items()}
    assert values["J"] == pytest.approx(9e-5, rel=1e-5)
    assert values["stiffness"] == pytest.approx(15.0, rel=1e-5)
    assert values["resonance"] == pytest.approx(RESONANCE, rel=1e-6)
    assert values["damping"] == pytest.approx(0.002, rel=1e-4)


def test_where_the_design_fails_is_said(found: FrequencyResponse) -> None:
    assert any(band.low < ANTIRESONANCE < band.high and band.ratio < 0.5 for band in found.bands)
    # the lines next to the resonance are at 115.5 and 138.8 Hz
    assert any(RESONANCE < band.low < 140.0 and band.ratio > 2.0 for band in found.bands)
    assert "The design's response differs from" in found.summary()


def test_the_response_is_one_of_python_control(found: FrequencyResponse) -> None:
    response = found.plant.frd
    assert isinstance(response, ct.FrequencyResponseData)
    assert response.omega[0] == pytest.approx(2.0 * math.pi * found.plant.frequency[0])


def test_the_measured_design_holds_the_spring_and_its_margins(found: FrequencyResponse, sprung: Log) -> None:
    again = frf(found.measured, sprung)
    assert not again.bands
    assert again.warnings == ()
    margin, before = found.margins["phase_margin"]
    assert margin.value < before - 2.0
    assert again.margins["phase_margin"][1] == pytest.approx(margin.value, rel=1e-3)


@pytest.mark.slow
def test_records_are_averaged(seed: Design) -> None:
    """Four records of the same excitation: the errors of each line, and of what is fitted, are half of those of one."""
    logs = [simulate(seed, multisine(design=seed, periods=3.0), seed=k) for k in range(4)]
    one, all_four = frf(seed, logs[0]), frf(seed, logs)
    near = np.argmin(np.abs(all_four.plant.frequency[:, None] - one.plant.frequency), axis=1)
    np.testing.assert_allclose(all_four.plant.frequency, one.plant.frequency[near], rtol=1e-4)
    assert np.median(all_four.plant.stderr / one.plant.stderr[near]) == pytest.approx(0.5, abs=0.1)
    assert all_four.estimates["J"].stderr / one.estimates["J"].stderr == pytest.approx(0.5, abs=0.12)
    assert all_four.estimates["J"].value == pytest.approx(9e-5, rel=0.005)
    assert "averaged over 4 records" in all_four.summary()
    assert "averaged" not in one.summary()


def test_a_wrong_inertia_is_said(seed: Design) -> None:
    result = frf(seed.with_parameters(J=7e-5), simulate(seed, multisine(design=seed, periods=3.0), seed=2))
    assert [one.code for one in result.notices] == ["frf_inertia_deviates"]
    assert result.estimates["J"].value == pytest.approx(9e-5, rel=0.01)


@pytest.mark.parametrize(
    ("motion", "said"),
    [
        ("linear", "the moving mass is 30.24 ± 0.10 kg; the design states 28 kg (+8.0%)"),
        ("rotary", "the inertia is 30.24 ± 0.10 kg m^2; the design states 28 kg m^2 (+8.0%)"),
    ],
)
def test_the_mass_of_a_linear_axis_is_in_kg(motion: str, said: str) -> None:
    """ "the inertia is 30.24 kg m^2" was said of a moving mass."""
    design = Design.from_dict({"name": "axis", "motion": motion, "motor": {"J": 28.0, "K_t": 50.0}})
    axis = Axis(np.array([math.log(30.24), 0.0, 0.0, 0.0]), np.eye(4), misfit=1.0, spread=1e-8)
    estimates = {"J": Estimate(30.24, "kg m^2", 0.1, 28.0), "delay": Estimate(0.0, "s", 1e-4)}
    assert [one.text for one in _judged(design, axis, estimates)] == [said]


def test_a_resonance_that_the_design_has_wrongly_is_said(seed: Design) -> None:
    believed = seed.with_effect("compliance", SPRING)
    motion = multisine(design=seed, periods=3.0)
    log = simulate(believed, motion, truth=seed.with_effect("compliance", SPRING | {"k": 20.0}), seed=4)
    result = frf(believed, log)
    assert [one.code for one in result.notices] == ["frf_resonance_deviates"]
    assert result.estimates["resonance"].value == pytest.approx(RESONANCE * math.sqrt(20.0 / 15.0), rel=0.005)
    rigid = frf(believed, simulate(believed, motion, truth=seed, seed=4))
    assert [one.code for one in rigid.notices] == ["frf_resonance_not_seen"]


def test_an_unknown_inertia_is_measured(seed: Design, found: FrequencyResponse, sprung: Log) -> None:
    result = frf(seed.replace(motor={"J": "unknown"}), sprung)
    assert result.estimates["J"].value == pytest.approx(found.estimates["J"].value, rel=1e-4)
    assert result.estimates["J"].nominal is None
    assert result.estimates["resonance"].value == pytest.approx(found.estimates["resonance"].value, rel=1e-4)
    assert pytest.approx(9e-5, rel=0.01) == result.measured.J
    assert [one.code for one in result.notices] == ["frf_resonance_not_in_design"]


def test_channels_that_are_apart_are_late(seed: Design) -> None:
    log = simulate(seed, multisine(design=seed, periods=3.0), seed=4)
    late = log.slice(1, len(log)).with_channels(theta=log["theta"][:-1], omega=log["omega"][:-1])
    result = frf(seed, late)
    assert "frf_delay" in [one.code for one in result.notices]
    assert result.estimates["delay"].value == pytest.approx(1e-3, abs=20e-6)


def test_a_response_that_holds_no_inertia_is_refused(seed: Design) -> None:
    """Counts of a coarse encoder, answered by the controller, are all that is in this torque."""
    coarse = seed.replace(sensor={"encoder_counts": 500, "speed_filter": 1e-4, "current_noise": 1e-4})
    log = simulate(coarse, chirp(design=coarse, f_stop=100.0), seed=3)
    with pytest.raises(LogError, match="does not determine the inertia"):
        frf(coarse, Log({name: log[name] for name in ("t", "theta", "i_q")}))


def test_an_axis_that_reverses_is_doubted(seed: Design, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = simulate(seed, multisine(design=seed, bias=0.0), seed=4)
    result = frf(seed, log)
    assert {"frf_axis_reverses", "frf_misfit"} <= {one.code for one in result.notices}
    assert result.notices[0].code == "frf_axis_not_linear"
    assert (result.trusted, result.verdict, result.measured) == (False, "not_linear", seed)
    log.write_csv(tmp_path / "log.csv")
    seed.write(tmp_path / "axis.toml")
    given = ["frf", str(tmp_path / "log.csv"), "--design", str(tmp_path / "axis.toml")]
    assert run(app, given) == 0
    assert capsys.readouterr().out.splitlines()[-1].startswith("next: pmsm-ctrl simulate ")
    assert run(app, [*given, "--output", str(tmp_path / "new.toml")]) == 1
    assert not (tmp_path / "new.toml").exists()
    assert "new.toml: not written: the residual of the fitted axis is" in capsys.readouterr().err


@pytest.mark.parametrize(("factor", "misfit", "taken"), [(3.2, 1.5, False), (3.2, 1.0, True), (2.8, 1.5, True)])
def test_an_inertia_far_off_is_doubted_where_the_axis_does_not_explain_the_response(
    seed: Design, factor: float, misfit: float, taken: bool
) -> None:
    """A design that states the motor alone is told so; one beside a residual that is no noise is not."""
    for J in (factor * seed.J, seed.J / factor):
        axis = Axis(np.array([math.log(J), 0.0, 0.0, 0.0]), 1e-6 * np.eye(4), misfit, 1e-8)
        assert (_nonlinear(seed, [], axis) is None) is taken


def test_without_a_reference_the_bias_is_said(seed: Design, sprung: Log) -> None:
    few = Log({name: sprung[name] for name in ("t", "theta", "i_q")})
    assert "frf_no_reference" in [one.code for one in frf(seed, few).notices]


def test_what_no_passive_axis_can_answer_is_left_out() -> None:
    """A torque that is three periods late: from (pi + LEAD) / (2 pi 3 ms) = 185.2 Hz on the phase leads too much.

    These 55 lines are most of what follows behind 131 Hz.
    """
    f = np.linspace(1.0, 240.0, 240)
    passive = 1.0 / (2j * math.pi * f * 9e-5)

    def response(late: float) -> Response:
        value = passive * np.exp(-2j * math.pi * f * late)
        return Response("plant", f, value, 1e-3 * np.abs(value), np.ones(240), "i_q_ref", 1.0)

    kept, cut = _passive(response(-3e-3), 1e-3)
    assert cut == pytest.approx(132.0)
    assert len(kept) == 131
    assert NOISE_ANSWERED(frequency=cut).code == "frf_noise_answered"
    for late in (0.0, 1e-3):
        whole, none = _passive(response(late), 1e-3)
        assert none is None
        assert len(whole) == 240


@pytest.mark.parametrize("sprung", [False, True])
def test_a_phase_that_wraps_is_late_and_not_ahead(*, sprung: bool) -> None:
    """At 1.9 of 2 periods a rigid axis is behind by 180 deg at 132 Hz, and by 363 deg at 400 Hz."""
    f, mass = np.linspace(1.0, 400.0, 200), SecondMass(**SPRING) if sprung else None
    value = mobility(2j * math.pi * f, 9e-5, 2e-4, mass) * np.exp(-2j * math.pi * f * 1.9e-3)
    late = Response("plant", f, value, 1e-3 * np.abs(value), np.ones(200), "i_q_ref", 1.0)
    whole, none = _passive(late, 1e-3)
    assert none is None
    assert len(whole) == 200
    axis = fit_axis(whole, 9e-5, 1e-3)
    assert axis.errors()["delay"][0] == pytest.approx(1.9e-3, abs=1e-9)
    assert pytest.approx(9e-5, rel=1e-6) == axis.J
    assert (axis.mass is not None) == sprung


def test_a_ratio_of_noisy_responses_is_not_too_small(rng: np.random.Generator) -> None:
    """Weighted by its power the plain ratio of 2 to 1, noise n in both and 0.3 n in common, is (2 + 0.3 n)/(1 + n)."""
    count, noise = 20000, 0.04
    covariance = noise * np.array([[1.0, 0.3], [0.3, 1.0]], dtype=complex)
    root = np.linalg.cholesky(covariance / 2.0)
    response = np.array([2.0, 1.0]) + (rng.normal(size=(count, 2)) + 1j * rng.normal(size=(count, 2))) @ root.T
    spread = np.broadcast_to(covariance, (count, 2, 2))
    value, variance, _ = _ratio(
        Local(np.arange(count), response, spread, np.ones(count), spread, np.full(count, 7), np.zeros(count, bool))
    )
    power = _beside(value, spread) / variance
    assert np.sum(power * value) / np.sum(power) == pytest.approx(2.0, abs=0.01)
    plain = np.sum(response[:, 0] * response[:, 1].conj()) / np.sum(np.abs(response[:, 1]) ** 2)
    assert plain.real == pytest.approx((2.0 + 0.3 * noise) / (1.0 + noise), abs=0.01)


@pytest.mark.parametrize(("log_divider", "speed_divider"), [(16, 4), (6, 4), (1, 4), (20, 10)])
def test_samples_of_the_current_hold_the_images_of_its_staircase(
    seed: Design, log_divider: int, speed_divider: int
) -> None:
    """Against the sum over the images that fold onto a frequency: held reference, PI with its delay, R-L, inertia."""
    design = seed.replace(drive={"speed_divider": speed_divider}, sensor={"log_divider": log_divider})
    T, K_p, T_n = 1.0 / design.drive.f_control, 262.2, 0.002587
    f = np.array([20.0, 90.0, 200.0, 390.0])
    # spaced by the rate at which the control periods of both meet
    images = f + np.arange(-20000, 20001)[:, None] * design.drive.f_control / math.gcd(log_divider, speed_divider)
    s = 2j * math.pi * images
    z = np.exp(s * T)
    decay = math.exp(-19.0 / 49.16e-3 * T)
    loop = K_p * (1.0 + T / T_n / (z - 1.0)) / z * (1.0 - decay) / 19.0 / (z - decay)
    held = np.where(np.abs(z - 1.0) < 1e-12, 1.0, (1.0 - z**-speed_divider) / (1.0 - 1.0 / z))
    command = K_p * (1.0 + T / T_n / (z - 1.0)) / z / (1.0 + loop) * held
    current = command * (1.0 - 1.0 / z) / s / (19.0 + s * 49.16e-3)
    expected = s[20000] ** 2 * np.sum(current / s**2, axis=0) / np.sum(current, axis=0)
    heavy = 100.0  # its speed, and so its EMF, hardly answers
    found = recorded(design, f, [log_divider * T], heavy, 0.0)
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_a_log_of_another_period_is_taken_as_it_is(seed: Design) -> None:
    assert np.all(recorded(seed, np.array([10.0, 100.0]), [1e-3, 2e-3], 9e-5, 50.0) == 1.0)


def binary(design: Design, clock: float, *, of_speed: bool = False, periods: float = 3.0) -> Scenario:
    """Return a multisine's motion with a binary sequence in its place, in A or rad/s, clocked in speed loop ticks.

    It begins in the first tick after the run-up, which is not one of the log.
    """
    motion, T = multisine(design=design, periods=periods), design.drive.speed_period
    start, channel = motion.segments[0][2], "omega_ref" if of_speed else "i_q_add"
    sequence = binary_signal(clock, 12, 0.7 if of_speed else 0.06)

    def references(t: np.ndarray) -> Mapping[str, np.ndarray]:
        turning = {"omega_ref": motion.references(t)["omega_ref"]}
        return {**turning, channel: turning.get(channel, 0.0) + sequence(t - start)}

    assert clock % T < 1e-12 or T - clock % T < 1e-12
    return replace(motion, references=references)


def is_right(result: FrequencyResponse) -> None:
    values = {name: one.value for name, one in result.estimates.items()}
    assert values["J"] == pytest.approx(9e-5, rel=0.01)
    assert values["resonance"] == pytest.approx(RESONANCE, rel=0.005)
    assert values["damping"] == pytest.approx(0.002, rel=0.2)
    assert abs(values["delay"]) < 20e-6


def test_a_binary_sequence_is_measured_at_the_rate_of_the_speed_loop(seed: Design) -> None:
    fast = seed.replace(sensor={"log_divider": seed.drive.speed_divider})
    spring = fast.with_effect("compliance", SPRING)
    result = frf(fast, simulate(fast, binary(seed, 2e-3), truth=spring, seed=11))
    is_right(result)
    assert not result.plant.held
    assert [one.code for one in result.notices] == ["frf_resonance_not_in_design"]


# of these clocks the samples tell all values: each time behind a filter, below
@pytest.mark.parametrize("clock", [5e-3, 2e-3, 1e-3])
@pytest.mark.slow
def test_a_binary_sequence_is_measured_at_a_quarter_of_that_rate(seed: Design, clock: float) -> None:
    spring = seed.with_effect("compliance", SPRING)
    result = frf(seed, simulate(seed, binary(seed, clock), truth=spring, seed=11))
    is_right(result)
    assert result.plant.held
    assert [one.code for one in result.notices] == ["frf_resonance_not_in_design"]
    assert "held between the samples" in result.summary()


@pytest.mark.slow
@pytest.mark.parametrize("J", seeds(7e-5, 9e-5, "unknown"))
def test_without_noise_nothing_is_left_of_the_steps(seed: Design, J: float | str) -> None:
    """The inertia need not be known: what the controller answers is that of the axis that is found first."""
    quiet = seed.replace(sensor={"encoder_counts": 0, "current_noise": 0.0})
    design = quiet.replace(motor={"J": J})
    _, axis, _ = measured_axis(design, stretches(design, [simulate(quiet, binary(seed, 2e-3, periods=1.0))]))
    assert pytest.approx(9e-5, rel=1e-3) == axis.J
    assert axis.values[2] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("noise_of", seeds(11, 12, 13))
def test_a_slow_sequence_leaves_a_wide_interval_at_the_resonance(seed: Design, noise_of: int) -> None:
    """Of 20 ms little power is left at 131 Hz: 0.62 % off with the first seed, 2.4 standard errors."""
    spring = seed.with_effect("compliance", SPRING)
    found = frf(seed, simulate(seed, binary(seed, 20e-3), truth=spring, seed=noise_of)).estimates["resonance"]
    assert abs(found.value - RESONANCE) < 3.3 * found.stderr
    assert 0.002 < found.stderr / RESONANCE < 0.0035


@pytest.mark.parametrize(
    "filters",
    [
        [{"kind": "notch", "frequency": 140.0, "width": 100.0}],
        slow(
            [{"kind": "low_pass", "frequency": 400.0, "order": 2}, {"kind": "lead", "frequency": 150.0, "phase": 15.0}]
        ),
    ],
)
def test_a_sequence_in_front_of_filters_is_measured(seed: Design, filters: list[dict[str, float]]) -> None:
    """Behind the filters of the current reference it is not held: 12 % of the inertia with this notch before."""
    filtered = seed.replace(loops={"speed": seed.loops.speed.model_dump() | {"filters": filters}})
    spring = filtered.with_effect("compliance", SPRING)
    result = frf(filtered, simulate(filtered, binary(seed, 2e-3), truth=spring, seed=11))
    is_right(result)
    assert result.plant.held
    assert "held between the samples" in result.summary()
    assert [one.code for one in result.notices] == ["frf_resonance_not_in_design"]


@pytest.mark.slow
@pytest.mark.parametrize("clock", seeds(1.25e-3, 1.5e-3, 5.25e-3))
def test_a_clock_between_the_samples_is_found(seed: Design, clock: float) -> None:
    """Steps between the samples, of which a sample tells the values: 11 % of the inertia before, and no doubt."""
    spring = seed.with_effect("compliance", SPRING)
    result = frf(seed, simulate(seed, binary(seed, clock), truth=spring, seed=11))
    is_right(result)
    assert result.plant.held
    assert [one.code for one in result.notices] == ["frf_resonance_not_in_design"]


@pytest.mark.parametrize("clock", [0.5e-3, 0.75e-3, 1e-3])
def test_values_between_the_samples_are_doubted(seed: Design, clock: float) -> None:
    """What is left of the current follows the excitation where the samples do not tell all of its values."""
    spring = seed.with_effect("compliance", SPRING)
    (record,) = stretches(seed, [simulate(seed, binary(seed, clock), truth=spring, seed=11)])
    taken = without_steps(seed, record, 9e-5, SecondMass(**SPRING))
    assert taken.held == "i_q_add"
    assert taken.explained == (clock == 1e-3)


@pytest.mark.parametrize("kind", ["noise", "sequence"])
def test_what_folds_all_over_the_response_is_not_said_to_lack_excitation(seed: Design, kind: str) -> None:
    """Noise to 2 kHz and a sequence of 0.25 ms in a log of 1 kHz: a quarter of the power is known."""
    motion = binary(seed, 0.25e-3)
    if kind == "noise":
        motion = noise(design=seed, f_max=2000.0, duration=10.0)
    with pytest.raises(LogError, match="frequencies only: 20 % of the power of i_q_add lies above 400 Hz"):
        frf(seed, simulate(seed, motion, truth=seed.with_effect("compliance", SPRING), seed=11))


@pytest.mark.parametrize(
    ("clock", "filtered"), [(5.25e-3, True), slow(2e-3, True), slow(2e-3, False), slow(5.25e-3, False)]
)
def test_a_binary_speed_reference_is_measured(seed: Design, clock: float, *, filtered: bool) -> None:
    """Without the filter of the reference 8 to 12 % of the inertia before. The signal is weak: two records."""
    loop = seed.loops.speed.model_dump() | ({} if filtered else {"reference_filter": 0.0})
    design = seed.replace(loops={"speed": loop})
    motion = binary(design, clock, of_speed=True)
    rigid = frf(design, [simulate(design, motion, seed=k) for k in (11, 12)])
    assert rigid.plant.instrument == "omega_ref"
    assert rigid.plant.held
    assert rigid.estimates["J"].value == pytest.approx(9e-5, rel=0.01)
    assert abs(rigid.estimates["delay"].value) < 20e-6
    assert not rigid.notices


@pytest.mark.slow
def test_the_speed_loop_is_that_of_a_smooth_reference(seed: Design) -> None:
    """A held reference acts half a period later: the response is taken to where python-control puts it."""
    design = seed.replace(loops={"speed": seed.loops.speed.model_dump() | {"reference_filter": 0.0}})
    quiet = design.replace(sensor={"encoder_counts": 0, "current_noise": 0.0})
    found = frf(quiet, simulate(quiet, binary(quiet, 2e-3, of_speed=True)))
    assert (found.plant.instrument, found.plant.held) == ("omega_ref", True)
    assert found.estimates["J"].value == pytest.approx(9e-5, rel=1e-3)
    assert abs(found.estimates["delay"].value) < 2e-6
    loop = found.responses["speed"]
    assert design.loops is not None
    cascade = Cascade.of(design, design.loops.current, design.loops.speed, at=50.0)
    f = loop.frequency
    expected = cascade.system(("omega_ref",), ("omega_hat",))(np.exp(2j * math.pi * f * cascade.period))
    near = (f > 5.0) & (f < 200.0)
    np.testing.assert_allclose(loop.value[near], expected[near], rtol=2e-3)


@pytest.mark.parametrize(
    ("seed_of_noise", "free"), [(26500, True), (26501, False), slow(26500, False), slow(26501, True)]
)
def test_noise_as_excitation(seed: Design, seed_of_noise: int, *, free: bool) -> None:
    spring = seed.with_effect("compliance", SPRING)
    motion = excitation_motion("noise", seed, free=free, seed=seed_of_noise)
    result = frf(seed, simulate(seed, motion, truth=spring, seed=seed_of_noise))
    is_right(result)
    for name, true in {"J": 9e-5, "resonance": RESONANCE, "damping": 0.002, "delay": 0.0}.items():
        one = result.estimates[name]
        assert abs(one.value - true) < 4.0 * one.stderr
    assert result.plant.instrument == ("i_q_ref" if free else "i_q_add")
    assert [one.code for one in result.notices] == ["frf_resonance_not_in_design"]


def test_steps_that_the_design_does_not_tell_are_doubted(seed: Design) -> None:
    """Of a log with another period than the design's nobody knows what a sample of the current shows."""
    log = simulate(seed, binary(seed, 2e-3), seed=11)
    other = seed.replace(sensor={"log_divider": 20})
    assert "frf_excitation_beyond_log" in [one.code for one in frf(other, log).notices]


@pytest.mark.parametrize("speed", [2.0, 50.0])
def test_noise_alone_leads_to_no_inertia(seed: Design, speed: float) -> None:
    """The logarithm of the inertia ran away, and ended in a message of the solver."""
    with pytest.raises(NotExcitedError, match="does not determine the inertia"):
        frf(seed, simulate(seed, scenario("reversal", seed, speed=speed), seed=1))


def test_a_log_without_excitation_is_refused(seed: Design) -> None:
    t = np.arange(5000) * 1e-3
    still = Log({"t": t, "theta": np.zeros_like(t), "i_q": np.zeros_like(t)})
    with pytest.raises(LogError, match="no stretch of 1 s in which the axis moves"):
        frf(seed, still)


def reversing(seed: Design) -> Log:
    """A log of reversals without any excitation, as a drive records it: no reference in it."""
    noisy = seed.replace(sensor={"current_noise": 0.01})
    log = simulate(noisy, scenario("identification", seed, duration=6.0), seed=3)
    return Log({name: log[name] for name in ("t", "theta", "omega", "i_q")})


def test_a_log_without_excitation_offers_no_inertia(
    seed: Design, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its response looks like an axis whose inertia is off; the warnings said so, and the value was offered."""
    log = reversing(seed)
    log.write_csv(tmp_path / "log.csv")
    seed.write(tmp_path / "axis.toml")
    result = frf(seed, log)
    assert not result.trusted
    assert result.notices[0].code == "frf_no_excitation"
    assert result.measured == seed
    assert not {"frf_inertia_deviates", "frf_delay"} & {one.code for one in result.notices}
    assert result.summary(width=1000).splitlines()[3].startswith("In doubt, no answer: the log holds no excitation")
    assert result.to_dict()["trusted"] is False
    given = ["frf", str(tmp_path / "log.csv"), "--design", str(tmp_path / "axis.toml")]
    assert run(app, given) == 0
    assert capsys.readouterr().out.splitlines()[-1].startswith("next: pmsm-ctrl identify ")
    assert run(app, [*given, "--output", str(tmp_path / "new.toml")]) == 1
    assert not (tmp_path / "new.toml").exists()
    assert "new.toml: not written: the log holds no excitation" in capsys.readouterr().err


def test_figures_and_json(found: FrequencyResponse) -> None:
    assert [axes.get_ylabel() for axes in found.plot().axes] == [
        "dB of (rad/s)/(N m)", "phase [deg]", "measured / design [dB]",
    ]  # fmt: skip
    assert json.loads(json.dumps(found.to_dict()))["responses"]["plant"]["instrument"] == "i_q_add"


@pytest.mark.parametrize(("damping", "expected"), [(2e-3, 0.0535), slow(5e-4, 0.188)])
def test_the_bias_of_a_coarse_resolution_is_told(seed: Design, damping: float, expected: float) -> None:
    """Without noise the windows of a chirp of 2.5 s are all that is wrong with the damping.

    2 zeta f with zeta = d / (2 sqrt(k J_load)): d / (2 pi J_load).
    """
    quiet = seed.replace(sensor={"encoder_counts": 0, "current_noise": 0.0})
    truth = quiet.with_effect("compliance", SPRING | {"d": damping})
    result = frf(quiet, simulate(quiet, chirp(design=quiet, duration=2.5), truth=truth, seed=5))
    away = result.estimates["damping"].value / damping - 1.0
    assert away == pytest.approx(expected, rel=0.05)
    assert result.window_bias["damping"] == pytest.approx(away, rel=0.15)
    assert result.widths[0] == pytest.approx(damping / (2.0 * math.pi * 4e-5), rel=0.25)
    assert "frf_resolution_coarse" in [one.code for one in result.notices]
    assert "Hz wide, the resonance" in " ".join(result.summary().split())


def test_a_long_record_has_no_bias_to_tell(found: FrequencyResponse) -> None:
    assert abs(found.window_bias["damping"] * found.estimates["damping"].value) < found.estimates["damping"].stderr
    assert abs(found.window_bias["resonance"]) < 1e-3
    width = 0.002 / (2.0 * math.pi * 4e-5)
    assert found.widths == pytest.approx((width, width * (RESONANCE / ANTIRESONANCE) ** 2), rel=0.05)
    assert "frf_resolution_coarse" not in [one.code for one in found.notices]


@pytest.mark.parametrize(("motion", "reference"), [("positioning", "theta_ref"), ("trapezoid", "omega_ref")])
def test_a_motion_that_reverses_is_no_excitation_although_a_reference_shows_it(
    seed: Design, motion: str, reference: str
) -> None:
    """An inertia 4.8 % off had a standard error of 0.1 %, one 1.7 % off 0.6 %, and a design with it was offered."""
    log = simulate(seed.replace(sensor={"current_noise": 0.01}), motion, seed=3)
    result = frf(seed, Log({name: log[name] for name in ("t", "theta", "omega", "i_q", reference)}))
    assert result.responses["plant"].instrument == reference
    assert not result.trusted
    assert result.measured == seed
    assert f"what {reference} shows is a motion in which the axis reverses" in str(result.notices[0])

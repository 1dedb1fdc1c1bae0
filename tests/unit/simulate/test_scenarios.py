"""Named scenarios: consistent references, limits kept, nothing depends on chunks, and the drive follows."""

import inspect
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import DesignError, RequestError
from pmsm_ctrl.simulate import INPUTS, SCENARIOS, scenario, simulate
from pmsm_ctrl.simulate.motions import (
    Limits,
    PathBuilder,
    binary_signal,
    chirp_signal,
    multisine_signal,
    noise_signal,
)

T_S = 1.0 / 4000.0  # the reference drive's speed loop
MOVES = ("trapezoid", "s_curve", "reversal")
# Shorter runs of the long ones.
SHORT = {"creep": {"speed_min": 2.0, "count": 2}, "warm_up": {"duration": 24.0}, "sweep": {"speed_step": 50.0}}


@pytest.fixture(scope="module")
def seed_motor(project_root):
    return Design.read(project_root / "designs/seed_motor.toml")


def columns(motion, t):
    return dict(zip(INPUTS, motion.inputs(t).T, strict=True))


def times(motion, step=T_S):
    return np.arange(0.0, motion.duration, step)


@pytest.mark.parametrize("name", SCENARIOS)
def test_every_scenario_has_finite_references_and_ordered_segments(seed_motor, name):
    for design in (None, seed_motor):
        motion = scenario(name, design)
        assert motion.name == name
        values = motion.inputs(times(motion, 0.01))
        assert np.isfinite(values).all()
        edges = [edge for _, start, stop in motion.segments for edge in (start, stop)]
        assert edges == sorted(edges)
        assert edges[0] >= 0.0
        assert edges[-1] <= motion.duration + 1e-9
        assert len({segment for segment, _, _ in motion.segments}) == len(motion.segments)


@pytest.mark.parametrize("name", SCENARIOS)
def test_references_at_a_time_do_not_depend_on_the_times_around_it(seed_motor, name):
    motion = scenario(name, seed_motor, **SHORT.get(name, {}))
    t = times(motion)
    whole = motion.inputs(t)
    pieces = np.vstack([motion.inputs(piece) for piece in np.array_split(t, 7)])
    assert np.array_equal(whole, pieces)


@pytest.mark.parametrize("name", SCENARIOS)
def test_every_motion_starts_at_rest(seed_motor, name):
    first = columns(scenario(name, seed_motor), np.zeros(1))
    assert first["omega_ref"][0] == 0.0
    assert first["theta_ref"][0] == 0.0
    assert first["i_q_add"][0] == 0.0


@pytest.mark.parametrize("name", SCENARIOS)
def test_defaults_are_shown_or_follow_from_the_design(name):
    for key, parameter in inspect.signature(SCENARIOS[name]).parameters.items():
        assert parameter.kind is inspect.Parameter.KEYWORD_ONLY
        assert key == "design" or parameter.default is None or math.isfinite(parameter.default)


@pytest.mark.parametrize("name", MOVES)
def test_speed_is_the_derivative_of_angle_and_acceleration_that_of_speed(seed_motor, name):
    motion = scenario(name, seed_motor)
    t = times(motion)[:-1]
    x = columns(motion, t)
    # The integral of a piecewise quadratic is met by the trapezoidal rule within j h^3 / 12 a step.
    integral = np.concatenate([[0.0], np.cumsum(0.5 * (x["omega_ref"][1:] + x["omega_ref"][:-1]) * T_S)])
    jump = 3000.0 * T_S**2  # where the acceleration jumps inside a step
    assert np.abs(integral - x["theta_ref"]).max() < 16 * jump
    change = np.diff(x["omega_ref"]) - 0.5 * (x["alpha_ref"][1:] + x["alpha_ref"][:-1]) * T_S
    assert np.abs(change).max() < 0.51 * 3000.0 * T_S
    assert np.median(np.abs(change)) < 1e-6


@pytest.mark.parametrize("name", MOVES)
def test_limits_are_kept_and_used(seed_motor, name):
    motion = scenario(name, seed_motor)
    limits = Limits.of(seed_motor)
    x = columns(motion, times(motion))
    if name == "reversal":
        assert np.abs(x["omega_ref"]).max() == pytest.approx(20.0, rel=1e-6)
        return
    assert np.abs(x["omega_ref"]).max() == pytest.approx(limits.speed, rel=1e-12)
    assert np.abs(x["alpha_ref"]).max() <= limits.acceleration * (1.0 + 1e-12)
    assert x["theta_ref"].max() == pytest.approx(20.0 * math.pi, rel=1e-12)
    assert x["theta_ref"][-1] == 0.0
    if name == "s_curve":
        assert np.abs(np.diff(x["alpha_ref"])).max() <= limits.jerk * T_S * (1.0 + 1e-9)


@settings(max_examples=200, deadline=None)
@given(
    distance=st.floats(1e-3, 1e3),
    speed=st.floats(0.1, 500.0),
    acceleration=st.floats(1.0, 1e5),
    stretch=st.floats(1e-3, 10.0),
)
def test_any_s_curve_ends_exactly_and_within_limits(distance, speed, acceleration, stretch):
    limits = Limits(speed=speed, acceleration=acceleration, jerk=acceleration / stretch)
    builder = PathBuilder()
    builder.move(distance, limits)
    end = builder.t
    path = builder.path()
    theta, omega, alpha = path.at(np.linspace(0.0, end * (1 - 1e-12), 2001))
    assert np.abs(omega).max() <= speed * (1 + 1e-9)
    assert np.abs(alpha).max() <= acceleration * (1 + 1e-9)
    assert np.all(np.diff(theta) >= -1e-9 * distance)
    # No jump where the last piece meets the exact end.
    before = path.at(np.array([end - 1e-8]))
    assert before[0][0] == pytest.approx(distance, rel=1e-6, abs=1e-8 * speed)
    assert abs(before[1][0]) < 1e-6 * speed + 2e-8 * acceleration


def test_move_times_against_closed_forms():
    """h / v + v / a + a / j when every limit is met; a / j + sqrt((a / j)^2 + 4 h / a) when the speed is not."""
    h, a, j = 10.0, 10.0, 30.0
    cases = {5.0: h / 5.0 + 5.0 / a + a / j, 10.0: a / j + math.sqrt((a / j) ** 2 + 4.0 * h / a)}
    for speed, expected in cases.items():
        builder = PathBuilder()
        builder.move(h, Limits(speed=speed, acceleration=a, jerk=j))
        assert builder.t == pytest.approx(expected, rel=1e-12)
    trapezoid = PathBuilder()
    trapezoid.move(30.0, Limits(speed=10.0, acceleration=10.0, jerk=math.inf))
    assert trapezoid.t == pytest.approx(30.0 / 10.0 + 10.0 / 10.0)
    short = PathBuilder()
    short.move(0.1, Limits(speed=100.0, acceleration=100.0, jerk=100.0))
    assert short.t == pytest.approx((32.0 * 0.1 / 100.0) ** (1.0 / 3.0))  # jerk alone: (32 h / j)^(1/3)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_multisine_has_its_power_on_its_grid(seed):
    period, rms = 4.0, 0.06
    t = np.arange(0.0, period, T_S)
    signal = multisine_signal(t, period, 1.0, 200.0, 30, seed, rms)
    assert np.std(signal) == pytest.approx(rms, rel=1e-9)
    assert np.allclose(signal, multisine_signal(t + 3 * period, period, 1.0, 200.0, 30, seed, rms), atol=1e-9)
    spectrum = np.abs(np.fft.rfft(signal)) / t.size * 2.0
    lines = np.flatnonzero(spectrum > 1e-9)
    assert lines[0] / period == 1.0
    assert lines[-1] / period == 200.0
    assert np.ptp(spectrum[lines]) < 1e-9
    other = multisine_signal(t, period, 1.0, 200.0, 30, seed + 1, rms)
    assert np.abs(signal - other).max() > rms


def test_chirp_frequency_is_exponential_in_time():
    t = np.arange(0.0, 20.0, 1e-4)
    signal = chirp_signal(t, 20.0, 1.0, 100.0, 0.1)
    up = t[1:][(signal[:-1] < 0.0) & (signal[1:] >= 0.0)]
    middle, frequency = 0.5 * (up[1:] + up[:-1]), 1.0 / np.diff(up)
    late = middle > 5.0
    assert np.allclose(frequency[late], 100.0 ** (middle[late] / 20.0), rtol=0.02)


@pytest.mark.parametrize("name", [name for name in SCENARIOS if name not in ("hold", "breakaway", "positioning")])
def test_the_drive_follows(seed_motor, name):
    """Within the speed loop's own error, and the current limit is not met."""
    log = simulate(seed_motor, scenario(name, seed_motor, **SHORT.get(name, {})), seed=2, keep_truth=True)
    error = log["omega_ref"] - log["omega_true"]
    if name == "sweep":  # its levels change by steps, which no drive follows at once
        error = error[(log.t % 1.0) > 0.5]
    assert np.sqrt(np.mean(error**2)) < 1.5
    assert np.abs(log["i_q"]).max() < seed_motor.drive.i_max
    if "theta_ref" in log:
        assert np.abs(log["theta_ref"] - log["theta"]).max() < 0.1


def test_positioning_arrives(seed_motor):
    log = simulate(seed_motor, "positioning", keep_truth=True)
    for segment in log.segments:
        last = slice(segment.stop - 100, segment.stop)
        assert np.abs(log["theta_true"][last] - log["theta_ref"][last]).max() < 2e-3


@pytest.mark.parametrize("sign", ["up", "down"])
def test_breakaway_sticks_until_the_torque_meets_friction(seed_motor, sign):
    design = seed_motor.replace(sensor={"current_noise": 0.0})
    log = simulate(design, "breakaway", keep_truth=True)
    for segment in log.segments:
        if not segment.name.startswith(sign):
            continue
        inside = slice(segment.start, segment.stop)
        omega = log["omega_true"][inside]
        assert omega[0] == 0.0  # it has come to rest from the ramp before
        first = np.flatnonzero(omega)[0]
        assert abs(log["i_q"][inside][first]) == pytest.approx(0.0213 / 1.032, rel=0.02)
        assert np.abs(omega).max() < 200.0


def test_sweep_starts_from_rest_and_keeps_the_papers_levels(seed_motor):
    motion = scenario("sweep", seed_motor)
    assert [name for name, _, _ in motion.segments] == [f"{level} rad/s" for level in range(-200, 201, 10)]
    middle = np.array([0.5 * (start + stop) for _, start, stop in motion.segments])
    assert np.array_equal(columns(motion, middle)["omega_ref"], np.arange(-200.0, 201.0, 10.0))
    early = columns(motion, np.linspace(0.0, 0.06, 50))["omega_ref"]
    assert np.allclose(np.diff(early), -3000.0 * 0.06 / 49)


def test_identification_visits_what_identification_needs(seed_motor):
    motion = scenario("identification", seed_motor)
    assert motion.duration == 30.0
    omega = columns(motion, times(motion))["omega_ref"]
    assert omega.max() == pytest.approx(200.0)
    assert omega.min() == pytest.approx(-200.0)
    alpha = np.diff(omega) / T_S
    at_speed = np.abs(omega[:-1] - 50.0) < 5.0
    slopes = {round(a, 3) for a in np.abs(alpha[at_speed]).tolist()}
    assert len([a for a in slopes if any(a == pytest.approx(b, rel=0.01) for b in (150.0, 750.0, 3000.0))]) >= 3
    for duration in (20.0, 60.0):
        longer = scenario("identification", seed_motor, duration=duration)
        assert longer.duration == duration
        assert np.abs(columns(longer, np.array([duration - 1e-6]))["omega_ref"]).max() < 0.01


def test_defaults_scale_with_the_design(seed_motor):
    big = seed_motor.replace(motor={"psi_f": 0.344, "J": 9e-3})
    assert Limits.of(big).speed == 100.0  # twice the flux: half the speed
    assert Limits.of(big).acceleration == 60.0  # 0.1 * 2.064 * 3 / 9e-3 = 68.8, rounded down to one digit
    assert Limits.of(None) == Limits.of(Design.from_dict({"motor": {"J": 1.0, "K_t": 1.0}}))


def test_parameters_from_the_design_and_from_the_call(seed_motor):
    design = seed_motor.replace(scenarios={"triangle": {"speed": 7.0, "cycles": 1.0}})
    assert scenario("triangle", design).duration == 8.0
    assert columns(scenario("triangle", design), np.array([2.0]))["omega_ref"][0] == pytest.approx(7.0)
    assert columns(scenario("triangle", design, speed=9.0), np.array([2.0]))["omega_ref"][0] == pytest.approx(9.0)


@pytest.mark.parametrize(
    ("name", "parameters", "message"),
    [
        ("triangle", {"period": -1.0}, "scenario 'triangle': period: found -1; it should be positive"),
        ("creep", {"count": 1.5}, "count: found 1.5; it should be a whole number from 1"),
        ("multisine", {"f_max": 0.5}, "f_max - f_min: found -0.5; it should be positive"),
        ("noise", {"f_max": 1e5}, "duration times f_max: found 2e\\+06; it should be a whole number from 1 to 100000"),
        ("prbs", {"order": 21.0}, "scenario 'prbs': order: found 21; it should be from 2 to 20"),
        ("s_curve", {"jerk": -3.0}, "jerk: found -3; it should be positive"),
        ("identification", {"duration": 3.0}, "leave too little of the duration of 3 s"),
        ("chirp", {"design": 1.0}, "unknown parameter 'design'"),
    ],
)
def test_wrong_parameters_are_named(name, parameters, message):
    design = Design.from_dict({"motor": {"J": 1.0, "K_t": 1.0}, "scenarios": {name: parameters}})
    with pytest.raises(RequestError, match=message):
        scenario(name, design)


def test_position_control_needs_a_position_gain(seed_motor):
    speed_only = seed_motor.replace(loops={"position": {"K_v": 0.0}})
    with pytest.raises(DesignError, match=r"loops.position.K_v: found 0; position control needs a gain above 0"):
        simulate(speed_only, "s_curve")


@pytest.mark.parametrize("seed", [0, 1])
def test_noise_has_its_power_in_its_band(seed):
    """A flat Gaussian spectrum: its power in the lower half of the band is a half, within 4 / sqrt(lines)."""
    duration, rms, rate = 20.0, 0.06, 4000.0
    t = np.arange(0.0, duration, 1.0 / rate)
    signal = noise_signal(duration, 5.0, 305.0, seed, rms)
    values = signal(t)
    assert np.sqrt(np.mean(values**2)) == pytest.approx(rms, rel=1e-3)
    power = np.abs(np.fft.rfft(values)) ** 2
    f = np.fft.rfftfreq(t.size, 1.0 / rate)
    assert power[(f < 5.0) | (f > 305.0)].sum() < 1e-4 * power.sum()
    assert power[f < 155.0].sum() / power.sum() == pytest.approx(0.5, abs=4.0 / math.sqrt(6000.0))
    assert np.mean(values**4) / np.mean(values**2) ** 2 == pytest.approx(3.0, abs=0.15)
    assert not np.any(signal(np.array([-1e-3, duration + 1e-3])))
    assert np.abs(values - noise_signal(duration, 5.0, 305.0, seed + 1, rms)(t)).max() > rms


def test_a_maximum_length_sequence_is_held_and_white():
    """Its circular autocorrelation is 1 at zero and -1 / (2^n - 1) elsewhere."""
    signal, length = binary_signal(2e-3, 7, 0.06), 127
    values = signal(2e-3 * np.arange(length))
    for within in (0.0, 0.5e-3, 1.9e-3):
        assert np.array_equal(signal(2e-3 * np.arange(length) + within), values)
    assert np.array_equal(signal(2e-3 * (np.arange(length) + length)), values)
    around = np.fft.irfft(np.abs(np.fft.rfft(values / 0.06)) ** 2, length) / length
    assert around[0] == pytest.approx(1.0)
    assert np.allclose(around[1:], -1.0 / length)
    assert signal(np.array([-1e-6]))[0] == 0.0

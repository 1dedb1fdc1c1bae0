"""The design methods: what they promise is met on the sampled loop, and bad requests get an answer."""

from __future__ import annotations

import math
from dataclasses import replace

import control as ct
import numpy as np
import pytest

from pmsm_ctrl.design import Design, Filter, SpeedLoop
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.section import Table
from pmsm_ctrl.tune import Tuning, current, position, speed, tune
from pmsm_ctrl.tune.delays import delays
from pmsm_ctrl.tune.margins import margins, response
from pmsm_ctrl.tune.requirements import Requirements, Specification
from pmsm_ctrl.tune.sampled import Cascade, current_loop

MACHINES = ("seed_motor", "small_servo", "servo_2kw")


@pytest.fixture(params=MACHINES)
def design(request, designs) -> Design:
    return Design.read(designs / f"{request.param}.toml")


@pytest.fixture
def seed_motor(designs) -> Design:
    return Design.read(designs / "seed_motor.toml")


def test_current_loop_by_bandwidth_meets_crossover_and_margin(design):
    asked = 0.03 * design.drive.f_control
    loop = current.tune_current(design, by_bandwidth("current", asked, 65.0))
    for axis in ("d", "q"):
        found = margins(current_loop(design, loop, axis))
        assert found.crossover == pytest.approx(asked, rel=1e-4)
        assert found.phase_margin == pytest.approx(65.0, abs=0.01)
        assert found.stable


def test_modulus_optimum_of_the_seed_motor(seed_motor):
    # K_p = L / (2 T_sigma) with T_sigma = 1.5 periods: f_control L / 3
    loop = current.tune_current(seed_motor)
    assert loop.K_p == pytest.approx(16000.0 * 49.16e-3 / 3.0)
    assert loop.T_n == pytest.approx(49.16e-3 / 19.0)
    assert loop.K_p_d is None


@pytest.mark.parametrize("method", ["modulus_optimum", "pole_cancellation"])
def test_the_rules_take_the_winding_that_the_controller_assumes(seed_motor, method):
    wanted = Specification(current=method, current_bandwidth=None if method == "modulus_optimum" else 500.0)
    loop = current.tune_current(seed_motor.replace(assumed={"R": 25.0, "L_q": 0.06, "L_d": 0.04}), wanted)
    right = current.tune_current(seed_motor, wanted)
    assert (loop.T_n, loop.T_n_d) == (pytest.approx(0.06 / 25.0), pytest.approx(0.04 / 25.0))
    assert loop.K_p / right.K_p == pytest.approx(0.06 / 49.16e-3)
    assert loop.K_p_d / right.K_p == pytest.approx(0.04 / 49.16e-3)


def test_a_bandwidth_is_met_on_the_motor_whatever_is_assumed(seed_motor):
    wanted = by_bandwidth("current", 500.0, 60.0)
    assert current.tune_current(seed_motor.replace(assumed={"R": 25.0}), wanted) == current.tune_current(
        seed_motor, wanted
    )


def test_unequal_axes_get_their_own_gains(designs):
    loop = current.tune_current(Design.read(designs / "servo_2kw.toml"))
    assert loop.K_p_d / loop.K_p == pytest.approx(4.5 / 5.5)


def test_pole_cancellation_defaults_to_the_margin_asked_for(design):
    loop = current.tune_current(design, Specification(current="pole_cancellation", phase_margin=60.0))
    assert margins(current_loop(design, loop)).phase_margin == pytest.approx(60.0, abs=4.0)


def test_the_highest_current_bandwidth_is_where_phase_runs_out(seed_motor):
    limit = current.highest_bandwidth(seed_motor, 45.0)
    with pytest.raises(RequestError, match=rf"93\.75 us of delay .* 45 deg of phase margin is {limit:.4g} Hz"):
        current.tune_current(seed_motor, by_bandwidth("current", limit * 1.01, 45.0))
    loop = current.tune_current(seed_motor, by_bandwidth("current", limit * 0.99, 45.0))
    assert margins(current_loop(seed_motor, loop)).phase_margin == pytest.approx(45.0, abs=0.01)
    # Integrator and delay alone: 90 - 45 deg less 3 deg of PI at w * 1.5 T, so a little above 42/360/(1.5 T).
    assert limit == pytest.approx(42.0 / 360.0 / (1.5 / 16000.0), rel=0.08)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"current": "modulus"}, "unknown method 'modulus'; did you mean 'modulus_optimum'"),
        ({"current": "bandwidth"}, r"needs a bandwidth in Hz \(up to"),
        ({"current_bandwidth": 300.0}, "fixes the bandwidth by the delay"),
        ({"current": "bandwidth", "current_bandwidth": -1.0}, "a positive number was expected"),
        ({"current": "bandwidth", "current_bandwidth": math.nan}, "a positive number was expected"),
        ({"current": "bandwidth", "current_bandwidth": 100.0, "phase_margin": 95.0}, "between 5 and 85 deg"),
    ],
)
def test_bad_current_requests_get_an_answer(seed_motor, options, message):
    with pytest.raises(RequestError, match=message):
        current.tune_current(seed_motor, Specification(**options))


def test_a_phase_margin_that_no_method_reads_is_refused() -> None:
    with pytest.raises(RequestError, match="follows from the modulus and the symmetrical optimum"):
        Specification(phase_margin=70.0)
    assert Specification(phase_margin=70.0, current="pole_cancellation").phase_margin == 70.0


def by_bandwidth(loop: str, asked: float, phase_margin: float = 60.0) -> Specification:
    return Specification(phase_margin=phase_margin, **{loop: "bandwidth", f"{loop}_bandwidth": asked})


def tuned(design: Design, at: float = 30.0) -> Cascade:
    return Cascade.of(design, current.tune_current(design), at=at)


@pytest.mark.parametrize("phase_margin", [40.0, 55.0, 65.0])
def test_speed_loop_by_bandwidth_meets_crossover_and_margin(design, phase_margin):
    cascade = tuned(design)
    asked = 0.6 * speed.highest_bandwidth(cascade, phase_margin)
    gains = speed.tune_speed(cascade, by_bandwidth("speed", asked, phase_margin))
    found = margins(speed.open_loop(cascade, gains))
    assert found.crossover == pytest.approx(asked, rel=1e-4)
    assert found.phase_margin == pytest.approx(phase_margin, abs=0.02)
    assert found.stable


@pytest.mark.parametrize("a", [2.0, 1.0 + math.sqrt(2.0), 3.0, 4.0])
def test_symmetrical_optimum_keeps_its_phase_margin_on_the_sampled_loop(design, a):
    cascade = tuned(design)
    gains = speed.tune_speed(cascade, Specification(a=a))
    found = margins(speed.open_loop(cascade, gains))
    # The rule lumps all delays into one lag: a few degrees of truth are lost at the fast end.
    assert found.phase_margin == pytest.approx(math.degrees(math.atan((a * a - 1.0) / (2.0 * a))), abs=2.5)
    assert found.crossover == pytest.approx(1.0 / (2.0 * math.pi * a * delays(design, cascade.current).speed), rel=0.12)


def test_pole_placement_places_the_dominant_poles(seed_motor):
    cascade = tuned(seed_motor)
    slow, damping = 6.0, 0.8
    gains = speed.tune_speed(cascade, Specification(speed="pole_placement", speed_bandwidth=slow, damping=damping))
    poles = cascade.with_gains(speed=gains).system(("omega_ref",), ("omega",)).poles()
    wanted = 2.0 * math.pi * slow * (-damping + 1j * math.sqrt(1.0 - damping**2))
    found = np.log(poles[np.abs(poles) > 0.0].astype(complex)) / cascade.period
    nearest = found[np.argmin(np.abs(found - wanted))]
    assert abs(nearest - wanted) < 0.06 * abs(wanted)


def test_a_speed_bandwidth_above_the_delays_says_what_is_possible_and_why(seed_motor):
    cascade = tuned(seed_motor)
    limit = speed.highest_bandwidth(cascade, 60.0)
    with pytest.raises(RequestError) as caught:
        speed.tune_speed(cascade, by_bandwidth("speed", 500.0))
    text = str(caught.value)
    assert f"60 deg of phase margin is {limit:.4g} Hz" in text
    assert "speed filter 0.385 ms" in text
    assert "\n" not in text


def cells(found: Tuning) -> list[str]:
    tables = [block for block in found.section().blocks if isinstance(block, Table)]
    return [str(cell) for table in tables for row in table.rows for cell in row]


@pytest.mark.parametrize(("asked", "crossed"), [(40.0, True), (80.0, False)])
def test_a_bandwidth_of_a_two_mass_axis_is_that_of_the_axis_where_it_can_be(designs, asked, crossed):
    """A filter that was only tried, and is too slow for 40 Hz, refused them with its own small time constants."""
    design = Design.read(designs / "geared_resonant.toml")
    found = tune(design, replace(by_bandwidth("speed", asked), filters=False), prove=False)
    loop = found.margins["speed"]
    assert not found.requirements.missed(loop)
    if crossed:
        assert loop.crossover == pytest.approx(asked, rel=1e-3)
        assert found.design.loops.speed.K_p == pytest.approx(0.1526, rel=1e-2)
    else:
        assert any("of the rigid axis" in cell for cell in cells(found))


def test_a_bandwidth_between_those_that_are_possible_is_no_lack_of_lag(designs):
    """A spring lets the phase margin return above its resonance: 'lags so little' was said of a lag too large."""
    design = Design.read(designs / "geared_resonant.toml")
    cascade = Cascade.of(design, current.tune_current(design), at=10.0)
    behind = (Filter(kind="notch", frequency=256.0, width=512.0, depth=30.0),)
    with pytest.raises(RequestError, match="lags too much for 60 deg"):
        speed.tune_speed(cascade, by_bandwidth("speed", 150.0), behind)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"speed": "optimum"}, "unknown method 'optimum'"),
        ({"speed": "bandwidth"}, "needs a bandwidth in Hz"),
        ({"speed_bandwidth": 400.0}, r"would need a = 0\.48.*hold up to --speed-bandwidth 103 "),
        ({"speed": "pole_placement", "speed_bandwidth": 400.0}, "highest bandwidth"),
        ({"speed": "pole_placement", "speed_bandwidth": 0.05}, "friction alone damps more"),
    ],
)
def test_bad_speed_requests_get_an_answer(seed_motor, options, message):
    cascade = tuned(seed_motor)
    with pytest.raises(RequestError, match=message):
        speed.tune_speed(cascade, Specification(**options))


def test_position_gain_has_no_resonance_and_no_overshoot(design):
    cascade = tuned(design)
    cascade = cascade.with_gains(speed=speed.tune_speed(cascade))
    place = position.tune_position(cascade)
    found = margins(position.open_loop(cascade, place.K_v))
    assert found.complementary_peak <= 1.0101
    assert found.sensitivity_peak <= 1.4001
    closed = cascade.with_gains(position=place).system(("theta_ref",), ("theta",))
    _, y = ct.step_response(closed, cascade.period * np.arange(4000))
    assert y.max() < 1.02
    assert y[-1] == pytest.approx(1.0, abs=1e-6)


def test_a_position_gain_that_is_unstable_is_refused(seed_motor):
    cascade = tuned(seed_motor)
    cascade = cascade.with_gains(speed=speed.tune_speed(cascade))
    with pytest.raises(RequestError, match=r"unstable with K_v = 5000 1/s .* without resonance is 1\d\d"):
        position.tune_position(cascade, gain=5000.0)
    with pytest.raises(RequestError, match="a positive number was expected"):
        position.tune_position(cascade, gain=-1.0)


def test_stiffness_at_low_frequency_is_that_of_the_gains(seed_motor):
    cascade = tuned(seed_motor)
    gains = SpeedLoop(K_p=0.03, T_n=0.02)
    cascade = cascade.with_gains(speed=gains)
    cascade = cascade.with_gains(position=position.tune_position(cascade, gain=50.0))
    found = position.stiffness(cascade)
    assert found.position_integral == pytest.approx(1.032 * 0.03 * 50.0 / 0.02)
    omega = np.array([0.01])
    by_angle = response(cascade.system(("T_load",), ("theta",)), omega)
    # T_load / theta -> K_t K_p K_v / (T_n s): infinite at rest, this slope on the way there.
    assert 1.0 / np.abs(by_angle)[0] == pytest.approx(found.position_integral / 0.01, rel=1e-3)
    assert found.position_dynamic < found.position_proportional
    # The least stiffness of the speed loop of a double pole is about J times the peak's bandwidth.
    assert found.speed_dynamic == pytest.approx(1.032 * 0.03, rel=0.15)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Specification(speed="bandwith"), "speed loop: unknown method 'bandwith'; did you mean 'bandwidth'"),
        (lambda: Specification(current=3), "current loop: unknown method 3 .known: modulus_optimum, pole_canc"),
        (
            lambda: Specification(speed="bandwidth", speed_bandwidth="60"),
            "speed_bandwidth: '60'; a number was expected",
        ),
        (lambda: Specification(damping=None), "damping: None; a number was expected"),
        (lambda: Requirements(phase_margin=400), "phase_margin: 400; 0 to 180 deg was expected"),
        (lambda: Requirements(phase_margin=-40.0), "phase_margin: -40; 0 to 180 deg was expected"),
        (lambda: Requirements(sensitivity_peak=0.5), "sensitivity_peak: 0.5; 1 to inf was expected"),
        (lambda: Requirements(gain_margin_db=math.nan), "gain_margin_db: nan; 0 to inf dB was expected"),
        (lambda: Requirements(gain_margin_db="6"), "gain_margin_db: '6'; a number was expected"),
    ],
)
def test_what_cannot_be_asked_of_a_loop_is_refused_where_it_is_stated(make, message):
    with pytest.raises(RequestError, match=message):
        make()

"""Every effect's physics against closed forms or published behaviour; the drive kernel is the one under test."""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.optimize import brentq

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects import CATALOGUE
from pmsm_ctrl.simulate import Scenario, simulate
from tests.unit.simulate.composed import DELAYED, LOOSE, SLIDING, SPRUNG, simulate_composed

J = 9e-5
F_C = 0.0213


@pytest.fixture(scope="module")
def bare(project_root):
    """The reference motor without magnets' torque, ideal sensors, a log at every control period: pure mechanics."""
    design = Design.read(project_root / "designs/seed_motor.toml")
    design = design.without_effect("viscous").with_parameters(psi_f=1e-9)
    return design.replace(sensor={"encoder_counts": 0, "current_noise": 0.0, "log_divider": 1})


@pytest.fixture(scope="module")
def ideal(project_root):
    """The reference motor as it is, with ideal sensors."""
    design = Design.read(project_root / "designs/seed_motor.toml")
    return design.replace(sensor={"encoder_counts": 0, "current_noise": 0.0})


@dataclass(frozen=True)
class Constant:
    value: float

    def __call__(self, t):
        return {"T_load": np.full(len(t), self.value)}


def free(duration, references=lambda t: {}, omega_0=0.0):
    return Scenario("free", duration, references, control="current", omega_0=omega_0)


# -- breakaway and stick-slip ------------------------------------------------------------------------------------


@pytest.mark.parametrize("f_control", [4000.0, 16000.0, 50000.0])
@pytest.mark.parametrize("steps", [1, 5])
@pytest.mark.parametrize("sign", [1, -1])
def test_breakaway_at_exactly_F_s_whatever_the_step(bare, f_control, steps, sign):
    design = bare.with_effect("stribeck", {"dF_s": 0.01}).replace(drive={"f_control": f_control, "plant_steps": steps})
    F_s = F_C + 0.01
    held = simulate_composed(design, free(1.0, Constant(sign * F_s * (1 - 1e-9))))
    assert np.all(held["theta_true"] == 0.0)
    released = simulate_composed(design, free(1.0, Constant(sign * F_s * (1 + 1e-9))))
    assert sign * released["theta_true"][-1] < 0.0


@pytest.mark.slow
def test_stick_slip_of_a_mass_pulled_through_a_spring(bare, checked):
    """Period and amplitude of the limit cycle of N. Amontons' block on a belt, undamped, F_s above F_c.

    A flywheel of 10^4 kg m^2 turning at v is the other end of the spring. Slip: w(t) = v (1 - cos) + dF/sqrt(kJ) sin;
    it ends after 2 (pi - atan(dF / (v sqrt(kJ)))) / w_n; then the spring has to wind up by 2 dF.
    """
    k, v, dF = 2.0, 0.05, 0.02
    design = (
        bare.with_parameters(J=1e4 + J)
        .with_effect("compliance", {"J_load": 1e4, "k": k, "d": 0.0})
        .with_effect("stribeck", {"dF_s": dF, "w_s": 1e-3 * v, "delta": 2.0})
    )
    log = simulate_composed(design, free(6.0, omega_0=v), composed=(*SPRUNG, "stribeck"))
    w, theta = log["omega_true"], log["theta_true"]
    root = np.sqrt(k * J)
    slip = 2.0 * (np.pi - np.arctan(dF / (v * root))) / np.sqrt(k / J)
    stick = 2.0 * dF / (k * v)
    starts = np.flatnonzero((w[1:] > 0.0) & (w[:-1] == 0.0))
    periods = np.diff(log.t[starts])[2:]
    assert len(periods) > 10
    checked("stick-slip period [s]", periods.mean(), slip + stick, rel=0.01)
    assert periods.std() < 0.002 * periods.mean()
    amplitude = np.diff(theta[starts])[2:]
    checked("stick-slip amplitude [rad]", amplitude.mean(), v * (slip + stick), rel=0.01)
    checked("stick-slip peak speed [rad/s]", w[starts[2] :].max(), v + np.hypot(v, dF / root), rel=0.01)


def test_stribeck_curve_in_steady_state(ideal, checked):
    design = ideal.with_effect("stribeck", {"dF_s": 0.015, "w_s": 5.0, "delta": 2.0})
    for speed in (1.0, 3.0, 5.0, 8.0, 20.0, 100.0, -4.0):
        steady = Scenario("steady", 1.5, lambda t, w=speed: {"omega_ref": np.full(len(t), w)})
        log = simulate_composed(design, steady)
        torque = 1.032 * log["i_q"][-200:].mean()
        curve = F_C + 0.015 * np.exp(-((speed / 5.0) ** 2)) + 0.000168 * abs(speed)
        checked(f"Stribeck curve at {speed:g} rad/s [N m]", torque, np.sign(speed) * curve, rel=0.005)


# -- presliding --------------------------------------------------------------------------------------------------


def swinging(mean, size, frequency):
    return lambda t: {"T_load": -(mean + size * np.sin(2 * np.pi * frequency * t)) * np.minimum(1.0, 10.0 * t)}


BRISTLE = {"z_s": 1e-3, "z_b": 0.5, "tau_z": 2e-3}


def test_presliding_stiffness(bare, checked):
    """A load below the elastic share winds the bristle up like a spring of stiffness F_c / z_s."""
    design = bare.with_effect("presliding", BRISTLE)
    log = simulate_composed(design, free(0.5, Constant(-0.3 * F_C)), composed=SLIDING)
    checked("presliding deflection under 0.3 F_c [rad]", log["theta_true"][-1], 0.3 * 1e-3, rel=1e-6)


def test_presliding_loops_close(bare, checked):
    """Between the elastic share and breakaway the loop has an area, and closes after each period."""
    design = bare.with_effect("presliding", BRISTLE).replace(sensor={"log_divider": 16})
    log = simulate_composed(design, free(4.0, swinging(0.0, 0.85 * F_C, 5.0)), composed=SLIDING)
    period = 200  # samples at 1 kHz
    last, before = log["theta_true"][-period:], log["theta_true"][-2 * period : -period]
    swing = np.ptp(last)
    checked("presliding loop, gap between periods / swing", np.abs(last - before).max() / swing, at_most=1e-3)
    torque = -log["T_load"][-period:]
    area = abs(np.trapezoid(torque, last))
    assert area > 0.05 * swing * 2 * 0.85 * F_C


def lugre_drift(mean, size, frequency, cycles, sigma_0, step):
    """Plain LuGre under a load below breakaway, quasi-static: dz = v - sigma_0 abs(v) z / F_c, sigma_0 z = load."""
    x = z = 0.0
    trace = []
    for n in range(round(cycles / frequency / step)):
        load = mean + size * np.sin(2 * np.pi * frequency * n * step)
        target = load / sigma_0
        # z follows the load; the shaft moves by dx with dz = dx (1 - sgn(dx) sigma_0 z / F_c)
        dz = target - z
        x += dz / (1.0 - np.sign(dz) * sigma_0 * z / F_C)
        z = target
        trace.append(x)
    return np.array(trace)


@pytest.mark.slow
def test_no_drift_over_1e5_cycles_where_plain_lugre_drifts(bare, checked):
    mean, size, frequency = 0.3 * F_C, 0.15 * F_C, 200.0
    design = bare.with_effect("presliding", BRISTLE).replace(sensor={"log_divider": 80 * 500})
    log = simulate_composed(design, free(501.0, swinging(mean, size, frequency)), composed=SLIDING)
    theta = log["theta_true"][log.t > 1.0]
    # sampled once every 500 cycles, at the same phase
    checked("drift in 1e5 cycles below breakaway [rad]", np.ptp(theta), at_most=1e-9)
    lugre = lugre_drift(mean, size, frequency, 1000, F_C / 1e-3, 1.0 / (200 * frequency))
    per_cycle = (lugre[-1] - lugre[len(lugre) // 2]) / 500
    # plain LuGre creeps by hundreds of breakaway deflections
    checked("the same, plain LuGre [rad]", per_cycle * 1e5, at_least=100 * 1e-3)


def test_breakaway_force_falls_with_the_loading_rate(bare):
    """V. Johannes, M. Green, C. Brockley, Wear 24 (1973) 381: faster loading breaks away at a lower force."""
    design = bare.with_effect("presliding", BRISTLE | {"tau_z": 5e-4}).with_effect(
        "stribeck", {"dF_s": 0.01, "w_s": 0.05, "delta": 1.0}
    )
    forces = []
    for rate in (0.005, 0.05, 0.5):
        ramp = free(0.05 / rate, lambda t, r=rate: {"T_load": -r * t})
        log = simulate_composed(design, ramp, composed=SLIDING)
        # Friction is what the load leaves after accelerating the shaft; its peak is the breakaway.
        friction = -log["T_load"][1:] - J * np.diff(log["omega_true"]) * 16000.0
        forces.append(friction.max())
    assert forces[0] > forces[1] > forces[2]
    assert F_C < forces[2] < forces[0] <= F_C + 0.01 + 1e-9


def test_friction_lags_behind_speed(bare):
    """D. Hess, A. Soom, J. Tribology 112 (1990) 147: more friction while speeding up than while slowing down."""
    term = CATALOGUE["presliding"].py_term
    h, zeta = 1e-4, 1.0
    t = np.arange(0, 2.0, h)
    omega = 0.06 + 0.05 * np.sin(2 * np.pi * 1.0 * t)
    friction = np.empty_like(t)
    for n, w in enumerate(omega):
        limit = (F_C + 0.02 * np.exp(-w / 0.02)) / (F_C + 0.02)
        zeta, friction[n] = term(zeta, w * h, w, limit, 5e-3, 0.5, 0.0)
    second = t >= 1.0
    for speed in (0.03, 0.06, 0.09):
        near = second & (np.abs(omega - speed) < 1e-3)
        up = near & (np.gradient(omega) > 0)
        assert friction[up].mean() > friction[near & ~up].mean() * 1.001


@pytest.mark.parametrize("z_s", [1e-3, 1e-5, 1e-7, 1e-12])
def test_stiff_bristles_are_stable_at_the_simulations_own_step(ideal, z_s):
    design = ideal.with_effect("presliding", {"z_s": z_s})
    back_and_forth = Scenario("swing", 1.0, lambda t: {"omega_ref": 100.0 * np.sin(2 * np.pi * 2 * t)})
    soft = simulate_composed(design, back_and_forth, composed=SLIDING)
    rigid = simulate(ideal, back_and_forth)
    assert np.abs(soft["omega"] - rigid["omega"]).max() < 1.0


# -- two masses --------------------------------------------------------------------------------------------------


def crossings(t, x):
    """Mean period from rising zero crossings, interpolated."""
    rising = np.flatnonzero((x[:-1] < 0) & (x[1:] >= 0))
    times = t[rising] - x[rising] * (t[rising + 1] - t[rising]) / (x[rising + 1] - x[rising])
    return np.diff(times).mean()


@pytest.mark.parametrize(("J_load", "k"), [(5e-5, 20.0), (8e-5, 5.0), (2e-5, 100.0)])
def test_two_mass_resonance_and_antiresonance(bare, checked, J_load, k):
    kick = lambda t: {"T_load": np.where(t < 0.002, 0.004, 0.0)}  # noqa: E731
    spring = {"J_load": J_load, "k": k, "d": 0.0, "F_load": 0.0}
    loose = bare.without_effect("coulomb").with_effect("compliance", spring)
    floating = simulate_composed(loose, free(1.0, kick), composed=SPRUNG)
    twist = (floating["theta_true"] - floating["theta_load"])[floating.t > 0.01]
    resonance = np.sqrt(k * (1.0 / J_load + 1.0 / (J - J_load))) / (2 * np.pi)
    found = 1.0 / crossings(floating.t[floating.t > 0.01], twist)
    checked(f"resonance, k = {k:g} [Hz]", found, resonance, rel=0.005)
    # Friction holds the motor: what is left swings at the antiresonance.
    held = simulate_composed(bare.with_effect("compliance", spring), free(1.0, kick), composed=SPRUNG)
    assert np.all(held["theta_true"] == 0.0)
    load = held["theta_load"][held.t > 0.01]
    antiresonance = np.sqrt(k / J_load) / (2 * np.pi)
    found = 1.0 / crossings(held.t[held.t > 0.01], load)
    checked(f"antiresonance, k = {k:g} [Hz]", found, antiresonance, rel=0.005)


def test_backlash_gap_is_traversed_with_conserved_momentum(bare, checked):
    gap, J_load, pulse, width = 0.02, 4e-5, 0.01, 0.005
    design = bare.without_effect("coulomb").with_effect("backlash", {"gap": gap, "J_load": J_load, "k": 50.0, "d": 0.0})
    push = free(0.5, lambda t: {"T_load": np.where(t < width, -pulse, 0.0)})
    log = simulate_composed(design, push, composed=LOOSE)
    w, theta, load = log["omega_true"], log["theta_true"], log["theta_load"]
    load_speed = np.gradient(load, log.t)
    after = log.t > width + 1e-3
    momentum = ((J - J_load) * w + J_load * load_speed)[after][:-1]
    given = pulse * width
    # gradient() of a contact is inexact where the flanks meet; the free flights are exact
    checked("momentum across the backlash gap [N m s]", np.median(momentum), given, rel=2e-2)
    free_flight = after & (np.abs(theta - load) < 0.499 * gap)
    assert np.ptp(w[free_flight & (log.t < 0.0105)]) == 0.0  # before the first contact the motor has not moved
    # The collision is elastic (d = 0): relative speed is reversed, v_motor = 2 J_l u / (J_l + J_m).
    u = load_speed[np.flatnonzero(log.t > width + 2e-4)[0]]
    first_contact = np.flatnonzero(w > 0)[0]
    later = np.flatnonzero((log.t > log.t[first_contact]) & (np.abs(theta - load) < 0.49 * gap))[5]
    checked("motor speed after an elastic contact [rad/s]", w[later], 2 * J_load * u / J, rel=1e-2)


@pytest.mark.slow
def test_a_gap_and_a_spring_together_use_the_springs_constants(bare):
    spring = bare.without_effect("coulomb").with_effect("compliance", {"J_load": 4e-5, "k": 20.0, "d": 0.0})
    both = spring.with_effect("backlash", {"gap": 1e-9, "J_load": 1e-5, "k": 1e3, "d": 0.5})
    push = free(0.2, lambda t: {"T_load": np.where(t < 0.005, -0.01, 0.0)})
    one, other = (simulate(d, push, keep_truth=True)["omega_true"] for d in (spring, both))
    assert np.abs(one - other).max() < 1e-4 * np.abs(one).max()


# -- dead time ---------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_dead_time_sixth_harmonic_of_the_current(project_root, checked):
    """A six-step error voltage of amplitude 4/3 dU at a steady speed, against R, L and the rotation's coupling.

    The averaged model solved by harmonic balance, without any time integration.
    """
    dU, speed, p, R, L, psi = 5.0, 20.0, 4, 19.0, 49.16e-3, 0.172
    design = Design.read(project_root / "designs/seed_motor.toml").replace(
        sensor={"encoder_counts": 0, "current_noise": 0.0, "log_divider": 1},
        loops={"current": {"K_p": 1e-9, "T_n": 1e9}, "speed": {"K_p": 0.0, "T_n": 1.0}},
        # The feedforward of a wrong flux drives a steady current; no current is fed back.
        assumed={"K_t": 1.5 * p * (psi + 1.0), "L_d": 1e-12, "L_q": 1e-12},
    )
    truth = design.with_parameters(J=1e6).replace_effects(()).with_effect("dead_time", {"dU": dU, "i_0": 1e-4})
    spin = Scenario("spin", 0.6, lambda t: {}, control="current", omega_0=speed)
    log = simulate_composed(design, spin, truth)
    turn = 2 * np.pi / (p * speed)
    late = (log.t > 0.2) & (log.t < 0.2 + np.floor(0.4 / turn) * turn)  # whole electrical periods
    angle = p * log["theta"][late]
    measured = np.mean((log["i_d"] + 1j * log["i_q"])[late] * np.exp(-6j * angle))
    mirrored = np.mean((log["i_d"] + 1j * log["i_q"])[late] * np.exp(6j * angle))

    # Harmonic balance of the averaged model: i(x) -> sign of each phase current -> error -> i(x), to a fixed point.
    n = 6000
    x = np.arange(n) * 2 * np.pi / n
    mean = np.mean((log["i_d"] + 1j * log["i_q"])[late])
    orders = np.fft.fftfreq(n, 1 / n)
    impedance = R + 1j * (orders + 1) * p * speed * L  # L_d = L_q: of i_d + j i_q in rotor coordinates
    current = np.full(n, mean)
    for _ in range(50):
        stator = current * np.exp(1j * x)
        phases = [np.sign((stator * np.exp(-2j * np.pi * m / 3)).real) for m in range(3)]
        lost = 2 / 3 * dU * sum(sign * np.exp(2j * np.pi * m / 3) for m, sign in enumerate(phases)) * np.exp(-1j * x)
        spectrum = -np.fft.fft(lost) / n / impedance
        spectrum[0] = mean
        current = np.fft.ifft(spectrum * n)
    for order, found in ((6, measured), (-6, mirrored)):
        analytic = spectrum[order]
        checked(f"dead time, current harmonic {order:+d} [A]", abs(found), abs(analytic), rel=0.03)
        assert abs(np.angle(found / analytic)) < 0.05


# -- delay, sensors ----------------------------------------------------------------------------------------------


def test_delay_is_exact(ideal):
    swing = Scenario("swing", 1.0, lambda t: {"omega_ref": 50.0 * np.sin(2 * np.pi * 5 * t)})
    fine = ideal.replace(sensor={"log_divider": 1})
    now = simulate(fine, swing)
    late = simulate_composed(fine, swing, fine.with_effect("delay", {"tau": 13.25 / 16000.0}), composed=DELAYED)
    expected = 0.75 * now["i_q"][100 - 13 : -13] + 0.25 * now["i_q"][100 - 14 : -14]
    assert np.allclose(late["i_q"][100:], expected, atol=1e-12)
    assert np.array_equal(late["omega"], now["omega"])


def test_current_offset_turns_against_the_rotor(ideal):
    """A pure offset at zero true current is seen as a vector of constant length, at minus the electrical angle."""
    loose = ideal.replace(loops={"current": {"K_p": 1e-9, "T_n": 1e9}, "speed": {"K_p": 0.0, "T_n": 1.0}})
    truth = loose.with_parameters(psi_f=1e-9, J=1e3).replace_effects(())
    truth = truth.with_effect("current_offset", {"o_alpha": 0.03, "o_beta": 0.04})
    blind = loose.replace(assumed={"K_t": 1e-9, "L_d": 1e-12, "L_q": 1e-12})
    log = simulate_composed(blind, Scenario("spin", 0.5, lambda t: {}, "current", omega_0=10.0), truth)
    seen = (log["i_d"] + 1j * log["i_q"]) * np.exp(1j * 4 * log["theta"])
    assert np.allclose(seen, 0.03 + 0.04j, atol=1e-4)


def test_encoder_eccentricity_is_in_the_measured_angle_only(ideal):
    truth = ideal.with_effect("encoder_eccentricity", {"e_s": 0.002, "e_c": 0.001})
    log = simulate_composed(ideal, Scenario("turn", 1.0, lambda t: {"omega_ref": np.full(len(t), 20.0)}), truth)
    true = log["theta_true"]
    assert np.allclose(log["theta"] - true, 0.002 * np.sin(true) + 0.001 * np.cos(true), atol=1e-12)


def test_inductance_saturation_changes_the_flux_linkage(ideal):
    """Steady state at speed and current: u_d = -p w (L_q - k i_q) i_q, by Krishnan's flux linkage."""
    k_L = 0.01
    pull = Scenario("pull", 1.0, lambda t: {"omega_ref": np.full(len(t), 50.0), "T_load": np.full(len(t), 1.0)})
    log = simulate_composed(ideal, pull, ideal.with_effect("inductance_saturation", {"k_L": k_L}))
    i_q = log["i_q"][-100:].mean()
    expected = -4 * 50.0 * (49.16e-3 - k_L * i_q) * i_q
    assert log["u_d"][-100:].mean() == pytest.approx(expected, rel=3e-3)


def test_spring_solver_reference_is_what_it_says():
    """The slip time used above solves w(t) = 0 of the closed form."""
    k, v, dF = 2.0, 0.05, 0.02
    n, root = np.sqrt(k / J), np.sqrt(k * J)
    slip = 2.0 * (np.pi - np.arctan(dF / (v * root))) / n
    w = lambda t: v * (1 - np.cos(n * t)) + dF / root * np.sin(n * t)  # noqa: E731
    assert brentq(w, 0.9 * slip, 1.05 * slip) == pytest.approx(slip, rel=1e-9)

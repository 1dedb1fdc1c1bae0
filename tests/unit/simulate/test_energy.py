"""Energy in = stored + dissipated, over random combinations of effects and motions; friction never adds any."""

from __future__ import annotations

import numpy as np
import pytest

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects import CATALOGUE
from pmsm_ctrl.effects.evaluate import column
from pmsm_ctrl.simulate import Scenario, simulate
from tests.unit.simulate.composed import SPRUNG, TERMS, simulate_composed

J = 9e-5
SIZES = {
    "coulomb": {"F_c": 0.02}, "viscous": {"F_v": 2e-4}, "stribeck": {"dF_s": 0.01, "w_s": 3.0},
    "viscous_asymmetry": {"dF_v": 5e-5}, "constant_load": {"T_0": 0.01}, "viscous_power": {"k": 1e-3},
    "quadratic_drag": {"k_2": 1e-6}, "load_dependent_friction": {"mu": 0.1},
    "position_dependent_friction": {"b_s": 0.004, "b_c": -0.002}, "thermal_drift": {"dF_v": -5e-5, "tau": 0.3},
    "unbalance": {"a_s": 0.01, "a_c": 0.003}, "cogging": {"a_s": 0.004, "order": 12.0},
    "rising_friction": {"dF_r": 0.01, "w_r": 3.0}, "detent_force": {"a_s": 0.004, "period": 0.5},
    "load_gravity": {"a_s": 0.004, "period": 20.0},
    "torque_ripple": {"r_s": 0.05}, "torque_saturation": {"k_s": 0.05}, "iron_loss": {"T_h": 0.002, "k_e": 1e-5},
}  # fmt: skip
# Drag of the moving parts: whatever the state, its power is never negative.
PASSIVE = {
    "coulomb", "viscous", "stribeck", "rising_friction", "viscous_power", "quadratic_drag", "load_dependent_friction",
    "iron_loss",
}  # fmt: skip


@pytest.fixture(scope="module")
def ideal(project_root):
    design = Design.read(project_root / "designs/seed_motor.toml").replace_effects(())
    return design.replace(sensor={"encoder_counts": 0, "current_noise": 0.0, "log_divider": 1})


def random_motion(rng):
    size, phase = rng.uniform(5, 60, 3), rng.uniform(0, 2 * np.pi, 3)
    frequency = rng.uniform(0.5, 6.0, 3)

    def references(t):
        return {"omega_ref": (size[:, None] * np.sin(2 * np.pi * frequency[:, None] * t + phase[:, None])).sum(0)}

    return Scenario("random", 1.5, references)


def test_every_torque_term_has_a_size_here():
    terms = {e.id for e in CATALOGUE.values() if e.enters == "torque" and not e.has_state}
    assert set(SIZES) == terms


@pytest.mark.parametrize("seed", range(8))
def test_energy_balance_of_random_combinations(ideal, checked, seed):
    rng = np.random.default_rng(seed)
    chosen = ["coulomb", *rng.choice(sorted(set(SIZES) - {"coulomb"}), size=5, replace=False)]
    design = ideal
    for identifier in chosen:
        design = design.with_effect(str(identifier), SIZES[str(identifier)])
    log = simulate_composed(design, random_motion(rng), composed=TERMS, seed=seed)
    w, t = log["omega_true"], log.t
    signals = {
        "omega": w, "theta": log["theta_true"], "direction": np.sign(w), "t": t, "p": 4.0,
        "i_d": log["i_d"], "i_q": log["i_q"], "torque": 1.5 * 4 * 0.172 * log["i_q"],
    }  # fmt: skip
    given = np.trapezoid(signals["torque"] * w, t)
    stored = 0.5 * J * (w[-1] ** 2 - w[0] ** 2)
    spent = 0.0
    for entry in design.effects:
        effect = CATALOGUE[entry.id]
        power = column(effect, signals, effect.values(entry)) * w
        spent += np.trapezoid(power, t)
        if entry.id in PASSIVE:
            assert power.min() >= 0.0, entry.id
    scale = np.trapezoid(np.abs(signals["torque"] * w), t)
    checked(f"energy not accounted for, combination {seed} (share of the energy moved)",
            abs(given - stored - spent) / scale, at_most=5e-4)  # fmt: skip


def test_energy_of_two_masses(ideal, checked):
    """Shaft work = two kinetic energies + spring + damper, nothing else."""
    J_load, k, d = 5e-5, 20.0, 2e-3
    design = ideal.with_effect("compliance", {"J_load": J_load, "k": k, "d": d})
    log = simulate_composed(design, random_motion(np.random.default_rng(3)), composed=SPRUNG)
    t, w = log.t, log["omega_true"]
    twist = log["theta_true"] - log["theta_load"]
    load_speed = np.gradient(log["theta_load"], t, edge_order=2)
    given = np.trapezoid(1.032 * log["i_q"] * w, t)
    stored = 0.5 * (J - J_load) * (w[-1] ** 2 - w[0] ** 2)
    stored += 0.5 * J_load * (load_speed[-1] ** 2 - load_speed[0] ** 2) + 0.5 * k * twist[-1] ** 2
    spent = np.trapezoid(d * (w - load_speed) ** 2, t)
    scale = np.trapezoid(np.abs(1.032 * log["i_q"] * w), t)
    checked("energy not accounted for, two masses (share of the energy moved)",
            abs(given - stored - spent) / scale, at_most=5e-4)  # fmt: skip


SWING = Scenario("swing", 0.1, lambda t: {"omega_ref": 30.0 * np.sin(40.0 * t)})


@pytest.mark.parametrize("identifier", sorted(CATALOGUE))
def test_zero_amplitude_is_the_baseline_bit_for_bit(ideal, identifier):
    base = ideal.with_effect("coulomb", {"F_c": 0.02}).replace(
        sensor={"encoder_counts": 131072, "current_noise": 0.004}
    )
    zero = dict.fromkeys(CATALOGUE[identifier].amplitudes, 0.0)
    expected = simulate(base.without_effect(identifier), SWING, seed=1)
    found = simulate(base.without_effect(identifier).with_effect(identifier, zero), SWING, seed=1)
    assert all(np.array_equal(expected[name], found[name]) for name in expected)


def test_terms_of_zero_amplitude_in_the_kernel_change_nothing_but_rounding(ideal):
    """Not only what is left out: every term's own lines give zero."""
    base = ideal.with_effect("coulomb", {"F_c": 0.02})
    expected = simulate(base, SWING, keep_truth=True)
    found = simulate_composed(base, SWING, composed=TERMS)
    for name in expected:
        assert np.abs(expected[name] - found[name]).max() < 1e-9 * max(np.abs(expected[name]).max(), 1.0), name


@pytest.mark.parametrize("identifier", sorted(e.id for e in CATALOGUE.values() if not e.has_state))
def test_a_vanishing_amplitude_tends_to_the_baseline(ideal, identifier):
    """The wiring itself adds nothing: amplitude 1e-12 gives the baseline to rounding."""
    tiny = dict.fromkeys(CATALOGUE[identifier].amplitudes, 1e-12)
    base = ideal.with_effect("viscous", {"F_v": 2e-4}).without_effect(identifier)
    swing = Scenario("swing", 0.1, lambda t: {"omega_ref": 30.0 + 10.0 * np.sin(40.0 * t)}, omega_0=30.0)
    expected = simulate(base, swing)
    found = simulate_composed(base.with_effect(identifier, tiny), swing, composed=TERMS)
    for name in ("omega", "i_q", "u_q"):
        assert np.abs(expected[name] - found[name]).max() < 1e-5, name

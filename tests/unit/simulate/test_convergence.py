"""Order of convergence of the integrator, measured for every effect: halve the step, watch the error."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects import CATALOGUE
from pmsm_ctrl.simulate import Scenario
from tests.unit.simulate.composed import DELAYED, LOOSE, SLIDING, SPRUNG, TERMS, simulate_composed

# Sizes large enough that the error of a coarse step stands above rounding.
SIZES = {
    "coulomb": {"F_c": 0.02}, "viscous": {"F_v": 5e-3}, "stribeck": {"dF_s": 0.05, "w_s": 40.0},
    "rising_friction": {"dF_r": 0.05, "w_r": 40.0},
    "viscous_asymmetry": {"dF_v": 5e-3}, "constant_load": {"T_0": 0.05}, "viscous_power": {"k": 2e-2},
    "quadratic_drag": {"k_2": 1e-4}, "load_dependent_friction": {"mu": 0.3},
    "position_dependent_friction": {"b_s": 0.05}, "thermal_drift": {"dF_v": 5e-3, "tau": 0.02},
    "unbalance": {"a_s": 0.05}, "cogging": {"a_s": 0.05, "order": 12.0}, "torque_ripple": {"r_s": 0.2},
    "detent_force": {"a_s": 0.05, "period": 0.5}, "load_gravity": {"a_s": 0.05, "period": 7.0},
    "torque_saturation": {"k_s": 0.1}, "iron_loss": {"T_h": 0.01, "k_e": 1e-3},
    "compliance": {"J_load": 5e-5, "k": 50.0, "d": 1e-3}, "inductance_saturation": {"k_L": 0.01},
    "current_offset": {"o_alpha": 0.1}, "current_gain": {"g": 0.05, "g_c": 0.05},
    "encoder_eccentricity": {"e_s": 0.005}, "delay": {"tau": 5e-4},
    "backlash": {"gap": 0.01, "J_load": 4e-5, "k": 50.0, "d": 0.02},
    "dead_time": {"dU": 6.0, "i_0": 0.05}, "presliding": {"z_s": 0.05, "z_b": 0.5, "tau_z": 1e-4},
}  # fmt: skip
# Smooth terms keep Runge-Kutta's fourth order. A term with a corner (a flank met, a phase current through the knee
# of the dead time, a bristle that yields, a torque through zero) costs orders at that one instant.
CORNERS = {"backlash": 0.8, "dead_time": 0.8, "presliding": 1.6, "load_dependent_friction": 1.6}


# One kernel holds every term; a structure needs one of its own.
COMPOSED = {"presliding": SLIDING, "compliance": SPRUNG, "backlash": LOOSE, "delay": DELAYED}


@pytest.mark.parametrize("identifier", sorted(CATALOGUE))
def test_order_of_convergence(project_root, checked, monkeypatch, identifier):
    monkeypatch.setattr(sys.modules["pmsm_ctrl.simulate.resolution"], "RESOLVED", np.inf)  # coarse where asked for
    base = Design.read(project_root / "designs/seed_motor.toml").replace_effects(())
    base = base.replace(
        sensor={"encoder_counts": 0, "current_noise": 0.0, "log_divider": 1}, drive={"f_control": 4000.0},
        loops={"current": {"K_p": 40.0, "T_n": 2.6e-3}},
    )  # fmt: skip
    truth = base if identifier != "presliding" else base.with_effect("coulomb", {"F_c": 0.02})
    truth = truth.with_effect(identifier, SIZES[identifier])
    single = CATALOGUE[identifier].has_state
    composed = COMPOSED.get(identifier, (identifier,)) if single else TERMS
    push = Scenario(
        "push", 0.06, lambda t: {"i_q_add": 0.15 + 0.1 * np.sin(150.0 * t)}, control="current", omega_0=60.0
    )

    def end(steps):
        log = simulate_composed(base, push, truth.replace(drive={"plant_steps": steps}), composed=composed)
        return np.concatenate([log["omega_true"], 100.0 * log["theta_true"]])

    exact = end(64)
    errors = [np.abs(end(steps) - exact).max() for steps in (1, 2, 4)]
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    checked(f"order of convergence, {identifier}", float(orders.max()), at_least=CORNERS.get(identifier, 3.7))

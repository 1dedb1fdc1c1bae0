"""The reference drive in other people's simulators, as a user would write it there.

Sampled: the same cascade, stepped by its control period. Averaged: one continuous cascade without sampling,
delay, encoder or limits, an easier problem that adaptive solvers like better. Both follow the same slow
reversal; none of them can stick, so Coulomb friction is a tanh.
"""

from __future__ import annotations

import importlib.util
import math
import time
from collections.abc import Callable

import numpy as np

from pmsm_ctrl.design import Design
from pmsm_ctrl.simulate import simulate
from pmsm_ctrl.simulate.parameters import Plant
from pmsm_ctrl.simulate.scenarios import Scenario

SPEED, FREQUENCY = 50.0, 2.0


def reference(t: float) -> float:
    """Speed reference in rad/s."""
    return SPEED * math.sin(2.0 * math.pi * FREQUENCY * t)


def reversal(duration: float) -> Scenario:
    """The same reference for the package."""
    return Scenario("reversal", duration, lambda t: {"omega_ref": SPEED * np.sin(2.0 * np.pi * FREQUENCY * t)})


def averaged(design: Design) -> Callable[[float, np.ndarray], list[float]]:
    """Right-hand side of the continuous cascade: i_d, i_q, omega, I_d, I_q, I_s."""
    plant, loops = Plant.of(design), design.loops
    assert loops is not None
    R, L_d, L_q, p, psi, J = plant.R, plant.L_d, plant.L_q, plant.p, plant.psi_f, plant.J
    K_c, T_c, K_s, T_s = loops.current.K_p, loops.current.T_n, loops.speed.K_p, loops.speed.T_n
    F_c, F_v = design.parameters("coulomb")["F_c"], design.parameters("viscous")["F_v"]

    def right_side(t: float, y: np.ndarray) -> list[float]:
        i_d, i_q, omega, I_d, I_q, I_s = y
        e = reference(t) - omega
        i_q_ref = K_s * e + I_s
        u_d = K_c * (-i_d) + I_d - p * omega * L_q * i_q
        u_q = K_c * (i_q_ref - i_q) + I_q + p * omega * (L_d * i_d + psi)
        torque = 1.5 * p * (psi * i_q + (L_d - L_q) * i_d * i_q)
        return [
            (u_d - R * i_d + p * omega * L_q * i_q) / L_d,
            (u_q - R * i_q - p * omega * (L_d * i_d + psi)) / L_q,
            (torque - F_c * math.tanh(omega / 0.1) - F_v * omega) / J,
            -K_c / T_c * i_d,
            K_c / T_c * (i_q_ref - i_q),
            K_s / T_s * e,
        ]

    return right_side


def by_scipy_averaged(design: Design, duration: float) -> float:
    """Speed at the end by scipy's LSODA on the averaged cascade."""
    from scipy.integrate import solve_ivp

    solution = solve_ivp(averaged(design), (0.0, duration), np.zeros(6), method="LSODA", rtol=1e-6, atol=1e-8)
    return float(solution.y[2, -1])


def by_control_averaged(design: Design, duration: float) -> float:
    """Speed at the end by python-control on the averaged cascade."""
    import control

    right_side = averaged(design)
    system = control.nlsys(
        lambda t, x, u, params: np.array(right_side(t, x)),
        lambda t, x, u, params: x[2:3],
        inputs=1,
        outputs=1,
        states=6,
    )
    t = np.linspace(0.0, duration, max(2, round(1000 * duration)))
    response = control.input_output_response(
        system,
        t,
        np.zeros_like(t),
        np.zeros(6),
        solve_ivp_method="LSODA",
        solve_ivp_kwargs={"rtol": 1e-6, "atol": 1e-8},
    )
    return float(np.squeeze(response.outputs)[-1])


def by_scipy_sampled(design: Design, duration: float) -> float:
    """Speed at the end by scipy's RK45 restarted at every control period, controllers in Python."""
    from scipy.integrate import solve_ivp

    plant, loops = Plant.of(design), design.loops
    assert loops is not None
    R, L, p, psi, J, T = plant.R, plant.L_q, plant.p, plant.psi_f, plant.J, plant.period
    F_c, F_v = design.parameters("coulomb")["F_c"], design.parameters("viscous")["F_v"]
    K_c, b_c, K_s = loops.current.K_p, T / loops.current.T_n, loops.speed.K_p
    b_s = T * plant.speed_divider / loops.speed.T_n
    y = np.zeros(3)
    I_d = I_q = I_s = i_q_ref = 0.0
    u = next_u = (0.0, 0.0)

    def right_side(t: float, y: np.ndarray, u_d: float, u_q: float) -> list[float]:
        i_d, i_q, omega = y
        return [
            (u_d - R * i_d + p * omega * L * i_q) / L,
            (u_q - R * i_q - p * omega * (L * i_d + psi)) / L,
            (1.5 * p * psi * i_q - F_c * math.tanh(omega / 0.1) - F_v * omega) / J,
        ]

    for k in range(round(duration / T)):
        i_d, i_q, omega = y
        if k % plant.speed_divider == 0:
            e = reference(k * T) - omega
            i_q_ref = K_s * e + I_s
            I_s += b_s * K_s * e
        u_d = -K_c * i_d + I_d - p * omega * L * i_q
        u_q = K_c * (i_q_ref - i_q) + I_q + p * omega * (L * i_d + psi)
        I_d -= b_c * K_c * i_d
        I_q += b_c * K_c * (i_q_ref - i_q)
        u, next_u = next_u, (u_d, u_q)
        y = solve_ivp(right_side, (k * T, (k + 1) * T), y, args=u, rtol=1e-6, atol=1e-8).y[:, -1]
    return float(y[2])


def by_twin(design: Design, duration: float) -> float:
    """Speed at the end by the readable twin in plain Python."""
    return float(simulate(design, reversal(duration), compiled=False, keep_truth=True)["omega_true"][-1])


def speeds(design: Design) -> list[tuple[str, float, float]]:
    """Return (tool, simulated seconds per second, factor the package is faster), measured in alternation."""
    own_duration = 20.0
    rows = []
    simulate(design, reversal(0.1))
    for name, call, duration in (
        ("plain Python, the kernel's own twin, sampled", by_twin, 0.25),
        ("scipy RK45 restarted each control period, sampled", by_scipy_sampled, 0.05),
        ("scipy LSODA, averaged continuous cascade", by_scipy_averaged, 1.0),
        ("python-control, averaged continuous cascade", by_control_averaged, 1.0),
    ):
        call(design, duration / 5.0)
        theirs, ours = [], []
        for _ in range(3):
            start = time.perf_counter()
            call(design, duration)
            theirs.append(duration / (time.perf_counter() - start))
            start = time.perf_counter()
            simulate(design, reversal(own_duration))
            ours.append(own_duration / (time.perf_counter() - start))
        rows.append((name, float(np.median(theirs)), float(np.median(np.array(ours) / np.array(theirs)))))
    return rows


def installed(name: str) -> bool:
    """Whether a simulator can be imported."""
    return importlib.util.find_spec(name) is not None

"""The reference drive in other people's simulators, as a user would write it there.

Sampled: the same cascade, stepped by its control period. Averaged: one continuous cascade without sampling,
delay, encoder or limits, an easier problem that adaptive solvers like better. Both follow the same slow
reversal; none of them can stick, so Coulomb friction is a tanh. motulator and gym-electric-motor are optional;
they get no Coulomb friction at all, which makes theirs the easier problem.
"""

from __future__ import annotations

import importlib.metadata
import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from pmsm_ctrl.design import Design
from pmsm_ctrl.simulate import simulate
from pmsm_ctrl.simulate.motions import Scenario
from pmsm_ctrl.simulate.parameters import Plant

SPEED, FREQUENCY = 50.0, 2.0
# A speed loop of 50 Hz without integral action on the reference lags 4 % of the amplitude behind 2 Hz.
FURTHEST = 0.05


class NotFollowedError(Exception):
    """A simulator was run, but its drive is not where the reference is: its speed means nothing."""


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


def cascade(design: Design) -> Callable[[int, float, float, float], tuple[float, float]]:
    """Return the sampled controllers in Python: voltages from the period's number, the currents and the speed."""
    plant, loops = Plant.of(design), design.loops
    assert loops is not None
    L, p, psi, T, divider = plant.L_q, plant.p, plant.psi_f, plant.period, plant.speed_divider
    K_c, b_c, K_s = loops.current.K_p, T / loops.current.T_n, loops.speed.K_p
    b_s = T * divider / loops.speed.T_n
    I_d = I_q = I_s = i_q_ref = 0.0

    def control(k: int, i_d: float, i_q: float, omega: float) -> tuple[float, float]:
        nonlocal I_d, I_q, I_s, i_q_ref
        if k % divider == 0:
            e = reference(k * T) - omega
            i_q_ref = K_s * e + I_s
            I_s += b_s * K_s * e
        u_d = -K_c * i_d + I_d - p * omega * L * i_q
        u_q = K_c * (i_q_ref - i_q) + I_q + p * omega * (L * i_d + psi)
        I_d -= b_c * K_c * i_d
        I_q += b_c * K_c * (i_q_ref - i_q)
        return u_d, u_q

    return control


def by_scipy_sampled(design: Design, duration: float) -> float:
    """Speed at the end by scipy's RK45 restarted at every control period, controllers in Python."""
    from scipy.integrate import solve_ivp

    plant, control = Plant.of(design), cascade(design)
    R, L, p, psi, J, T = plant.R, plant.L_q, plant.p, plant.psi_f, plant.J, plant.period
    F_c, F_v = design.parameters("coulomb")["F_c"], design.parameters("viscous")["F_v"]
    y = np.zeros(3)
    u = next_u = (0.0, 0.0)

    def right_side(t: float, y: np.ndarray, u_d: float, u_q: float) -> list[float]:
        i_d, i_q, omega = y
        return [
            (u_d - R * i_d + p * omega * L * i_q) / L,
            (u_q - R * i_q - p * omega * (L * i_d + psi)) / L,
            (1.5 * p * psi * i_q - F_c * math.tanh(omega / 0.1) - F_v * omega) / J,
        ]

    for k in range(round(duration / T)):
        u, next_u = next_u, control(k, *y)
        y = solve_ivp(right_side, (k * T, (k + 1) * T), y, args=u, rtol=1e-6, atol=1e-8).y[:, -1]
    return float(y[2])


def by_twin(design: Design, duration: float) -> float:
    """Speed at the end by the readable twin in plain Python."""
    return float(simulate(design, reversal(duration), compiled=False, keep_truth=True)["omega_true"][-1])


def followed(t: np.ndarray, omega: np.ndarray, duration: float) -> float:
    """Return the speed at the end of a run that followed the reversal to its end.

    Raises
    ------
    NotFollowedError
        When the run stops early or is anywhere further from the reference than `FURTHEST` of its amplitude.
    """
    if t[-1] < duration * (1.0 - 1e-6):
        raise NotFollowedError(f"the run stopped at {t[-1]:.4g} s of {duration:.4g} s")
    away = np.abs(omega - np.array([reference(x) for x in t])) / SPEED
    worst = int(np.argmax(away))
    if not away[worst] <= FURTHEST:
        raise NotFollowedError(
            f"the speed is {omega[worst]:.4g} rad/s at {t[worst]:.4g} s where the reference is "
            f"{reference(t[worst]):.4g} rad/s: {100.0 * away[worst]:.3g} % of the amplitude apart, "
            f"at most {100.0 * FURTHEST:.3g} % are accepted"
        )
    return float(omega[-1])


def by_motulator(design: Design, duration: float) -> float:
    """Speed at the end by motulator: its drive, its sensored current-vector control and its speed controller.

    Its own design rules make its gains, from the bandwidths of the design. Left out, which makes it easier: Coulomb
    friction (it cannot stick either), encoder counts, current noise and speed filter; its solver keeps scipy's
    tolerance of 1e-3 (the others here have 1e-6). Its speed controller runs every period, not every fourth, which
    is more work in Python. A delay of one period and the voltage limit are in.
    """
    from motulator.drive import model
    from motulator.drive.control.sm import CurrentReferenceCfg, CurrentVectorControl, SpeedController
    from motulator.drive.utils import SynchronousMachinePars

    plant, loops, i_max = Plant.of(design), design.loops, design.drive.i_max
    assert loops is not None
    K_t = 1.5 * plant.p * plant.psi_f
    machine = SynchronousMachinePars(n_p=plant.p, R_s=plant.R, L_d=plant.L_d, L_q=plant.L_q, psi_f=plant.psi_f)
    drive = model.Drive(
        model.VoltageSourceConverter(u_dc=plant.u_dc),
        model.SynchronousMachine(machine),
        model.StiffMechanicalSystem(J=plant.J, B_L=design.parameters("viscous")["F_v"]),
    )
    currents = CurrentReferenceCfg(machine, max_i_s=i_max, nom_w_m=plant.u_dc / math.sqrt(3.0) / plant.psi_f)
    control = CurrentVectorControl(
        machine, currents, T_s=plant.period, J=plant.J, alpha_c=loops.current.K_p / plant.L_q, sensorless=False
    )
    control.speed_ctrl = SpeedController(plant.J, loops.speed.K_p * K_t / plant.J, K_t * i_max)
    control.ref.w_m = lambda t: plant.p * reference(t)
    model.Simulation(drive, control).simulate(t_stop=duration)
    return followed(drive.mechanics.data.t, drive.mechanics.data.w_M, duration)


def gym_environment(design: Design) -> Any:
    """Return gym-electric-motor's environment with the reference drive in it, in rotor coordinates."""
    import gym_electric_motor as gem
    from gym_electric_motor.physical_system_wrappers import DeadTimeProcessor, DqToAbcActionProcessor
    from gym_electric_motor.reference_generators import ConstReferenceGenerator

    plant = Plant.of(design)
    limits = {"omega": 4.0 * SPEED, "i": design.drive.i_max, "u": plant.u_dc}
    motor = {"p": plant.p, "l_d": plant.L_d, "l_q": plant.L_q, "r_s": plant.R, "psi_p": plant.psi_f, "j_rotor": 0.0}
    # The inertia is the load's: it divides by that before it learns the rotor's.
    load = {"a": 0.0, "b": design.parameters("viscous")["F_v"], "c": 0.0, "j_load": plant.J}
    # No dashboard, no checker, a constant reference that nobody reads: switched off as a user in a hurry would.
    return gem.make(
        "Cont-SC-PMSM-v0",
        disable_env_checker=True,
        supply={"u_nominal": plant.u_dc},
        motor={"motor_parameter": motor, "limit_values": limits, "nominal_values": limits},
        load={"load_parameter": load},
        reference_generator=ConstReferenceGenerator(),
        visualization=(),
        physical_system_wrappers=(DeadTimeProcessor(plant.delay), DqToAbcActionProcessor.make("PMSM")),
        tau=plant.period,
    )


def by_gym_electric_motor(design: Design, duration: float) -> float:
    """Speed at the end by gym-electric-motor, its default solver (dopri5), controllers in Python.

    Left out, which makes it easier: Coulomb friction (it cannot stick either), encoder counts, current noise and
    speed filter. Delay and duty ratios are in; over the current limit the run ends.
    """
    plant, control = Plant.of(design), cascade(design)
    environment = gym_environment(design)
    inner = environment.unwrapped
    limits = inner.limits
    seen = [inner.state_names.index(name) for name in ("i_sd", "i_sq", "omega")]
    (state, _), _ = environment.reset()
    omega = [0.0]
    for k in range(round(duration / plant.period)):
        u = control(k, *(state[seen] * limits[seen]))
        (state, _), _, over_limit, _, _ = environment.step(np.array(u) / (plant.u_dc / 2.0))
        omega.append(state[seen[2]] * limits[seen[2]])
        if over_limit:
            break
    environment.close()
    return followed(plant.period * np.arange(len(omega)), np.array(omega), duration)


OPTIONAL = (("motulator", by_motulator), ("gym-electric-motor", by_gym_electric_motor))


def measured(
    design: Design, call: Callable[[Design, float], float], duration: float, own_duration: float = 20.0
) -> tuple[float, float]:
    """Return simulated seconds per second and the factor the package is faster, measured in alternation."""
    call(design, duration / 5.0)
    theirs, ours = [], []
    for _ in range(3):
        start = time.perf_counter()
        call(design, duration)
        theirs.append(duration / (time.perf_counter() - start))
        start = time.perf_counter()
        simulate(design, reversal(own_duration))
        ours.append(own_duration / (time.perf_counter() - start))
    return float(np.median(theirs)), float(np.median(np.array(ours) / np.array(theirs)))


def speeds(design: Design) -> list[tuple[str, float, float]]:
    """Return (tool, simulated seconds per second, factor the package is faster) of the simulators always there."""
    simulate(design, reversal(0.1))
    return [
        (name, *measured(design, call, duration))
        for name, call, duration in (
            ("plain Python, the kernel's own twin, sampled", by_twin, 0.25),
            ("scipy RK45 restarted each control period, sampled", by_scipy_sampled, 0.05),
            ("scipy LSODA, averaged continuous cascade", by_scipy_averaged, 1.0),
            ("python-control, averaged continuous cascade", by_control_averaged, 1.0),
        )
    ]


def optional_speed(design: Design, call: Callable[[Design, float], float]) -> tuple[float, float] | Exception:
    """Return the two figures of an optional simulator, or why it cannot be run as it is written here.

    Raises
    ------
    NotFollowedError
        When it runs, but does not follow the reversal.
    """
    simulate(design, reversal(0.1))
    try:
        call(design, 0.01)
    except NotFollowedError:
        raise
    except Exception as error:  # another version may refuse in any way
        return error
    # Three quarters of a period: from rest over the reversal to the largest backward speed.
    return measured(design, call, 0.75 / FREQUENCY)


def installed(name: str) -> str | None:
    """Version of an installed package, None when it is not there."""
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return None

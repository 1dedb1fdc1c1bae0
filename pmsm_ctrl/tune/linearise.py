"""The nonlinear drive as a python-control system, its operating points, and its linearisation there.

The equations are read from `pmsm_ctrl.kernels.balance` and from the effects' own terms; nothing is restated.
Dry friction has no derivative at rest, so two cases are told apart: a *sliding* shaft feels the slope of the
friction curve, a *stuck* one does not move at all and its acceleration row is zero.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import control as ct
import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects import bound_effects, catalogue_of
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.kernels import balance
from pmsm_ctrl.simulate.parameters import Plant

__all__ = [
    "INPUTS", "STATES", "Linearisation", "OperatingPoint", "SecondMass", "drive_system", "linearise",
    "opposing_torque", "rigid", "second_mass",
]  # fmt: skip

Array = NDArray[np.float64]

STATES = ("i_d", "i_q", "omega", "theta")
INPUTS = ("u_d", "u_q", "T_load")

# Effects that put a second mass behind the shaft, the one whose constants count first.
TWO_MASS = ("compliance", "backlash")

_voltage_d = balance.voltage_d.py_func
_voltage_q = balance.voltage_q.py_func
_torque_em = balance.torque_em.py_func


@dataclass(frozen=True)
class OperatingPoint:
    """Where the drive is linearised.

    Attributes
    ----------
    speed, load : rad/s and N m
    i_d, i_q, u_d, u_q : A and V, the currents and voltages that hold this point
    case : {"sliding", "stuck"}
    friction_slope : float
        Derivative of the opposing torque with respect to speed in N m s/rad; 0 when stuck.
    """

    speed: float
    load: float
    i_d: float
    i_q: float
    u_d: float
    u_q: float
    case: Literal["sliding", "stuck"]
    friction_slope: float


@dataclass(frozen=True, eq=False)
class Linearisation:
    """A linear model at an operating point.

    Attributes
    ----------
    point : OperatingPoint
    A, B : array, shape (n, n) and (n, 3)
        Analytic Jacobian; states `STATES` (and ``omega_load``, ``twist`` for two masses), inputs `INPUTS`.
    numerical : control.StateSpace or None
        What `control.linearize` finds from the nonlinear equations; None for a stuck shaft, where they have
        no derivative.
    states : names of the states
    rigid_A, rigid_B : the same with the load rigidly coupled, which is what `numerical` is compared with
    """

    point: OperatingPoint
    A: Array
    B: Array
    numerical: Any
    states: tuple[str, ...]
    rigid_A: Array
    rigid_B: Array

    @property
    def system(self) -> Any:
        """The analytic model as a control.StateSpace; its outputs are its states."""
        n = len(self.states)
        return ct.ss(
            self.A, self.B, np.eye(n), np.zeros((n, 3)), states=self.states, inputs=INPUTS, outputs=self.states
        )

    @property
    def deviation(self) -> float:
        """Largest difference between the analytic and the numerical matrices, relative to their largest entry."""
        if self.numerical is None:
            return math.nan
        a = np.abs(self.numerical.A - self.rigid_A).max() / np.abs(self.rigid_A).max()
        b = np.abs(self.numerical.B - self.rigid_B).max() / np.abs(self.rigid_B).max()
        return float(max(a, b))


def opposing_torque(design: Design) -> Callable[..., float]:
    """Return the sum of the design's torque effects as ``f(omega, theta, direction, i_d, i_q)`` in N m.

    Effects that bring states of their own (a second mass, bristles) are left out.
    """
    machine = Plant.of(design)
    bound = [
        (effect, values)
        for effect, values in bound_effects(design)
        if effect.enters == "torque" and effect.structure == "term"
    ]

    def total(omega: float, theta: float, direction: float, i_d: float, i_q: float) -> float:
        torque = _torque_em(machine.p, machine.psi_f, machine.L_d, machine.L_q, i_d, i_q)
        signals = {
            "omega": omega, "theta": theta, "direction": direction, "i_d": i_d, "i_q": i_q, "torque": torque,
            "t": 0.0, "p": float(machine.p), "di_d": 0.0, "di_q": 0.0,
        }  # fmt: skip
        out = 0.0
        for effect, values in bound:
            known = signals | values
            out += float(effect.py_term(*(known[name] for name in effect.arguments)))
        return out

    return total


def drive_system(design: Design, *, direction: float = 1.0) -> Any:
    """Return the dq drive with its torque effects as a `control.nlsys` nonlinear system.

    Parameters
    ----------
    design : Design
    direction : float
        Direction of sliding, 1 or -1; dry friction acts against it.

    Returns
    -------
    control.NonlinearIOSystem
        States `STATES`, inputs `INPUTS`, outputs the states and the torque in N m.

    Raises
    ------
    DesignError
        When the motor's electrical data are not known.
    """
    m = Plant.of(design)
    opposing = opposing_torque(design)

    def update(t: float, x: Array, u: Array, params: dict[str, float]) -> Array:
        i_d, i_q, omega, theta = (float(v) for v in x)
        # The balances are solved for the derivative by evaluating them with a derivative of zero.
        di_d = (u[0] - _voltage_d(m.R, m.L_d, m.L_q, m.p, i_d, i_q, 0.0, omega)) / m.L_d
        di_q = (u[1] - _voltage_q(m.R, m.L_d, m.L_q, m.p, m.psi_f, i_d, i_q, 0.0, omega)) / m.L_q
        torque = _torque_em(m.p, m.psi_f, m.L_d, m.L_q, i_d, i_q)
        domega = (torque - opposing(omega, theta, direction, i_d, i_q) - u[2]) / m.J
        return np.array([di_d, di_q, domega, omega])

    def output(t: float, x: Array, u: Array, params: dict[str, float]) -> Array:
        return np.append(x, _torque_em(m.p, m.psi_f, m.L_d, m.L_q, float(x[0]), float(x[1])))

    return ct.nlsys(update, output, name=design.name, states=STATES, inputs=INPUTS, outputs=(*STATES, "torque"), dt=0)


def _holding_current(design: Design, opposing: Callable[..., float], speed: float, load: float) -> float:
    """Return the i_q in A that balances load and friction at constant speed (i_d = 0)."""
    direction = math.copysign(1.0, speed) if speed else 0.0
    i_q = 0.0
    # Friction may depend on the torque itself; the fixed point contracts because that share is well below one.
    for _ in range(50):
        new = (load + opposing(speed, 0.0, direction, 0.0, i_q)) / design.K_t
        if abs(new - i_q) <= 1e-13 * max(1.0, abs(new)):
            return new
        i_q = new
    raise RequestError(
        f"no current holds {speed:g} rad/s against {load:g} N m: the torque effects grow with the torque faster "
        "than the torque itself"
    )


def operating_point(design: Design, speed: float = 0.0, load: float = 0.0) -> OperatingPoint:
    """Return the operating point at constant speed (rad/s) under a load (N m) with i_d = 0.

    Raises
    ------
    RequestError
        When the point needs more current or voltage than the drive has; the message says which and how much.
    """
    m = Plant.of(design)
    opposing = opposing_torque(design)
    stuck = speed == 0.0 and any(e.dry for e, _ in bound_effects(design))
    i_q = _holding_current(design, opposing, speed, load)
    u_d = _voltage_d(m.R, m.L_d, m.L_q, m.p, 0.0, i_q, 0.0, speed)
    u_q = _voltage_q(m.R, m.L_d, m.L_q, m.p, m.psi_f, 0.0, i_q, 0.0, speed)
    if abs(i_q) > design.drive.i_max:
        raise RequestError(
            f"operating point {speed:g} rad/s, {load:g} N m: needs {abs(i_q):.3g} A, but the drive's limit i_max is "
            f"{design.drive.i_max:.3g} A"
        )
    limit = m.u_dc / math.sqrt(3.0)
    if math.hypot(u_d, u_q) > limit:
        raise RequestError(
            f"operating point {speed:g} rad/s, {load:g} N m: needs {math.hypot(u_d, u_q):.4g} V, but a dc link of "
            f"{m.u_dc:g} V gives at most {limit:.4g} V (peak, phase)"
        )
    direction = math.copysign(1.0, speed) if speed else 0.0
    slope = 0.0 if stuck else _slopes(opposing, speed, 0.0, direction, i_q)[0]
    return OperatingPoint(speed, load, 0.0, i_q, u_d, u_q, "stuck" if stuck else "sliding", slope)


def _slopes(
    opposing: Callable[..., float], omega: float, theta: float, direction: float, i_q: float
) -> tuple[float, float, float, float]:
    """Central differences of the opposing torque: with respect to omega, theta, i_d and i_q."""

    def slope(h: float, index: int) -> float:
        up, down = [omega, theta, 0.0, i_q], [omega, theta, 0.0, i_q]
        up[index] += h
        down[index] -= h
        return (
            opposing(up[0], up[1], direction, up[2], up[3]) - opposing(down[0], down[1], direction, down[2], down[3])
        ) / (2.0 * h)

    h_omega = 1e-4 * max(1.0, abs(omega))
    return slope(h_omega, 0), slope(1e-5, 1), slope(1e-4, 2), slope(1e-4, 3)


def linearise(design: Design, speed: float = 0.0, load: float = 0.0) -> Linearisation:
    """Linearise the drive at constant speed (rad/s) and load (N m), i_d = 0, theta = 0.

    The matrices are the analytic Jacobian; `Linearisation.numerical` holds what `control.linearize` finds
    from the nonlinear system, and `deviation` how far the two are apart.

    Raises
    ------
    DesignError
        When the motor's electrical data are not known.
    RequestError
        When the operating point needs more current or voltage than the drive has.
    """
    m = Plant.of(design)
    point = operating_point(design, speed, load)
    opposing = opposing_torque(design)
    direction = math.copysign(1.0, speed) if speed else 0.0
    k_t = 1.5 * m.p * m.psi_f
    A = np.zeros((4, 4))
    # Derivatives of the voltage balances (balance.voltage_d, voltage_q) divided by the inductance.
    A[0, :3] = -m.R / m.L_d, m.p * speed * m.L_q / m.L_d, m.p * m.L_q * point.i_q / m.L_d
    A[1, :3] = -m.p * speed * m.L_d / m.L_q, -m.R / m.L_q, -m.p * (m.L_d * point.i_d + m.psi_f) / m.L_q
    B = np.zeros((4, 3))
    B[0, 0], B[1, 1] = 1.0 / m.L_d, 1.0 / m.L_q
    if point.case == "sliding":
        d_omega, d_theta, d_id, d_iq = _slopes(opposing, speed, 0.0, direction, point.i_q)
        reluctance = 1.5 * m.p * (m.L_d - m.L_q)
        A[2] = (reluctance * point.i_q - d_id) / m.J, (k_t + reluctance * point.i_d - d_iq) / m.J, -d_omega / m.J, 0.0
        A[2, 3] = -d_theta / m.J
        A[3, 2] = 1.0
        B[2, 2] = -1.0 / m.J
    numerical = None
    if point.case == "sliding":
        system = drive_system(design, direction=direction)
        x = np.array([point.i_d, point.i_q, speed, 0.0])
        numerical = ct.linearize(system, x, np.array([point.u_d, point.u_q, load]), eps=1e-6)
    rigid_A, rigid_B = A, B
    A, B, states = _with_second_mass(design, A, B, point.case == "stuck")
    return Linearisation(point, A, B, numerical, states, rigid_A, rigid_B)


@dataclass(frozen=True)
class SecondMass:
    """The load behind a spring: its inertia is part of the total. A gap counts as closed."""

    J_load: float  # kg m^2
    k: float  # N m/rad
    d: float  # N m s/rad


def second_mass(design: Design) -> SecondMass | None:
    """Return the second mass of a design, or None for a rigid axis.

    Raises
    ------
    RequestError
        When the load's inertia is not smaller than the total.
    """
    where = f"{design.source}: " if design.source else ""
    effects = catalogue_of(design)
    found = {e.id: effects[e.id].values(e, where) for e in design.effects if e.id in TWO_MASS}
    for name in TWO_MASS:
        values = found.get(name)
        if values is None or values["J_load"] == 0.0:
            continue
        if not values["J_load"] < design.J:
            raise RequestError(
                f"{name}: J_load = {values['J_load']:g} kg m^2 should be smaller than the total inertia "
                f"{design.J:g} kg m^2, of which it is a part"
            )
        return SecondMass(values["J_load"], values["k"], values["d"])
    return None


def rigid(design: Design) -> Design:
    """Return the design with its load rigidly coupled."""
    for name in TWO_MASS:
        design = design.without_effect(name)
    return design


def _with_second_mass(design: Design, A: Array, B: Array, stuck: bool) -> tuple[Array, Array, tuple[str, ...]]:
    """Add the load behind a spring and a damper: friction stays at the motor, the external load moves behind."""
    mass = second_mass(design)
    if mass is None:
        return A, B, STATES
    J = design.J
    J_m = J - mass.J_load
    big_A, big_B = np.zeros((6, 6)), np.zeros((6, 3))
    big_A[:4, :4], big_B[:4] = A, B
    big_A[2] *= J / J_m
    big_B[2, 2], big_B[4, 2] = 0.0, -1.0 / mass.J_load
    # twist = theta - theta_load
    if not stuck:
        big_A[2, 2:] += np.array([-mass.d / J_m, 0.0, mass.d / J_m, -mass.k / J_m])
    big_A[4, 2:] = np.array([mass.d, 0.0, -mass.d, mass.k]) / mass.J_load
    big_A[5, 2], big_A[5, 4] = 1.0, -1.0
    return big_A, big_B, (*STATES, "omega_load", "twist")

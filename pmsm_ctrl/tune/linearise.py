"""The nonlinear drive as a python-control system, its operating points, and its linearisation there.

The equations are read from `pmsm_ctrl.kernels.balance` and from the effects' own terms; nothing is restated.
Dry friction has no derivative at rest, so two cases are distinguished: a *sliding* shaft sees the slope of the
friction curve, a *stuck* one does not move at all and its acceleration row is zero.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal

import control as ct
import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects import bound_effects, catalogue_of
from pmsm_ctrl.effects.soundness import value_at
from pmsm_ctrl.effects.structures import SecondMass
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.kernels import balance
from pmsm_ctrl.simulate.parameters import Plant
from pmsm_ctrl.units import axis_unit

__all__ = [
    "INPUTS",
    "STATES",
    "Linearisation",
    "OperatingPoint",
    "default_speed",
    "drive_system",
    "friction_slope",
    "linearise",
    "mobility",
    "operating_point",
    "passed_through",
    "rigid",
    "second_mass",
    "with_second_mass",
]  # fmt: skip

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Derivative = Callable[[Array, Array], Array]

STATES = ("i_d", "i_q", "omega", "theta")
INPUTS = ("u_d", "u_q", "T_load")
STEPS = (1e-4, 1e-4, 1e-4, 1e-5)  # of the central differences, by state; relative for a speed above 1 rad/s

_voltage_d = balance.voltage_d.py_func
_voltage_q = balance.voltage_q.py_func
_torque_em = balance.torque_em.py_func


@dataclass(frozen=True)
class OperatingPoint:
    """Where the drive is linearised.

    Attributes
    ----------
    speed, load : float
        rad/s and N m.
    i_d, i_q, u_d, u_q : float
        Currents and voltages that hold this point, A and V.
    case : {"sliding", "stuck"}
    friction_slope : float
        Derivative of the opposing torque with respect to speed, N m s/rad; 0 when stuck.
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
        Jacobian; states `STATES` (and ``omega_load``, ``twist`` for two masses), inputs `INPUTS`.
    states : tuple of str
        Names of the n states.
    """

    point: OperatingPoint
    A: Array
    B: Array
    states: tuple[str, ...] = STATES


def _opposing_torque(design: Design) -> Callable[..., float]:
    """Return the sum of the design's torque effects as ``f(omega, theta, direction, i_d, i_q)`` in N m.

    Effects with states of their own (a second mass, bristles) are left out. Without winding data the torque is K_t i_q.
    """
    motor = design.motor
    wound = motor.p is not None and motor.L_d is not None and motor.L_q is not None
    m = Plant.of(design) if wound else None
    p = float(motor.p or 0)
    bound = [(e, values) for e, values in bound_effects(design) if e.enters == "torque" and not e.has_state]

    def total(omega: float, theta: float, direction: float, i_d: float, i_q: float) -> float:
        signals = {
            "omega": omega, "theta": theta, "direction": direction, "i_d": i_d, "i_q": i_q,
            "torque": design.K_t * i_q if m is None else _torque_em(m.p, m.psi_f, m.L_d, m.L_q, i_d, i_q),
            "t": 0.0, "p": p, "di_d": 0.0, "di_q": 0.0,
        }  # fmt: skip
        return sum(float(value_at(effect, signals | values)) for effect, values in bound)

    return total


def _nothing(*signals: float) -> float:
    """Return the torque of no effects."""
    return 0.0


def _derivative(design: Design, direction: float, *, effects: bool = True) -> Derivative:
    """Return the derivative of the states as a function of states and inputs, with or without torque effects."""
    m = Plant.of(design)
    opposing = _opposing_torque(design) if effects else _nothing

    def derivative(x: Array, u: Array) -> Array:
        i_d, i_q, omega, theta = (float(v) for v in x)
        # The balances are solved for the derivative by evaluating them with a derivative of zero.
        di_d = (u[0] - _voltage_d(m.R, m.L_d, m.L_q, m.p, i_d, i_q, 0.0, omega)) / m.L_d
        di_q = (u[1] - _voltage_q(m.R, m.L_d, m.L_q, m.p, m.psi_f, i_d, i_q, 0.0, omega)) / m.L_q
        torque = _torque_em(m.p, m.psi_f, m.L_d, m.L_q, i_d, i_q)
        return np.array([di_d, di_q, (torque - opposing(omega, theta, direction, i_d, i_q) - u[2]) / m.J, omega])

    return derivative


def drive_system(design: Design, *, direction: float = 1.0) -> Any:
    """Return the dq drive with its torque effects as a control.NonlinearIOSystem.

    States `STATES`, inputs `INPUTS`, outputs the states and the torque (N m). Dry friction acts against the
    direction of sliding, 1 or -1.
    """
    m = Plant.of(design)
    derivative = _derivative(design, direction)

    def update(t: float, x: Array, u: Array, params: dict[str, float]) -> Array:
        return derivative(x, u)

    def output(t: float, x: Array, u: Array, params: dict[str, float]) -> Array:
        return np.append(x, _torque_em(m.p, m.psi_f, m.L_d, m.L_q, float(x[0]), float(x[1])))

    return ct.nlsys(update, output, name=design.name, states=STATES, inputs=INPUTS, outputs=(*STATES, "torque"), dt=0)


def _holding_current(design: Design, opposing: Callable[..., float], speed: float, load: float) -> float:
    """Return the i_q in A that balances load and friction at constant speed (i_d = 0)."""
    i_q = 0.0
    # Friction may depend on the torque itself; the fixed point contracts because that share is well below one.
    for _ in range(50):
        new = (load + opposing(speed, 0.0, _direction(speed), 0.0, i_q)) / design.K_t
        if abs(new - i_q) <= 1e-13 * max(1.0, abs(new)):
            return new
        i_q = new
    raise RequestError(
        f"no current holds {speed:g} rad/s against {load:g} N m: the torque effects grow with the torque faster "
        "than the torque itself"
    )


def _direction(speed: float) -> float:
    return math.copysign(1.0, speed) if speed else 0.0


def operating_point(design: Design, speed: float = 0.0, load: float = 0.0) -> OperatingPoint:
    """Return the operating point at constant speed (rad/s) under a load (N m) with i_d = 0.

    Raises
    ------
    RequestError
        When the point needs more current or voltage than the drive has; the message says which and how much.
    """
    m = Plant.of(design)
    opposing = _opposing_torque(design)
    stuck = speed == 0.0 and any(e.dry for e, _ in bound_effects(design))
    i_q = _holding_current(design, opposing, speed, load)
    u_d = _voltage_d(m.R, m.L_d, m.L_q, m.p, 0.0, i_q, 0.0, speed)
    u_q = _voltage_q(m.R, m.L_d, m.L_q, m.p, m.psi_f, 0.0, i_q, 0.0, speed)
    where = axis_unit(f"operating point {speed:g} rad/s, {load:g} N m", design.motion)
    if abs(i_q) > design.drive.i_max:
        raise RequestError(
            f"{where}: needs {abs(i_q):.3g} A, but the drive's limit i_max is {design.drive.i_max:.3g} A"
        )
    limit = m.u_dc / math.sqrt(3.0)
    if math.hypot(u_d, u_q) > limit:
        raise RequestError(
            f"{where}: needs {math.hypot(u_d, u_q):.4g} V, but a dc link of "
            f"{m.u_dc:g} V gives at most {limit:.4g} V (peak, phase)"
        )
    slope = 0.0 if stuck else _slope(opposing, speed, i_q)
    return OperatingPoint(speed, load, 0.0, i_q, u_d, u_q, "stuck" if stuck else "sliding", slope)


def _slope(opposing: Callable[..., float], speed: float, i_q: float) -> float:
    h, direction = STEPS[2] * max(1.0, abs(speed)), _direction(speed)
    return (opposing(speed + h, 0.0, direction, 0.0, i_q) - opposing(speed - h, 0.0, direction, 0.0, i_q)) / (2.0 * h)


def default_speed(design: Design) -> float:
    """Return a tenth of the speed (rad/s) at which the EMF alone takes the whole voltage."""
    assert design.motor.p is not None
    assert design.motor.psi_f is not None
    return 0.1 * design.drive.u_dc / math.sqrt(3.0) / (design.motor.p * design.motor.psi_f)


def friction_slope(design: Design, speed: float) -> float:
    """Return the derivative of the torque effects with respect to speed, N m s/rad, without load.

    Neither winding nor drive data are needed.

    Parameters
    ----------
    design : Design
    speed : float
        rad/s.
    """
    opposing = _opposing_torque(design)
    return _slope(opposing, speed, _holding_current(design, opposing, speed, 0.0))


def linearise(
    design: Design, speed: float = 0.0, load: float = 0.0, *, mass: SecondMass | None = None
) -> Linearisation:
    """Linearise the drive at constant speed and load, with i_d = 0 and theta = 0.

    Parameters
    ----------
    design : Design
    speed, load : float
        rad/s and N m.
    mass : SecondMass, optional
        In the place of the design's.

    Returns
    -------
    Linearisation
        By central differences of the nonlinear equations, which are exact for all but the effects' own terms.

    Raises
    ------
    DesignError
        When the motor's electrical data are not known.
    RequestError
        When the operating point needs more current or voltage than the drive has.
    """
    point = operating_point(design, speed, load)
    x, u = np.array([point.i_d, point.i_q, speed, 0.0]), np.array([point.u_d, point.u_q, load])
    derivative = _derivative(design, _direction(speed))
    A = _by_states(derivative, x, u)
    B = np.column_stack([0.5 * (derivative(x, u + h) - derivative(x, u - h)) for h in np.eye(3)])
    if point.case == "stuck":
        A[2:], B[2:] = 0.0, 0.0
    return _with_second_mass(design, Linearisation(point, A, B), mass or second_mass(design))


def _by_states(derivative: Derivative, x: Array, u: Array) -> Array:
    """Return the derivatives with respect to the states by central differences."""
    steps = np.diag(np.array(STEPS) * [1.0, 1.0, max(1.0, abs(x[2])), 1.0])
    return np.column_stack([(derivative(x + h, u) - derivative(x - h, u)) / (2.0 * h.sum()) for h in steps])


def passed_through(design: Design, model: Linearisation, speed: float, i_q: float, i_d: float = 0.0) -> Linearisation:
    """Return a model whose products of speed and currents are those at a point of a motion.

    Friction and spring stay as they are. No limit is looked at.

    Parameters
    ----------
    design : Design
        Whose model it is.
    model : Linearisation
    speed, i_q, i_d : float
        rad/s and A.

    Returns
    -------
    Linearisation
        Its point has no voltages.
    """
    x = np.array([i_d, i_q, speed, 0.0])
    bare = _by_states(_derivative(design, 0.0, effects=False), x, np.zeros(3))
    A = model.A.copy()
    A[:2, :4] = bare[:2]
    A[2, :2] = bare[2, :2] * model.A[2, 1] * design.J / design.K_t  # the motor's share of the inertia; 0 when stuck
    point = replace(model.point, speed=speed, i_d=i_d, i_q=i_q, u_d=math.nan, u_q=math.nan)
    return replace(model, A=A, point=point)


def second_mass(design: Design) -> SecondMass | None:
    """Return the second mass of a design, or None for a rigid axis.

    A spring and a gap together are one spring with a gap: the spring's constants count.

    Raises
    ------
    RequestError
        When the load's inertia is not smaller than the total.
    """
    masses = [(mass, e) for e, v in bound_effects(design) if (mass := e.structure.second_mass(v)) is not None]
    if not masses:
        return None
    mass, effect = min(masses, key=lambda found: found[0].gap)
    if not mass.J_load < design.J:
        raise RequestError(
            f"{effect.id}: J_load = {mass.J_load:g} kg m^2 should be smaller than the total inertia "
            f"{design.J:g} kg m^2, of which it is a part"
        )
    return mass


def with_second_mass(design: Design, mass: SecondMass) -> Design:
    """Return a design whose load hangs on this spring, by the first effect of the catalogue that is one.

    Parameters
    ----------
    design : Design
    mass : SecondMass
    """
    springs = ((e.id, values) for e in catalogue_of(design).values() if (values := e.structure.values_of(mass)))
    return rigid(design).with_effect(*next(springs))


def rigid(design: Design) -> Design:
    """Return a design with its load rigidly coupled."""
    for effect, _ in bound_effects(design):
        if effect.structure.splits_inertia:
            design = design.without_effect(effect.id)
    return design


def _with_second_mass(design: Design, model: Linearisation, mass: SecondMass | None) -> Linearisation:
    """Add the load behind a spring and a damper: friction stays at the motor, the external load moves behind."""
    if mass is None:
        return model
    J_m = design.J - mass.J_load
    A, B = np.zeros((6, 6)), np.zeros((6, 3))
    A[:4, :4], B[:4] = model.A, model.B
    A[2] *= design.J / J_m
    B[2, 2], B[4, 2] = 0.0, -1.0 / mass.J_load
    # twist = theta - theta_load
    if model.point.case == "sliding":
        A[2, 2:] += np.array([-mass.d / J_m, 0.0, mass.d / J_m, -mass.k / J_m])
    A[4, 2:] = np.array([mass.d, 0.0, -mass.d, mass.k]) / mass.J_load
    A[5, 2], A[5, 4] = 1.0, -1.0
    return Linearisation(model.point, A, B, (*STATES, "omega_load", "twist"))


def mobility(s: Complex, J: float, slope: float, mass: SecondMass | None = None) -> Complex:
    """Return the response from drive torque to motor speed in closed form, (rad/s)/(N m).

    The transfer function of `linearise`'s matrices, for fits to measured responses. Source: G. Ellis, R. D. Lorenz,
    Resonant load control methods for industrial servo drives, IEEE IAS Annual Meeting 2000.

    Parameters
    ----------
    s : complex array, shape (n,)
        rad/s.
    J, slope : float
        Total inertia, kg m^2, and slope of the friction at the motor, N m s/rad.
    mass : SecondMass, optional
        The load behind a spring; its inertia is part of the total.

    Returns
    -------
    complex array, shape (n,)
    """
    if mass is None:
        return np.asarray(1.0 / (s * J + slope))
    spring = mass.k + s * mass.d
    coupled = (
        spring * mass.J_load / (spring + s * s * mass.J_load)
    )  # the load's share of the inertia, at this frequency
    return np.asarray(1.0 / (s * (J - mass.J_load + coupled) + slope))

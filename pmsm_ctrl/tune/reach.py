"""How fast a move may be: the voltage, the current and the current loop's stability along a profile.

All three are taken from the sampled drive at constant speed, with the rotation of the held voltage within a control
period. They are upper bounds of what the profile needs: full speed, full acceleration and jerk at the same time.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from pmsm_ctrl.design import CurrentLoop, Design
from pmsm_ctrl.effects import bound_effects
from pmsm_ctrl.simulate.motions import Limits
from pmsm_ctrl.simulate.parameters import Plant
from pmsm_ctrl.tune.held import held_period

__all__ = ["RESERVE", "highest_stable_speed", "largest", "reachable", "steady_voltage", "within_period"]

Array = NDArray[np.float64]

RESERVE = 0.8  # share of a limit that a move may take; the rest is left to the controllers
HALVINGS = 40  # of an interval, until a bound is known to rounding
STEP = 0.02  # rad (electrical) per control period between two speeds at which the current loop is looked at


def reachable(design: Design, current: CurrentLoop, limits: Limits, *, jumps: bool) -> Limits:
    """Return limits of a motion that keep a reserve to the drive's own limits.

    The speed stays below the one at which the current loop becomes unstable. Where the acceleration `jumps`, so does
    the current reference, and its controller asks for K_p times the jump at once. What is left over the voltage and
    the current is taken from speed, acceleration and jerk alike, so that the profile keeps its times. Limits that
    already keep the reserve are returned as they are, and so are those that no move can keep.

    Parameters
    ----------
    design : Design
    current : CurrentLoop
    limits : Limits
        rad/s, rad/s^2, rad/s^3.
    jumps : bool
        Whether the acceleration jumps (a trapezoid) or is built up with the jerk (an s-curve).

    Returns
    -------
    Limits
    """
    speed = min(limits.speed, RESERVE * highest_stable_speed(design, current, limits.speed / RESERVE))
    slower = limits if speed == limits.speed else replace(limits, speed=speed)

    def scaled(share: float) -> Limits:
        speed, acceleration, jerk = (share * x for x in (slower.speed, slower.acceleration, slower.jerk))
        return replace(slower, speed=speed, acceleration=acceleration, jerk=jerk)

    if _need(design, current, slower, jumps) <= RESERVE:
        return slower
    if jumps and _need(design, current, scaled(0.0), jumps) < RESERVE:
        # A jump is lowered by the acceleration alone.
        lowered = largest(lambda share: _jump(design, current, share * slower.acceleration) <= RESERVE)
        slower = replace(slower, acceleration=lowered * slower.acceleration, jerk=lowered * slower.jerk)
    if _need(design, current, scaled(0.0), jumps) >= RESERVE:
        return limits
    return scaled(largest(lambda share: _need(design, current, scaled(share), jumps) <= RESERVE))


def largest(allowed: Callable[[float], bool], low: float = 0.0, high: float = 1.0) -> float:
    """Return the largest value that is allowed, between one that is and one that may not be, by bisection.

    Parameters
    ----------
    allowed : function
    low, high : float
        The first one is allowed.
    """
    if allowed(high):
        return high
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if allowed(middle) else (low, middle)
    return low


def _friction(design: Design, speed: float) -> float:
    """Largest torque of the design's effects without a state at rest, or at a speed, N m."""
    p = float(design.motor.p or 0)
    acting = [b for b in bound_effects(design) if b[0].enters == "torque" and not b[0].has_state]
    at_rest = sum(effect.standing_level(values, p) for effect, values in acting)
    return max(at_rest, sum(effect.standing(values, p=p, omega=speed) for effect, values in acting))


def _jump(design: Design, current: CurrentLoop, acceleration: float) -> float:
    """Share of the voltage for a jump of the acceleration at rest, friction held."""
    m = Plant.of(design)
    change, held = design.J * acceleration / design.K_t, _friction(design, 0.0) / design.K_t
    return (current.K_p * change + m.R * held) * math.sqrt(3.0) / m.u_dc


def _need(design: Design, current: CurrentLoop, limits: Limits, jumps: bool) -> float:
    """Share of the voltage or of the current that a profile takes at most, whichever is larger."""
    m, K_t = Plant.of(design), design.K_t
    change = design.J * limits.acceleration / K_t
    i_q = change + _friction(design, limits.speed) / K_t
    u_d, u_q = steady_voltage(design, limits.speed, i_q)
    top = m.u_dc / math.sqrt(3.0)
    if jumps:
        # At speed a jump ends the acceleration or begins the braking: it acts against the EMF.
        swing = math.hypot(u_d, max(abs(u_q), current.K_p * change - u_q))
        voltage = max(swing / top, _jump(design, current, limits.acceleration))
    else:
        voltage = math.hypot(u_d, u_q + m.L_q * design.J * limits.jerk / K_t) / top
    return max(voltage, i_q / design.drive.i_max)


def _winding(m: Plant, omega_e: float) -> tuple[Array, Array]:
    """Currents per current and per voltage of the winding."""
    winding = np.array([[-m.R / m.L_d, omega_e * m.L_q / m.L_d], [-omega_e * m.L_d / m.L_q, -m.R / m.L_q]])
    return winding, np.diag([1.0 / m.L_d, 1.0 / m.L_q])


def _period(m: Plant, omega_e: float, turning: float) -> tuple[Array, Array]:
    """Return what one control period makes of the currents, and of a voltage that turns back at a rate (rad/s)."""
    winding, driven = _winding(m, omega_e)
    return held_period(winding[None], driven[None], turning, m.period)


def within_period(design: Design, speed: float, i_q: float, parts: int, i_d: float = 0.0) -> tuple[Array, Array]:
    """Return currents and voltage within a control period at constant speed, as the rotor sees them.

    A winding that is fast against the control period follows the voltage as it turns.

    Parameters
    ----------
    design : Design
    speed : float
        rad/s.
    i_q : float
        A, at the ticks.
    parts : int
        Equal parts of the period.
    i_d : float
        A, at the ticks.

    Returns
    -------
    currents, voltages : array, shape (parts, 2)
        i_d, i_q in A and u_d, u_q in V in the middle of every part.
    """
    m = Plant.of(design)
    omega_e = m.p * speed
    half, held = 0.5 * omega_e * m.period, np.array(steady_voltage(design, speed, i_q, i_d))
    ahead = np.array([[math.cos(half), -math.sin(half)], [math.sin(half), math.cos(half)]])
    # currents, voltage, and a one for the EMF
    rates = np.zeros((5, 5))
    rates[:2, :2], rates[:2, 2:4] = _winding(m, omega_e)
    rates[1, 4], rates[2, 3], rates[3, 2] = -omega_e * m.psi_f / m.L_q, omega_e, -omega_e
    step = expm(rates * m.period / parts)
    state = expm(0.5 * rates * m.period / parts) @ np.array([i_d, i_q, *(ahead @ held), 1.0])
    found = np.empty((parts, 5))
    for row in found:
        row[:] = state
        state = step @ state
    return found[:, :2], found[:, 2:4]


def steady_voltage(design: Design, speed: float, i_q: float, i_d: float = 0.0) -> tuple[float, float]:
    """Return the voltage that holds currents at a speed.

    With i_d = 0 it is u_d = -p omega L_q i_q, u_q = R i_q + p omega psi_f with a short control period. In a long one
    the held voltage moves the flux along a chord, and is smaller; the current is that at the ticks.

    Parameters
    ----------
    design : Design
    speed : float
        rad/s.
    i_q, i_d : float
        A.

    Returns
    -------
    u_d, u_q : float
        V.
    """
    m = Plant.of(design)
    omega_e = m.p * speed
    carried, by_voltage = _period(m, omega_e, omega_e)
    by_emf = _period(m, omega_e, 0.0)[1]
    currents = np.array([i_d, i_q])
    change = currents - carried @ currents + by_emf @ np.array([0.0, omega_e * m.psi_f])
    u_d, u_q = np.linalg.solve(by_voltage, change)
    return float(u_d), float(u_q)


def highest_stable_speed(design: Design, current: CurrentLoop, up_to: float = math.inf) -> float:
    """Return the speed up to which the sampled current loop with its decoupling is stable.

    The controller turns the voltage ahead by the delay, but the decoupling acts late and the held voltage does not turn
    with the rotor. It tells when the rotor covers a good part of a radian (electrical) in a control period.

    Parameters
    ----------
    design : Design
    current : CurrentLoop
    up_to : float
        Speeds above are not looked at, rad/s.

    Returns
    -------
    float
        rad/s; infinite when it is stable up to `up_to`, or up to half an electrical turn per control period.
    """
    m = Plant.of(design)
    rate = 1.0 / (m.p * m.period)  # rad/s for 1 rad (electrical) per control period

    def stable(turn: float) -> bool:
        return _radius(design, m, current, turn / m.period) < 1.0

    last = min(math.pi, up_to / rate)
    below, above = 0.0, min(STEP, last)
    while stable(above):
        if above >= last:
            return math.inf
        below, above = above, min(above + STEP, last)
    return rate * largest(stable, below, above)


def _radius(design: Design, m: Plant, current: CurrentLoop, omega_e: float) -> float:
    """Largest magnitude of the poles of the closed current loop at an electrical speed."""
    carried, by_voltage = _period(m, omega_e, omega_e)
    L_d, L_q = design.assumed.L_d or m.L_d, design.assumed.L_q or m.L_q
    gains = np.diag([current.K_p_d or current.K_p, current.K_p])
    rates = m.period * gains / np.array([current.T_n_d or current.T_n, current.T_n])
    proportional = omega_e * np.array([[0.0, -L_q], [L_d, 0.0]]) - gains
    one, zero = np.eye(2), np.zeros((2, 2))
    if m.delay:
        # currents, voltage that acts, integrators
        closed = np.block([[carried, by_voltage, zero], [proportional, zero, one], [-rates, zero, one]])
    else:
        closed = np.block([[carried + by_voltage @ proportional, by_voltage], [-rates, one]])
    return float(np.abs(np.linalg.eigvals(closed)).max())

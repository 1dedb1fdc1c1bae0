"""Limit cycles in theory: hunting against stiction, solved exactly, and what the describing function predicts."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.compensate.window import GAINS
from pmsm_ctrl.design import Design
from pmsm_ctrl.effects import bound_effects
from pmsm_ctrl.simulate.feedforward import smoothing_width

__all__ = ["Hunting", "describing_function_limit", "hunting"]

Array = NDArray[Any]

LONGEST = 40.0  # slips are looked for up to this many of the slowest time constant
GRID = 2000  # durations tried before a root is bracketed


@dataclass(frozen=True)
class Hunting:
    """A symmetric stick-slip limit cycle about a resting reference.

    Attributes
    ----------
    amplitude : float
        Where the axis sticks, to either side of the reference, rad.
    period : float
        s.
    slip, stick : float
        Duration of one slip and of one stop, s; the period is twice their sum.
    """

    amplitude: float
    period: float
    slip: float
    stick: float


def hunting(design: Design) -> Hunting | None:
    """Return the limit cycle of PID position control with stiction, or None when there is none.

    Position P over speed PI is a PID controller on the angle, with the integral of the position error in it. From
    rest at -a the axis breaks away when the torque meets the breakaway torque F_s, slips under the smaller sliding
    friction F_c (plus F_v omega), a linear system, until its speed is zero again, and sticks where it is while the
    integral ramps from what it was to F_s the other way. In a symmetric cycle it stops at +a. The slip is linear,
    so its end follows from one root in its duration.

    The sampled drive's lags (current loop, speed filter, computation) are left out: with loops slow against them the
    drive agrees. Dry friction counts as F_s at rest and as its level without Stribeck friction in motion, so the
    Stribeck speed must be small against the speed of a slip.

    Source: B. Armstrong, B. Amin, PID control in the presence of static friction: a comparison of algebraic and
    describing function analysis, Automatica 32 (1996) 679; R. H. A. Hensen, M. J. G. van de Molengraft,
    M. Steinbuch, Friction induced hunting limit cycles, Automatica 39 (2003) 2131.

    Parameters
    ----------
    design : Design
        With its loops set.

    Returns
    -------
    Hunting or None

    Raises
    ------
    DesignError
        When the design has no loops.
    """
    loops = design.require_loops()
    breakaway, sliding = _levels(design)
    if not breakaway > sliding > 0.0 or loops.position.K_v == 0.0:
        return None
    system = _system(design)
    roots = np.linalg.eigvals(system)
    if roots.real.max() >= 0.0:
        return None
    found = _first_stop(design, system, breakaway, sliding, float(1.0 / -roots.real.max()))
    if found is None:
        return None
    amplitude, slip, torque = found
    if not (amplitude > 0.0 and abs(torque) < breakaway):
        return None  # it overshoots the other way, or slides on at once
    ramp = design.K_t * loops.speed.K_p / loops.speed.T_n * loops.position.K_v * amplitude
    stick = (breakaway + torque) / ramp
    return Hunting(amplitude, 2.0 * (slip + stick), slip, stick)


def _levels(design: Design) -> tuple[float, float]:
    """Dry friction at rest and in motion beyond the Stribeck speed, N m, from the effects' own terms."""
    breakaway = sliding = 0.0
    for effect, values in bound_effects(design):
        if effect.dry and not effect.has_state:
            level = effect.standing(values, p=float(design.motor.p or 0))
            breakaway += level
            sliding += 0.0 if effect.bends_over else level
    return float(breakaway), float(sliding)


def _system(design: Design) -> Array:
    """Matrix of (torque of the integral, angle, speed) while the axis slips; the reference rests at 0."""
    loops = design.require_loops()
    speed, position = loops.speed, loops.position
    gain, F_v = design.K_t * speed.K_p, design.parameters("viscous").get("F_v", 0.0)
    integral = gain / speed.T_n
    return np.array([
        [0.0, -integral * position.K_v, -integral],
        [0.0, 0.0, 1.0],
        [1.0 / design.J, -gain * position.K_v / design.J, -(gain + F_v) / design.J],
    ])  # fmt: skip


def _first_stop(
    design: Design, system: Array, breakaway: float, sliding: float, slowest: float
) -> tuple[float, float, float] | None:
    """Return amplitude, duration and control torque at the end of the symmetric slip; None when there is none.

    The slip starts at -a with the control torque F_s and ends at +a with speed 0: two conditions, a and the time.
    """
    from scipy.optimize import brentq

    loops = design.require_loops()
    stiffness = design.K_t * loops.speed.K_p * loops.position.K_v
    values, vectors = np.linalg.eig(system)
    inverse = np.linalg.inv(vectors)
    # x' = A x - b with b the sliding friction; the state that would rest: A x = b.
    rest = np.linalg.solve(system, np.array([0.0, 0.0, sliding / design.J]))

    def state(a: float, t: Array | float) -> Array:
        """State `t` after the slip began at -a; shape (3,), or (3, n) for n times."""
        start = inverse @ (np.array([breakaway - stiffness * a, -a, 0.0]) - rest)
        modes = np.exp(np.multiply.outer(values, t)) * start.reshape((3,) + (1,) * np.ndim(t))
        return np.asarray((vectors @ modes).real.T + rest).T

    def amplitude(t: Array | float) -> Any:
        """The a whose slip ends at +a after t: the angle is linear in it."""
        none, one = state(0.0, t)[1], state(1.0, t)[1]
        return none / (1.0 - (one - none))

    def speed(t: Array | float) -> Any:
        none, one = state(0.0, t)[2], state(1.0, t)[2]
        return none + amplitude(t) * (one - none)

    times = np.geomspace(1e-3 * slowest, LONGEST * slowest, GRID)
    speeds = speed(times)
    for k in np.flatnonzero((speeds[:-1] > 0.0) & (speeds[1:] <= 0.0)).tolist():
        t = float(brentq(speed, times[k], times[k + 1], xtol=1e-12))
        a = float(amplitude(t))
        if a > 0.0 and state(a, np.linspace(0.0, t, 50)[1:-1])[2].min() > 0.0:
            end = state(a, t)
            return a, t, float(end[0] - stiffness * a)
    return None


def describing_function_limit(design: Design, source: str, gains: Iterable[float] = GAINS) -> float | None:
    """Return the smallest gain with a limit cycle at rest by describing functions, or None.

    Friction is a relay ``-F_c sgn(omega)`` on the true speed, the compensation a relay of `gain` F_c on what is
    acted on: the measured speed, a lag ``H`` later, or the commanded speed, which at rest is ``-K_v theta``, so
    ``H = -K_v / (j w)`` times its lag. Both have the same sine of amplitude A as input: a cycle needs
    ``Z(j w) + 4 F_c / (pi A) (1 - gain sgn H(j w)) = 0`` with Z the axis under speed and position control, torque
    over speed; of H only the phase counts. Where the sign is smoothed, a cycle within the width does not
    count. The reference speed is zero at rest, so its relay has no effect.

    Source: K. J. Astrom, IEEE Trans. Automat. Contr. 43 (1998); A. Gelb, W. E. Vander Velde, Multiple-Input
    Describing Functions, McGraw-Hill 1968. Armstrong and Amin (Automatica 32 (1996) 679) show that it misleads for
    stiction under integral control, so it is given beside the simulation and never instead.
    """
    if design.loops is None or source not in ("measured", "commanded"):
        return None
    speed, position = design.loops.speed, design.loops.position
    T_s = design.drive.speed_period
    lag = design.sensor.speed_filter + 0.5 * T_s
    act = T_s + 2.0 / design.drive.f_control
    w = np.geomspace(1.0, 0.5 / T_s, 4000)
    s = 1j * w
    seen, acted = np.exp(-0.5 * T_s * s) / (1.0 + (lag - 0.5 * T_s) * s), np.exp(-act * s)
    control = speed.K_p * (1.0 + 1.0 / (speed.T_n * s)) * acted
    Z = design.J * s + design.K_t * control * (seen + position.K_v / s)
    H = seen * acted if source == "measured" else -position.K_v / s * acted
    F_c = design.parameters("coulomb").get("F_c", 0.0)
    by_source = design.model_copy(update={"compensation": design.compensation.model_copy(update={"source": source})})
    for gain in sorted(gains):
        needed = -(1.0 - gain * H / np.abs(H)) / Z
        crossing = np.flatnonzero(np.diff(np.sign(needed.imag)) != 0)
        for k in crossing.tolist():
            amplitude = 4.0 * F_c / np.pi * needed.real[k]
            width = smoothing_width(by_source) if source == "commanded" else 0.0
            if needed.real[k] > 0.0 and amplitude * position.K_v / w[k] >= width:
                return float(gain)
    return None

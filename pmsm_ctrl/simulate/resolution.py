"""How many integration steps a control period needs: the step follows the fastest mode of the drive.

A Runge-Kutta step that is too long for a mode is not less accurate but wrong: the mode dies, grows, or stands still
where the sampled controller holds it. The modes are those of the linearised drive: the winding, the EMF against the
inertia, the steepest slope of the friction, a spring or a contact, the voltage that dead time loses.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.effects import Effect
from pmsm_ctrl.effects.signals import SIGNALS
from pmsm_ctrl.effects.soundness import value_at
from pmsm_ctrl.effects.structures.interface import SecondMass
from pmsm_ctrl.errors import DesignError

if TYPE_CHECKING:
    from pmsm_ctrl.simulate.parameters import Plant

__all__ = ["MOST_STEPS", "RESOLVED", "fastest_rate", "second_mass", "steps_needed"]

Array = NDArray[np.float64]
Bound = tuple[Effect, Mapping[str, float]]

# Largest product x of a mode's rate (abs of its eigenvalue) and the step. The classical Runge-Kutta step then errs by
# x^4 / 120 = 7e-5 rad in the phase of an oscillation, per radian, and by x^5 / 144 = 2e-5 in its amplitude; it is
# unstable from 2.8.
RESOLVED = 0.3
MOST_STEPS = 8192  # per control period: a simulated second takes several
# Speeds at which the slopes of friction are read, as shares of the no-load speed, and of a parameter that is a speed.
SPEED_SHARES, BEND_SHARES = (1e-3, 1e-2, 0.1, 0.5, 1.0), (0.1, 0.4, 0.7, 1.0, 2.0)
DIFFERENCE = 1e-4  # of a speed, for a slope
SMALL_CURRENT = 1e-9  # A; the loss of a dead time is linear below at least 1e-6 A


def steps_needed(plant: Plant, bound: Sequence[Bound], *, i_max: float = math.inf, label: str = "") -> int:
    """Return the integration steps per control period that resolve every mode of a plant.

    Parameters
    ----------
    plant : Plant
    bound : sequence of (Effect, dict of str to float)
        The active effects and their values.
    i_max : float
        Largest current, A.
    label : str
        What an error begins with.

    Returns
    -------
    int
        Never less than ``plant.steps``.

    Raises
    ------
    DesignError
        When a mode is too fast for any simulation with this control period.
    """
    rate = fastest_rate(plant, bound, i_max)
    needed = rate * plant.period / RESOLVED
    if needed <= MOST_STEPS:
        return max(plant.steps, math.ceil(needed - 1e-9))
    stiff = second_mass(bound) is not None
    cure = (
        "the spring is so stiff that motor and load are one mass: leave the second mass out"
        if stiff and fastest_rate(plant, [b for b in bound if not b[0].structure.splits_inertia], i_max) < 0.5 * rate
        else "check the units of R, L_d, L_q, J and of the effects"
    )
    raise DesignError(
        f"{label}the fastest mode of this drive is at {rate:.3g} rad/s, which takes {needed:.3g} integration steps per "
        f"control period, and at most {MOST_STEPS} are possible; {cure}"
    )


def fastest_rate(plant: Plant, bound: Sequence[Bound], i_max: float = math.inf) -> float:
    """Return the largest abs of an eigenvalue of the linearised plant, rad/s, over speeds and slopes of friction."""
    # Where the EMF meets the voltage limit, rad/s, and the rotor turns by no more than a radian in a control period.
    top = min(plant.u_dc / (math.sqrt(3.0) * plant.psi_f), 1.0 / plant.period) / plant.p
    mass = second_mass(bound)
    slopes, stiffness = _friction(bound, plant, top)
    resistance, L_q = _winding(bound, plant, i_max)
    found = 0.0
    for speed in (0.0, top):
        for slope in {min(slopes), max(slopes)}:
            for spring in {0.0, stiffness}:
                A = _matrix(plant, mass, speed, slope, spring, resistance, L_q)
                found = max(found, float(np.abs(np.linalg.eigvals(A)).max()))
    return found


def second_mass(bound: Iterable[Bound]) -> SecondMass | None:
    """Return the mass behind the shaft; where a spring and a gap are given, the spring's constants count."""
    masses = [mass for effect, values in bound if (mass := effect.structure.second_mass(values)) is not None]
    return min(masses, key=lambda mass: mass.gap) if masses else None


def _matrix(
    plant: Plant, mass: SecondMass | None, speed: float, slope: float, spring: float, resistance: float, L_q: float
) -> Array:
    """Return the matrix of (i_d, i_q, omega, theta, omega_load, twist); `spring` is the angle's own stiffness."""
    R, p, psi = plant.R + resistance, plant.p, plant.psi_f
    J_m = plant.J - (mass.J_load if mass is not None else 0.0)
    A = np.zeros((6, 6))
    A[0, 0], A[0, 1] = -R / plant.L_d, p * speed * plant.L_q / plant.L_d
    A[1, 0], A[1, 1], A[1, 2] = -p * speed * plant.L_d / L_q, -R / L_q, -p * psi / L_q
    A[2, 1], A[2, 2], A[2, 3] = 1.5 * p * psi / J_m, -slope / J_m, -spring / J_m
    A[3, 2] = 1.0
    if mass is not None:
        A[2, 2:] += np.array([-mass.d, 0.0, mass.d, -mass.k]) / J_m
        A[4, 2:] = np.array([mass.d, 0.0, -mass.d, mass.k]) / mass.J_load
        A[5, 2], A[5, 4] = 1.0, -1.0
    return A


def _friction(bound: Sequence[Bound], plant: Plant, top: float) -> tuple[list[float], float]:
    """Return slopes of the torque effects over the speed, N m s/rad, and their steepest over the angle, N m/rad."""
    acting = [(e, v) for e, v in bound if e.enters == "torque" and not e.has_state]
    bends = [v[p.symbol] for e, v in acting for p in e.parameters if p.unit == "rad/s"]
    speeds = {share * top for share in SPEED_SHARES} | {share * bend for bend in bends for share in BEND_SHARES}
    moving = [(e, v) for e, v in acting if "omega" in e.signals]
    slopes = [0.0]
    for speed in speeds:
        for direction in (1.0, -1.0):
            for t in (0.0, 1e9):  # before and after a warm-up
                signals = {"direction": direction, "p": float(plant.p), "t": t}
                step = DIFFERENCE * speed
                high, low = (
                    sum(_term(e, v, omega=direction * speed + shift, **signals) for e, v in moving)
                    for shift in (step, -step)
                )
                slopes.append((high - low) / (2.0 * step))
    stiffness = sum(
        effect.standing_level(values, float(plant.p)) * _waves(effect, values, plant)
        for effect, values in acting
        if "theta" in effect.signals
    )
    return [slope for slope in slopes if math.isfinite(slope)], stiffness


def _waves(effect: Effect, values: Mapping[str, float], plant: Plant) -> float:
    return max(effect.waves(values, plant.p), 1.0)


def _winding(bound: Sequence[Bound], plant: Plant, i_max: float) -> tuple[float, float]:
    """Return what voltage effects add to the resistance, Ohm, and the smallest incremental inductance, H."""
    resistance, L_q = 0.0, plant.L_q
    for effect, values in bound:
        if effect.enters != "voltage" or effect.has_state:
            continue
        if {"i_d", "i_q"} & set(effect.signals):
            resistance += max(
                max(abs(high - low) for high, low in _pair(effect, values, axis, SMALL_CURRENT)) / (2.0 * SMALL_CURRENT)
                for axis in ("i_d", "i_q")
            )
        if "di_q" in effect.signals and math.isfinite(i_max):
            high, low = (_value(effect, values, i_q=i_max, di_q=rate) for rate in (1.0, 0.0))
            L_q += float(high[1]) - float(low[1])
    return resistance, max(L_q, 0.05 * plant.L_q)


def _pair(effect: Effect, values: Mapping[str, float], axis: str, step: float) -> Iterator[tuple[float, float]]:
    """Yield the term's d and q voltages at a current of + and - `step`, A."""
    high, low = (_value(effect, values, **{axis: sign * step}) for sign in (1.0, -1.0))
    yield from zip(high, low, strict=True)


def _term(effect: Effect, values: Mapping[str, float], **signals: float) -> float:
    return float(_value(effect, values, **signals))


def _value(effect: Effect, values: Mapping[str, float], **signals: float) -> Any:
    return value_at(effect, dict.fromkeys(SIGNALS, 0.0) | signals | dict(values))

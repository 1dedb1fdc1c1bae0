"""Motions on which a compensation is judged: slow reversals, creep, a circle, positioning, a push, a warm-up.

They are written for a shaft, in rad; those of a linear axis are `Limits.length` times as long and as fast.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects import bound_effects, thermal_drift
from pmsm_ctrl.errors import RequestError, nearest
from pmsm_ctrl.simulate import SCENARIOS, Scenario, scenario
from pmsm_ctrl.simulate.motions import Limits, PathBuilder
from pmsm_ctrl.units import axis_unit

__all__ = ["CIRCLE", "WARM_UP", "Trial", "at_speed", "named_trial", "study_trials"]

Array = NDArray[Any]

CIRCLE, WARM_UP = "circle", "warm-up"
RADIUS = 10.0 / math.pi  # lengths: half a turn of the circle a second is a speed of 10 lengths a second
WARMER = 0.4  # share by which F_c and F_v fall during the warm-up
PUSHES = ((0.5, 4.0), (-1.0, 4.0))  # size, as a share of twice the friction, and the rest after it, s
WARMING = 6.0  # s; a real axis takes minutes, with as many reversals for the tracker as here, or more


@dataclass(frozen=True)
class Trial:
    """A test motion for compensations.

    Attributes
    ----------
    motions : tuple of Scenario
        One an axis; the two axes of a contour are alike.
    radius : float
        Of the circle that two axes draw, rad at the motors (m); 0 for one axis.
    changed : mapping of effect to parameters
        Effects that the plant has besides its own, or in their place.
    """

    motions: tuple[Scenario, ...]
    radius: float = 0.0
    changed: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    def plant(self, design: Design) -> Design:
        """Return the plant of this trial.

        Parameters
        ----------
        design : Design
            The plant before the trial changes it.
        """
        for effect, parameters in self.changed.items():
            design = design.with_effect(effect, dict(parameters))
        return design


def at_speed(motion: str, speed: float, design: Design) -> str:
    """Return the name of a trial at a speed, which has the unit of the axis: "creep 0.1 rad/s", "creep 0.000955 m/s".

    Parameters
    ----------
    motion : {"reversal", "creep"}
    speed : float
        Lengths of the axis in a second.
    design : Design

    Returns
    -------
    str
    """
    return axis_unit(f"{motion} {Limits.of(design).length * speed:.3g} rad/s", design.motion)


def study_trials(design: Design) -> dict[str, Trial]:
    """Return the trials by name; all under position control, each with rest at its end.

    Parameters
    ----------
    design : Design
        Limits and friction of the axis.

    Returns
    -------
    dict of str to Trial
    """
    length = Limits.of(design).length
    motions = {at_speed("reversal", v, design): _sine_then_rest(design, v * length) for v in (0.5, 2.0, 10.0)}
    motions["triangle"] = _path("triangle", _triangle(length))
    motions |= {at_speed("creep", v, design): _path("creep", _creep(v, length)) for v in (0.1, 1.0)}
    motions["positioning"] = _path("positioning", _positioning(length))
    motions["push"] = _push(design, 2.0 * length)
    trials = {name: Trial((motion,)) for name, motion in motions.items()}
    radius = RADIUS * length
    trials[CIRCLE] = Trial((_circle(0, radius), _circle(1, radius)), radius=radius)
    trials[WARM_UP] = _warm_up(design, 20.0 * length)
    return trials


def named_trial(design: Design, name: str) -> Trial:
    """Return a trial of the study, or a named scenario under position control as a trial.

    Parameters
    ----------
    design : Design
    name : str

    Returns
    -------
    Trial

    Raises
    ------
    RequestError
        When neither has this name, or the scenario is not under position control.
    """
    trials = study_trials(design)
    if name in trials:
        return trials[name]
    if name not in SCENARIOS:
        known = tuple(dict.fromkeys((*trials, *SCENARIOS)))
        raise RequestError(f"unknown scenario '{name}'{nearest(name, known)} (known: {', '.join(known)})")
    motion = scenario(name, design)
    if motion.control != "position":
        raise RequestError(
            f"scenario '{name}' is under {motion.control} control and has no position error; accepted: "
            f"{', '.join(trials)}, or a scenario under position control"
        )
    return Trial((motion,))


def _warm_up(design: Design, speed: float) -> Trial:
    """Fast reversals while Coulomb and viscous friction fall by 40 %, or as the design's own drift says."""
    trial = Trial((_sine_then_rest(design, speed, cycles=10.0),))
    if any("t" in effect.signals for effect, _ in bound_effects(design)):
        return trial
    F_c, F_v = design.parameters("coulomb").get("F_c", 0.0), design.parameters("viscous").get("F_v", 0.0)
    drift = thermal_drift.change(-WARMER * F_c, -WARMER * F_v, WARMING)
    return Trial(trial.motions, changed={thermal_drift.effect.id: drift})


def _circle(axis: int, radius: float) -> Scenario:
    """One axis of a circle, two turns at half a turn a second, from rest to rest: reversals are its quadrants.

    The angle on the circle runs up along half a cosine within 1 s. Axis 0 starts at a quadrant, where it turns.
    """
    rate, ramp, turns = math.pi, 1.0, 2.0
    steady = 2.0 * math.pi * turns / rate - ramp

    def angle(t: Array) -> tuple[Array, Array, Array]:
        """Angle on the circle with its first two derivatives."""
        rising = np.minimum(t, ramp)
        falling = np.clip(t - ramp - steady, 0.0, ramp)
        turn = np.pi / ramp

        def gone(x: Array) -> Array:
            return 0.5 * rate * (x - np.sin(turn * x) / turn)

        whole = rate * np.clip(t - ramp, 0.0, steady + ramp)
        bend = np.sin(turn * rising) * (t < ramp) - np.sin(turn * falling)
        speed = 0.5 * rate * (np.cos(turn * falling) - np.cos(turn * rising))
        return gone(rising) + whole - gone(falling), speed, 0.5 * rate * turn * bend

    def references(t: Array) -> Mapping[str, Array]:
        phi, speed, change = angle(np.asarray(t, dtype=np.float64))
        c, s = np.cos(phi), np.sin(phi)
        omega = np.where(t < steady + 2.0 * ramp, (-s if axis == 0 else c) * speed, 0.0)
        return {
            "theta_ref": radius * (c - 1.0 if axis == 0 else s),
            "omega_ref": radius * omega,
            "alpha_ref": radius * ((-c if axis == 0 else -s) * speed**2 + (-s if axis == 0 else c) * change),
        }

    return Scenario(CIRCLE, steady + 2.0 * ramp + 1.0, references, control="position")


def _push(design: Design, speed: float) -> Scenario:
    """A slow sine, then rest, in which a load of 5 ms can start a limit cycle: `PUSHES`, one from either side.

    One push is not enough: whether a cycle starts hangs on where the axis sticks after it. A cycle of 0.6 Hz needs the
    4 s.
    """
    moving = _sine_then_rest(design, speed, cycles=1.0, rest=0.2 + sum(rest for _, rest in PUSHES))
    load = Limits.of(design).breakaway * design.K_t

    def references(t: Array) -> Mapping[str, Array]:
        pushed, start = np.zeros(np.shape(t)), moving.duration - sum(rest for _, rest in PUSHES)
        for size, rest in PUSHES:
            pushed = np.where((t >= start) & (t < start + 0.005), size * load, pushed)
            start += rest
        return {**moving.references(t), "T_load": pushed}

    return Scenario("push", moving.duration, references, control="position")


def _sine_then_rest(design: Design, speed: float, cycles: float = 3.0, rest: float = 1.0) -> Scenario:
    """Cycles at 0.5 Hz, then rest."""
    moving = scenario("reversal", design, speed=speed, frequency=0.5, cycles=cycles)
    end = moving.duration

    def references(t: Array) -> Mapping[str, Array]:
        given = moving.references(np.minimum(t, end))
        return {
            "theta_ref": given["theta_ref"],
            "omega_ref": np.where(t < end, given["omega_ref"], 0.0),
            "alpha_ref": np.where(t < end, given["alpha_ref"], 0.0),
        }

    return Scenario("reversal", end + rest, references, control="position")


def _path(name: str, build: Callable[[PathBuilder], None]) -> Scenario:
    builder = PathBuilder()
    build(builder)
    path = builder.path()

    def references(t: Array) -> Mapping[str, Array]:
        return dict(zip(("theta_ref", "omega_ref", "alpha_ref"), path.at(t), strict=True))

    return Scenario(name, builder.t, references, control="position")


def _triangle(length: float) -> Callable[[PathBuilder], None]:
    """Speed in a slow triangle of +-2 lengths a second, twice."""

    def build(builder: PathBuilder) -> None:
        for level in (2.0, -2.0, 2.0, -2.0, 0.0):
            builder.ramp(level * length, 4.0 * length)
        builder.piece(1.0)

    return build


def _positioning(length: float) -> Callable[[PathBuilder], None]:
    """Half a length there and back, with rests long enough to detect hunting from 0.7 Hz on."""
    limits = Limits(speed=5.0 * length, acceleration=50.0 * length, jerk=1000.0 * length)

    def build(builder: PathBuilder) -> None:
        for place in (0.5, 0.0):
            builder.move(place * length, limits)
            builder.piece(4.0)

    return build


def _creep(speed: float, length: float) -> Callable[[PathBuilder], None]:
    """Constant low speed in both directions, over at least half a period of cogging of order 24."""

    def build(builder: PathBuilder) -> None:
        stay = max(1.0, math.pi / 24.0 / speed)
        for signed in (speed, -speed):
            builder.ramp(signed * length, 10.0 * length)
            builder.piece(stay)
        builder.ramp(0.0, 10.0 * length)
        builder.piece(1.0)

    return build

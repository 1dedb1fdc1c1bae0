"""Motions on which a compensation is judged: slow reversals, creep, positioning with rest, a disturbed hold."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.simulate import Scenario, scenario
from pmsm_ctrl.simulate.motions import Limits, PathBuilder

__all__ = ["study_motions"]

Array = NDArray[Any]


def study_motions(design: Design) -> dict[str, Scenario]:
    """Return the motions by name; all under position control, each with rest at its end."""
    motions = {f"reversal {speed:g} rad/s": _sine_then_rest(design, speed) for speed in (0.5, 2.0, 10.0)}
    motions["triangle"] = _path("triangle", _triangle)
    motions |= {f"creep {speed:g} rad/s": _path("creep", _creep(speed)) for speed in (0.1, 1.0)}
    motions["positioning"] = scenario(
        "s_curve", design, distance=0.5, speed=5.0, acceleration=50.0, jerk=1000.0, dwell=2.0, cycles=2.0
    )
    motions["push"] = _push(design)
    return motions


def _push(design: Design) -> Scenario:
    """A slow sine, then rest; a push of twice the friction for 5 ms wakes what sleeps there, and 2 s to see it."""
    moving = _sine_then_rest(design, 2.0, cycles=1.0, rest=2.5)
    start = moving.duration - 2.3
    push = Limits.of(design).breakaway * design.K_t

    def references(t: Array) -> Mapping[str, Array]:
        inside = (t >= start) & (t < start + 0.005)
        return {**moving.references(t), "T_load": np.where(inside, push, 0.0)}

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


def _triangle(builder: PathBuilder) -> None:
    """Speed in a slow triangle of +-2 rad/s, twice."""
    for level in (2.0, -2.0, 2.0, -2.0, 0.0):
        builder.ramp(level, 4.0)
    builder.piece(1.0)


def _creep(speed: float) -> Callable[[PathBuilder], None]:
    """Forth and back at a speed at which an axis sticks and slips; about half a cogging pitch of 24 at least."""

    def build(builder: PathBuilder) -> None:
        stay = max(1.0, math.pi / 24.0 / speed)
        for signed in (speed, -speed):
            builder.ramp(signed, 10.0)
            builder.piece(stay)
        builder.ramp(0.0, 10.0)
        builder.piece(1.0)

    return build

"""Motions on which a compensation is judged: slow reversals, creep, positioning with rest, a disturbed hold."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.simulate import Scenario, scenario
from pmsm_ctrl.simulate.motions import PathBuilder

__all__ = ["study_motions"]

Array = NDArray[Any]


def study_motions(design: Design) -> dict[str, Scenario]:
    """Return the motions by name; all under position control, each with rest at its end."""
    motions = {f"reversal {speed:g} rad/s": _sine_then_rest(design, speed) for speed in (0.5, 2.0, 10.0)}
    motions["triangle"] = _path("triangle", _triangle)
    motions |= {f"creep {speed:g} rad/s": _path("creep", _creep(speed)) for speed in (0.1, 1.0)}
    motions["positioning"] = scenario(
        "s_curve", design, distance=0.5, speed=5.0, acceleration=50.0, jerk=1000.0, dwell=1.0, cycles=2.0
    )
    return motions


def _sine_then_rest(design: Design, speed: float) -> Scenario:
    """Three cycles at 0.5 Hz, then 1 s of rest in which a limit cycle would show."""
    moving = scenario("reversal", design, speed=speed, frequency=0.5, cycles=3.0)
    end = moving.duration

    def references(t: Array) -> Mapping[str, Array]:
        given = moving.references(np.minimum(t, end))
        return {
            "theta_ref": given["theta_ref"],
            "omega_ref": np.where(t < end, given["omega_ref"], 0.0),
            "alpha_ref": np.where(t < end, given["alpha_ref"], 0.0),
        }

    return Scenario("reversal", end + 1.0, references, control="position")


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

"""The identification run: parts for friction, inertia, ripple and dynamics in one motion."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.likely import unlikely
from pmsm_ctrl.simulate.motions import Array, Limits, PathBuilder, Scenario, multisine_signal, require_positive
from pmsm_ctrl.units import axis_unit

__all__ = ["identification", "identification_parts"]

# Segments in which a multisine is added to the current, and the share of the top speed at which the axis turns.
MULTISINES = {"multisine forward": 0.3, "multisine backward": -0.3}


def identification(
    *,
    duration: float = 30.0,
    speed_max: float | None = None,
    acceleration: float | None = None,
    amplitude: float | None = None,
    seed: float = 0.0,
    design: Design | None = None,
) -> Scenario:
    """Identify friction, inertia and ripple in one run: the best mix of the others, 30 s long.

    Slow triangle through zero (Stribeck, breakaway), one slow turn each way (cogging, ripple), staircase in both
    directions up to speed_max [200 rad/s] (drag), the same reversal at three accelerations up to `acceleration`
    [3000 rad/s^2] (inertia), multisine of rms `amplitude` [0.03 A] at one speed each way (dynamics).
    `duration` stretches the time spent at each. A turn of a linear axis is 2 pi of its lengths.

    Raises
    ------
    RequestError
        When the ramps leave too little of the duration.
    """
    limits = Limits.of(design)
    top = limits.steady if speed_max is None else speed_max
    slope = limits.acceleration if acceleration is None else acceleration
    rms = 0.5 * limits.current if amplitude is None else amplitude
    require_positive("identification", duration=duration, speed_max=top, acceleration=slope, amplitude=rms)
    turn = 2.0 * math.pi * limits.length
    unit = _time_unit(duration, top, slope, turn)
    # A heavy load ramps slowly: the default speed is lowered to fit the duration.
    while speed_max is None and unit < 0.4 and top > 0.02 * limits.steady:
        top *= 0.9
        unit = _time_unit(duration, top, slope, turn)
    if unit < 0.2:
        raise RequestError(
            f"scenario 'identification': its ramps leave too little of the duration of {duration:g} s; "
            f"it should be longer, or the acceleration greater{_why_slow(design, slope, acceleration)}"
        )
    builder, segments = identification_parts(unit, top, slope, turn)
    path, ramp = builder.path(), 0.3 * top / (0.1 * slope)
    stays = [(start + ramp, stop - ramp) for name, start, stop in segments if name in MULTISINES]

    def references(t: Array) -> Mapping[str, Array]:
        signal = np.zeros_like(t)
        for start, stop in stays:
            inside = (t >= start) & (t < stop)
            signal[inside] = multisine_signal(t[inside] - start, stop - start, 2.0, 100.0, 20, round(seed), rms)
        return {"omega_ref": path.at(t)[1], "i_q_add": signal}

    return Scenario("identification", duration, references, segments=tuple(segments))


def _why_slow(design: Design | None, slope: float, stated: float | None) -> str:
    """Return where a slow acceleration comes from, and how a longer run is asked for."""
    if design is None or stated is not None:
        return ""
    where = axis_unit("rad/s^2", design.motion)
    doubts = "".join(f". {notice.text}" for notice in unlikely(design))
    inertia = "mass" if design.motion == "linear" else "inertia J"
    return (
        f": the current limit and the {inertia} of the design make it {slope:.3g} {where}; duration = 120.0 in "
        f"[scenarios.identification] asks for a longer run{doubts}"
    )


def _time_unit(duration: float, top: float, slope: float, turn: float) -> float:
    """Return the time spent at each part: the duration less that of the ramps, shared."""
    once, twice = (identification_parts(unit, top, slope, turn)[0].t for unit in (1.0, 2.0))
    return (duration - (2.0 * once - twice)) / (twice - once)


def _slow_triangle(builder: PathBuilder, unit: float, top: float, slope: float) -> None:
    for level in (0.1 * top, -0.1 * top, 0.0):
        builder.ramp(level, 0.4 * top / (5.0 * unit))


def _slow_turns(turn: float) -> Callable[[PathBuilder, float, float, float], None]:
    def part(builder: PathBuilder, unit: float, top: float, slope: float) -> None:
        for signed in (1.0, -1.0):
            builder.ramp(signed * turn / 1.5, 0.01 * slope)  # one turn in 1.5 s
            builder.piece(1.5 * unit)
            builder.ramp(0.0, 0.01 * slope)

    return part


def _staircase(builder: PathBuilder, unit: float, top: float, slope: float) -> None:
    for signed in (top, -top):
        for share in (0.02, 0.05, 0.1, 0.2, 0.4, 0.7, 1.0):
            builder.ramp(share * signed, 0.2 * slope)
            builder.piece(0.6 * unit)
        builder.ramp(0.0, 0.2 * slope)


def _reversals(builder: PathBuilder, unit: float, top: float, slope: float) -> None:
    for share in (0.05, 0.25, 1.0):
        for level in (0.5 * top, -0.5 * top, 0.5 * top, 0.0):
            builder.ramp(level, share * slope)
            builder.piece(0.1 * unit)


def _stay(share: float) -> Callable[[PathBuilder, float, float, float], None]:
    def part(builder: PathBuilder, unit: float, top: float, slope: float) -> None:
        builder.ramp(share * top, 0.1 * slope)
        builder.piece(2.8 * unit)
        builder.ramp(0.0, 0.1 * slope)

    return part


def identification_parts(
    unit: float, top: float, slope: float, turn: float
) -> tuple[PathBuilder, list[tuple[str, float, float]]]:
    """Return the parts of the identification run in order, and their names with start and end.

    `unit` stretches the time spent at each, about 1 for a run of 30 s; `top` speed in rad/s, `slope` in rad/s^2, the
    way of the slow `turn` in rad.
    """
    builder = PathBuilder()
    segments = []
    for name, part in (
        ("slow triangle", _slow_triangle),
        ("slow turns", _slow_turns(turn)),
        ("staircase", _staircase),
        ("reversals", _reversals),
        *((name, _stay(share)) for name, share in MULTISINES.items()),
    ):
        start = builder.t
        part(builder, unit, top, slope)
        segments.append((name, start, builder.t))
    return builder, segments

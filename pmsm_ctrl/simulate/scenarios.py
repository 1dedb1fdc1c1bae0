"""Named motions. A scenario has a duration and returns the references at given times.

A maker takes its parameters by keyword, in SI units. A default of None follows from the design (`Limits`); the value
in brackets is the reference motor's. Every motion starts at rest. For a linear axis read m for rad, N for N m; its
lengths and speeds are multiples of `Limits.length`.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import RequestError, nearest
from pmsm_ctrl.simulate.identification import identification
from pmsm_ctrl.simulate.motions import (
    TIME_TOLERANCE,
    Limits,
    Path,
    PathBuilder,
    Scenario,
    binary_signal,
    chirp_signal,
    multisine_signal,
    noise_signal,
    require_positive,
    triangle_signal,
    whole,
)
from pmsm_ctrl.units import axis_unit

__all__ = ["SCENARIOS", "scenario"]

Array = NDArray[Any]

LONGEST_ORDER = 20  # of a maximum-length sequence: a million values


def sweep(
    *,
    speed_max: float | None = None,
    speed_step: float | None = None,
    dwell: float = 1.0,
    acceleration: float | None = None,
    design: Design | None = None,
) -> Scenario:
    """Speed staircase from -speed_max to speed_max, `dwell` s each: the reference paper's experiment.

    speed_max [200 rad/s], speed_step [10 rad/s]. The first level is reached on a ramp with `acceleration`
    [3000 rad/s^2], within the first half of its dwell; the others by a step, as in the paper.
    """
    limits = Limits.of(design)
    top = limits.steady if speed_max is None else speed_max
    step = top / 20.0 if speed_step is None else speed_step
    slope = limits.acceleration if acceleration is None else acceleration
    require_positive("sweep", speed_max=top, speed_step=step, dwell=dwell, acceleration=slope)
    count = whole("sweep", "2 speed_max / speed_step", max(1.0, float(np.round(2.0 * top / step))))
    levels = -top + step * np.arange(count + 1)
    approach = min(top / slope, 0.5 * dwell)

    def references(t: Array) -> Mapping[str, Array]:
        index = np.clip(((t + TIME_TOLERANCE) / dwell).astype(np.intp), 0, count)
        return {"omega_ref": levels[index] * np.minimum(t / approach, 1.0)}

    unit = _unit("rad/s", design)
    segments = tuple((f"{level:g} {unit}", k * dwell, (k + 1) * dwell) for k, level in enumerate(levels.tolist()))
    return Scenario("sweep", dwell * (count + 1), references, segments=segments)


def triangle(
    *, speed: float | None = None, period: float = 8.0, cycles: float = 3.0, design: Design | None = None
) -> Scenario:
    """Slow triangular speed through zero, to `speed` [20 rad/s] and -speed, `cycles` times."""
    peak = Limits.of(design).swing if speed is None else speed
    require_positive("triangle", speed=peak, period=period, cycles=cycles)
    builder = PathBuilder()
    slope = 4.0 * peak / period
    segments = []
    for k in range(whole("triangle", "cycles", cycles)):
        start = builder.t
        for level in (peak, -peak, 0.0):
            builder.ramp(level, slope)
        segments.append((f"cycle {k + 1}", start, builder.t))
    return _speed_scenario("triangle", builder, segments)


def creep(
    *,
    speed_min: float | None = None,
    speed_max: float | None = None,
    count: float = 4.0,
    turns: float = 1.0,
    pause: float = 0.5,
    acceleration: float | None = None,
    design: Design | None = None,
) -> Scenario:
    """Turn slowly, `turns` forth and back, at `count` speeds from speed_min to speed_max in equal ratios.

    speed_min [0.1 rad/s], speed_max [5 rad/s]. With the defaults one turn each way at 0.1, 0.37, 1.4 and 5 rad/s:
    176 s. With count = 1, at speed_min alone. A turn of a linear axis is 2 pi of its lengths.
    """
    limits = Limits.of(design)
    slope = 0.1 * limits.acceleration if acceleration is None else acceleration
    slowest = 0.1 * limits.length if speed_min is None else speed_min
    fastest = 5.0 * limits.length if speed_max is None else speed_max
    require_positive("creep", speed_min=slowest, speed_max=fastest, turns=turns, acceleration=slope)
    number = whole("creep", "count", count)
    speeds = np.geomspace(slowest, fastest, number) if number > 1 else np.array([slowest])
    builder = PathBuilder()
    segments = []
    for speed in speeds.tolist():
        for signed in (speed, -speed):
            builder.piece(pause)
            start = builder.t
            builder.ramp(signed, slope)
            builder.piece(2.0 * math.pi * limits.length * turns / speed)
            segments.append((f"{signed:.3g} {_unit('rad/s', design)}", start, builder.t))
            builder.ramp(0.0, slope)
    builder.piece(pause)
    return _speed_scenario("creep", builder, segments)


def multisine(
    *,
    bias: float | None = None,
    amplitude: float | None = None,
    f_min: float = 1.0,
    f_max: float = 200.0,
    count: float = 30.0,
    period: float = 4.0,
    periods: float = 5.0,
    seed: float = 0.0,
    design: Design | None = None,
) -> Scenario:
    """Random-phase multisine added to i_q while the axis turns at `bias` [50 rad/s].

    `amplitude` is its rms value [0.06 A]; `count` frequencies from f_min to f_max (Hz), logarithmically spread,
    multiples of 1 / period. The axis runs up and settles for 1 s first.
    """
    limits = Limits.of(design)
    turning = 0.25 * limits.steady if bias is None else bias
    rms = limits.current if amplitude is None else amplitude
    require_positive("multisine", amplitude=rms, f_min=f_min, period=period)
    require_positive("multisine", **{"f_max - f_min": f_max - f_min})
    number, repeats = whole("multisine", "count", count), whole("multisine", "periods", periods)
    path, settled = _run_up(turning, limits)

    def references(t: Array) -> Mapping[str, Array]:
        signal = multisine_signal(t - settled, period, f_min, f_max, number, round(seed), rms)
        return {"omega_ref": path.at(t)[1], "i_q_add": signal}

    segments = [("run-up", 0.0, settled)]
    segments += [(f"period {k + 1}", settled + k * period, settled + (k + 1) * period) for k in range(repeats)]
    return Scenario("multisine", settled + repeats * period, references, segments=tuple(segments))


def chirp(
    *,
    bias: float | None = None,
    amplitude: float | None = None,
    f_start: float = 1.0,
    f_stop: float = 500.0,
    duration: float = 20.0,
    design: Design | None = None,
) -> Scenario:
    """Sine of `amplitude` [0.085 A] added to i_q, its frequency growing exponentially, at `bias` [50 rad/s].

    From f_start to f_stop (Hz) in `duration` s, after the axis has run up and settled for 1 s.
    """
    limits = Limits.of(design)
    turning = 0.25 * limits.steady if bias is None else bias
    peak = math.sqrt(2.0) * limits.current if amplitude is None else amplitude
    require_positive("chirp", amplitude=peak, f_start=f_start, duration=duration)
    require_positive("chirp", **{"f_stop - f_start": f_stop - f_start})
    path, settled = _run_up(turning, limits)

    def references(t: Array) -> Mapping[str, Array]:
        return {"omega_ref": path.at(t)[1], "i_q_add": chirp_signal(t - settled, duration, f_start, f_stop, peak)}

    segments = (("run-up", 0.0, settled), ("chirp", settled, settled + duration))
    return Scenario("chirp", settled + duration, references, segments=segments)


def noise(
    *,
    bias: float | None = None,
    amplitude: float | None = None,
    f_min: float = 1.0,
    f_max: float = 300.0,
    duration: float = 20.0,
    seed: float = 0.0,
    design: Design | None = None,
) -> Scenario:
    """Gaussian noise of rms `amplitude` [0.06 A] from f_min to f_max (Hz), added to i_q while the axis turns at `bias`.

    `bias` [50 rad/s]. The axis runs up and settles for 1 s first. Keep f_max below 0.4 times the log's rate.
    """
    limits = Limits.of(design)
    turning = 0.25 * limits.steady if bias is None else bias
    rms = limits.current if amplitude is None else amplitude
    require_positive("noise", amplitude=rms, f_min=f_min, duration=duration, **{"f_max - f_min": f_max - f_min})
    whole("noise", "duration times f_max", math.ceil(duration * f_max))
    whole("noise", "lines between f_min and f_max", math.floor(duration * f_max) - math.ceil(duration * f_min))
    path, settled = _run_up(turning, limits)
    signal = noise_signal(duration, f_min, f_max, round(seed), rms)

    def references(t: Array) -> Mapping[str, Array]:
        return {"omega_ref": path.at(t)[1], "i_q_add": signal(t - settled)}

    segments = (("run-up", 0.0, settled), ("noise", settled, settled + duration))
    return Scenario("noise", settled + duration, references, segments=segments)


def prbs(
    *,
    bias: float | None = None,
    amplitude: float | None = None,
    clock: float = 2e-3,
    order: float = 13.0,
    duration: float = 20.0,
    design: Design | None = None,
) -> Scenario:
    """Binary sequence of +-`amplitude` [0.06 A], each value held for `clock` s, added to i_q at `bias` [50 rad/s].

    A maximum-length sequence of 2^order - 1 values. The axis runs up and settles for 1 s first. Make `clock` a whole
    number of periods of the log, and of the speed loop.

    Raises
    ------
    RequestError
        When `order` is no number of a sequence.
    """
    limits = Limits.of(design)
    turning = 0.25 * limits.steady if bias is None else bias
    peak = limits.current if amplitude is None else amplitude
    require_positive("prbs", amplitude=peak, clock=clock, duration=duration)
    if not 2 <= whole("prbs", "order", order) <= LONGEST_ORDER:
        raise RequestError(f"scenario 'prbs': order: found {order:g}; it should be from 2 to {LONGEST_ORDER}")
    path, settled = _run_up(turning, limits)
    signal = binary_signal(clock, round(order), peak)

    def references(t: Array) -> Mapping[str, Array]:
        return {"omega_ref": path.at(t)[1], "i_q_add": signal(t - settled)}

    segments = (("run-up", 0.0, settled), ("sequence", settled, settled + duration))
    return Scenario("prbs", settled + duration, references, segments=segments)


def breakaway(
    *,
    current: float | None = None,
    rise: float = 0.5,
    pause: float = 0.5,
    cycles: float = 4.0,
    design: Design | None = None,
) -> Scenario:
    """Current rises to `current` [0.0412 A, twice what friction holds] and falls again, forth and back in turn.

    Current control: the shaft sticks until the torque meets breakaway. `rise` s up and down, `pause` s of rest.
    """
    peak = Limits.of(design).breakaway if current is None else current
    require_positive("breakaway", current=peak, rise=rise, pause=pause)
    number = whole("breakaway", "cycles", cycles)
    cycle = 2.0 * (2.0 * rise + pause)

    def references(t: Array) -> Mapping[str, Array]:
        half, where = np.divmod(t, 0.5 * cycle)
        sign = np.where(half % 2 == 0, 1.0, -1.0)
        return {"i_q_add": sign * triangle_signal(where / (2.0 * rise), peak)}

    names = ((k, name, 0.5 * cycle * (2 * k + m)) for k in range(number) for m, name in enumerate(("up", "down")))
    segments = tuple((f"{name} {k + 1}", start, start + 0.5 * cycle) for k, name, start in names)
    return Scenario("breakaway", number * cycle, references, control="current", segments=segments)


def hold(
    *, duration: float = 10.0, T_load: float = 0.0, current: float = 0.0, design: Design | None = None
) -> Scenario:
    """Leave the axis alone at a constant current (A) and external torque (N m): standstill, or what creeps away."""
    require_positive("hold", duration=duration)

    def references(t: Array) -> Mapping[str, Array]:
        return {"i_q_add": np.full(t.shape, current), "T_load": np.full(t.shape, T_load)}

    return Scenario("hold", duration, references, control="current", segments=(("hold", 0.0, duration),))


def positioning(
    *, step: float | None = None, count: float = 5.0, dwell: float = 1.0, design: Design | None = None
) -> Scenario:
    """Steps of the reference angle: `count` times `step` [1 rad] up and back down, `dwell` s each; position control."""
    height = Limits.of(design).length if step is None else step
    require_positive("positioning", step=height, dwell=dwell)
    number = whole("positioning", "count", count)
    places = height * np.array([*range(number + 1), *range(number - 1, -1, -1)], dtype=np.float64)

    def references(t: Array) -> Mapping[str, Array]:
        return {"theta_ref": places[np.clip(((t + TIME_TOLERANCE) / dwell).astype(np.intp), 0, 2 * number)]}

    unit = _unit("rad", design)
    segments = tuple((f"{k + 1}: {x:g} {unit}", k * dwell, (k + 1) * dwell) for k, x in enumerate(places.tolist()))
    return Scenario("positioning", places.size * dwell, references, control="position", segments=segments)


def trapezoid(
    *,
    distance: float | None = None,
    speed: float | None = None,
    acceleration: float | None = None,
    dwell: float = 0.5,
    cycles: float = 4.0,
    design: Design | None = None,
) -> Scenario:
    """Moves of `distance` [10 turns] forth and back with a trapezoidal speed profile; position control.

    speed [200 rad/s], acceleration [3000 rad/s^2]; `dwell` s of rest before every move.
    """
    return _moves("trapezoid", distance, speed, acceleration, math.inf, dwell, cycles, design)


def s_curve(
    *,
    distance: float | None = None,
    speed: float | None = None,
    acceleration: float | None = None,
    jerk: float | None = None,
    dwell: float = 0.5,
    cycles: float = 4.0,
    design: Design | None = None,
) -> Scenario:
    """Moves of `distance` [10 turns] forth and back with limited jerk [150000 rad/s^3]; position control.

    speed [200 rad/s], acceleration [3000 rad/s^2]; `dwell` s of rest before every move.
    """
    j = Limits.of(design).jerk if jerk is None else jerk
    require_positive("s_curve", jerk=j)
    return _moves("s_curve", distance, speed, acceleration, j, dwell, cycles, design)


def warm_up(
    *,
    speed: float | None = None,
    duration: float = 600.0,
    dwell: float = 5.0,
    acceleration: float | None = None,
    design: Design | None = None,
) -> Scenario:
    """Run at `speed` [150 rad/s] for `dwell` s forth and back in turn, for `duration` s: friction changes with heat."""
    limits = Limits.of(design)
    level = 0.75 * limits.steady if speed is None else speed
    slope = 0.1 * limits.acceleration if acceleration is None else acceleration
    require_positive("warm_up", speed=level, duration=duration, dwell=dwell, acceleration=slope)
    half = dwell + 2.0 * level / slope
    start = level / slope

    def references(t: Array) -> Mapping[str, Array]:
        # Ramp up, then a wave of `dwell` s at speed and a ramp through zero, in either direction.
        number, where = np.divmod(np.maximum(t - start, 0.0), half)
        sign = np.where(number % 2 == 0, 1.0, -1.0)
        wave = sign * (level - slope * np.maximum(where - dwell, 0.0))
        return {"omega_ref": np.where(t < start, slope * t, wave)}

    return Scenario("warm_up", duration, references, segments=(("warm-up", 0.0, duration),))


def reversal(
    *, speed: float | None = None, frequency: float = 0.5, cycles: float = 5.0, design: Design | None = None
) -> Scenario:
    """Sinusoidal speed about zero with amplitude `speed` [20 rad/s] at `frequency` Hz; position control.

    Friction shows as a peak of the position error where the speed changes sign.
    """
    peak = Limits.of(design).swing if speed is None else speed
    require_positive("reversal", speed=peak, frequency=frequency, cycles=cycles)
    w = 2.0 * math.pi * frequency

    def references(t: Array) -> Mapping[str, Array]:
        return {
            "theta_ref": peak / w * (1.0 - np.cos(w * t)),
            "omega_ref": peak * np.sin(w * t),
            "alpha_ref": peak * w * np.cos(w * t),
        }

    number = whole("reversal", "cycles", cycles)
    segments = tuple((f"cycle {k + 1}", k / frequency, (k + 1) / frequency) for k in range(number))
    return Scenario("reversal", number / frequency, references, control="position", segments=segments)


def _moves(
    name: str,
    distance: float | None,
    speed: float | None,
    acceleration: float | None,
    jerk: float,
    dwell: float,
    cycles: float,
    design: Design | None,
) -> Scenario:
    """Moves forth and back in position control."""
    own = Limits.of(design)
    v, a = (own.speed if speed is None else speed), (own.acceleration if acceleration is None else acceleration)
    far = 20.0 * math.pi * own.length if distance is None else distance
    require_positive(name, distance=far, speed=v, acceleration=a, dwell=dwell)
    limits = Limits(speed=v, acceleration=a, jerk=jerk)
    builder = PathBuilder()
    segments = []
    for k in range(whole(name, "cycles", cycles)):
        for place, way in ((far, "forth"), (0.0, "back")):
            builder.piece(dwell)
            start = builder.t
            builder.move(place, limits)
            segments.append((f"{way} {k + 1}", start, builder.t))
    builder.piece(dwell)
    path = builder.path()

    def references(t: Array) -> Mapping[str, Array]:
        return dict(zip(("theta_ref", "omega_ref", "alpha_ref"), path.at(t), strict=True))

    return Scenario(name, builder.t, references, control="position", segments=tuple(segments))


def _unit(rotary: str, design: Design | None) -> str:
    """Return a rotary unit as that of the design's axis."""
    return rotary if design is None else axis_unit(rotary, design.motion)


def _run_up(speed: float, limits: Limits) -> tuple[Path, float]:
    """Return the way from rest to a speed and the time after which it has settled."""
    builder = PathBuilder()
    builder.ramp(speed, 0.1 * limits.acceleration)
    return builder.path(), builder.t + 1.0


def _speed_scenario(name: str, builder: PathBuilder, segments: list[tuple[str, float, float]]) -> Scenario:
    """Follow the speed of the path in speed control."""
    path = builder.path()

    def references(t: Array) -> Mapping[str, Array]:
        return {"omega_ref": path.at(t)[1]}

    return Scenario(name, builder.t, references, segments=tuple(segments))


SCENARIOS: Mapping[str, Callable[..., Scenario]] = {
    maker.__name__: maker
    for maker in (
        sweep, triangle, creep, multisine, chirp, noise, prbs, breakaway, hold, positioning, trapezoid, s_curve,
        warm_up, reversal, identification,
    )
}  # fmt: skip


def scenario(name: str, design: Design | None = None, **parameters: float) -> Scenario:
    """Return a named scenario.

    Parameters
    ----------
    name : str
        One of `SCENARIOS`.
    design : Design, optional
        Its ``[scenarios.NAME]`` holds parameters, and defaults follow from it.
    **parameters : float
        In SI units, before those of the design.

    Returns
    -------
    Scenario

    Raises
    ------
    RequestError
        For an unknown scenario or parameter, or a duration that is not positive.
    """
    if name not in SCENARIOS:
        raise RequestError(f"unknown scenario '{name}'{nearest(name, SCENARIOS)} (known: {', '.join(SCENARIOS)})")
    maker = SCENARIOS[name]
    known = [key for key in inspect.signature(maker).parameters if key != "design"]
    values = dict(design.scenarios.get(name, {})) if design is not None else {}
    values |= parameters
    for key in values:
        if key not in known:
            raise RequestError(
                f"scenario '{name}': unknown parameter '{key}'{nearest(key, known)} (known: {', '.join(known)})"
            )
    made = maker(**values, design=design)
    if not (made.duration > 0.0 and math.isfinite(made.duration)):
        raise RequestError(f"scenario '{name}': its duration is {made.duration:g} s; it should be positive")
    return made

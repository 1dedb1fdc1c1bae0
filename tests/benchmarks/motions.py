"""Motions of machines, for the second simulator: speed references over time, random in everything but their kind."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["MACHINES", "limited", "machine", "rounded"]

Array = NDArray[Any]
Rng = np.random.Generator


def _trapezoids(t: Array, rng: Rng) -> Array:
    """Moves there and back, each pair as far and as fast as chance has it."""
    times, speeds = [0.0], [0.0]
    while times[-1] < t[-1]:
        v, slope = rng.uniform(20.0, 150.0) * rng.choice([-1.0, 1.0]), rng.uniform(400.0, 3000.0)
        hold, rest, ramp = rng.uniform(0.05, 0.6), rng.uniform(0.1, 0.4), abs(v) / slope
        for way in (v, -v):
            times += (times[-1] + np.cumsum([ramp, hold, ramp, rest])).tolist()
            speeds += [way, way, 0.0, 0.0]
    return np.interp(t, times, speeds)


def _staircase(t: Array, rng: Rng) -> Array:
    up = np.array([5.0, 10.0, 20.0, 40.0, 70.0, 100.0, 130.0, 150.0])
    one_way = np.concatenate([up, up[::-1]])
    levels = np.concatenate([one_way, -one_way])
    place = np.minimum((t / t[-1] * len(levels)).astype(int), len(levels) - 1)
    return limited(t, levels[place], rng.uniform(200.0, 1000.0))


def _triangle(t: Array, rng: Rng) -> Array:
    period, top = rng.uniform(2.0, 6.0), rng.uniform(60.0, 150.0)
    return top * 2.0 / np.pi * np.arcsin(np.sin(2.0 * np.pi * t / period))


def _chirp(t: Array, rng: Rng) -> Array:
    growth = np.log(rng.uniform(3.0, 8.0) / 0.1)
    phase = 2.0 * np.pi * 0.1 * t[-1] / growth * np.expm1(growth * t / t[-1])
    return rng.uniform(25.0, 60.0) * np.sin(phase)


def _steps(t: Array, rng: Rng) -> Array:
    """Speed steps of random size and length, as fast as the drive gets there."""
    raw, start = np.zeros(len(t)), 0.0
    while start < t[-1]:
        stop = start + rng.uniform(0.15, 1.0)
        raw[(t >= start) & (t < stop)] = rng.choice([-1.0, 1.0]) * rng.uniform(10.0, 100.0)
        start = stop
    return limited(t, raw, rng.uniform(1000.0, 4000.0))


def _slow_ramps(t: Array, rng: Rng) -> Array:
    knots = np.array([0.0, 0.2, 0.25, 0.5, 0.55, 0.75, 0.8, 1.0])
    return np.interp(t / t[-1], knots, [0.0, 140.0, 140.0, -140.0, -140.0, 3.0, 3.0, -3.0])


def _two_sines(t: Array, rng: Rng) -> Array:
    slow = rng.uniform(40.0, 90.0) * np.sin(2.0 * np.pi * rng.uniform(0.1, 0.4) * t)
    return slow + rng.uniform(5.0, 20.0) * np.sin(2.0 * np.pi * rng.uniform(2.0, 6.0) * t)


def _cycle(t: Array, rng: Rng) -> Array:
    """One cycle of a machine again and again: smoothly there and back."""
    phase = (t / rng.uniform(1.2, 2.5)) % 1.0
    there = np.where(phase < 0.4, np.sin(np.pi * phase / 0.4) ** 2, 0.0)
    back = np.where((phase > 0.5) & (phase < 0.9), np.sin(np.pi * (phase - 0.5) / 0.4) ** 2, 0.0)
    return rng.uniform(50.0, 140.0) * (there - back)


MACHINES: dict[str, Callable[[Array, Rng], Array]] = {
    "trapezoids": _trapezoids, "staircase": _staircase, "triangle": _triangle, "chirp": _chirp, "steps": _steps,
    "slow ramps": _slow_ramps, "two sines": _two_sines, "cycle": _cycle,
}  # fmt: skip


def machine(kind: str, duration: float, dt: float, rng: Rng) -> Array:
    """Return the speed reference of one kind of motion, rad/s, rounded over 10 ms, shape (round(duration / dt),)."""
    t = np.arange(round(duration / dt)) * dt
    return rounded(MACHINES[kind](t, rng), dt)


def rounded(raw: Array, dt: float) -> Array:
    """Take the mean over 10 ms."""
    width = round(0.01 / dt)
    return np.convolve(raw, np.ones(width) / width, mode="same")


def limited(t: Array, raw: Array, slope: float) -> Array:
    """Follow `raw` no faster than `slope`, decided every half millisecond."""
    stride = max(1, round(5e-4 / (t[1] - t[0])))
    most = slope * stride * (t[1] - t[0])
    last, values = 0.0, np.empty(len(raw[::stride]))
    for n, target in enumerate(raw[::stride]):
        last += np.clip(target - last, -most, most)
        values[n] = last
    return np.repeat(values, stride)[: len(t)]

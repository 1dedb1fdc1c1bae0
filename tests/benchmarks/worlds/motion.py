"""What a world's axis is asked to do: from torque steps to jerk-limited moves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tests.benchmarks.worlds.world import World

__all__ = ["reference"]

Array = NDArray[np.float64]


def reference(world: World, seed: int, duration: float) -> tuple[Array, int]:
    """Return rows of position, speed and acceleration (or current, speed limit, hold) and the kernel's mode."""
    rng = np.random.default_rng([world.seed, seed, 29])
    n = round(duration * world.f_control)
    t = np.arange(n) / world.f_control
    if world.motion == "torque steps":
        return _torque_steps(world, rng, t), 2
    speed = _SPEEDS[world.motion](world, rng, t)
    limit = 0.5 * world.i_max * _K_t(world) / world.motor[5]  # half of what the drive can accelerate with
    speed = _limited(speed, min(limit, world.top * 40.0) / world.f_control)
    if world.reference_hold > 0.0:
        held = max(1, round(world.reference_hold * world.f_control))
        position = np.cumsum(speed) / world.f_control
        speed, position = np.repeat(speed[::held], held)[:n], np.repeat(position[::held], held)[:n]
    else:
        position = np.cumsum(speed) / world.f_control
    smooth = max(1, round(2e-3 * world.f_control))
    accelerate = np.gradient(np.convolve(speed, np.full(smooth, 1.0 / smooth), "same")) * world.f_control
    return np.column_stack([position, speed, accelerate]), world.control


def _K_t(world: World) -> float:
    return world.motor[4] if world.linear else 1.5 * world.motor[3] * world.motor[4]


def _limited(speed: Array, step: float) -> Array:
    out = np.empty_like(speed)
    now = 0.0
    for k, wanted in enumerate(speed.tolist()):
        now = min(max(wanted, now - step), now + step)
        out[k] = now
    return out


def _torque_steps(world: World, rng: np.random.Generator, t: Array) -> Array:
    """Steps of the current, turned round where the axis gets too fast; columns current, speed limit, hold."""
    drag = (world.motor[6] + world.motor[7] * world.top) / _K_t(world)
    levels = drag * rng.uniform(1.3, 5.0, 200)
    place = np.minimum(
        (np.cumsum(rng.exponential(0.6, 200))[None, :] < t[:: max(1, len(t) // 20000), None]).sum(1), 199
    )
    coarse = levels[place]
    current = np.minimum(coarse[np.minimum(np.arange(len(t)) // max(1, len(t) // 20000), len(coarse) - 1)], world.i_max)
    return np.column_stack([current, np.full(len(t), 0.7 * world.top), np.zeros(len(t))])


def _steps(world: World, rng: np.random.Generator, t: Array) -> Array:
    levels = rng.choice([-1.0, 1.0], 60) * world.top * np.exp(rng.uniform(np.log(0.01), 0.0, 60))
    return levels[np.minimum((t / 0.7).astype(int), 59)]


def _ramps(world: World, rng: np.random.Generator, t: Array) -> Array:
    knots = np.arange(0.0, t[-1] + 2.0, float(rng.uniform(0.5, 2.0)))
    return np.interp(t, knots, world.top * rng.uniform(-1.0, 1.0, len(knots)))


def _sines(world: World, rng: np.random.Generator, t: Array) -> Array:
    a, f = rng.uniform(0.15, 0.5, 4), rng.uniform(0.07, 1.8, 4)
    phase = rng.uniform(0.0, 6.0, 4)
    return world.top * sum(x * np.sin(2 * np.pi * y * t + z) for x, y, z in zip(a, f, phase, strict=True))


def _moves(world: World, rng: np.random.Generator, t: Array) -> Array:
    """Trapezoids from rest to rest, pauses in between."""
    out = np.zeros(len(t))
    at = 0.1
    while at < t[-1]:
        rise, flat = float(rng.uniform(0.03, 0.3)), float(rng.uniform(0.05, 0.6))
        level = world.top * float(rng.choice([-1.0, 1.0]) * np.exp(rng.uniform(np.log(0.05), 0.0)))
        out += level * np.interp(t, [at, at + rise, at + rise + flat, at + 2 * rise + flat], [0.0, 1.0, 1.0, 0.0])
        at += 2 * rise + flat + float(rng.uniform(0.0, 0.4))
    return out


def _jerk_limited(world: World, rng: np.random.Generator, t: Array) -> Array:
    speed = _moves(world, rng, t)
    width = max(3, round(float(rng.uniform(0.01, 0.06)) * world.f_control))
    return np.convolve(speed, np.full(width, 1.0 / width), "same")


def _staircase(world: World, rng: np.random.Generator, t: Array) -> Array:
    levels = np.linspace(-1.0, 1.0, 12)
    levels = world.top * np.sign(levels) * np.abs(levels) ** float(rng.uniform(1.0, 2.5))
    order = np.concatenate([levels, levels[::-1]])
    return order[np.minimum((t / t[-1] * len(order)).astype(int), len(order) - 1)]


def _chirp(world: World, rng: np.random.Generator, t: Array) -> Array:
    rate = np.log(float(rng.uniform(8.0, 25.0)) / 0.2) / t[-1]
    phase = 2 * np.pi * 0.2 * np.expm1(rate * t) / rate
    frequency = 0.2 * np.exp(rate * t)
    slow = 0.3 * world.top * np.sin(2 * np.pi * 0.11 * t)
    return slow + 0.6 * world.top * np.sin(phase) / (1.0 + frequency / 2.0)


_SPEEDS = {
    "speed steps": _steps, "ramps": _ramps, "sines": _sines, "moves": _moves, "jerk-limited": _jerk_limited,
    "staircase": _staircase, "chirp": _chirp,
}  # fmt: skip

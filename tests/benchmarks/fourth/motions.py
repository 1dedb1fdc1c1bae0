"""Eleven motions of machines, as the speed that the reference asks for."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy import signal

from tests.benchmarks.fourth.axis import Array

TRAPEZOID, POLYNOMIAL, COSINE = range(3)  # shapes of the speed in one move


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """Draw a number whose logarithm is uniform."""
    return float(math.exp(rng.uniform(math.log(low), math.log(high))))


def one_move(period: float, distance: float, speed: float, acceleration: float, shape: int) -> Array:
    """Return the speed of one move from rest to rest, (n,)."""
    sign = np.sign(distance) or 1
    distance = abs(distance)
    speed = min(speed, math.sqrt(distance * acceleration))
    duration = distance / speed + speed / acceleration
    n = max(4, int(duration / period))
    t = (np.arange(n) + 0.5) * period
    u = t / duration
    if shape == TRAPEZOID:
        y = np.minimum(np.minimum(acceleration * t, speed), np.maximum(acceleration * (duration - t), 0))
    elif shape == POLYNOMIAL:
        y = 30 * u * u * (1 - u) ** 2 * distance / duration
    else:
        y = distance / duration * (1 - np.cos(2 * np.pi * u))
    return sign * y


class Path:
    """A speed over time that grows piece by piece until it is long enough."""

    def __init__(self, rng: np.random.Generator, period: float, duration: float, top: float, steepest: float) -> None:
        self.rng, self.period, self.duration = rng, period, duration
        self.top, self.steepest = top, steepest  # speed and acceleration
        self.samples, self.length, self.pieces = int(duration / period), 0, []
        self.shape = int(rng.integers(3))
        self.jerk_time = log_uniform(rng, 0.004, 0.06)  # s, of the mean that smooths the whole
        self.ramp_time = top / steepest
        self.reach = top * max(self.ramp_time, 0.15) * rng.uniform(1.2, 4)
        self.rest(0.2, 0.8)

    @property
    def open(self) -> bool:
        """Is there time left?"""
        return self.length < self.samples

    def put(self, piece: Array) -> None:
        self.pieces.append(piece)
        self.length += len(piece)

    def replace(self, whole: Array) -> None:
        self.pieces, self.length = [whole], self.samples

    def rest(self, low: float, high: float) -> None:
        self.put(np.zeros(int(self.rng.uniform(low, high) / self.period)))

    def move(self, distance: float, speed: float, acceleration: float, shape: int | None = None) -> None:
        self.put(one_move(self.period, distance, speed, acceleration, self.shape if shape is None else shape))

    def ramp_and_hold(self, start: float, end: float, ramp: int, hold: int) -> float:
        self.put(np.linspace(start, end, ramp))
        self.put(np.full(hold, end))
        return end

    def smoothed(self) -> Array:
        """Return the speed, smoothed by a mean over the jerk time."""
        v = np.concatenate(self.pieces)[: self.samples]
        m = max(1, int(self.jerk_time / self.period))
        return np.convolve(np.concatenate([np.full(m, v[0]), v]), np.ones(m) / m)[m : m + len(v)]


def pick(path: Path) -> None:
    rng, uniform = path.rng, path.rng.uniform
    while path.open:
        share = uniform(0.15, 1)
        distance = path.reach * share * uniform(0.4, 1)
        steepness = uniform(0.2, 1)
        speed = path.top * rng.uniform(0.2, 1)
        path.move(distance, speed, path.steepest * steepness)
        path.rest(0.05, 0.4)
        path.move(-distance * uniform(0.7, 1.3), speed * uniform(0.5, 1), path.steepest * uniform(0.3, 1))
        path.rest(0.1, 0.8)


def cam(path: Path) -> None:
    rng = path.rng
    while path.open:
        turn = rng.uniform(0.6, 3) * max(1, path.ramp_time * 3)
        n = int(turn / path.period)
        u = np.arange(n) / n
        rise, dwell = rng.uniform(0.2, 0.4), rng.uniform(0.05, 0.2)
        back = rng.uniform(0.2, 1 - rise - dwell - 0.05)
        speed = np.zeros(n)
        up, down = u < rise, (u > rise + dwell) & (u < rise + dwell + back)
        speed[up] = (1 - np.cos(2 * np.pi * u[up] / rise)) / rise
        speed[down] = -(1 - np.cos(2 * np.pi * (u[down] - rise - dwell) / back)) / back
        size = rng.uniform(0.3, 1) * path.top / max(2 / rise, 2 / back)
        size = min(size, path.steepest * turn / (2 * np.pi / min(rise, back) ** 2))
        for _ in range(int(rng.integers(2, 6))):
            path.put(size * speed)


def jog(path: Path) -> None:
    for share in np.tile(np.geomspace(0.03, 1, int(path.rng.integers(4, 9))), 40):
        if not path.open:
            return
        speed, acceleration = path.top * share, path.steepest * path.rng.uniform(0.15, 1)
        distance = path.top * share * path.rng.uniform(0.5, 1.8) + (path.top * share) ** 2 / acceleration
        for way in (distance, -distance):
            path.move(way, speed, acceleration, TRAPEZOID)
            path.rest(0, 0.2)


def gearing(path: Path) -> None:
    """Follow a master whose speed steps and wobbles."""
    rng, n, period = path.rng, path.samples, path.period
    level, start = np.zeros(n), 0
    while start < n:
        length = int(rng.uniform(1.5, 6) / period)
        level[start : start + length] = path.top * rng.choice([-1, 1]) * rng.uniform(0.05, 0.8)
        start += length
    wobble_rate = rng.uniform(0.3, 2)  # Hz
    slow = min(0.5 * path.steepest / path.top / 2, 3)  # Hz
    level = signal.lfilter(*signal.butter(2, 2 * slow * period), level)
    wobble = signal.lfilter(*signal.butter(2, 2 * wobble_rate * period), rng.standard_normal(n))
    size = min(0.2 * path.top, 0.4 * path.steepest / (2 * np.pi * wobble_rate))
    path.replace(level + wobble * (size / (wobble.std() + 1e-12) / 2))


def homing(path: Path) -> None:
    rng = path.rng
    path.move(-path.reach * 0.5, path.top * 0.08, path.steepest * 0.2, TRAPEZOID)
    path.rest(0.2, 0.5)
    path.move(path.reach * 0.1, path.top * 0.03, path.steepest * 0.2, TRAPEZOID)
    while path.open:
        distance = path.reach * rng.uniform(-1, 1)
        path.move(distance, path.top * rng.uniform(0.1, 1), path.steepest * rng.uniform(0.2, 1))
        path.rest(0.1, 0.7)


def sweep(path: Path) -> None:
    rng, duration = path.rng, path.duration
    t = np.arange(path.samples) * path.period
    low, high = rng.uniform(0.1, 0.4), rng.uniform(4, 25)  # Hz
    phase = 2 * np.pi * low * duration / np.log(high / low) * ((high / low) ** (t / duration) - 1)
    frequency = low * (high / low) ** (t / duration)
    size = np.minimum(path.top * 0.9, 0.7 * path.steepest / (2 * np.pi * frequency))
    offset = path.top * rng.choice([0, 0, 0.1]) * np.sign(np.sin(2 * np.pi * t / 7.0))
    path.replace(size * np.sin(phase) + offset)
    path.jerk_time = max(path.jerk_time, 0.01)


def positions(path: Path, shortest_rest: float, longest_rest: float) -> None:
    """Go to random positions and rest there."""
    rng, position = path.rng, 0.0
    while path.open:
        target = rng.uniform(-1, 1) * path.reach
        distance, position = target - position, target
        path.move(distance, path.top * log_uniform(rng, 0.05, 1), path.steepest * log_uniform(rng, 0.1, 1))
        path.rest(shortest_rest, longest_rest)


def staircase(path: Path) -> None:
    levels = np.linspace(-1, 1, int(path.rng.integers(7, 17))) * path.top * 0.95
    levels = levels[np.abs(levels) > 1e-9 * path.top]
    levels = np.concatenate([levels, levels[::-1]]) if path.rng.random() < 0.5 else levels
    length = (path.samples - int(0.5 / path.period)) / len(levels)
    speed = 0
    for level in levels:
        ramp = min(max(2, int(abs(level - speed) / (path.steepest * 0.6) / path.period)), int(length * 0.7))
        speed = path.ramp_and_hold(speed, level, ramp, int(length) - ramp)


def spindle(path: Path) -> None:
    rng, speed = path.rng, 0
    while path.open:
        level = rng.choice([-1, 1]) * path.top * rng.uniform(0.3, 1) if rng.random() < 0.75 else 0
        ramp = max(2, int(abs(level - speed) / (path.steepest * rng.uniform(0.05, 0.6)) / path.period))
        speed = path.ramp_and_hold(speed, level, ramp, int(rng.uniform(0.3, 3) / path.period))


def s_curve(path: Path) -> None:
    rng, speed = path.rng, 0
    path.jerk_time = rng.uniform(0.03, 0.15)
    while path.open:
        level = path.top * rng.uniform(-1, 1)
        ramp = max(2, int(abs(level - speed) / (path.steepest * rng.uniform(0.1, 0.9)) / path.period))
        speed = path.ramp_and_hold(speed, level, ramp, int(rng.uniform(0.1, 1.2) / path.period))


MOTIONS: dict[str, Callable[[Path], None]] = {
    "pick": pick,
    "cam": cam,
    "jog": jog,
    "gearing": gearing,
    "homing": homing,
    "sweep": sweep,
    "setpoints": lambda path: positions(path, 0.0, 0.5),
    "mdi": lambda path: positions(path, 0.5, 2.0),
    "staircase": staircase,
    "spindle": spindle,
    "s_curve": s_curve,
}
SPEED_MOTIONS = ("staircase", "spindle", "s_curve")  # may be asked of a speed controller


def speed_of(name: str, path: Path) -> Array:
    """Return the reference of the speed, (n,)."""
    MOTIONS[name](path)
    return path.smoothed()

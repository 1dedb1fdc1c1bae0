"""Logs of linear axes in closed form, with waves of the force along the way: made by no simulator of the package."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pmsm_ctrl import Design, Log

__all__ = ["MOTIONS", "Slide", "slide"]

RATE = 1000.0  # Hz


@dataclass(frozen=True)
class Slide:
    """A log, a design with other parameters, and the true ones: mass, kg, dry friction, N, viscous friction, N s/m."""

    log: Log
    design: Design
    true: Mapping[str, float]


def between_places(rng: np.random.Generator) -> np.ndarray:
    """Return the speed of trapezoids between places on half a metre, m/s, for 20 s."""
    parts, at, length = [np.zeros(100)], 0.0, 100
    while length < 20.0 * RATE:
        goal = rng.uniform(0.0, 0.5)
        top = min(rng.uniform(0.05, 0.4), np.sqrt(2.0 * abs(goal - at)))
        ramp = np.arange(1, int(RATE * top / 2.0) + 2)
        flat = np.full(int(RATE * abs(goal - at) / top) + 1, ramp.size + 1)
        part = top * np.sign(goal - at) * np.concatenate([ramp, flat, ramp[::-1]]) / (ramp.size + 1)
        parts += [part, np.zeros(int(rng.uniform(50, 300)))]
        at, length = at + part.sum() / RATE, length + part.size + parts[-1].size
    return np.concatenate(parts)[: int(20.0 * RATE)]


def two_sines(rng: np.random.Generator) -> np.ndarray:
    """Return the speed of two sines, m/s, for 20 s."""
    t = np.arange(20.0 * RATE) / RATE
    return 0.2 * np.sin(2.0 * np.pi * 0.2 * t) + 0.1 * np.sin(2.0 * np.pi * 0.57 * t + rng.uniform(0.0, 6.0))


MOTIONS = {"moves": between_places, "sines": two_sines}


def slide(
    motion: str, seed: int, waves: Mapping[float, tuple[float, float]], of: Slide | None = None, zero: float = 0.0
) -> Slide:
    """Return a linear axis with waves along it: of a period, m, sine and cosine part, N; below noise of 1 N.

    Another record of the same axis where one is given, its positions counted from another zero.
    """
    rng = np.random.default_rng(seed)
    window = np.hanning(41) / np.hanning(41).sum()
    v = np.convolve(MOTIONS[motion](rng), window, mode="same")
    t = np.arange(v.size) / RATE
    x = np.cumsum(v) / RATE - 0.5 * v / RATE
    drawn = rng.uniform(2.0, 20.0), rng.uniform(3.0, 15.0), rng.uniform(2.0, 30.0)
    m, F_c, F_v = of.true.values() if of else drawn
    force = m * np.gradient(v, t) + F_c * np.sign(v) + F_v * v
    for period, (sine, cosine) in waves.items():
        force += sine * np.sin(2.0 * np.pi * x / period) + cosine * np.cos(2.0 * np.pi * x / period)
    log = Log({"t": t, "theta": np.round(x + zero, 6), "torque": force + rng.normal(size=v.size)}, motion="linear")
    effects = [{"id": "coulomb", "F_c": 0.8 * F_c}, {"id": "viscous", "F_v": 1.2 * F_v}]
    motor = {"J": 1.05 * m, "K_t": 30.0}
    design = Design.from_dict({"name": "slide", "motion": "linear", "motor": motor, "effects": effects})
    return Slide(log, design, {"J": m, "F_c": F_c, "F_v": F_v})

"""A force that repeats along a linear axis, as of a linear motor's magnets: named with its period where it is.

The logs are made in closed form, from moves between places drawn at random, by no simulator of the package.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from pmsm_ctrl import Design, Log, compare, diagnose
from tests.effort import seeds, slow

PERIOD, RATE = 0.024, 1000.0  # m, Hz


@dataclass(frozen=True)
class Axis:
    """A log, its design with other parameters, and the place at which the wave is zero."""

    log: Log
    design: Design


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
    t = np.arange(20.0 * RATE) / RATE
    return 0.2 * np.sin(2.0 * np.pi * 0.2 * t) + 0.1 * np.sin(2.0 * np.pi * 0.57 * t + rng.uniform(0.0, 6.0))


MOTIONS = {"moves": between_places, "sines": two_sines}


def axis(motion: str, seed: int, size: float, second: float = 0.0) -> Axis:
    """Return a linear axis with a wave of this size along it, N, and one of half the period, below noise of 1 N."""
    rng = np.random.default_rng(seed)
    window = np.hanning(41) / np.hanning(41).sum()
    v = np.convolve(MOTIONS[motion](rng), window, mode="same")
    t = np.arange(v.size) / RATE
    x = np.cumsum(v) / RATE - 0.5 * v / RATE
    m, F_c, F_v = rng.uniform(2.0, 20.0), rng.uniform(3.0, 15.0), rng.uniform(2.0, 30.0)
    force = m * np.gradient(v, t) + F_c * np.tanh(v / 1e-3) + F_v * v
    force += size * np.sin(2.0 * np.pi * x / PERIOD) + second * np.sin(4.0 * np.pi * x / PERIOD + 1.0)
    log = Log({"t": t, "theta": np.round(x, 6), "torque": force + rng.normal(size=v.size)}, motion="linear")
    effects = [{"id": "coulomb", "F_c": 0.8 * F_c}, {"id": "viscous", "F_v": 1.2 * F_v}]
    motor = {"J": 1.05 * m, "K_t": 30.0}
    return Axis(log, Design.from_dict({"name": "slide", "motion": "linear", "motor": motor, "effects": effects}))


@pytest.mark.parametrize("motion", ["moves", slow("sines")])
@pytest.mark.parametrize("seed", seeds(1, 2, 3))
def test_it_is_named_with_period_and_size(motion: str, seed: int) -> None:
    one = axis(motion, seed, size=2.0)
    found = diagnose(one.design, one.log, plan=False)
    (step,) = found.steps
    assert step.effect == "detent_force"
    period, a_s, a_c = (step.parameters[name] for name in ("period", "a_s", "a_c"))
    assert period.value == pytest.approx(PERIOD, abs=4.0 * period.stderr)
    assert period.stderr < 1e-3 * PERIOD
    assert np.hypot(a_s.value, a_c.value) == pytest.approx(2.0, rel=0.05)
    written = compare(found.design, one.log).log.errors["torque"]
    assert written.relative == pytest.approx(found.errors["final"]["torque"]["relative"], rel=1e-3)
    # the sign of the speed in the model, a rounded one in the log
    assert written.relative < 1.2 * found.errors["noise_floor"]["torque"]["relative"]


@pytest.mark.slow
@pytest.mark.parametrize("motion", list(MOTIONS))
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_second_wave_is_named_beside_it(motion: str, seed: int) -> None:
    one = axis(motion, seed, size=3.0, second=1.5)
    periods = [step.parameters["period"].value for step in diagnose(one.design, one.log, plan=False).steps]
    assert periods == pytest.approx([PERIOD, 0.5 * PERIOD], rel=1e-3)


@pytest.mark.parametrize("motion", ["moves", slow("sines")])
@pytest.mark.parametrize("seed", seeds(4, 5, 6))
def test_nothing_is_named_without_one(motion: str, seed: int) -> None:
    one = axis(motion, seed, size=0.0)
    found = diagnose(one.design, one.log, plan=False)
    assert (found.verdict, found.steps) == ("consistent", ())

"""Where a model fails, on residuals whose dependence is known."""

from __future__ import annotations

import numpy as np
import pytest

from pmsm_ctrl.compare.where import coordinates, where
from pmsm_ctrl.design import Design
from pmsm_ctrl.identify.signals import prepare
from pmsm_ctrl.simulate import simulate


def _motion(rng: np.random.Generator) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    t = np.arange(3000) * 0.01
    speed = 20.0 * np.sin(2.0 * np.pi * 0.3 * t) + 3.0 * np.sin(2.0 * np.pi * 1.1 * t)
    theta = np.mod(np.cumsum(speed) * 0.01, 2.0 * np.pi)
    return t, {"speed": speed, "direction": np.sign(speed), "position": theta, "time": t}


def test_share_is_that_of_the_variance(rng: np.random.Generator) -> None:
    t, against = _motion(rng)
    signal = np.exp(-np.abs(against["speed"]) / 3.0) * np.sign(against["speed"])
    noise = rng.standard_normal(t.size) * signal.std() * 0.5  # a fifth of the variance is noise
    found = where(t, signal + noise, np.ones(t.size, dtype=bool), against)
    assert found.dependences[0].coordinate == "speed"
    assert found.dependences[0].significant
    assert found.dependences[0].share == pytest.approx(0.8, abs=0.06)
    assert "speed and direction" in found.sentence()


def test_position_is_told_from_time(rng: np.random.Generator) -> None:
    t, against = _motion(rng)
    residual = np.sin(3.0 * against["position"]) + 0.3 * rng.standard_normal(t.size)
    found = where(t, residual, np.ones(t.size, dtype=bool), against)
    assert found.dependences[0].coordinate == "position"
    assert not next(d for d in found.dependences if d.coordinate == "time").significant


def test_noise_depends_on_nothing(rng: np.random.Generator) -> None:
    t, against = _motion(rng)
    found = where(t, rng.standard_normal(t.size), np.ones(t.size, dtype=bool), against)
    assert not any(d.significant for d in found.dependences)
    assert found.sentence() == "what is left depends on no coordinate of this log"


def test_worst_stretch_is_found(rng: np.random.Generator) -> None:
    t, against = _motion(rng)
    residual = rng.standard_normal(t.size) * np.where((t > 12.0) & (t < 12.7), 10.0, 1.0)
    worst = where(t, residual, np.ones(t.size, dtype=bool), against).stretches[0]
    assert worst.start <= 12.7
    assert worst.stop >= 12.0


def test_coordinates_of_a_log(designs) -> None:
    design = Design.read(designs / "seed_motor.toml")
    prepared = prepare(design, simulate(design, "triangle", seed=1))
    found = coordinates(prepared)
    assert set(found) == {"speed", "direction", "position", "acceleration", "time", "current"}
    assert {values.shape for values in found.values()} == {prepared.keep.shape}

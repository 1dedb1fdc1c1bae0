"""Effects that are hidden in a world, with strengths relative to what the noise allows anybody to see (`margin`)."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.log import Log
from tests.benchmarks.worlds.margin import margin
from tests.benchmarks.worlds.motion import reference
from tests.benchmarks.worlds.plant import HIDDEN, PLACE, run
from tests.benchmarks.worlds.recorder import record, truth
from tests.benchmarks.worlds.world import World

__all__ = ["EFFECTS", "hidden_log", "possible", "simulate_with_truth", "simulate_world"]

Array = NDArray[np.float64]
Rng = np.random.Generator


def _dry(world: World) -> float:
    return world.motor[6]


def _at_top(world: World) -> float:
    """Dry and viscous friction at the fastest speed of this world."""
    return world.motor[6] + world.motor[7] * world.top


def _stribeck(w: World, g: Rng) -> dict[str, float]:
    return {"stribeck": 0.3 * _dry(w), "stribeck_speed": w.top * math.exp(g.uniform(math.log(0.01), math.log(0.15))),
            "stribeck_lorentz": float(g.integers(0, 2))}  # fmt: skip


def _compliance(w: World, g: Rng) -> dict[str, float]:
    J = w.motor[5] * float(g.uniform(0.3, 0.7))
    w_a = 2 * math.pi * float(g.uniform(15.0, 60.0))
    rubbing = _dry(w) * float(g.uniform(0.2, 0.9)) if g.random() < 0.5 else 0.0  # the load's part of the dry friction
    return {"load_inertia": J, "stiffness": J * w_a**2, "damping": 2 * 0.03 * J * w_a, "load_dry": rubbing}


def _backlash(w: World, g: Rng) -> dict[str, float]:
    J = w.motor[5] * float(g.uniform(0.3, 0.6))
    w_a = 2 * math.pi * 150.0
    return {"gap": 0.01 * (w.top / 100.0), "load_inertia": J, "stiffness": J * w_a**2, "damping": 0.4 * J * w_a}


# effect -> what it sets in the plant (the first entry, or those of `SCALED`, carry its strength), and where it can be
EFFECTS: dict[str, Callable[[World, Rng], dict[str, float]]] = {
    "stribeck": _stribeck,
    "viscous_asymmetry": lambda w, g: {"viscous_asymmetry": 0.1 * _at_top(w) / w.top},
    "constant_load": lambda w, g: {"constant_load": 0.15 * _dry(w)},
    "viscous_power": lambda w, g: {"drag_gain": 0.2 * _at_top(w) / w.top**0.6, "drag_power": 0.6},
    "quadratic_drag": lambda w, g: {"drag_gain": 0.2 * _at_top(w) / w.top**2, "drag_power": 2.0},
    "load_dependent_friction": lambda w, g: {"load_friction": 0.08},
    "thermal_drift": lambda w, g: {"warm_share": 0.3, "warm_time": w.duration * float(g.uniform(0.2, 0.6))},
    "presliding": lambda w, g: {"bristle": 1e-3 * w.top / 10.0},
    "position_dependent_friction": lambda w, g: {
        "position_friction": 0.2 * _dry(w), "position_phase": float(g.uniform(0, 6))},
    "unbalance": lambda w, g: {"wave": 0.2 * _dry(w), "wave_order": 1.0, "wave_phase": float(g.uniform(0, 6))},
    "cogging": lambda w, g: {
        "wave": 0.2 * _dry(w), "wave_order": float(g.choice([12, 18, 24, 36, 72])),
        "wave_phase": float(g.uniform(0, 6))},
    "torque_ripple": lambda w, g: {"ripple": 0.05, "ripple_order": 6.0},
    "torque_saturation": lambda w, g: {"saturation": 0.1 / w.i_max},
    "compliance": _compliance,
    "backlash": _backlash,
    "dead_time": lambda w, g: {"dead_voltage": 0.3 * w.motor[0] * _dry(w) / (1.5 * w.motor[3] * w.motor[4]),
                               "dead_current": 0.05 * _dry(w) / (1.5 * w.motor[3] * w.motor[4])},
    "current_offset": lambda w, g: {"offset_a": 0.05 * _dry(w) / (1.5 * w.motor[3] * w.motor[4]),
                                    "offset_b": 0.03 * _dry(w) / (1.5 * w.motor[3] * w.motor[4])},
    "current_gain": lambda w, g: {"gain_a": 0.03},
    "encoder_eccentricity": lambda w, g: {"eccentricity": 2e-3, "eccentricity_phase": float(g.uniform(0, 6))},
}  # fmt: skip
SCALED = {
    "current_offset": ("offset_a", "offset_b"),
    "compliance": ("load_inertia", "stiffness", "damping", "load_dry"),
}
# What a linear axis, known by its force alone, cannot have; and what only shows where voltages are logged.
ROTARY = {"position_dependent_friction", "unbalance", "cogging", "torque_ripple", "current_offset", "current_gain",
          "encoder_eccentricity", "dead_time"}  # fmt: skip
NEEDS_VOLTAGES = {"dead_time"}


def possible(world: World) -> list[str]:
    """Return the effects that this world can have and its log could show."""
    out = [e for e in EFFECTS if not (world.linear and e in ROTARY)]
    return [e for e in out if world.voltages or e not in NEEDS_VOLTAGES]


def simulate_world(world: World, hidden: dict[str, float] | None = None) -> Log:
    """Return the log of a world, with these entries of the plant's hidden physics."""
    return record(world, _tables(world, hidden or {}))


def simulate_with_truth(world: World, hidden: dict[str, float]) -> tuple[Log, dict[str, Array]]:
    """Return the log of a world with an effect, and what the effect adds to its balances."""
    tables = _tables(world, hidden)
    return record(world, tables), truth(world, tables)


def _tables(world: World, hidden: dict[str, float]) -> list[Array]:
    x = np.zeros(len(HIDDEN))
    x[PLACE["stribeck_speed"]] = x[PLACE["warm_time"]] = x[PLACE["dead_current"]] = 1.0
    for name, value in hidden.items():
        x[PLACE[name]] = value
    tables = []
    substeps = max(2, math.ceil(3.1e4 / world.f_control))
    sizes = np.array([1.0 / world.f_control, substeps, world.divider, world.delay])
    for number in range(world.runs):
        ref, mode = reference(world, number, world.duration / world.runs)
        tables.append(
            run(
                np.array(world.motor), x, ref, sizes, np.array(world.loops), mode, np.array(world.noise),
                np.array(world.encoder), world.seed * 10 + number,
            )
        )  # fmt: skip
        if not np.all(np.isfinite(tables[-1])):
            raise ArithmeticError(f"world {world.seed}: the drive leaves the finite numbers")
    return tables


def hidden_log(world: World, effect: str, wanted: float) -> tuple[Log, float, dict[str, float]] | None:
    """Return a log with the effect at about this margin, the margin reached, and its parameters; None where it fails.

    Strengths are scaled twice; what is reported is the margin measured on the log itself.
    """
    rng = np.random.default_rng([world.seed, 31])
    clean = simulate_world(world)
    values = EFFECTS[effect](world, rng)
    scaled = SCALED.get(effect, (next(iter(values)),))
    for _ in range(4):
        try:
            log, added = simulate_with_truth(world, values)
        except ArithmeticError:
            factor = 0.3
        else:
            reached = margin(world, clean, log, added)
            if 0.7 * wanted <= reached <= 1.5 * wanted:
                return log, reached, values
            factor = min(max(wanted / max(reached, 0.05), 0.1), 8.0)
        values = {name: value * (factor if name in scaled else 1.0) for name, value in values.items()}
        if values.get("load_inertia", 0.0) > 0.8 * world.motor[5] or values.get("ripple", 0.0) > 0.5:
            return None
        if values.get("stribeck", 0.0) > 4.0 * world.motor[6] or values.get("load_friction", 0.0) > 0.5:
            return None
        if values.get("position_friction", 0.0) > 0.9 * world.motor[6]:  # dry friction has one sign
            return None
        if values.get("eccentricity", 0.0) > 0.05 or values.get("gap", 0.0) > 0.5 or values.get("gain_a", 0.0) > 0.3:
            return None
        if values.get("warm_share", 0.0) > 0.8 or values.get("saturation", 0.0) * world.i_max > 0.6:
            return None
    return None

"""What is hidden in a log: sizes of the catalogue's effects by the terms of `axis.c`."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from tests.benchmarks.fourth.axis import Array
from tests.benchmarks.fourth.motions import log_uniform
from tests.benchmarks.fourth.recorder import Channels, low_pass
from tests.benchmarks.fourth.world import FAMILIES, Wishes, World

EFFECTS = (
    "stribeck", "cogging", "unbalance", "viscous_asymmetry", "constant_load", "load_dependent_friction",
    "position_dependent_friction", "quadratic_drag", "viscous_power", "thermal_drift", "compliance", "backlash",
    "presliding", "torque_ripple", "dead_time", "current_offset", "current_gain", "encoder_eccentricity", "delay",
    "torque_saturation",
)  # fmt: skip
OF_POSITION = (
    "cogging", "unbalance", "position_dependent_friction", "torque_ripple", "current_offset", "current_gain",
    "encoder_eccentricity", "spot", "gear_mesh",
)  # fmt: skip
SLOW_MOTIONS = ("jog", "homing", "staircase", "setpoints", "pick", "s_curve", "spindle", "gearing", "mdi", "cam")
ROTARY = tuple(name for name in FAMILIES if name != "linear")
GEARED = ("geared", "belt", "robot", "linear")


@dataclass
class Hidden:
    """An effect's terms; those named in `scaled` may grow up to `most` times."""

    terms: dict[str, float]
    scaled: tuple[str, ...] = ()
    most: float = 1.0
    seen: Callable[[World, Channels], Array] | None = None  # its part of the torque, where the table has none
    delay: int = field(default=0)  # samples of the speed controller


def wishes(effect: str) -> Wishes:
    """What an effect needs of its world."""
    families = ROTARY if effect in (*OF_POSITION, "dead_time") else tuple(FAMILIES)
    return Wishes(
        voltages=effect == "dead_time",
        dq_currents=effect in ("current_offset", "current_gain", "torque_ripple"),
        position=effect in (*OF_POSITION, "presliding", "backlash"),
        families=GEARED if effect == "backlash" else families,
        **({"motions": SLOW_MOTIONS} if effect in (*OF_POSITION, "stribeck") else {}),
    )


def hide(effect: str, world: World, rng: np.random.Generator) -> Hidden:
    """Draw an effect; those that can be scaled are drawn at a size that is scaled later."""
    for draws in (_friction, _position, _mechanics, _currents):
        hidden = draws(effect, world, rng)
        if hidden is not None:
            return hidden
    raise ValueError(f"effect {effect!r} is none of {EFFECTS}")


def _phase(rng: np.random.Generator) -> float:
    return rng.uniform(0, 2 * np.pi)


def _friction(effect: str, world: World, rng: np.random.Generator) -> Hidden | None:
    p, v = world.parameters, world.top
    F_c, F_v = p["F_c"], p["F_v"]
    whole = F_c + F_v * v
    if effect == "stribeck":
        terms = {"stribeck_force": 0.4 * F_c, "stribeck_speed": v * log_uniform(rng, 0.004, 0.08)}
        return Hidden(terms | {"stribeck_power": float(rng.choice([1, 2]))}, ("stribeck_force",), 3)
    if effect == "viscous_asymmetry":
        return Hidden({effect: 0.15 * whole / v * rng.choice([-1, 1])}, (effect,), 3)
    if effect == "constant_load":
        return Hidden({effect: 0.3 * F_c * rng.choice([-1, 1])}, (effect,), 3)
    if effect == "load_dependent_friction":
        return Hidden({"load_friction": 0.08}, ("load_friction",), 3.5)
    if effect == "quadratic_drag":
        return Hidden({effect: 0.4 * whole / v**2}, (effect,), 4)
    if effect == "viscous_power":
        power = float(rng.choice([0.33, 0.5, 0.67, 1.7, 3]))
        return Hidden({"drag_gain": 0.5 * whole / v**power, "drag_power": power}, ("drag_gain",), 4)
    if effect == "thermal_drift":
        terms = {"warm_F_v": -0.3 * F_v, "warm_F_c": -0.25 * F_c, "warm_time": world.duration * rng.uniform(0.15, 0.8)}
        return Hidden(terms, ("warm_F_v", "warm_F_c"), 2.5)
    return None


def _position(effect: str, world: World, rng: np.random.Generator) -> Hidden | None:
    p, peak = world.parameters, world.peak
    if effect == "cogging":
        waves = int(rng.integers(1, 3))
        poles = 2 * int(p["p"])
        order = poles * int(rng.choice([1, 3, 6])) if rng.random() < 0.7 else int(rng.integers(3, 60))
        terms = {}
        for n in range(waves):
            terms[f"cogging_{n}"] = 0.02 * peak * (1 if n == 0 else 0.5)
            terms[f"cogging_order_{n}"], terms[f"cogging_phase_{n}"] = order * (n + 1), _phase(rng)
        return Hidden(terms, tuple(f"cogging_{n}" for n in range(waves)), 4)
    if effect == "unbalance":
        return Hidden({effect: 0.1 * peak, "unbalance_phase": _phase(rng)}, (effect,), 4)
    if effect == "position_dependent_friction":
        terms = {"position_friction": 0.25 * p["F_c"], "position_phase": _phase(rng)}
        return Hidden(terms, ("position_friction",), 2.5)
    if effect == "torque_ripple":
        terms = {"ripple": 0.03, "ripple_order": float(rng.choice([6, 6, 12, 2])), "ripple_phase": _phase(rng)}
        return Hidden(terms, ("ripple",), 3.5)
    if effect == "encoder_eccentricity":
        terms = {"eccentricity": 1e-3, "eccentricity_phase": _phase(rng)}  # rad
        hidden = Hidden(terms, ("eccentricity",), 15)
        hidden.seen = lambda world, run: _eccentric_inertia(world, run, terms)
        return hidden
    return None


def _mechanics(effect: str, world: World, rng: np.random.Generator) -> Hidden | None:
    p = world.parameters
    if effect == "compliance":
        J = p["J"] * rng.uniform(0.3, 0.85)
        stiffness = J * (2 * np.pi * max(3.5 * world.speed_bandwidth, log_uniform(rng, 20, 70))) ** 2
        damping = 2 * log_uniform(rng, 0.02, 0.1) * math.sqrt(stiffness * J)
        return Hidden({"load_inertia": J, "stiffness": stiffness, "damping": damping})
    if effect == "backlash":
        J = p["J"] * rng.uniform(0.3, 0.8)
        stiffness = J * (2 * np.pi * max(4 * world.speed_bandwidth, log_uniform(rng, 60, 140))) ** 2
        damping = 2 * 0.05 * math.sqrt(stiffness * J)
        gap = log_uniform(rng, 1e-5, 2e-4) if world.linear else log_uniform(rng, 2e-3, 4e-2)
        return Hidden({"load_inertia": J, "stiffness": stiffness, "damping": damping, "gap": gap})
    if effect == "presliding":
        ranges = {"linear": (4e-6, 6e-5), "torque": (3e-4, 3e-3)}  # m, rad
        length = log_uniform(rng, *ranges.get(world.family, (4e-3, 6e-2)))
        terms = {"bristle_length": max(12 * p["encoder_step"], length), "bristle_time": log_uniform(rng, 1e-4, 2e-3)}
        return Hidden(terms)
    return None


def _currents(effect: str, world: World, rng: np.random.Generator) -> Hidden | None:
    i_max = world.parameters["i_max"]
    if effect == "dead_time":
        lost = world.u_dc * log_uniform(rng, 0.004, 0.02)
        return Hidden({"dead_voltage": lost, "dead_current": i_max * log_uniform(rng, 0.01, 0.04)})
    if effect in ("current_offset", "current_gain"):
        angle = _phase(rng)
        offset = effect == "current_offset"
        names = ("offset_alpha", "offset_beta") if offset else ("gain_cos", "gain_sin")
        size = 0.015 * i_max if offset else 0.03
        terms = {names[0]: size * math.cos(angle), names[1]: size * math.sin(angle)}
        hidden = Hidden(terms, names, 4 if offset else 3)
        hidden.seen = lambda world, run: _sensor_torque(world, run, terms)
        return hidden
    if effect == "torque_saturation":
        return Hidden({effect: 0.1 / i_max}, (effect,), 3)
    if effect == "delay":
        if world.recorder["torque"] != "i_q":
            world.recorder.update(torque="i_q", torque_filter=0.0)
        wished = rng.uniform(1.6, 5) / world.log_rate  # s
        hidden = Hidden({}, delay=round(wished * world.rate))
        hidden.seen = lambda world, run: _late_torque(world, run, hidden.delay)
        return hidden
    return None


def _as_logged(world: World, torque: Array) -> Array:
    return low_pass(torque, world.decimation) if world.decimation > 1 else torque


def _eccentric_inertia(world: World, run: Channels, terms: dict[str, float]) -> Array:
    error = terms["eccentricity"] * np.sin(run["theta"] + terms["eccentricity_phase"])
    return _as_logged(world, np.gradient(np.gradient(error)) * world.rate**2 * world.parameters["J"])


def _sensor_torque(world: World, run: Channels, terms: dict[str, float]) -> Array:
    p = world.parameters
    angle = p["p"] * run["theta"]
    if "offset_alpha" in terms:
        a, b = terms["offset_alpha"], terms["offset_beta"]
    else:
        i_q, c, s = run["ideal torque"] / p["K_t"], terms["gain_cos"], terms["gain_sin"]
        i_a, i_b = -np.sin(angle) * i_q, np.cos(angle) * i_q
        a, b = c * i_a + s * i_b, s * i_a - c * i_b
    return _as_logged(world, p["K_t"] * (-np.sin(angle) * a + np.cos(angle) * b))


def _late_torque(world: World, run: Channels, delay: int) -> Array:
    return _as_logged(world, -np.gradient(run["ideal torque"]) * world.rate * delay / world.rate)

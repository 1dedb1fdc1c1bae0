"""What no catalogue holds: effects outside it, and logs that were spoiled on their way."""

from __future__ import annotations

import math

import numpy as np
from scipy import signal

from tests.benchmarks.fourth.axis import Array, RunawayError, simulate
from tests.benchmarks.fourth.effects import OF_POSITION, ROTARY
from tests.benchmarks.fourth.motions import log_uniform
from tests.benchmarks.fourth.recorder import Channels
from tests.benchmarks.fourth.world import FAMILIES, Noise, Reference, Wishes, World, draw

OUTSIDE = ("spot", "gear_mesh", "seal", "push", "slow_load", "dwell", "random_load", "limit_cycle")
SPOILED = ("sign", "rpm", "lost", "swapped", "filtered", "clipped", "foreign", "rms", "frozen", "wrap")
DONORS = 50  # sub-seed of the first log that lends its torque to another


def wishes_outside(effect: str) -> Wishes:
    bound = effect in OF_POSITION
    return Wishes(position=bound, families=ROTARY if bound else tuple(FAMILIES))


def wishes_spoiled(fault: str) -> Wishes:
    return Wishes(position=fault == "wrap", families=ROTARY if fault == "wrap" else tuple(FAMILIES))


def outside(
    effect: str, world: World, reference: Reference, noise: Noise, rng: np.random.Generator
) -> tuple[dict[str, float], Noise]:
    """Draw an effect outside the catalogue; return its terms and the noise. Torques in parts of F_c or of the peak."""
    p, peak, F_c = world.parameters, world.peak, world.parameters["F_c"]
    phase = rng.uniform(0, 6.28)
    angle = reference[0]
    span = angle.max() - angle.min()
    if effect == "spot":  # a worn place
        terms = {"spot_force": F_c * rng.uniform(0.5, 1.5)}
        terms["spot_centre"] = float(np.quantile(angle, rng.uniform(0.2, 0.8)))
        return terms | {"spot_width": span * rng.uniform(0.01, 0.06)}, noise
    if effect == "gear_mesh":
        terms = {"mesh_force": 0.08 * peak * rng.uniform(0.5, 2)}
        return terms | {"mesh_order": float(rng.choice([5, 11, 17, 8])) * 3 / 7, "mesh_phase": phase}, noise
    if effect == "seal":
        return {"seal_force": F_c * rng.uniform(0.5, 1.2), "seal_length": span * log_uniform(rng, 0.003, 0.05)}, noise
    if effect == "push":
        terms = {"push_force": 0.5 * peak * rng.uniform(0.5, 1.5) * rng.choice([-1, 1])}
        terms["push_start"] = world.duration * rng.uniform(0.2, 0.7)
        return terms | {"push_duration": rng.uniform(0.4, 2)}, noise
    if effect == "slow_load":
        terms = {"slow_load": F_c * rng.uniform(0.4, 1.2)}
        return terms | {"slow_load_frequency": log_uniform(rng, 0.03, 0.7), "slow_load_phase": phase}, noise
    if effect == "dwell":
        return {"dwell_force": F_c * rng.uniform(0.7, 2), "dwell_speed": world.top * 0.003}, noise
    if effect == "random_load":
        filtered = signal.butter(1, 2 * log_uniform(rng, 0.2, 3) / world.rate)
        load = signal.lfilter(*filtered, rng.standard_normal(len(angle)))
        return {}, (noise[0], noise[1], noise[2] + load / load.std() * F_c * rng.uniform(0.3, 0.8))
    gain = rng.uniform(3, 9)
    return {"K_p": p["K_p"] * gain, "K_d": p.get("K_d", 0) * gain, "K_i": p["K_i"] * gain**2}, noise


def undeclared_filter(fault: str, rng: np.random.Generator) -> float | None:
    """Return the time constant in s of a filter of the torque that nobody declares."""
    return log_uniform(rng, 6e-3, 25e-3) if fault == "filtered" else None


def spoil(fault: str, world: World, log: Channels, rng: np.random.Generator, base: int) -> Channels | None:
    """Spoil a log; None where the fault cannot be had in it. `base` is the sub-seed of the seed's first world."""
    name = "torque" if "torque" in log else "i_q"
    if fault in ("rpm", "swapped") and "omega" not in log:
        return None
    torque = log[name]
    if fault == "sign":
        return log | {name: -torque}
    if fault == "rpm":
        return log | {"omega": log["omega"] * 60 / (2 * math.pi)}
    if fault == "lost":
        return _without_samples(log, rng)
    if fault == "swapped":
        return log | {name: log["omega"], "omega": torque}
    if fault == "clipped":
        limit = np.abs(torque).max() * rng.uniform(0.3, 0.6)
        return log | {name: np.clip(torque, -limit, limit)}
    if fault == "foreign":
        return log | {name: _torque_of_another(world, torque, base)}
    if fault == "rms":
        return log | {name: torque / math.sqrt(2)}
    if fault == "frozen":
        return log | {name: _frozen(world, torque, rng)}
    if fault == "wrap":
        turn = 2 * math.pi * rng.uniform(0.93, 0.98)
        if rng.random() < 0.5:
            return log | {"theta": np.mod(log["theta"], 2 * math.pi) * turn / (2 * math.pi)}
        return log | {"theta": np.mod(log["theta"], turn)}
    return log


def _without_samples(log: Channels, rng: np.random.Generator) -> Channels:
    n = len(log["t"])
    kept = np.ones(n, bool)
    for _ in range(int(rng.integers(4, 20))):
        start = int(rng.integers(0, n - 200))
        kept[start : start + int(rng.integers(3, 60))] = False
    return {k: v[kept] for k, v in log.items()} | {"t": log["t"][: kept.sum()]}


def _torque_of_another(world: World, torque: Array, base: int) -> Array:
    for n in range(20):
        other, reference, noise = draw(base + DONORS + n, Wishes(families=(world.family,)))
        try:
            i_q = simulate(other.parameters, reference, noise)["i_q"]
        except RunawayError:
            continue
        scaled = i_q / np.abs(i_q).max() * np.abs(torque).max()
        return np.resize(scaled[:: max(1, round(other.rate / world.log_rate))], len(torque))
    raise RunawayError("no other axis of this family is stable")


def _frozen(world: World, torque: Array, rng: np.random.Generator) -> Array:
    torque, n = torque.copy(), len(torque)
    for _ in range(int(rng.integers(1, 4))):
        start = int(rng.integers(n // 10, n * 8 // 10))
        torque[start : start + int(world.log_rate * rng.uniform(0.3, 2))] = torque[start]
    return torque

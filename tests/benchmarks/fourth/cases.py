"""One log of a seed: clean, with one hidden effect, with one outside the catalogue, or spoiled.

A seed has up to twelve worlds, its sub-seeds; the first that fits is taken. One does not fit where the axis runs away
or does not follow its reference, where its loop is unstable, nor where the hidden effect has less than 0.8 times the
rms of the residual or 1.5 % of the torque.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.benchmarks.fourth.axis import Array, RunawayError, simulate
from tests.benchmarks.fourth.effects import EFFECTS, Hidden, hide, wishes
from tests.benchmarks.fourth.motions import log_uniform
from tests.benchmarks.fourth.others import (
    OUTSIDE,
    SPOILED,
    outside,
    spoil,
    undeclared_filter,
    wishes_outside,
    wishes_spoiled,
)
from tests.benchmarks.fourth.recorder import Channels, record
from tests.benchmarks.fourth.regression import regress, regress_voltage
from tests.benchmarks.fourth.world import Noise, Reference, Wishes, World, draw

CLEAN, HIDDEN, FOREIGN, BROKEN = 1, 2, 3, 4
SUB_SEEDS = 12
LEAST_RATIO = 0.8  # rms of a hidden effect over that of the residual
LEAST_SHARE = 0.015  # the same over the torque
RINGING = 0.3  # rms of the current over its limit at constant speed; 0.7 and more in limit cycles, below 0.1 otherwise
ROTOR_AND_LOAD = ("load_inertia", "stiffness", "damping")  # what changes the loop
LAG = 0.2  # rms of the position error over the motion's, from which an axis does not follow


@dataclass(frozen=True)
class Case:
    """A log and what is true of it."""

    seed: int
    sub_seed: int
    name: str | None  # what is hidden, foreign or spoiled
    world: World
    log: Channels
    run: Channels
    noise: Noise
    terms: dict[str, float]
    size: dict[str, float]  # `ratio` and `share` of a hidden effect


def seed_of(group: int, number: int) -> int:
    """Return the seed of a log: 1000, 2000, ... and its number, or a million and its number from 1000 on.

    So 1000 to 1999 are clean, 2000 to 2999 hide an effect, 3000 to 3999 one outside the catalogue, 4000 to 4999 are
    spoiled, and the next clean one is 1001000.
    """
    return group * (1_000 if number < 1_000 else 1_000_000) + number


def group_of(seed: int) -> int:
    """Return the group of a seed."""
    return seed // (1_000 if seed < 1_000_000 else 1_000_000)


def name_of(seed: int) -> str | None:
    """Return what a seed hides; the names come in turn."""
    names = {HIDDEN: EFFECTS, FOREIGN: OUTSIDE, BROKEN: SPOILED}.get(group_of(seed))
    return names[seed % len(names)] if names else None


def build(seed: int) -> Case | None:
    """Return the log of a seed; None where none of its worlds fits."""
    for attempt in range(SUB_SEEDS):
        try:
            case = _attempt(seed, seed * 100 + attempt)
        except RunawayError:
            continue
        if case is not None:
            return case
    return None


def _attempt(seed: int, sub_seed: int) -> Case | None:
    group, name = group_of(seed), name_of(seed)
    rng = np.random.default_rng([sub_seed, 7])
    wanted = {CLEAN: lambda _: Wishes(), HIDDEN: wishes, FOREIGN: wishes_outside, BROKEN: wishes_spoiled}[group]
    world, reference, noise = draw(sub_seed, wanted(name))
    terms: dict[str, float] = {}
    size: dict[str, float] = {}
    spoiling_filter = None
    if group == HIDDEN:
        made = _with_effect(str(name), world, reference, noise, rng)
        if made is None:
            return None
        run, log, terms, size = made
    else:
        if group == FOREIGN:
            terms, noise = outside(str(name), world, reference, noise, rng)
        run = simulate(world.parameters | terms, reference, noise)
        if group == BROKEN:
            spoiling_filter = undeclared_filter(str(name), rng)
        log = record(world, run, reference, spoiling_filter=spoiling_filter)
    if group == BROKEN:
        spoiled = spoil(str(name), world, log, rng, seed * 100)
        if spoiled is None:
            return None
        log = spoiled
    if not _follows(world, run, reference[0]) or (name != "limit_cycle" and not stable(world, terms)):
        return None
    return Case(seed, sub_seed, name, world, log, run, noise, terms, size)


def _with_effect(
    name: str, world: World, reference: Reference, noise: Noise, rng: np.random.Generator
) -> tuple[Channels, Channels, dict[str, float], dict[str, float]] | None:
    """Hide an effect and scale it to a ratio of 1.2 to 8 where it can be scaled; None where it is too small."""
    hidden = hide(name, world, rng)
    run, log, size = _made(name, hidden, world, reference, noise)
    if hidden.scaled:
        wanted = log_uniform(rng, 1.2, 8)
        factor = min(hidden.most, max(0.15, wanted / max(size["ratio"], 1e-9)))
        for term in hidden.scaled:
            hidden.terms[term] *= factor
        run, log, size = _made(name, hidden, world, reference, noise)
    enough = size["ratio"] >= LEAST_RATIO and size["share"] >= LEAST_SHARE
    return (run, log, hidden.terms, size) if enough else None


def _made(
    name: str, hidden: Hidden, world: World, reference: Reference, noise: Noise
) -> tuple[Channels, Channels, dict[str, float]]:
    run = simulate(world.parameters | hidden.terms, reference, noise)
    log = record(world, run, reference, delay=hidden.delay)
    if name == "dead_time":
        return run, log, regress_voltage(world, run, log, hidden)
    return run, log, regress(world, run, log, name, hidden.seen(world, run) if hidden.seen else None)


def _follows(world: World, run: Channels, angle: Array) -> bool:
    error = run["theta"] - angle
    return bool(world.parameters["speed_only"]) or np.std(error - error.mean()) <= LAG * np.std(angle)


def stable(world: World, terms: dict[str, float]) -> bool:
    """Does the current come to rest at a tenth of the top speed, without noise, dry friction, gap and other effects?"""
    p = world.parameters | {name: terms[name] for name in ROTOR_AND_LOAD if name in terms} | {"F_c": 0.0}
    n, ramp = int(1.5 * world.rate), 0.3  # s
    speed = 0.1 * world.top * np.minimum(1, np.arange(n) / world.rate / ramp)
    reference = (np.cumsum(speed) / world.rate, speed, np.gradient(speed) * world.rate)
    try:
        current = simulate(p, reference, (np.zeros((2, n)), np.zeros(n), np.zeros(n)))["i_q command"]
    except RunawayError:
        return False
    return bool(np.std(current[-n // 4 :]) < RINGING * p["i_max"])

"""Drives side by side: groups that share one kernel, whose loops over the drives become vector instructions.

A group has one combination of effects and one timing; every drive has its own parameters, controllers, references
and noise. The physics is the scalar kernel's, so that a drive differs from its single run by rounding alone.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.effects import Effect
from pmsm_ctrl.log import Log
from pmsm_ctrl.simulate.compose import BARE_STATES, lines_of, module_of, source
from pmsm_ctrl.simulate.feedforward import FIRST
from pmsm_ctrl.simulate.run import LOGGED, Prepared

__all__ = ["LANES", "WORTH", "Group", "groups", "load_lanes", "simulate_group"]

Array = NDArray[Any]

LANES = 16
FEWEST = 6  # drives above which a group with empty lanes is faster than single runs
WORTH = 50_000_000  # control periods of a combination above which compiling its kernel saves time
CHUNK = 1 << 13  # control periods of noise drawn at once: each call holds the interpreter's lock
BLOCK = 1 << 14  # control periods of references computed at once
_TEMPLATE = Path(__file__).resolve().parent.parent / "kernels" / "lanes_template.py"


@dataclass(frozen=True, eq=False)
class Group:
    """Drives for one kernel: their numbers in the batch, and the drives."""

    numbers: tuple[int, ...]
    drives: tuple[Prepared, ...]


def groups(drives: Mapping[int, Prepared], *, always: bool = False) -> list[Group]:
    """Return groups of drives that can run side by side; all others are simulated one by one.

    With `always` also groups whose kernel takes longer to compile than it saves.
    """
    alike: dict[Any, list[int]] = defaultdict(list)
    for number, drive in drives.items():
        if not drive.parts.memory and not any(effect.has_state for effect in drive.active):
            alike[_key(drive)].append(number)
    found = []
    for numbers in alike.values():
        periods = len(numbers) * drives[numbers[0]].total
        if not always and (periods < WORTH or len(numbers) < LANES):
            continue
        for k in range(0, len(numbers), LANES):
            part = tuple(numbers[k : k + LANES])
            if always or len(part) >= FEWEST:
                found.append(Group(part, tuple(drives[number] for number in part)))
    return found


def _key(drive: Prepared) -> tuple[Any, ...]:
    plant = drive.plant
    timing = plant.period, plant.steps, plant.speed_divider, plant.log_divider, plant.delay
    compensated = drive.feedforward.effects if drive.feedforward else ()
    return drive.active, compensated, timing, plant.counts, drive.total


def load_lanes(group: Group) -> ModuleType:
    """Return the module whose `run` takes this group."""
    first = group.drives[0]
    columns = FIRST + (first.feedforward.values.size if first.feedforward else 0)
    return _load(first.active, first.feedforward.effects if first.feedforward else (), len(first.effects), columns)


@lru_cache(maxsize=64)
def _load(active: tuple[Effect, ...], compensated: tuple[Effect, ...], parameters: int, columns: int) -> ModuleType:
    def rows(first: str, count: int) -> list[str]:
        return [f"return ({', '.join(f'x[{first} + {k} * LANES + l]' for k in range(count))},)"]

    drive, _, _ = source(active, compensated).partition("@kernel\ndef run(")
    lines = {
        "drive": drive.splitlines(),
        "rows": [f"EFFECTS = INPUTS + {columns} * LANES"],
        "reference": rows("INPUTS", columns),
        "effects": rows("EFFECTS", parameters),
    }
    if any(effect.dry for effect in active):
        lines["direction"] = ["direction = direction_of(y, t, held, machine, effects)"]
    if "sensed" in lines_of(active):
        lines["measure"] = ["theta_m, i_d_m, i_q_m = measure(y, p, counts, effects_of(x, l))"]
    text = _TEMPLATE.read_text(encoding="utf-8")
    for name, new in lines.items():

        def indented(mark: re.Match[str], new: list[str] = new) -> str:
            return "\n".join(mark.group(1) + line for line in new)

        text = re.sub(rf"^( *)\S.*# <{name}>$", indented, text, flags=re.MULTILINE)
    return module_of(text, active, compensated)


def simulate_group(group: Group, seed: int, keep_truth: bool) -> list[Log] | None:
    """Simulate a group; drive `number` has the seed ``seed + number``.

    Returns
    -------
    list of Log or None
        The logs in order; None when a state stopped being finite: single runs find the drive.
    """
    from pmsm_ctrl.kernels.noise import draw

    module = load_lanes(group)
    plant = group.drives[0].plant
    total, divider = group.drives[0].total, plant.speed_divider
    timing = np.array([plant.period, plant.counts, plant.steps, divider, plant.log_divider, plant.delay])
    x = _rows(group, module)
    noisy = any(drive.plant.current_noise > 0.0 for drive in group.drives)
    generators = [np.random.default_rng(seed + number) for number in group.numbers] if noisy else []
    noise = np.zeros((CHUNK if noisy else 1, 2, LANES))
    out = np.empty((-(-total // plant.log_divider), LANES, len(LOGGED)))
    row = 0
    for k in range(0, total, CHUNK):
        n = min(CHUNK, total - k)
        if k % BLOCK == 0:
            inputs = _references(group, k, min(BLOCK, total - k))
            first = k // divider
        for lane, generator in enumerate(generators):
            draw(noise[:n], lane, generator)
        wrote = module.run(n, k, x, timing, inputs[k // divider - first :], noise, out[row:])
        if wrote < 0:
            return None
        row += wrote
    found = zip(group.numbers, group.drives, out[:row].swapaxes(0, 1), strict=False)  # without the empty lanes
    return [drive.log(table, seed + number, keep_truth) for number, drive, table in found]


def _rows(group: Group, module: ModuleType) -> Array:
    """Return the kernel's initial rows, flat; an empty lane repeats the last drive."""
    x = np.zeros((module.EFFECTS // LANES + len(group.drives[0].effects), LANES))
    for lane in range(LANES):
        drive = group.drives[min(lane, len(group.drives) - 1)]
        x[:BARE_STATES, lane] = drive.states()[:BARE_STATES]
        x[module.MACHINE // LANES : module.GAINS // LANES, lane] = drive.plant.array()[:10]
        gains = drive.controller.array()
        x[module.GAINS // LANES : module.GAINS // LANES + gains.size, lane] = gains
        x[module.EFFECTS // LANES :, lane] = drive.effects
    return x.reshape(-1)


def _references(group: Group, k: int, n: int) -> Array:
    """Return the references of `n` control periods from `k`, shape (ticks, columns, LANES), or 1 if all share them."""
    plant = group.drives[0].plant
    ticks = np.arange(k // plant.speed_divider, -(-(k + n) // plant.speed_divider))
    t = ticks * (plant.period * plant.speed_divider)
    known: dict[int, Array] = {}
    columns: list[Array] = []
    for drive in group.drives:
        key = id(drive.motion)
        if key not in known:
            known[key] = drive.motion.inputs(t)
        columns.append(drive.feedforward.widen(known[key]) if drive.feedforward else known[key])
    if len(known) == 1 and group.drives[0].feedforward is None:
        return columns[0][:, :, np.newaxis]
    inputs = np.empty((ticks.size, columns[0].shape[1], LANES))
    for lane in range(LANES):
        inputs[:, :, lane] = columns[min(lane, len(columns) - 1)]
    return inputs

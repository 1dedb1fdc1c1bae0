"""A simulated fleet: logs with known causes, for the tutorial, the tests and the benchmark."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from pmsm_ctrl.design import Design
from pmsm_ctrl.files import write_text

__all__ = ["Axis", "axes_of", "simulated_fleet"]

FIRST = datetime(2026, 3, 1, 22, 0, tzinfo=UTC)
SPREAD, DAILY = 0.05, 0.02  # relative standard deviation of F_c and F_v between axes, and from day to day
# What appears on an axis, with parameters that one log of 30 s shows.
EFFECTS: tuple[tuple[str, dict[str, float]], ...] = (
    ("unbalance", {"a_s": 5e-3, "a_c": 3e-3}),
    ("viscous_asymmetry", {"dF_v": 5e-5}),
)
DRIFT = 0.02  # a day, relative, of a drifting axis's F_c
MANIFEST = """logs = "logs/*/*.csv"
path = "{axis}/{time:%Y-%m-%d}.csv"
design = "design.toml"

[limits]
F_c = 0.03  # N m
"""


@dataclass(frozen=True)
class Axis:
    """What is true of a simulated axis.

    Attributes
    ----------
    name : str
    F_c, F_v : float
        On the first day, N m and N m s/rad.
    effect : str
        What appears; empty on most axes.
    parameters : dict of str to float
    since : int
        Number of the first record with the effect.
    drift : float
        Growth of F_c from record to record, relative.
    """

    name: str
    F_c: float
    F_v: float
    effect: str = ""
    parameters: dict[str, float] | None = None
    since: int = 0
    drift: float = 0.0


def axes_of(design: Design, axes: int, records: int, seed: int, effects: int, drifting: int) -> tuple[Axis, ...]:
    """Draw a fleet: the first axes get an effect in the middle third of the records, the next ones drift.

    Parameters
    ----------
    design : Design
    axes, records, seed, effects, drifting : int
        Of which so many have an effect, and so many drift.

    Returns
    -------
    tuple of Axis
    """
    rng = np.random.default_rng(seed)
    nominal = {name: value for one in design.effects for name, value in one.parameters.items()}
    drawn = []
    for k in range(axes):
        F_c, F_v = (nominal[name] * (1.0 + SPREAD * rng.standard_normal()) for name in ("F_c", "F_v"))
        one = Axis(f"axis{k + 1:02d}", F_c, F_v)
        since = int(rng.integers(max(1, records // 3), max(2, (2 * records) // 3 + 1)))
        if k < effects:
            name, values = EFFECTS[k % len(EFFECTS)]
            one = replace(one, effect=name, parameters=values, since=since)
        elif k < effects + drifting:
            one = replace(one, drift=DRIFT)
        drawn.append(one)
    return tuple(drawn)


def simulated_fleet(
    folder: str | os.PathLike[str], design: Design, *, axes: int = 6, records: int = 4, effects: int = 2,
    drifting: int = 1, broken: int = 2, seed: int = 1, duration: float = 30.0,
) -> tuple[Axis, ...]:  # fmt: skip
    """Write the logs of a simulated fleet with its manifest, and return what is true of its axes.

    Parameters
    ----------
    folder : path
        Gets ``logs/AXIS/DATE.csv``, ``design.toml``, ``run.toml`` and ``truth.json``.
    design : Design
    axes, records : int
        A record a day.
    effects, drifting, broken : int
        Axes with an effect that appears, axes that drift, and files that cannot be read.
    seed : int
    duration : float
        Of a log, s.

    Returns
    -------
    tuple of Axis
    """
    drawn, root = axes_of(design, axes, records, seed, effects, drifting), Path(folder)
    for one in drawn:
        (root / "logs" / one.name).mkdir(parents=True, exist_ok=True)
    for k, one in enumerate(drawn):
        for day, path in _paths(root, one, records):
            _write(path, design, one, day, seed * 1_000_000 + k * 1000 + day, duration)
    spoil(sorted((root / "logs").rglob("*.csv")), broken, seed)
    design.write(root / "design.toml")
    write_text(root / "run.toml", MANIFEST)
    write_text(root / "truth.json", json.dumps([vars(one) for one in drawn], indent=1))
    return drawn


def _paths(root: Path, axis: Axis, records: int) -> Iterator[tuple[int, Path]]:
    for day in range(records):
        yield day, root / "logs" / axis.name / f"{FIRST + timedelta(days=day):%Y-%m-%d}.csv"


def _write(path: Path, design: Design, axis: Axis, day: int, seed: int, duration: float) -> None:
    from pmsm_ctrl.simulate import scenario, simulate

    rng = np.random.default_rng(seed)
    daily = 1.0 + DAILY * rng.standard_normal(2)
    values = {"F_c": axis.F_c * daily[0] * (1.0 + axis.drift * day), "F_v": axis.F_v * daily[1]}
    plant = design.replace_effects(
        tuple(
            entry.model_copy(update={"parameters": {name: values.get(name, x) for name, x in entry.parameters.items()}})
            for entry in design.effects
        )
    )
    if axis.effect and day >= axis.since:
        plant = plant.with_effect(axis.effect, axis.parameters)
    motion = scenario("identification", design)
    log = simulate(design, motion, truth=plant, seed=seed)
    log.between(0.0, duration).write_csv(path)


def spoil(paths: list[Path], count: int, seed: int) -> list[Path]:
    """Break files: one empty, one cut within its header, one without current, one whose numbers are words, and so on.

    Parameters
    ----------
    paths : list of Path
    count, seed : int

    Returns
    -------
    list of Path
        Those that were broken.
    """
    rng = np.random.default_rng(seed + 7)
    chosen = [paths[k] for k in rng.choice(len(paths), size=min(count, len(paths)), replace=False)]
    for k, path in enumerate(chosen):
        text = path.read_text(encoding="utf-8")
        head, _, rest = text.partition("\n")
        match k % 4:
            case 0:
                path.write_text("", encoding="utf-8")
            case 1:
                path.write_text(head[: len(head) // 2], encoding="utf-8")
            case 2:
                path.write_text(f"{head}\n{rest[:200].replace('.', 'x')}\n", encoding="utf-8")
            case 3:
                path.write_bytes(bytes(rng.integers(0, 256, 2000, dtype=np.uint8)))
    return chosen

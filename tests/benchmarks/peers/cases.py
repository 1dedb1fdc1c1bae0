"""One log, all methods: drives drawn at random, and EMPS."""

from __future__ import annotations

import math
import os
import time
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose import diagnose
from pmsm_ctrl.diagnose.fit import predicted_elsewhere
from pmsm_ctrl.errors import PmsmCtrlError
from pmsm_ctrl.importers import read_log
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.balances import Record, make_record
from tests.benchmarks.peers.library import Library, base_torque, generic, held_out, library_of, read_alike, relative
from tests.benchmarks.peers.methods import PEERS, VARIANTS
from tests.benchmarks.worlds.hidden import hidden_log, possible, simulate_world
from tests.benchmarks.worlds.world import World, draw

__all__ = ["MUJOCO", "OURS", "Case", "emps_rows", "make", "rows_of"]

OURS = "pmsm_ctrl.diagnose"
MUJOCO = "mujoco sysid"  # names nothing: on EMPS alone, for its parameters
ANOTHER = 10_000_000  # added to a seed for the held-out record
MARGINS = (1.0, 15.0)


@dataclass(frozen=True, eq=False)
class Case:
    """A log, and another one of the same axis."""

    design: Design
    log: Log
    held: Log
    hidden: str | None = None
    margin: float = 0.0


def make(seed: int, hide: bool) -> Case | None:
    """Return a world's log, clean or with one effect hidden; None where the world cannot have it."""
    world = replace(draw(seed), voltages=False)
    other = replace(world, seed=seed + ANOTHER)
    try:
        if not hide:
            return Case(world.design, simulate_world(world), simulate_world(other))
        return _hidden(world, other)
    except ArithmeticError:
        return None


def _hidden(world: World, other: World) -> Case | None:
    offered = possible(world)
    effect = offered[world.seed % len(offered)]
    rng = np.random.default_rng([world.seed, 37])
    made = hidden_log(world, effect, float(np.exp(rng.uniform(*np.log(MARGINS)))))
    if made is None:
        return None
    log, margin, values = made
    return Case(world.design, log, simulate_world(other, values), effect, margin)


def rows_of(seed: int, hide: bool, methods: Sequence[str]) -> list[dict[str, Any]]:
    """Return one row per method; none where the world cannot have the effect drawn for it."""
    case = make(seed, hide)
    if case is None:
        return []
    head = {"case": "world", "seed": seed, "hidden": case.hidden, "margin": case.margin}
    return [head | row for row in judged(case, methods)]


def judged(case: Case, methods: Sequence[str]) -> list[dict[str, Any]]:
    """Return what each method names in a log, whether that is right, and its error on the other one."""
    out = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        shared: Library | None = None
        other: Record | None = None
        seconds, failed = 0.0, ""
        if set(methods) - {OURS}:
            began = time.perf_counter()
            try:
                shared = library_of(case.design, case.log)
            except Exception as error:  # whatever it is, it is a row of the table
                failed = f"{type(error).__name__}: {error}"
            seconds = time.perf_counter() - began
            other = _elsewhere(case, shared.record) if shared is not None else None
        for name in methods:
            began = time.perf_counter()
            try:
                if name == OURS:
                    row = _ours(case)
                elif shared is None:
                    raise RuntimeError(failed)
                else:
                    row = _peer(shared, other, name)
            except ImportError as error:
                raise SystemExit(f"{name}: {error}; pip install -e '.[peers]'") from error
            except Exception as error:
                row = {"named": [], "equivalents": [], "why": f"{type(error).__name__}: {error}", "took": 0.0}
            took = row.pop("took", time.perf_counter() - began)
            out.append({"method": name, "seconds": took + (0.0 if name == OURS else seconds)} | row)
    return out


def _ours(case: Case) -> dict[str, Any]:
    began = time.perf_counter()
    found = diagnose(case.design, case.log, plan=False)
    took = time.perf_counter() - began
    fit = found.selection.fit
    own = fit.record.target[0] - fit.residual[0]
    left = None
    if (other := _elsewhere(case, fit.record)) is not None:
        there = predicted_elsewhere(case.design, other, fit.accepted, fit)
        left = relative(there.record, there.predicted[0])
    return {
        "named": [step.effect for step in found.steps], "equivalents": [list(step.equivalents) for step in found.steps],
        "verdict": str(found.verdict), "flagged": [d.parameter for d in found.parameter_deviations if d.flagged],
        "error": relative(fit.record, own), "held_out": left, "took": took,
    }  # fmt: skip


def _peer(library: Library, other: Record | None, name: str) -> dict[str, Any]:
    select, without_physics = (PEERS | VARIANTS)[name]
    began = time.perf_counter()
    used = generic(library) if without_physics else library
    named = select(used)
    row: dict[str, Any] = {"named": named, "equivalents": [[] for _ in named], "took": time.perf_counter() - began}
    if not without_physics:
        row["error"] = held_out(library, library.record, named)
        row["held_out"] = held_out(library, other, named) if other is not None else None
    return row


def _elsewhere(case: Case, record: Record) -> Record | None:
    """Return the held-out record; None where it cannot be evaluated."""
    try:
        return read_alike(case.design, case.held, record)
    except PmsmCtrlError:
        return None


def emps_rows(methods: Sequence[str]) -> list[dict[str, Any]]:
    """Return one row per method for the measured axis EMPS; none, loudly, where its files are absent."""
    named = os.environ.get("PMSM_CTRL_DATA")
    root = Path(__file__).resolve().parents[3]
    folder = (Path(named) if named else root.parent / "shared" / "data") / "emps"
    files = folder / "DATA_EMPS.mat", folder / "DATA_EMPS_PULSES.mat"
    if not all(path.is_file() for path in files):
        print(f"MEASURED DATA ABSENT: {files[0]} (set PMSM_CTRL_DATA to the folder that holds emps/)")
        return []
    design = Design.read(root / "designs" / "emps.toml")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        log, held = (read_log(path, design) for path in files)
    case = Case(design, log, held)
    head = {"case": "emps", "seed": 0, "hidden": None, "margin": math.nan}
    rows = judged(case, [m for m in methods if m != MUJOCO]) + ([_mujoco(case)] if MUJOCO in methods else [])
    return [head | row for row in rows]


def _mujoco(case: Case) -> dict[str, Any]:
    """Return the errors with the four parameters that mujoco's sysid finds, and these."""
    from tests.benchmarks.peers.mujoco_sysid import fitted

    record = make_record(case.design, case.log)
    other = read_alike(case.design, case.held, record)
    began = time.perf_counter()
    try:
        values = fitted(case.log, record)
    except ImportError as error:
        raise SystemExit(f"{MUJOCO}: {error}; pip install -e '.[peers]'") from error
    return {
        "method": MUJOCO, "seconds": time.perf_counter() - began, "named": [], "equivalents": [], "parameters": values,
        "error": relative(record, base_torque(case.design, record, values)),
        "held_out": relative(other, base_torque(case.design, other, values)),
    }  # fmt: skip

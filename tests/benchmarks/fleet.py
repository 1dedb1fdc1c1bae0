"""A fleet with known causes: what is found, what it costs. `python -m tests.benchmarks.fleet --help`.

The size that was asked for is ``--axes 40 --logs 2000 --effects 8 --drifting 5 --broken 20``; the default is a
fifth of the axes and 64 logs, some minutes.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from datetime import timedelta
from pathlib import Path

from pmsm_ctrl import Design, fleet
from pmsm_ctrl.fleet import Engine, FleetReport, FleetResult, Manifest, Store, fleet_report, read_manifest
from pmsm_ctrl.fleet.example import FIRST, Axis, simulated_fleet

ROOT = Path(__file__).resolve().parents[2]
YEAR = 10_000 * 365  # logs of 10,000 axes in a year


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.fleet", description=__doc__)
    parser.add_argument("--axes", type=int, default=8)
    parser.add_argument("--logs", type=int, default=64, help="of all axes together")
    parser.add_argument("--effects", type=int, default=2, help="axes on which an effect appears")
    parser.add_argument("--drifting", type=int, default=1)
    parser.add_argument("--broken", type=int, default=2, help="files that cannot be read")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--folder", type=Path, help="keeps logs and results; simulated logs that are there are used")
    parser.add_argument(
        "--workers", type=int, default=2, help="of the run whose speed is compared with one worker; 0: none"
    )
    given = parser.parse_args(arguments)
    folder = given.folder or Path(tempfile.mkdtemp(prefix="fleet"))
    records = max(1, given.logs // given.axes)
    truth = known_truth(folder)
    if truth:
        print(f"{len(truth)} axes, simulated before; their number, logs and seed are those of {folder}")
    else:
        start = time.perf_counter()
        design = Design.read(ROOT / "designs" / "seed_motor.toml")
        truth = simulated_fleet(
            folder, design, axes=given.axes, records=records, effects=given.effects, drifting=given.drifting,
            broken=given.broken, seed=given.seed,
        )  # fmt: skip
        print(f"{given.axes} axes, {records} logs each, simulated in {time.perf_counter() - start:.0f} s: {folder}")
    manifest = read_manifest(folder / "run.toml")
    plain = timed("one process", manifest, folder / "plain", 1)
    if given.workers:
        spread = timed(f"{given.workers} workers", manifest, folder / "workers", given.workers)
        if plain.evaluated == spread.evaluated > 0:
            print(f"  {plain.seconds / spread.seconds:.2f} times as fast on the clock, with {os.cpu_count()} cores")
        print(f"  same rows: {numbers(folder / 'plain') == numbers(folder / 'workers')}")
    again = fleet(replace(manifest, results=str(folder / "plain")), engine=Engine(jobs=1))
    print(f"a run with nothing new: {again.seconds:.2f} s for {again.logs} logs, {again.evaluated} evaluated")
    size = sum(path.stat().st_size for path in (folder / "plain" / "rows").iterdir())
    print(f"results: {size / plain.logs / 1e3:.2f} kB a log")
    print_answers(fleet_report(folder / "plain"), truth)
    each = evaluation_time(folder / "plain") / plain.logs
    print(f"on paper, a year of 10,000 axes, a log a day: {YEAR * each / 86400 / 365:.2f} cores all year, "
          f"{YEAR * size / plain.logs / 1e9:.1f} GB of results")  # fmt: skip


def known_truth(folder: Path) -> tuple[Axis, ...]:
    """Return what is true of the logs of an earlier run; nothing where there are none, or not all of them."""
    path = folder / "truth.json"  # written last
    return tuple(Axis(**one) for one in json.loads(path.read_text(encoding="utf-8"))) if path.exists() else ()


def evaluation_time(results: Path) -> float:
    """Return the processor time of all logs in the table, those of earlier runs included, s."""
    return sum(row.value or 0.0 for row in Store(results).read(("quantity",)) if row.name == "processor_time")


def timed(name: str, manifest: Manifest, results: Path, jobs: int) -> FleetResult:
    """Run a fleet and print logs a minute, the processor time beside the evaluation, and the memory."""
    before = processor_time()
    run = fleet(replace(manifest, results=str(results)), engine=Engine(jobs=jobs))
    if not run.evaluated:
        print(f"{name}: all {run.logs} logs were evaluated before; another --folder measures their cost again")
        return run
    beside = processor_time() - before - run.processor_seconds  # start, compiling, engine, writing
    own, children = (
        resource.getrusage(who).ru_maxrss / 1e3 for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    )
    each, rate = run.processor_seconds / run.evaluated, run.evaluated / max(run.processor_seconds, 1e-9)
    print(
        f"{name}: {run.evaluated} logs in {run.seconds:.0f} s at load {os.getloadavg()[0]:.1f}; "
        f"{each:.2f} s of a processor a log, {60 * rate:.0f} logs a minute and core; {beside:.1f} s of a processor "
        f"beside it ({beside / max(run.processor_seconds, 1e-9):.0%}); most memory {own:.0f} MB here, "
        f"{children:.0f} MB in a worker"
    )
    return run


def processor_time() -> float:
    """Return the processor time of this process and of those that it has ended, s."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in used)


def numbers(results: Path) -> dict[tuple[str, int], tuple[object, ...]]:
    """Return the rows but for what they cost."""
    return {
        (row.record, row.row): (row.source, row.kind, row.name, row.value, row.stderr, row.p_value, row.text)
        for row in Store(results).read() if row.name not in ("processor_time", "memory")
    }  # fmt: skip


def print_answers(report: FleetReport, truth: Sequence[Axis]) -> None:
    """Print what was found, missed and false, by axis, and by how many records the day of the change is off."""
    by_name = {one.name: one for one in report.axes}
    found = missed = false = 0
    late: list[int] = []
    for axis in truth:
        answer = by_name[axis.name]
        named = {word: one for one in answer.findings for word in (one.effect, *one.equivalents)}
        if axis.effect and axis.effect in named:
            found += 1
            appeared = (FIRST + timedelta(days=axis.since)).date()
            late.append((named[axis.effect].since.date() - appeared).days)
        missed += bool(axis.effect) and axis.effect not in named
        false += sum(axis.effect not in (one.effect, *one.equivalents) for one in answer.findings)
        if axis.effect or answer.missing:
            said = ", ".join(f"{one.effect} since {one.since:%m-%d}, {one.records}/{one.of}" for one in answer.findings)
            print(
                f"  {axis.name}: true {axis.effect or 'nothing'} since record {axis.since}; named {said or 'nothing'}"
            )
    total = max(1, found + false)
    print(f"effects: {found} found, {missed} missed, {false} false: {false / total:.0%} of the discoveries; "
          f"day of appearance off by {late} records")  # fmt: skip
    changing = {one.axis for one in report.changes if one.parameter in ("F_c", "F_v") and one.trend is not None}
    drifting = {axis.name for axis in truth if axis.drift}
    quiet = {axis.name for axis in truth if not axis.drift and not axis.effect}
    stepping = {one.axis for one in report.changes if one.parameter in ("F_c", "F_v") and one.step is not None}
    disturbed = quiet & (changing | stepping)
    seen = drifting & (changing | stepping)
    other = [one for one in report.changes if one.axis not in drifting and not one.beside]
    print(f"changes: {len(report.changes)} named, {len(other)} of them on axes that do not drift")
    print(f"drifts: {len(seen)} of {len(drifting)} found, {len(drifting & changing)} as a trend; "
          f"{len(disturbed)} of {len(quiet)} quiet axes said to change")  # fmt: skip
    reasons = sorted({one.reason.partition(": ")[2][:50] for one in report.worthless})
    print(f"logs without an answer: {len(report.worthless)}: {reasons}")


if __name__ == "__main__":
    main()

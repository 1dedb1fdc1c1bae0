"""What the engine of a fleet costs, and how it scales. `python -m tests.benchmarks.fleet_engine --help`.

In each round, one after another: one plain loop over all logs, two plain loops over half of the logs each at the same
time, and two workers over all of them. Two loops at the same time are what the machine can do: they share its memory
and its caches as two workers do. All are whole commands in processes of their own; the kernels come from the cache.
"""

from __future__ import annotations

import argparse
import csv
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from statistics import median
from typing import NamedTuple

from pmsm_ctrl import Design
from pmsm_ctrl.fleet.example import simulated_fleet

ROOT = Path(__file__).resolve().parents[2]


class Cost(NamedTuple):
    """Time on the clock and of processors, s."""

    clock: float
    processor: float


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the ratios of each round, and their medians."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.fleet_engine", description=__doc__)
    parser.add_argument("--logs", type=int, default=24)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--duration", type=float, default=30.0, help="of a log, s")
    given = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory(prefix="fleet") as name:
        folder = Path(name)
        design = Design.read(ROOT / "designs" / "seed_motor.toml")
        simulated_fleet(folder, design, axes=4, records=given.logs // 4, broken=0, duration=given.duration)
        logs = sorted((folder / "logs").rglob("*.csv"))
        tables = [table(folder, part, k) for k, part in enumerate((logs, logs[::2], logs[1::2]))]
        run(folder, tables[:1], 1, "first")  # kernels are compiled
        rounds = []
        for number in range(given.rounds):
            one = run(folder, tables[:1], 1, f"one{number}")
            both = run(folder, tables[1:], 1, f"both{number}")
            workers = run(folder, tables[:1], 2, f"workers{number}")
            rounds.append((one, both, workers))
            print(
                f"round {number + 1}, load {os.getloadavg()[0]:.1f}: {said(one, both, workers, len(logs))}", flush=True
            )
    best = [Cost(min(row[k].clock for row in rounds), median(row[k].processor for row in rounds)) for k in range(3)]
    print(f"least time, median processor: {said(*best, len(logs))}")


def said(one: Cost, both: Cost, workers: Cost, logs: int) -> str:
    """Return the ratios of a round."""
    return (
        f"{one.processor / logs:.2f} s of a processor a log; two loops at once {one.clock / both.clock:.2f} times as "
        f"fast with {both.processor / one.processor - 1.0:+.1%} processor time; two workers "
        f"{one.clock / workers.clock:.2f} times as fast, {workers.processor / one.processor - 1.0:+.1%} processor time "
        f"against one loop, {workers.processor / both.processor - 1.0:+.1%} against two"
    )


def table(folder: Path, logs: Sequence[Path], number: int) -> Path:
    """Write the manifest of some logs."""
    with open(folder / f"list{number}.csv", "w", encoding="utf-8", newline="") as stream:
        rows = csv.writer(stream)
        rows.writerow(("file", "axis"))
        rows.writerows((path.relative_to(folder), path.parent.name) for path in logs)
    path = folder / f"run{number}.toml"
    path.write_text(f'table = "list{number}.csv"\ndesign = "design.toml"\n', encoding="utf-8")
    return path


def run(folder: Path, manifests: Sequence[Path], jobs: int, name: str) -> Cost:
    """Run one command a manifest, all at the same time, and return what they cost with all their processes."""
    start, spent = time.perf_counter(), used()
    running = [
        subprocess.Popen(
            [sys.executable, "-m", "pmsm_ctrl", "fleet", str(path), "-j", str(jobs), "-o", str(folder / f"{name}-{k}")],
            cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )
        for k, path in enumerate(manifests)
    ]  # fmt: skip
    ended = [one.wait() for one in running]
    assert not any(ended), ended
    return Cost(time.perf_counter() - start, used() - spent)


def used() -> float:
    """Return the processor time of all processes that were started here and have ended, s."""
    found = os.times()
    return found.children_user + found.children_system


if __name__ == "__main__":
    main()

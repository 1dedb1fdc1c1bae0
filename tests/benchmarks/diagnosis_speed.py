r"""Time and memory of the diagnosis against another tree of the package, measured side by side.

    python -m tests.benchmarks.diagnosis_speed --against ../other-tree

Both trees diagnose the same simulated logs in processes of their own, alternating: 30 s at 1 kHz with one and with two
hidden effects, with and without the search for the next experiment, and 10 min at 4 kHz. Time is that of one call in
a process that has diagnosed before, and of the first one; memory is what a call adds to the process at its peak, and
the process' whole peak.
"""

from __future__ import annotations

import argparse
import json
import os
import pickle
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve()
CASES = ("one", "two", "one_planned", "two_planned", "long")
HIDDEN = {"one": ("stribeck",), "two": ("stribeck", "unbalance"), "long": ("stribeck",)}

# Runs in the tree that is measured: uses nothing that both trees do not have.
WORKER = """
import json, pickle, resource, sys, threading, time
import pmsm_ctrl
from pmsm_ctrl.design import Design
from pmsm_ctrl.log import Log
from pmsm_ctrl.diagnose import diagnose

design_file, log_file, plan, repeats = sys.argv[1], sys.argv[2], sys.argv[3] == "True", int(sys.argv[4])
design = Design.read(design_file)
with open(log_file, "rb") as stream:
    log = Log(pickle.load(stream))

def resident():
    with open("/proc/self/statm") as stream:
        return int(stream.read().split()[1]) * resource.getpagesize()

start = time.perf_counter()
diagnose(design, log.between(0.0, 8.0), plan=plan)  # imports, compiled code and caches are there
first = time.perf_counter() - start
times, before = [], resident()
for _ in range(repeats):
    start = time.process_time()
    found = diagnose(design, log, plan=plan)
    times.append(time.process_time() - start)
peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
print(json.dumps({
    "time": min(times), "first": first, "added": peak - before, "peak": peak, "verdict": found.verdict,
    "steps": [[s.effect, {n: e.value for n, e in s.parameters.items()}, s.evidence["p_value"]] for s in found.steps],
}))
"""


def main() -> None:
    """Measure both trees and print the ratios."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--against", type=Path, required=True, help="root of the other tree")
    parser.add_argument("--cases", nargs="+", default=list(CASES), choices=CASES)
    parser.add_argument("--rounds", type=int, default=3, help="alternations")
    parser.add_argument("--repeats", type=int, default=3, help="calls a process; the fastest counts")
    args = parser.parse_args()
    trees = {"this": HERE.parents[2], "other": args.against.resolve()}
    print(f"{'case':12} {'time, s':>16} {'ratio':>6} {'added, MiB':>16} {'ratio':>6} {'peak, MiB':>14} {'ratio':>6}")
    with tempfile.TemporaryDirectory() as folder:
        for case in args.cases:
            design, log = _made(case, Path(folder))
            found: dict[str, list[dict[str, Any]]] = {name: [] for name in trees}
            for _ in range(args.rounds):
                for name, tree in trees.items():
                    found[name].append(_measured(tree, design, log, case.endswith("planned"), args.repeats))
            print(_row(case, found), flush=True)


def _made(case: str, folder: Path) -> tuple[Path, Path]:
    """Simulate the log of a case; return the files of its design and of the log."""
    from pmsm_ctrl.design import Design
    from pmsm_ctrl.simulate import simulate
    from pmsm_ctrl.simulate.scenarios import scenario
    from tests.benchmarks.blind import DESIGN, Case, motion, truth_of

    kind = case.removesuffix("_planned")
    base = Design.read(DESIGN)
    design, truth = truth_of(base, Case(HIDDEN[kind], 1.0, "identification", 7))
    if kind == "long":
        design, truth = (d.replace(sensor={"log_divider": 4}) for d in (design, truth))
        log = simulate(design, scenario("identification", design, seed=109, duration=600.0), truth=truth, seed=9)
    else:
        log = simulate(design, motion("identification", design, 7), truth=truth, seed=7)
    files = folder / f"{kind}.toml", folder / f"{kind}.pickle"
    design.write(files[0])
    with files[1].open("wb") as stream:
        pickle.dump(dict(log.channels), stream)
    return files


def _measured(tree: Path, design: Path, log: Path, plan: bool, repeats: int) -> dict[str, Any]:
    """Diagnose in a process that imports the package from a tree."""
    environment = {**os.environ, "PYTHONPATH": str(tree), "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, "-c", WORKER, str(design), str(log), str(plan), str(repeats)]
    done = subprocess.run(command, env=environment, cwd=design.parent, capture_output=True, text=True, check=True)
    return dict(json.loads(done.stdout.splitlines()[-1]))


def _row(case: str, found: dict[str, list[dict[str, Any]]]) -> str:
    """One line of the table: this tree, the other one, and how many times less this one needs."""
    median = {
        name: {key: statistics.median(run[key] for run in runs) for key in ("time", "added", "peak")}
        for name, runs in found.items()
    }
    ours, theirs = median["this"], median["other"]
    mib = 2.0**20
    answers = [(runs[0]["verdict"], [step[0] for step in runs[0]["steps"]]) for runs in found.values()]
    same = "same names" if answers[0] == answers[1] else f"DIFFER: {answers}"
    return (
        f"{case:12} {ours['time']:7.3f} {theirs['time']:8.3f} {theirs['time'] / ours['time']:6.2f} "
        f"{ours['added'] / mib:7.0f} {theirs['added'] / mib:8.0f} {theirs['added'] / ours['added']:6.2f} "
        f"{ours['peak'] / mib:6.0f} {theirs['peak'] / mib:7.0f} {theirs['peak'] / ours['peak']:6.2f}  {same}"
    )


if __name__ == "__main__":
    main()

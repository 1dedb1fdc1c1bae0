r"""Memory and time of `diagnose` or `compare` over the length of a log at 1 kHz.

    python -m tests.benchmarks.memory --minutes 10 20 60

Each run is a process of its own, which has evaluated eight seconds of the log before: the memory is the peak of the
whole process, the log and all libraries in it.
"""

from __future__ import annotations

import argparse
import multiprocessing
import resource
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pmsm_ctrl.compare import compare
from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose import diagnose
from pmsm_ctrl.log import Log
from pmsm_ctrl.simulate import simulate
from pmsm_ctrl.simulate.scenarios import scenario

DESIGN = Path(__file__).resolve().parents[2] / "designs" / "hand_tuned.toml"
VERBS: dict[str, Callable[..., Any]] = {"diagnose": diagnose, "compare": compare}


def made(minutes: float) -> Log:
    """Simulate a mixed motion of the reference drive with a Stribeck curve."""
    design = Design.read(DESIGN)
    truth = design.with_effect("stribeck", {"dF_s": 0.008, "w_s": 5.0, "delta": 2.0})
    return simulate(design, scenario("identification", design, seed=5, duration=60.0 * minutes), truth=truth, seed=5)


def evaluated(verb: str, minutes: float) -> tuple[float, float, str]:
    """Return peak memory, bytes, processor time, s, and what was named."""
    log, design = made(minutes), Design.read(DESIGN)
    run = VERBS[verb]
    run(design, log.between(0.0, 8.0))
    before = time.process_time()
    found = run(design, log)
    spent = time.process_time() - before
    names = ", ".join(step.name for step in found.steps) if verb == "diagnose" else "-"
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024.0, spent, names


def main() -> None:
    """Print a row for each verb and length."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", nargs="+", type=float, default=[10.0, 20.0, 60.0])
    parser.add_argument("--verbs", nargs="+", choices=list(VERBS), default=list(VERBS))
    args = parser.parse_args()
    print("| verb | minutes | peak, GB | processor time, s | named |\n|---|---|---|---|---|")
    for verb in args.verbs:
        for minutes in args.minutes:
            with multiprocessing.get_context("spawn").Pool(1) as pool:
                peak, spent, names = pool.apply(evaluated, (verb, minutes))
            print(f"| {verb} | {minutes:g} | {peak / 1e9:.2f} | {spent:.0f} | {names} |", flush=True)


if __name__ == "__main__":
    main()

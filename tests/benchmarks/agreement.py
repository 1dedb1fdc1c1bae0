"""Do `frf` and `diagnose` agree on a spring? ``python -m tests.benchmarks.agreement --count 10 --first 100``.

The motor of the reference paper with springs of several frequencies and dampings. One record with a multisine goes
through `frf`, another one without excitation through `diagnose`, with the response as its start: of the same axis, of
one whose spring is 5 % softer by then, and of a rigid one.
"""

from __future__ import annotations

import argparse
import math
from collections import Counter
from pathlib import Path

import numpy as np

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose import diagnose
from pmsm_ctrl.diagnose.result import Agreement
from pmsm_ctrl.frf import frf
from pmsm_ctrl.simulate import scenario, simulate

DESIGN = Path(__file__).resolve().parents[2] / "designs" / "seed_motor.toml"
LOAD = 4e-5  # kg m^2 of 9e-5
SPRINGS = ((25.0, 0.01), (44.0, 0.004), (44.0, 0.014), (44.0, 0.05), (60.0, 0.01), (97.0, 0.0065))  # Hz, damping ratio
SOFTER = 0.95
ANSWERS = {True: "agree", False: "differ", None: "not told"}


def spring(frequency: float, damping: float, factor: float = 1.0) -> dict[str, float]:
    """Return the parameters of a load with this antiresonance, Hz, its stiffness times a factor."""
    w = 2.0 * math.pi * frequency
    return {"J_load": LOAD, "k": factor * LOAD * w * w, "d": 2.0 * damping * LOAD * w}


def errors_of(found: Agreement, truth: dict[str, float]) -> dict[str, float]:
    """Return how far the diagnosis is from the truth, in its standard errors."""
    w = math.sqrt(truth["k"] / truth["J_load"])
    true = {
        "antiresonance": w / (2.0 * math.pi), "load_inertia": truth["J_load"],
        "damping_ratio": truth["d"] / (2.0 * w * truth["J_load"]),
    }  # fmt: skip
    return {name: (own.value - true[name]) / own.stderr for name, own in found.diagnosed.items()}


def table(frequency: float, damping: float, seeds: range, motion: str) -> str:
    """Return the rows of one spring."""
    design = Design.read(DESIGN)
    same, softer = spring(frequency, damping), spring(frequency, damping, SOFTER)
    axes = {
        "the same": design.with_effect("compliance", same), "5 % softer": design.with_effect("compliance", softer),
        "rigid": design,
    }  # fmt: skip
    answers: dict[str, Counter[str]] = {name: Counter() for name in axes}
    named: Counter[str] = Counter()
    away: dict[str, list[float]] = {}
    for seed in seeds:
        excited = simulate(design, scenario("multisine", design), truth=axes["the same"], seed=seed)
        told = frf(design, excited)
        for name, truth in axes.items():
            log = simulate(design, scenario(motion, design), truth=truth, seed=seed + 1_000_000)
            found = diagnose(design, log, start=told, plan=False).resonance
            if found is None:
                answers[name]["implausible"] += 1
                continue
            answers[name][ANSWERS[found.agrees]] += 1
            named[name] += bool(found.effect)
            if name == "the same":
                for quantity, error in errors_of(found, same).items():
                    away.setdefault(quantity, []).append(error)
    rows = []
    for name in axes:
        counted = ", ".join(f"{answer} {n}" for answer, n in answers[name].most_common())
        spread = "-"
        if name == "the same":
            spread = ", ".join(
                f"{quantity.replace('_', ' ')} {np.mean(all_of):+.1f} +- {np.std(all_of):.1f}"
                for quantity, all_of in away.items()
            )
        rows.append(
            f"| {frequency:g} Hz, {damping:g} | {name} | {named[name]} of {len(seeds)} | {counted} | {spread} |"
        )
    return "\n".join(rows)


def main() -> None:
    """Print the table."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--count", type=int, default=10)
    asked.add_argument("--first", type=int, default=100)
    asked.add_argument("--motion", default="identification")
    chosen = asked.parse_args()
    columns = ("antiresonance, damping ratio", "axis of the log", "spring named", "frf and diagnosis")
    print(f"| {' | '.join(columns)} | errors of the diagnosis, standard errors |")
    print("|---|---|---|---|---|")
    for frequency, damping in SPRINGS:
        seeds = range(chosen.first, chosen.first + chosen.count)
        print(table(frequency, damping, seeds, chosen.motion), flush=True)


if __name__ == "__main__":
    main()

r"""Several effects hidden at once in worlds drawn at random: which are named, and what else is.

    python -m tests.benchmarks.worlds.several --count 60 --first 12000000

A real axis has more than one effect that its design lacks. Every log draws a world, two to five effects that act in
different ways, and for each a margin of 3 and more, as it has when it is alone (`margin`). What one hides of another is
not allowed for: this is no target to be reached, but the state of such logs.
"""

from __future__ import annotations

import argparse
import json
import os
from collections import Counter, defaultdict
from pathlib import Path
from typing import Any

import numpy as np

from pmsm_ctrl.log import Log
from tests.benchmarks.worlds.hidden import EFFECTS, hidden_log, possible, simulate_with_truth
from tests.benchmarks.worlds.judge import SAME, interval
from tests.benchmarks.worlds.world import World, draw

MOST, WEAKEST, STRONGEST = 5, 3.0, 15.0  # effects of a log; their margins
Rng = np.random.Generator


def several(seed: int) -> tuple[World, Log, dict[str, float]] | None:
    """Draw a world with several effects; returns it, its log, and the margin of each effect; None where it fails."""
    world = draw(seed)
    rng = np.random.default_rng([seed, 41])
    offered = list(rng.permutation(possible(world)))
    wanted = int(rng.integers(2, MOST + 1))
    values: dict[str, float] = {}
    margins: dict[str, float] = {}
    while offered and len(margins) < wanted:
        effect = str(offered.pop())
        share = float(np.exp(rng.uniform(np.log(1.3 * WEAKEST), np.log(STRONGEST))))
        if values.keys() & EFFECTS[effect](world, np.random.default_rng(0)).keys():
            continue  # the plant has one place for both
        try:
            made = hidden_log(world, effect, share)
        except ArithmeticError:
            continue
        if made is not None and made[1] >= WEAKEST:
            margins[effect] = made[1]
            values |= made[2]
    if len(margins) < 2:
        return None
    try:
        return world, simulate_with_truth(world, values)[0], margins
    except ArithmeticError:
        return None


def matched(hidden: list[str], named: list[tuple[str, ...]]) -> tuple[list[str], list[str]]:
    """Return the hidden effects that a name stands for, each name for one, and the names that stand for none.

    A name stands for itself before it stands for another one. `named` holds each name with those that the answer
    declares equivalent.
    """
    left, told = list(hidden), dict.fromkeys(range(len(named)), False)
    for same in (lambda one, names: one == names[0], lambda one, names: bool({one, *SAME.get(one, ())} & set(names))):
        for number, names in enumerate(named):
            means = next((one for one in left if not told[number] and same(one, names)), None)
            if means is not None:
                told[number] = True
                left.remove(means)
    false = [names[0] for number, names in enumerate(named) if not told[number]]
    return [one for one in hidden if one not in left], false


def row_of(seed: int) -> dict[str, Any] | None:
    """Diagnose one world; None where it has no two effects."""
    import warnings

    from pmsm_ctrl.diagnose import diagnose
    from pmsm_ctrl.errors import PmsmCtrlError

    warnings.simplefilter("ignore")
    if (made := several(seed)) is None:
        return None
    world, log, margins = made
    row: dict[str, Any] = {"seed": seed, "hidden": margins, **world.properties}
    try:
        found = diagnose(world.design, log, plan=False)
    except PmsmCtrlError as error:
        return row | {"verdict": "refused", "named": [], "right": [], "false": [], "why": str(error)}
    right, false = matched(list(margins), [(s.effect, *s.equivalents) for s in found.steps])
    return row | {
        "verdict": str(found.verdict), "named": [s.effect for s in found.steps], "right": right, "false": false,
        "error": found.errors["final"]["torque"]["relative"],
        "floor": found.errors["noise_floor"]["torque"]["relative"],
    }  # fmt: skip


def report(rows: list[dict[str, Any]]) -> None:
    """Print the shares, by the number of effects and by effect."""
    for number in (*range(2, MOST + 1), None):
        part = [r for r in rows if number in (None, len(r["hidden"]))]
        if not part:
            continue
        effects = sum(len(r["hidden"]) for r in part)
        print(f"\n{'any number' if number is None else number} of effects, {len(part)} logs")
        print(f"  effects named: {interval(sum(len(r['right']) for r in part), effects)}")
        named = [r for r in part if r["named"]]
        print(
            f"  first name is one of them: {interval(sum(r['named'][0] not in r['false'] for r in named), len(named))}"
        )
        print(f"  logs with a false name: {interval(sum(bool(r['false']) for r in part), len(part))}")
        print(f"  `consistent`: {interval(sum(r['verdict'] == 'consistent' for r in part), len(part))}")
        print(f"  verdicts {dict(Counter(r['verdict'] for r in part).most_common())}")
    print("\n| effect | named |\n|---|---|")
    by_effect: dict[str, list[bool]] = defaultdict(list)
    for r in rows:
        for effect in r["hidden"]:
            by_effect[effect].append(effect in r["right"])
    for effect, hits in sorted(by_effect.items()):
        print(f"| {effect} | {sum(hits)}/{len(hits)} |")
    print(f"\nfalse names {dict(Counter(n for r in rows for n in r['false']).most_common())}")


def main() -> None:
    """Judge the diagnosis on worlds with several effects and print the shares."""
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    from rich.progress import track

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    parser.add_argument("--rows", type=Path, default=None, help="rows are added to this file")
    args = parser.parse_args()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    seeds = range(args.first, args.first + args.count)
    rows = []
    with ProcessPoolExecutor(args.jobs, mp_context=get_context("spawn")) as pool:
        for row in track(pool.map(row_of, seeds), description="worlds", total=len(seeds)):
            if row is not None:
                rows.append(row)
                if args.rows:
                    with args.rows.open("a", encoding="utf-8") as file:
                        file.write(json.dumps(row, default=str) + "\n")
    report(rows)
    print(f"{len(rows)} of {len(seeds)} worlds judged; the others cannot have two effects of that size")


if __name__ == "__main__":
    main()

"""The smallest strength of every effect that the diagnosis finds, beside what the noise allows anybody to find.

    python -m tests.benchmarks.limits [--motion identification] [--seeds 3] [--effects …]

The limit is that of the F-test with the true shape, order and noise known, at the significance that the diagnosis asks
for: the strength at which the effect, in standard errors by Cramer and Rao's bound, passes in half of all logs. What is
found is the smallest strength of a grid of factors of the square root of two, by bisection, at which at least two
thirds of the seeds name the effect or a declared equivalent first.
"""

from __future__ import annotations

import argparse
import os
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context

import numpy as np

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose import POLICY, diagnose
from pmsm_ctrl.diagnose.limits import detection_limits
from pmsm_ctrl.effects.catalogue import CATALOGUE
from pmsm_ctrl.errors import SimulationError
from pmsm_ctrl.regression.columns import effect_group
from tests.benchmarks.blind import DESIGN, MIDDLE, MOTIONS, Case, log_of, right, run, truth_of

FACTORS = 2.0 ** (np.arange(-10, 6) / 2.0)  # of the middle strength


def bound(case: Case) -> float:
    """Strength, in units of the middle one, at which the best possible test finds the effect in half of the logs."""
    effect = CATALOGUE[case.hidden[0]]
    if effect.id in ("backlash", "presliding"):
        return float("nan")  # its strength is not the size of a column
    design, truth = truth_of(Design.read(DESIGN), case)
    fit = diagnose(design, log_of(design, truth, case), candidates=()).selection.fits[0]
    values = MIDDLE[effect.id]
    group = effect_group(fit.record, effect, effect.structure.shape(effect, values))
    proportion = np.array([values[s] for s in group.symbols])
    return float(detection_limits(fit.solved, fit.whitener, group, POLICY.significance / len(CATALOGUE), proportion)[0])


def found(effect: str, motion: str, seeds: int, strength: float) -> bool:
    """Whether two thirds of the seeds name it first at this strength, or the drive cannot even run with it."""
    cases = [Case((effect,), strength, motion, 400 + seed) for seed in range(seeds)]
    try:
        return 3 * sum(right(case, run(case)) for case in cases) >= 2 * seeds
    except SimulationError:
        return True


def limits(effect: str, motion: str, seeds: int) -> tuple[str, float, float]:
    """Return the effect, the smallest strength that was found, and the bound."""
    low, high = -1, len(FACTORS)  # not found at `low`, found at `high`
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if found(effect, motion, seeds, FACTORS[middle]) else (middle, high)
    bounds = [bound(Case((effect,), 1.0, motion, 400 + seed)) for seed in range(seeds)]
    return effect, FACTORS[high] if high < len(FACTORS) else float("inf"), float(np.median(bounds))


def main() -> None:
    """Print the table, an effect a row."""
    from rich.progress import track

    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--motion", default="identification", choices=MOTIONS)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--effects", nargs="*", default=[e for e in MIDDLE if MIDDLE[e]])
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    args = parser.parse_args()
    print("| effect | found from | the noise allows | factor |\n|---|---|---|---|")
    work = partial(limits, motion=args.motion, seeds=args.seeds)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # threads that wait for each other cost every process half
    with ProcessPoolExecutor(args.jobs, mp_context=get_context("spawn")) as pool:
        for effect, smallest, allowed in track(pool.map(work, args.effects), "limits", len(args.effects)):
            least = f"{allowed:.2g}" if np.isfinite(allowed) else "-"
            factor = f"{smallest / allowed:.1f}" if np.isfinite(allowed) else "-"
            print(f"| {effect} | {smallest:.2g} | {least} | {factor} |", flush=True)


if __name__ == "__main__":
    main()

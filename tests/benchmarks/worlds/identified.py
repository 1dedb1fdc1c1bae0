r"""Errors of `identify` on clean worlds of the third simulator, in units of what it states.

python -m tests.benchmarks.worlds.identified --first 54100 --count 60
python -m tests.benchmarks.worlds.identified --first 54100 --count 60 --effective

With `--effective`: how often it says that the values are effective ones only, on clean worlds and on as many with a
hidden effect at margins from 1 to 15.
"""

from __future__ import annotations

import argparse
import warnings
from collections import Counter
from collections.abc import Iterator

import numpy as np

from pmsm_ctrl.errors import PmsmCtrlError
from pmsm_ctrl.identify import Processing, identify
from pmsm_ctrl.regression.drive_timing import SYNCHRONOUS
from tests.benchmarks.worlds.hidden import hidden_log, possible, simulate_world
from tests.benchmarks.worlds.judge import interval
from tests.benchmarks.worlds.world import draw


def rows(first: int, count: int, synchronous: bool) -> Iterator[tuple[str, float, float, bool]]:
    """Yield the name, the relative error, the error in standard errors, and whether the interval covers."""
    processing = Processing(sampling=SYNCHRONOUS) if synchronous else None
    for seed in range(first, first + count):
        world = draw(seed)
        try:
            found = identify(world.design, simulate_world(world), processing=processing)
        except (ArithmeticError, PmsmCtrlError):
            continue
        motor = world.motor
        K_t = motor[4] if world.linear else 1.5 * motor[3] * motor[4]
        # the evaluation believes the design's torque constant
        for name, value in zip(("J", "F_c", "F_v"), motor[5:8], strict=True):
            true, estimate = value * world.design.K_t_assumed / K_t, found.estimates.get(name)
            if estimate is None or not np.isfinite(estimate.stderr):
                continue
            low, high = found.intervals[name]
            off = estimate.value - true
            yield name, abs(off / true), off / estimate.stderr, low <= true <= high


def told(first: int, count: int) -> Iterator[tuple[str, float, float, bool]]:
    """Yield the hidden effect or "", its margin, the error left, and whether the values are called effective ones."""
    rng = np.random.default_rng([first, 37])
    for seed in range(first, first + count):
        for hidden in (False, True):
            world, effect, margin = draw(seed), "", 0.0
            try:
                if hidden:
                    offered = possible(world)
                    effect = offered[seed % len(offered)]
                    made = hidden_log(world, effect, float(np.exp(rng.uniform(0.0, np.log(15.0)))))
                    if made is None:
                        continue
                    log, margin = made[:2]
                else:
                    log = simulate_world(world)
                found = identify(world.design, log)
            except (ArithmeticError, PmsmCtrlError):
                continue
            yield effect, margin, found.relative_error, any(n.code == "effective_values" for n in found.notices)


def tell(first: int, count: int) -> None:
    """Print how often values are called effective ones."""
    found = list(told(first, count))
    groups = {"clean": [row for row in found if not row[0]]}
    groups |= {
        f"hidden, margin {low} to {high}": [row for row in found if row[0] and low <= row[1] < high]
        for low, high in ((1, 3), (3, 100))
    }
    for name, part in groups.items():
        print(f"{name}: effective values only on {interval(sum(row[3] for row in part), len(part))}")
    missed = Counter(row[0] for row in found if row[0] and row[1] >= 3 and not row[3])
    print(f"not said at margin 3 and more: {dict(missed)}")


def main() -> None:
    """Print coverage and errors by parameter, or how often values are called effective ones."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=54100)
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--synchronous", action="store_true", help="take the sampling for synchronous")
    parser.add_argument("--effective", action="store_true", help="how often the values are called effective ones")
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    if args.effective:
        tell(args.first, args.count)
        return
    found = list(rows(args.first, args.count, args.synchronous))
    for name in ("J", "F_c", "F_v"):
        part = [row for row in found if row[0] == name]
        error, off, inside = (np.array([row[k] for row in part]) for k in (1, 2, 3))
        print(
            f"{name:4} {len(part)} logs, covered {100 * inside.mean():.1f} %, error in standard errors "
            f"{np.sqrt(np.mean(off**2)):.2f} rms, median error {100 * np.median(error):.2f} %, "
            f"nine of ten below {100 * np.quantile(error, 0.9):.2f} %"
        )


if __name__ == "__main__":
    main()

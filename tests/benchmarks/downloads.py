"""What `verify` says of drives that apply a downloaded compensator in eight ways, or not at all.

    python -m tests.benchmarks.downloads --count 5 --first 80000

Drives with the shipped designs; their logs at 1 kHz, with the current reference, or with the noisy measured current
alone. The verdicts, the share of 95 % intervals of the gain that hold the true one, and the verdicts on drives that
were not changed while their friction fell by 20 %, or a load pushed.
"""

from __future__ import annotations

import argparse
from collections import Counter, defaultdict
from pathlib import Path

import numpy as np

from pmsm_ctrl.compensate.motions import named_trial
from pmsm_ctrl.compensate.runs import scaled
from pmsm_ctrl.design import Design
from pmsm_ctrl.log import Log
from pmsm_ctrl.verify import verify
from tests.unit.verify.downloads import WAYS, logs_of, verified_design

DESIGNS = Path(__file__).resolve().parents[2] / "designs"
NAMES = ("low_speed", "seed_motor", "small_servo", "servo_2kw", "hand_tuned")
MOTIONS = ("reversal 2 rad/s", "reversal 10 rad/s", "triangle")
# the gain of all of it, where one number says it
TRUE = {"nothing": 0.0, "half": 0.5, "as designed": 1.0, "reversed": -1.0, "one and a half": 1.5, "3 ms late": 1.0}


def without(log: Log, *names: str) -> Log:
    return Log({name: values for name, values in log.channels.items() if name not in names}, log.motion)


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--count", type=int, default=3)
    options.add_argument("--first", type=int, default=80000)
    chosen = options.parse_args()
    verdicts: dict[str, Counter[str]] = defaultdict(Counter)
    errors: dict[str, list[tuple[float, float]]] = defaultdict(list)
    designs = [verified_design(Design.read(DESIGNS / f"{name}.toml")) for name in NAMES]
    for seed in range(chosen.first, chosen.first + chosen.count):
        for number, design in enumerate(designs):
            trial = MOTIONS[(seed + number) % len(MOTIONS)]
            for name, way in WAYS.items():
                before, after = logs_of(design, trial, way, seed)
                for kind, left_out in (("reference", ()), ("measured current alone", ("i_q_ref",))):
                    found = verify(design, *(without(one, *left_out) for one in (before, after)), seed=seed)
                    verdicts[f"{name}, {kind}"][found.verdict] += 1
                    if name in TRUE:
                        half = 0.5 * (found.interval[1] - found.interval[0])
                        errors[f"{name}, {kind}"].append((found.gain.value - TRUE[name], half))
            colder = scaled(design, ("coulomb", "viscous"), 0.8)
            found = verify(design, *logs_of(design, trial, WAYS["nothing"], seed, plant=colder), seed=seed)
            verdicts["unchanged, friction -20 %"][found.verdict] += 1
            found = verify(design, *logs_of(design, named_trial(design, "push").motions[0], WAYS["nothing"], seed))
            verdicts["unchanged, a load pushes"][found.verdict] += 1
    print("| the drive, the log | verdicts | error of the gain, rms | interval +- | intervals that hold |")
    print("|---|---|---|---|---|")
    for name, counted in verdicts.items():
        said = ", ".join(f"{verdict} {count}" for verdict, count in counted.most_common())
        numbers = np.array(errors.get(name, [(np.nan, np.nan)]))
        if name in errors:
            hold = f"{100.0 * np.mean(np.abs(numbers[:, 0]) <= numbers[:, 1]):.0f} % of {len(numbers)}"
            spread = f"{np.sqrt(np.mean(numbers[:, 0] ** 2)):.4f} | {np.median(numbers[:, 1]):.4f} | {hold}"
        else:
            spread = "- | - | -"
        print(f"| {name} | {said} | {spread} |")


if __name__ == "__main__":
    main()

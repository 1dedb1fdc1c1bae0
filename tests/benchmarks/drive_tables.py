"""Every exported table read back as the drive would read it, in the loop of the simulated drive.

    python -m tests.benchmarks.drive_tables

For each design: the change of the RMS error and of the reversal peak, the worst of the reversals of 0.5, 2 and 10
rad/s, with the compensator and with each table, and what simulators lose of the friction. A CNC's cycle is 1 ms.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from pmsm_ctrl.compensate.motions import Trial, study_trials
from pmsm_ctrl.compensate.runs import baseline, compensated, judge, run_trial
from pmsm_ctrl.design import Design
from pmsm_ctrl.export.blocks import identifier
from pmsm_ctrl.export.simulators import joint_friction
from pmsm_ctrl.export.tables import friction_points, table_files
from tests.benchmarks.read_back import (
    added_to,
    read_ax8000,
    read_cogging_ax8000,
    read_compensation_list,
    read_friction_csv,
    read_sinumerik,
    read_torque_over_angle,
)

DESIGNS = Path(__file__).resolve().parents[2] / "designs"
NAMES = ("seed_motor", "low_speed", "small_servo", "servo_2kw", "presliding")
MOTIONS = ("reversal 0.5 rad/s", "reversal 2 rad/s", "reversal 10 rad/s")
READERS = {
    "friction.csv": (read_friction_csv,),
    "friction.csv, torque_over_angle.csv": (read_friction_csv, read_torque_over_angle),
    "frict_comp.lis": (read_compensation_list,),
    "friction_ax8000.csv, cogging_ax8000.csv": (read_ax8000, read_cogging_ax8000),
    "friction_sinumerik.csv": (read_sinumerik,),
}


def design_of(name: str) -> Design:
    if name != "presliding":
        return Design.read(DESIGNS / f"{name}.toml")
    seed = Design.read(DESIGNS / "seed_motor.toml").with_effect("presliding", {"z_s": 5e-4})
    return seed.replace(name="presliding")


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--designs", nargs="*", default=NAMES)
    chosen = options.parse_args().designs
    header = ("design", "compensator", *READERS)
    print(f"| {' | '.join(header)} |\n|{'---|' * len(header)}")
    rows = []
    for name in chosen:
        design = design_of(name)
        base, files = baseline(design), table_files(design)
        trials = {motion: study_trials(design)[motion] for motion in MOTIONS}
        plain = {motion: judge(trial, run_trial(base, trial)) for motion, trial in trials.items()}

        def changes(believed: Design, changed: dict[str, Trial], plain=plain, base=base) -> str:  # type: ignore[no-untyped-def]
            found = {motion: judge(trial, run_trial(believed, trial, truth=base)) for motion, trial in changed.items()}
            worst = (
                100.0 * (max(getattr(found[m], one) / getattr(plain[m], one) for m in found) - 1.0)
                for one in ("rms", "reversal_peak")
            )
            return ", ".join(f"{one:+.0f} %" for one in worst)

        cells = [changes(compensated(base, [e.id for e in design.effects]), trials)]
        for endings, readers in READERS.items():
            names = [f"{identifier(design.name)}_{ending}" for ending in endings.split(", ")]
            given = [read(files[file], base) for file, read in zip(names, readers, strict=True) if file in files]

            def reading(position, omega, t, given=given):  # type: ignore[no-untyped-def]
                return np.sum([read(position, omega, t) for read in given], axis=0)

            moved = {
                motion: Trial((added_to(trial.motions[0], reading, base.drive.speed_period),))
                for motion, trial in trials.items()
            }
            cells.append(changes(base, moved))
        print(f"| {name} | {' | '.join(cells)} |", flush=True)
        joint = joint_friction(design, friction_points(design)[0])
        rows.append((name, ", ".join(joint.lost) or "nothing", f"{100.0 * joint.missed:.2g} %",
                     f"{1e3 * joint.breakaway:.4g} -> {1e3 * joint.level:.4g} mN m"))  # fmt: skip
    print("\n| design | simulators lose | line misses (rms) | breakaway |\n|---|---|---|---|")
    for row in rows:
        print(f"| {' | '.join(row)} |")


if __name__ == "__main__":
    main()

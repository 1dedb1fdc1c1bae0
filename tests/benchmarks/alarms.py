"""Alarms of streams from the third simulator: ``python -m tests.benchmarks.alarms --streams 60``.

Every stream draws its own world (drive, loops, encoder, recorder, noise, motion), and in every window of 10 s the
motion is drawn anew. In a third of the streams nothing changes; in a third F_c steps by 30 % up or down at a third of
the stream; in a third it rises by 1.5 % a window. The tracker knows the world's design, which is off in friction,
inertia and torque constant. An alarm before the change is false, and so is one of F_v, which never changes: it may take
a part of a change of F_c. Of a drift of F_c, which begins with the stream, no alarm can be too early.
"""

from __future__ import annotations

import argparse
import math
import warnings
from collections import defaultdict
from dataclasses import replace

import numpy as np

from pmsm_ctrl.errors import PmsmCtrlError
from pmsm_ctrl.track.alarms import WINDOW, Alarm, Windows
from pmsm_ctrl.track.inputs import samples_of
from pmsm_ctrl.track.settings import Settings
from tests.benchmarks.worlds.motion import reference
from tests.benchmarks.worlds.plant import HIDDEN, PLACE, run
from tests.benchmarks.worlds.recorder import record
from tests.benchmarks.worlds.world import World, draw

DRY = 6  # place of F_c among the numbers of a world's motor
KINDS = ("nothing", "step", "trend")


def stream(world: World, factors: list[float]) -> list[Alarm]:
    """Return the alarms of a stream with these factors on F_c, one a window."""
    windows: Windows | None = None
    told, x = [], np.zeros(len(HIDDEN))
    x[PLACE["stribeck_speed"]] = x[PLACE["warm_time"]] = x[PLACE["dead_current"]] = 1.0
    sizes = np.array([1.0 / world.f_control, max(2, math.ceil(3.1e4 / world.f_control)), world.divider, world.delay])
    for k, factor in enumerate(factors):
        motor = np.array(world.motor)
        motor[DRY] *= factor
        ref, mode = reference(world, k, WINDOW)
        drive = (np.array(world.loops), mode, np.array(world.noise), np.array(world.encoder))
        table = run(motor, x, ref, sizes, *drive, world.seed * 100 + k)
        if not np.all(np.isfinite(table)):
            raise ArithmeticError(f"world {world.seed}: the drive leaves the finite numbers")
        log = record(world, [table])
        measure = "theta" if "theta" in log else "omega"
        settings = Settings(measure=measure, estimate=("T_load", "J"))
        windows = windows or Windows(world.design, settings, log.period)
        samples = samples_of(world.design, log, measure)
        told += windows.judge(replace(samples, t=samples.t + k * WINDOW))
    return told


def factors_of(kind: str, windows: int, seed: int) -> tuple[list[float], int]:
    """Return the factors on F_c, and the window of the change."""
    start = windows // 3
    if kind == "step":
        size = 1.3 if seed % 2 else 1.0 / 1.3
        return [1.0] * start + [size] * (windows - start), start
    slope = 0.015 if kind == "trend" else 0.0
    return [1.0 + slope * k for k in range(windows)], 0


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--streams", type=int, default=60)
    parser.add_argument("--windows", type=int, default=30)
    parser.add_argument("--first", type=int, default=500000)
    parser.add_argument("--all", action="store_true", help="a line for every alarm")
    asked = parser.parse_args()
    warnings.simplefilter("ignore")
    count, right, wrong, other = defaultdict(int), defaultdict(int), defaultdict(int), defaultdict(int)
    late, sizes = [], []
    for seed in range(asked.first, asked.first + asked.streams):
        kind, world = KINDS[seed % 3], draw(seed)
        factors, start = factors_of(kind, asked.windows, seed)
        try:
            told = stream(world, factors)
        except (ArithmeticError, PmsmCtrlError) as error:
            print(f"{seed}: left out ({error})"[:100], flush=True)
            continue
        count[kind] += 1
        false = [one for one in told if kind == "nothing" or one.told <= start * WINDOW]
        found = [one for one in told if one not in false and one.parameter == "F_c"]
        wrong[kind] += bool(false)
        right[kind] += bool(found)
        other[kind] += any(one.parameter == "F_v" for one in told if one not in false)
        if kind == "step" and found:
            late.append(found[0].told / WINDOW - start)
            sizes.append(found[0].after / found[0].before / factors[-1] - 1.0)
        if asked.all or false:
            for one in told:
                print(
                    f"{seed} {kind} {world.motion} {world.channel} {world.mode}: {one.parameter} {one.kind} "
                    f"{one.before:.4g} -> {one.after:.4g} at {one.t:.0f} s told {one.told:.0f} s p {one.p_value:.1e}",
                    flush=True,
                )
    print("\n| F_c | streams | F_c named | alarm before a change | F_v named after it |\n|---|---|---|---|---|")
    for kind in KINDS:
        early, later = "-" if kind == "trend" else wrong[kind], "-" if kind == "nothing" else other[kind]
        print(f"| {kind} | {count[kind]} | {right[kind]} | {early} | {later} |")
    if late:
        print(f"\nsteps: told after {np.median(late):.0f} windows (median), {np.quantile(late, 0.9):.0f} (9 of 10); "
              f"size off by {100 * np.median(np.abs(sizes)):.1f} % of F_c (median)")  # fmt: skip


if __name__ == "__main__":
    main()

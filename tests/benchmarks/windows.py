"""Nothing cycles inside a window reported as safe: ``python -m tests.benchmarks.windows --count 300 --first 100``.

Each random drive gets its windows as `compensate` finds them, by the same sweep with steps of 25 % instead of 10 %, on
the drive and on the drive with presliding.
Then gains drawn anywhere inside, with parameters off by up to 20 % and other noise, are simulated: a limit cycle there
is a window that was wrong. Drives run side by side, which is what makes 300 of them affordable.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pmsm_ctrl.compensate import GainWindow, Metrics, Trial, baseline, compensated, gain_window, judge, study_trials
from pmsm_ctrl.compensate.plants import judged
from pmsm_ctrl.compensate.study import SOURCES
from pmsm_ctrl.compensate.window import FACTORS
from pmsm_ctrl.design import Design
from pmsm_ctrl.log import Log
from pmsm_ctrl.simulate.compose import load
from pmsm_ctrl.simulate.lanes import groups, load_lanes, simulate_group
from pmsm_ctrl.simulate.run import Prepared, prepare, run_kernel
from tests.unit.compensate.random_drives import random_drive

ROOT = Path(__file__).resolve().parents[2]
STEP = 0.25  # coarser than `compensate`'s own: more room to hide between
STAGES = (2, 4, 7)  # gains done after each stage, 0 among them; who is not safe then is not swept further
EFFECTS = ("coulomb", "viscous", "stribeck")
PROBES = 4  # gains drawn inside each window
PROBED = ("reversal 2 rad/s", "positioning", "push", "positioning, with presliding", "push, with presliding")
PLAIN = ("none", 0.0, 1.0)
DRAWS = 8  # of the noise, in which an axis without compensation is run where it cycles with one: it may by itself
LARGER = 1.5  # than what the axis does by itself

Key = tuple[int, str, float, float, str]  # seed of the drive, source, gain, factor, trial


@dataclass(frozen=True)
class Cycle:
    """A limit cycle inside a window."""

    drive: int
    source: str
    gain: float
    factor: float
    trial: str
    amplitude: float
    safe: float


def prepared(
    base: Design, trial: Trial, source: str, gain: float, factor: float, truth: Design | None = None
) -> Prepared:  # fmt: skip
    """Return one run, ready for a lane."""
    believed = base if gain == 0.0 else compensated(base, EFFECTS, gain=gain, factor=factor, source=source)
    return prepare(believed, trial.motions[0], truth=base if truth is None else truth)


def side_by_side(runs: Mapping[Key, Prepared], seed: int, trial: Trial) -> dict[Key, Metrics]:
    """Return the metrics of many runs, 16 drives at a time, those with presliding one by one."""
    keys, found = list(runs), {}

    def take(number: int, log: Log) -> None:
        found[keys[number]] = judge(trial, (log,), runs[keys[number]].design.encoder_step)

    for group in groups(dict(enumerate(runs.values())), always=True):
        load_lanes(group)
        logs = simulate_group(group, seed, keep_truth=True)
        assert logs is not None, "a drive diverged"
        for number, log in zip(group.numbers, logs, strict=True):
            take(number, log)
    for number, (key, drive) in enumerate(runs.items()):
        if key not in found:
            module = load(drive.active, drive.feedforward.effects if drive.feedforward else ())
            take(number, drive.log(run_kernel(module, drive, seed + number), seed + number, True))
    return found


class Drives:
    """Random drives with their trials and the motions on which they are judged."""

    def __init__(self, drives: Mapping[int, Design]) -> None:
        self.bases = {k: baseline(drive) for k, drive in drives.items()}
        self.trials = {k: study_trials(drive) for k, drive in drives.items()}
        self.motions = {k: judged(base) for k, base in self.bases.items()}
        self.at_rest = {name for motions in self.motions.values() for name, m in motions.items() if m.at_rest}

    def run(self, keys: Iterable[Key], seed: int) -> dict[Key, Metrics]:
        """Return the metrics of these runs."""
        runs = {}
        for key in keys:
            k, source, gain, factor, name = key
            motion = self.motions[k][name]
            runs[key] = prepared(self.bases[k], self.trials[k][motion.trial], source, gain, factor, motion.plant)
        any_axis = next(iter(self.trials.values()))["push"]
        return side_by_side(runs, seed, any_axis)


def swept(
    drives: Mapping[int, Design], seed: int, sources: Iterable[str] = SOURCES, step: float = STEP
) -> dict[int, dict[str, GainWindow]]:
    """Return each drive's windows by source, as `compensate` finds them; beyond a gain that is not safe none is run."""
    every = Drives(drives)
    found = every.run([(k, *PLAIN, name) for k in drives for name in every.motions[k]], seed)
    windows: dict[int, dict[str, GainWindow]] = {k: {} for k in drives}
    alive, done, gains = [(k, source) for k in drives for source in sources], 1, [step * n for n in range(STAGES[-1])]
    for stage in STAGES:
        found.update(every.run([
            (k, source, gain, factor, name)
            for k, source in alive for gain in gains[done:stage] for factor in FACTORS for name in every.motions[k]
        ], seed))  # fmt: skip
        done = stage
        for k, source in alive:

            def run(gain: float, factor: float, name: str, k: int = k, source: str = source) -> Metrics:
                return found[(k, *PLAIN, name) if gain == 0.0 else (k, source, gain, factor, name)]

            windows[k][source] = gain_window(
                run, every.motions[k], source, gains=gains[:done], at_rest=every.at_rest,
                resolution=drives[k].encoder_step,
            )  # fmt: skip
        alive = [(k, source) for k, source in alive if windows[k][source].safe == gains[done - 1]]
    return windows


def cycles_inside(drives: Mapping[int, Design], windows: Mapping[int, Mapping[str, GainWindow]]) -> list[Cycle]:
    """Return the limit cycles at gains drawn inside the windows; one that the axis has by itself does not count.

    Nor does one no larger than those of the axis without compensation in several draws of the noise.
    """
    every, keys = Drives(drives), []
    for k in drives:
        rng = np.random.default_rng(k + 1_000_000)
        keys += [(k, *PLAIN, name) for name in PROBED]
        for source, window in windows[k].items():
            for _ in range(PROBES if window.safe > 0.0 else 0):
                gain, factor = rng.uniform(0.0, window.safe), rng.uniform(min(FACTORS), max(FACTORS))
                keys += [(k, source, gain, factor, name) for name in PROBED]
    found = every.run(keys, 10_000_000)
    larger = {
        key: metrics.cycle_amplitude for key, metrics in found.items()
        if metrics.cycle_amplitude > LARGER * found[key[0], *PLAIN, key[-1]].cycle_amplitude
    }  # fmt: skip
    by_itself = dict.fromkeys({(k, name) for k, *_, name in larger}, 0.0)
    for draw in range(1, DRAWS + 1):
        for (k, *_, name), metrics in every.run(
            [(k, *PLAIN, name) for k, name in by_itself], draw * 10_000_019
        ).items():
            by_itself[k, name] = max(by_itself[k, name], metrics.cycle_amplitude)
    return [
        Cycle(k, source, gain, factor, name, amplitude, windows[k][source].safe)
        for (k, source, gain, factor, name), amplitude in larger.items()
        if amplitude > LARGER * by_itself[k, name]
    ]


def check(
    seeds: Iterable[int],
    sources: Iterable[str] = SOURCES,
    step: float = STEP,
    batch: int = 20,
    report: Callable[[str], None] = print,
) -> list[Cycle]:
    """Check the windows of the random drives with these seeds; return what cycles inside."""
    sources = tuple(sources)
    design = Design.read(ROOT / "designs" / "hand_tuned.toml")
    every, wrong, start = list(seeds), [], time.perf_counter()
    safe: dict[str, Counter[float]] = {source: Counter() for source in sources}
    for first in range(0, len(every), batch):
        drives = {k: random_drive(design, np.random.default_rng(k)) for k in every[first : first + batch]}
        windows = swept(drives, first, sources, step)
        new = cycles_inside(drives, windows)
        for cycle in new:
            report(f"# {cycle}")
        wrong += new
        for found in windows.values():
            for source, window in found.items():
                safe[source][window.safe] += 1
        report(f"# {first + len(drives)} drives, {time.perf_counter() - start:.0f} s, {len(wrong)} cycles inside")
    report("| feedforward with | highest safe gain: drives | limit cycles at safe gains |\n|---|---|---|")
    for source, counted in safe.items():
        ends = ", ".join(f"{100 * gain:.0f} %: {n}" for gain, n in sorted(counted.items()))
        report(f"| {source} speed | {ends} | {sum(c.source == source for c in wrong)} |")
    return wrong


def main() -> None:
    """Print how many windows were wrong."""
    asked = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    asked.add_argument("--count", type=int, default=300)
    asked.add_argument("--first", type=int, default=100, help="seed of the first drive")
    asked.add_argument("--sources", nargs="+", choices=SOURCES, default=SOURCES)
    asked.add_argument("--step", type=float, default=STEP, help="of the sweep's gains")
    chosen = asked.parse_args()
    seeds = range(chosen.first, chosen.first + chosen.count)
    check(seeds, chosen.sources, chosen.step, report=lambda text: print(text, flush=True))


if __name__ == "__main__":
    main()

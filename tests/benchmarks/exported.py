"""The exported C in the loop of drawn drives, against the windows that `compensate` declares.

``python -m tests.benchmarks.exported --count 300`` draws drives (`random_drives`), exports their compensator by
reference, commanded or measured speed at a drawn gain, compiles it, and runs it in the simulated drive's loop: after a
push at rest, on the rigid contact and with presliding. A limit cycle above an encoder count at a gain that was declared
safe is an error; so is one that the simulation has and the C has not, or the other way round.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pmsm_ctrl.compensate import baseline, compensated, gain_verdict, judge, run_trial, study_trials
from pmsm_ctrl.compensate.plants import with_bristle
from pmsm_ctrl.design import Design
from pmsm_ctrl.simulate import Scenario
from pmsm_ctrl.simulate.motions import Limits
from tests.unit.compensate.random_drives import random_drive
from tests.unit.export.compiled_c import Compensator, simulate_with

ROOT = Path(__file__).resolve().parents[2]
SOURCES = ("reference", "commanded", "measured")
EFFECTS = ("coulomb", "viscous", "stribeck")
LARGER = 1.5  # as in the windows: a limit cycle of the axis itself does not count
REST = 3.2  # s after the push has settled: a push ends a rest, and four swings at 0.6 Hz need as long


@dataclass(frozen=True)
class Row:
    """One drive with its exported compensator.

    Attributes
    ----------
    seed : int
    source : str
    gain : float
    declared : bool
        Safe, as `gain_verdict` says.
    cycles : float
        Largest limit cycle with the C in the loop, encoder counts; 0 for none.
    simulated : float
        With the simulation's own compensator.
    apart : float
        Largest difference of the angle between the two, encoder counts, in the first quarter second.
    """

    seed: int
    source: str
    gain: float
    declared: bool
    cycles: float
    simulated: float
    apart: float

    @property
    def wrong(self) -> bool:
        """Whether a gain that was declared safe cycles."""
        return self.declared and self.cycles > 0.0

    @property
    def other(self) -> bool:
        """Whether the C does not do what was simulated."""
        return (self.cycles > 0.0) != (self.simulated > 0.0)


def pushed(design: Design) -> Scenario:
    """Return a reference at rest with a push of twice the friction, half a second into it, whatever the trial's are."""
    load = Limits.of(design).breakaway * design.K_t

    def references(t: np.ndarray) -> dict[str, np.ndarray]:
        push = np.where((t >= 0.5) & (t < 0.505), load, 0.0)
        return {"T_load": push} | {n: np.zeros_like(t) for n in ("theta_ref", "omega_ref", "alpha_ref")}

    return Scenario("push at rest", 0.5 + 0.8 + REST, references, control="position")


def drawn(seed: int) -> tuple[Design, str, float, float]:
    """Draw a drive, a source, a gain and the factor by which the compensated parameters are wrong."""
    rng = np.random.default_rng(seed)
    design = random_drive(Design.read(ROOT / "designs" / "hand_tuned.toml"), rng)
    source = str(rng.choice(SOURCES))
    gain = float(rng.uniform(0.05, 0.3) if source == "measured" else rng.uniform(0.2, 1.5))
    return design, source, gain, float(rng.uniform(0.8, 1.2))


def run(seed: int, folder: Path) -> Row:
    """Draw a drive, a source and a gain; export, compile and run it."""
    design, source, gain, factor = drawn(seed)
    stated = design.replace(compensation={"source": source, "gain": gain, "effects": EFFECTS})
    declared = gain_verdict(stated, gain).safe is True
    base, trial = baseline(stated), study_trials(design)["push"]
    believed = compensated(base, EFFECTS, gain=gain, factor=factor, source=source)
    function, motion, count = Compensator(believed, folder), pushed(design), design.encoder_step
    found, simulated, apart = 0.0, 0.0, 0.0
    for plant in (base, with_bristle(base)):
        assert plant is not None
        alone = type(trial)((motion,))
        logs = {
            "C": simulate_with(function, believed, motion, plant, seed=seed),
            "simulated": run_trial(believed, alone, truth=plant, seed=seed)[0],
            "without": run_trial(base, alone, truth=plant, seed=seed)[0],
        }
        cycle = {name: judge(alone, (log,), count).cycle_amplitude for name, log in logs.items()}
        allowed = LARGER * cycle["without"]
        found = max(found, cycle["C"] if cycle["C"] > allowed else 0.0)
        simulated = max(simulated, cycle["simulated"] if cycle["simulated"] > allowed else 0.0)
        first = logs["C"].t < 0.25
        apart = max(apart, float(np.abs(logs["C"]["theta_true"] - logs["simulated"]["theta_true"])[first].max()))
    return Row(seed, source, gain, declared, found / count, simulated / count, apart / count)


def check(
    seeds: Iterable[int], sources: Iterable[str] = SOURCES, report: Callable[[str], None] = print
) -> list[Row]:  # fmt: skip
    """Run the drives with these seeds that are compensated by these sources; print what is wrong, and the totals."""
    rows, start, wanted = [], time.perf_counter(), tuple(sources)
    for seed in seeds:
        if drawn(seed)[1] not in wanted:
            continue
        with tempfile.TemporaryDirectory() as folder:
            rows.append(run(seed, Path(folder)))
        if rows[-1].wrong or rows[-1].other or len(rows) % 10 == 0:
            report(f"# {len(rows)} drives, {time.perf_counter() - start:.0f} s: {rows[-1]}")
    report(
        "| source | drives | declared safe | of these cycle | declared unsafe | of these cycle | C unlike simulation |"
    )
    report("|---|---|---|---|---|---|---|")
    for source in wanted:
        some = [row for row in rows if row.source == source]
        safe, unsafe = ([r for r in some if r.declared is declared] for declared in (True, False))
        report(
            f"| {source} | {len(some)} | {len(safe)} | {sum(r.wrong for r in safe)} | {len(unsafe)} | "
            f"{sum(r.cycles > 0.0 for r in unsafe)} | {sum(r.other for r in some)} |"
        )
    return rows


def main() -> None:
    """Draw, export, run and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0, help="of the first drive")
    parser.add_argument("--sources", nargs="+", choices=SOURCES, default=SOURCES, help="drives by others are left out")
    asked = parser.parse_args()
    seeds = range(asked.seed, asked.seed + asked.count)
    check(seeds, asked.sources, lambda text: print(text, flush=True))


if __name__ == "__main__":
    main()

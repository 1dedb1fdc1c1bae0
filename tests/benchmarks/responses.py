"""Errors and coverage of what `frf` fits: ``python -m tests.benchmarks.responses --count 10 --first 100 --open``.

``--excitation noise prbs`` takes Gaussian noise and a binary sequence (``--clock``, s) in place of multisine and chirp.
Every record has a noise of its own.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.frf.measured import measured_axis
from pmsm_ctrl.frf.stretches import stretches
from pmsm_ctrl.simulate import simulate
from pmsm_ctrl.simulate.motions import Scenario
from pmsm_ctrl.simulate.scenarios import SCENARIOS
from pmsm_ctrl.tune.linearise import operating_point

DESIGN = Path(__file__).resolve().parents[2] / "designs" / "seed_motor.toml"
SPRING = {"J_load": 4e-5, "k": 15.0, "d": 0.002}
TRUE = {
    "J": 9e-5, "friction_slope": 1.68e-4, "delay": 0.0, "antiresonance": math.sqrt(15.0 / 4e-5) / (2.0 * math.pi),
    "resonance": math.sqrt(15.0 / 4e-5 + 15.0 / 5e-5) / (2.0 * math.pi),
    "load_inertia": 4e-5, "stiffness": 15.0, "damping": 0.002,
}  # fmt: skip

KINDS = ("multisine", "chirp", "noise", "prbs")

# Open loop: friction is balanced at this speed, rad/s. Slow lines move an axis further than its speed loop would let
# them, so that the excitation starts higher, Hz.
FREE_SPEED = 150.0
FREE_FROM = {"chirp": {"f_start": 5.0}, "multisine": {"f_min": 2.0}, "noise": {"f_min": 5.0}}


def motion(excitation: str, design: Design, *, free: bool, **parameters: float) -> Scenario:
    """Return an excitation in the closed speed loop, or in current control on an axis that turns already."""
    scenario = SCENARIOS[excitation]
    if not free:
        return scenario(design=design, **parameters)
    closed = scenario(design=design, **FREE_FROM.get(excitation, {}), **parameters)
    begin = closed.segments[0][2]
    held = operating_point(design, FREE_SPEED).i_q

    def references(t: NDArray[np.float64]) -> Mapping[str, NDArray[np.float64]]:
        return {"i_q_add": held + closed.references(t + begin)["i_q_add"]}

    return replace(
        closed, duration=closed.duration - begin, references=references, control="current", omega_0=FREE_SPEED,
        segments=(),
    )  # fmt: skip


def table(excitation: str, sprung: bool, seeds: range, *, free: bool = False, clock: float = 2e-3) -> str:
    """Return the rows of one case: relative errors (of the delay in us), share of intervals that hold.

    Bias and scatter are those of the errors over their standard errors. The last row says how many of the logs showed
    two masses.
    """
    design = Design.read(DESIGN)
    truth = design.with_effect("compliance", SPRING) if sprung else design
    own: dict[str, float] = {"clock": clock} if excitation == "prbs" else {}
    fixed = motion(excitation, design, free=free, **own)
    found: dict[str, list[tuple[float, float]]] = {}
    split = 0
    for seed in seeds:
        # every record has its own noise
        excited = motion(excitation, design, free=free, seed=seed) if excitation == "noise" else fixed
        log = simulate(design, excited, truth=truth, seed=seed)
        _, axis, _ = measured_axis(design, stretches(design, [log]))
        split += axis.mass is not None
        for name, (value, stderr) in axis.errors().items():
            if name in TRUE:
                size = 1e-6 if name == "delay" else 0.01 * TRUE[name]
                found.setdefault(name, []).append(((value - TRUE[name]) / size, (value - TRUE[name]) / stderr))
    case = f"{excitation}{', open loop' if free else ''}, {'two masses' if sprung else 'rigid'}"
    rows = []
    for name, pairs in found.items():
        away, errors = np.array(pairs).T
        unit = "us" if name == "delay" else "%"
        rows.append(
            f"| {case} | {name} | {np.median(np.abs(away)):.2g} {unit} "
            f"| {np.max(np.abs(away)):.2g} {unit} | {np.mean(errors):+.2f} | {np.std(errors):.2f} "
            f"| {100.0 * np.mean(np.abs(errors) < 1.96):.0f} % of {len(pairs)} |"
        )
    rows.append(f"| {case} | shows two masses | | | | | {split} of {len(seeds)} |")
    return "\n".join(rows)


def main() -> None:
    """Print the table."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--count", type=int, default=10)
    asked.add_argument("--first", type=int, default=100)
    asked.add_argument("--open", action="store_true", help="in current control, without the speed loop")
    asked.add_argument("--excitation", nargs="+", default=["multisine", "chirp"], choices=KINDS)
    asked.add_argument("--clock", type=float, default=2e-3, help="of a binary sequence, s")
    chosen = asked.parse_args()
    seeds = range(chosen.first, chosen.first + chosen.count)
    print("| record | parameter | median error | largest | bias | scatter | intervals that hold |")
    print("|---|---|---|---|---|---|---|")
    for excitation in chosen.excitation:
        for sprung in (False, True):
            print(table(excitation, sprung, seeds, free=chosen.open, clock=chosen.clock), flush=True)


if __name__ == "__main__":
    main()

r"""The blind suite: hide every effect in simulated logs and see what the diagnosis calls it.

    python -m tests.benchmarks.blind                        short: every effect once, 20 clean logs
    python -m tests.benchmarks.blind --seeds 10 --strengths 0.5 1 2 --motions identification mixed moves \
        --clean 200 --pairs 30 --left-out                   long

The controller and the diagnosed design know nothing of the hidden effect, and the true motor differs from the
design inside its datasheet tolerance. Prints one line per log that was misnamed, the confusion matrix and the shares;
and of the misses how many had less than twice the strength at which a test that knows everything but the strength
finds the effect in half of all logs (Cramer and Rao; `limits.py`).
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import time
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose import POLICY, Diagnosis, Policy, diagnose
from pmsm_ctrl.effects.catalogue import CATALOGUE
from pmsm_ctrl.errors import SimulationError
from pmsm_ctrl.log import Log
from pmsm_ctrl.simulate import simulate
from pmsm_ctrl.simulate.motions import Limits, PathBuilder, Scenario
from pmsm_ctrl.simulate.scenarios import scenario

Array = NDArray[Any]

DESIGN = Path(__file__).resolve().parents[2] / "designs" / "hand_tuned.toml"

# Middle strength of every effect on the reference motor; coulomb and viscous are hidden by leaving them out.
MIDDLE: dict[str, dict[str, float]] = {
    "coulomb": {}, "viscous": {},
    "stribeck": {"dF_s": 0.008, "w_s": 8.0, "delta": 2.0},
    "presliding": {"z_s": 0.02, "z_b": 0.5, "tau_z": 1e-3},
    "viscous_asymmetry": {"dF_v": 2e-5},
    "constant_load": {"T_0": 0.003},
    "viscous_power": {"k": 6e-4, "n": 2.0 / 3.0},
    "quadratic_drag": {"k_2": 4e-7},
    "load_dependent_friction": {"mu": 0.06},
    "position_dependent_friction": {"b_s": 0.003, "b_c": 0.002},
    "thermal_drift": {"dF_v": -5e-5, "dF_c": -0.004, "tau": 10.0},
    "unbalance": {"a_s": 0.004, "a_c": 0.002},
    "cogging": {"a_s": 0.004, "a_c": 0.003, "order": 24.0},
    "torque_ripple": {"r_s": 0.02, "r_c": 0.02, "order": 6.0},
    "torque_saturation": {"k_s": 0.15},
    "iron_loss": {"T_h": 0.006, "k_e": 2e-5},
    "compliance": {"J_load": 4e-5, "k": 3.0, "d": 3e-4},
    "backlash": {"gap": 0.02, "J_load": 3e-5, "k": 50.0, "d": 0.01},
    "dead_time": {"dU": 3.0, "i_0": 0.05},
    "inductance_saturation": {"k_L": 0.04},
    "current_offset": {"o_alpha": 0.012, "o_beta": -0.008},
    "current_gain": {"g": 0.0, "g_c": 0.02, "g_s": 0.015},
    "encoder_eccentricity": {"e_s": 2e-3, "e_c": 1e-3},
    "delay": {"tau": 2.5e-3},  # beyond what sampling at 1 kHz can do
}  # fmt: skip
STRENGTH = {"compliance": ("J_load",), "backlash": ("gap",), "presliding": ("z_s",)}
MOTIONS = ("identification", "mixed", "moves", "servo")
# Strength that the noise allows to be found in half of all logs, over the strength that is there.
HOPELESS = 0.5


@dataclass(frozen=True)
class Case:
    """One log to be diagnosed: hidden effects, strength, motion and seed."""

    hidden: tuple[str, ...]
    strength: float
    motion: str
    seed: int
    left_out: bool = False


def motion(name: str, design: Design, seed: int) -> Scenario:
    """Return one of the motions, all about 30 s long."""
    if name == "identification":
        return scenario("identification", design, seed=seed)
    if name == "moves":
        return moves(seed)
    if name == "mixed":
        return scenario("identification", design, seed=seed + 100, duration=24.0, speed_max=120.0, acceleration=1200.0)
    return scenario("reversal", design, speed=80.0, frequency=0.31, cycles=9.0)


def moves(seed: int) -> Scenario:
    """Moves from rest to rest, as a machine makes them: random places, speeds, accelerations and pauses."""
    rng = np.random.default_rng([seed, 31])
    builder = PathBuilder()
    while builder.t < 30.0:
        builder.piece(rng.uniform(0.05, 0.3))
        limits = Limits(speed=rng.uniform(10.0, 150.0), acceleration=10.0 ** rng.uniform(2.5, 3.5), jerk=1e5)
        builder.move(rng.uniform(-40.0, 40.0), limits)
    path = builder.path()

    def references(t: Array) -> dict[str, Array]:
        return dict(zip(("theta_ref", "omega_ref", "alpha_ref"), path.at(t), strict=True))

    return Scenario("moves", builder.t, references, control="position")


def truth_of(design: Design, case: Case) -> tuple[Design, Design]:
    """Return what is diagnosed and what is true."""
    rng = np.random.default_rng([case.seed, len(case.hidden), 77])
    shares = {"J": 0.05, "R": 0.05, "L_d": 0.05, "L_q": 0.05, "psi_f": 0.01}
    values = {"J": design.J, **{name: float(getattr(design.motor, name)) for name in ("R", "L_d", "L_q", "psi_f")}}
    truth = design.with_parameters(**{n: v * (1.0 + shares[n] * rng.uniform(-1.0, 1.0)) for n, v in values.items()})
    for identifier in case.hidden:
        if not MIDDLE[identifier]:
            design = design.without_effect(identifier)
            continue
        effect = CATALOGUE[identifier]
        scaled = STRENGTH.get(identifier, effect.amplitudes)
        values = {s: v * (case.strength if s in scaled else 1.0) for s, v in MIDDLE[identifier].items()}
        truth = truth.with_effect(identifier, values)
    return design, truth


def log_of(design: Design, truth: Design, case: Case) -> Log:
    """Simulate the case; what the log may not tell is not in it."""
    return simulate(design, motion(case.motion, design, case.seed), truth=truth, seed=case.seed)


def run(case: Case, policy: Policy = POLICY) -> Diagnosis:
    """Simulate and diagnose one case."""
    design, truth = truth_of(Design.read(DESIGN), case)
    log = log_of(design, truth, case)
    offered = [i for i in CATALOGUE if not (case.left_out and i in case.hidden)]
    return diagnose(design, log, candidates=offered, plan=False, policy=policy)


def named(result: Diagnosis) -> str:
    """What the diagnosis calls it: the first effect, or the verdict."""
    return result.steps[0].effect if result.steps else result.verdict


def right(case: Case, result: Diagnosis) -> bool:
    """Whether the answer is the one hoped for."""
    if not case.hidden:
        return result.verdict == "consistent"
    if case.left_out:
        looks = {case.hidden[0], *CATALOGUE[case.hidden[0]].look_alikes}
        looks |= {i for i, e in CATALOGUE.items() if case.hidden[0] in e.look_alikes}
        return result.verdict == "unexplained" or bool(result.unexplained) or named(result) in looks
    if case.hidden == ("iron_loss",):  # no log tells it from friction: F_c and F_v come out larger, and nothing else
        values = {d.parameter: d.estimate for d in result.parameter_deviations}
        nominal = {d.parameter: d.nominal for d in result.parameter_deviations}
        return not result.steps and all(values[s] > nominal[s] for s in ("F_c", "F_v"))
    if len(case.hidden) > 1:
        return all(any(h == s.effect or h in s.equivalents for s in result.steps) for h in case.hidden)
    first = result.steps[0] if result.steps else None
    return first is not None and (first.effect == case.hidden[0] or case.hidden[0] in first.equivalents)


def cases(args: argparse.Namespace) -> Iterator[Case]:
    """Yield every case asked for."""
    wanted = args.effects or list(MIDDLE)
    for strength, name, seed, effect in itertools.product(
        args.strengths, args.motions, range(args.first, args.first + args.seeds), wanted
    ):
        yield Case((effect,), strength, name, seed)
    for k in range(args.clean):
        yield Case((), 0.0, MOTIONS[k % len(MOTIONS)], 1000 + args.first + k)
    rng = np.random.default_rng([5, args.first])
    # structures that take each other's place and effects the log cannot separate are no pairs
    single = [e for e in MIDDLE if MIDDLE[e] and e not in ("backlash", "iron_loss", "compliance")]
    for k in range(args.pairs):
        yield Case(tuple(rng.choice(single, 2, replace=False).tolist()), 1.0, MOTIONS[k % 3], 2000 + args.first + k)
    for k, effect in itertools.product(range(args.left_out), wanted):
        if MIDDLE[effect]:
            yield Case((effect,), 1.0, "identification", 3000 + args.first + k, left_out=True)


def arguments() -> argparse.Namespace:
    """Return the command line."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--strengths", type=float, nargs="+", default=[1.0])
    parser.add_argument("--motions", nargs="+", default=["identification"], choices=MOTIONS)
    parser.add_argument("--effects", nargs="*", default=None)
    parser.add_argument("--clean", type=int, default=20)
    parser.add_argument("--pairs", type=int, default=0)
    parser.add_argument("--left-out", type=int, nargs="?", const=1, default=0, help="seeds of left-out effects")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes")
    parser.add_argument("--json", type=Path, default=None)
    return parser.parse_args()


def row_of(case: Case) -> dict[str, Any] | None:
    """Diagnose one case and say how it went, with the error that is left over the true model's.

    None where the effect is so strong that the drive cannot run: an inductance that saturates to nothing.
    """
    design, truth = truth_of(Design.read(DESIGN), case)
    try:
        log = log_of(design, truth, case)
    except SimulationError:
        return None
    offered = [i for i in CATALOGUE if not (case.left_out and i in case.hidden)]
    result = diagnose(design, log, candidates=offered, plan=False)
    final = {name: e["rms"] for name, e in result.errors["final"].items()}
    true = diagnose(truth, log, candidates=()).errors["base"]
    hopeless = False
    if len(case.hidden) == 1 and not case.left_out and not right(case, result) and MIDDLE[case.hidden[0]]:
        from tests.benchmarks.limits import bound

        hopeless = bound(case) > HOPELESS * case.strength
    single = f"strength {case.strength:g}, {case.motion}"
    kind = "left out" if case.left_out else "pairs" if len(case.hidden) > 1 else single if case.hidden else "clean"
    hidden = "+".join(case.hidden) or "nothing"
    return {
        "hidden": f"({hidden})" if case.left_out else hidden, "kind": kind, "seed": case.seed, "motion": case.motion,
        "strength": case.strength, "right": right(case, result), "first": named(result), "verdict": result.verdict,
        "named": [s.effect for s in result.steps], "equivalents": [s.equivalents for s in result.steps],
        "over_true": max(final[name] / true[name]["rms"] for name in final), "unexplained": result.unexplained,
        "hopeless": hopeless,
    }  # fmt: skip


def report(rows: list[dict[str, Any]]) -> None:
    """Print the confusion matrix and the shares."""
    confusion: dict[str, Counter[str]] = defaultdict(Counter)
    for row in rows:
        confusion[row["hidden"]][row["first"]] += 1
    print(f"\n{'hidden':<30} named first (count)")
    for hidden, names in confusion.items():
        print(f"{hidden:<30} {', '.join(f'{n} {c}' for n, c in names.most_common())}")
    for kind in dict.fromkeys(row["kind"] for row in rows):
        part = [row for row in rows if row["kind"] == kind]
        good = sum(row["right"] for row in part)
        over = np.array([row["over_true"] for row in part])
        lost = sum(row["hopeless"] for row in part)
        near = f"in {100 * np.mean(over <= 1.10):.0f} % (median {np.median(over):.3f}, worst {over.max():.2f})"
        print(
            f"{kind:<32} {good} of {len(part)} right ({100 * good / len(part):.1f} %)"
            + (f", {lost} more within twice what the noise allows anybody" if lost else "")
            + f"; final error within 1.10 x the true model's {near}"
        )


def main() -> None:
    """Run the suite with a progress bar and print the confusion matrix."""
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    from rich.progress import track

    args = arguments()
    rows = []
    start = time.perf_counter()
    every = list(cases(args))
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # threads that wait for each other cost every process half
    with ProcessPoolExecutor(args.jobs, mp_context=get_context("spawn")) as pool:
        for row in track(pool.map(row_of, every), description="blind suite", total=len(every)):
            if row is None:
                continue
            rows.append(row)
            if not row["right"]:
                why = " (within twice what the noise allows)" if row["hopeless"] else ""
                print(f"  {row['kind']}, seed {row['seed']}: {row['hidden']} -> {row['verdict']} {row['named']}{why}")
    report(rows)
    print(f"{len(rows)} logs in {time.perf_counter() - start:.0f} s")
    if args.json:
        args.json.write_text(json.dumps(rows, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()

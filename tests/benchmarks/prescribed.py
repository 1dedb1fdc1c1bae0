"""The diagnosis on motions that are prescribed, with the torque that the written-down balance needs for them.

    python -m tests.benchmarks.prescribed --first 1 --count 70          some minutes

No drive, no controller and no recorder: a sine, two sines, a triangle, a trapezoid or steps of the speed, or a chirp,
as on a test stand for friction; the torque in closed form, white noise, an angle in counts. Nothing is simpler, and
what fails here fails on every stand. Log number N is clean, or has the hidden effect number N of the list.
"""

from __future__ import annotations

import argparse
import os
import warnings
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose import diagnose
from pmsm_ctrl.log import Log
from tests.benchmarks.worlds.judge import interval

Array = NDArray[np.float64]

FINER = 4  # times the rate of the log, at which the motion is worked out
MOTIONS = ("sine", "two sines", "triangle", "trapezoid", "steps", "chirp")
STEPS = (0.1, -0.1, 0.25, -0.25, 0.5, -0.5, 1.0, -1.0)  # of the top speed, 2 s each
ORDERS = (6, 12, 24, 36, 48)
EFFECTS = (
    "stribeck", "viscous_asymmetry", "constant_load", "unbalance", "cogging", "quadratic_drag",
    "position_dependent_friction", "presliding", "presliding of Dahl", "thermal_drift", "torque_saturation", "delay",
    "viscous_power",
)  # fmt: skip
# Names that are as right: other laws of the same curve, and the same law of another bend.
SAME = {
    "presliding of Dahl": {"presliding"},
    "viscous_power": {"viscous_power", "quadratic_drag", "stribeck"},
    "quadratic_drag": {"quadratic_drag", "viscous_power"},
}


class Axis(NamedTuple):
    """Inertia, Coulomb and viscous friction."""

    J: float
    F_c: float
    F_v: float


class Case(NamedTuple):
    """A log, the design that an engineer has of it, and what is hidden."""

    design: Design
    log: Log
    effect: str
    motion: str
    noise: float


def speed_of(motion: str, t: Array, top: float, rng: np.random.Generator) -> Array:
    """Return a speed with this largest value, rad/s."""
    slow = 2.0 * np.pi * float(np.exp(rng.uniform(np.log(0.1), np.log(1.0))))
    if motion == "sine":
        return np.asarray(top * np.sin(rng.uniform(1.5, 3.0) * slow * t))
    if motion == "two sines":
        return np.asarray(top * (0.6 * np.sin(slow * t) + 0.4 * np.sin(3.3 * slow * t + 1.0)))
    if motion == "triangle":
        return np.asarray(top * (2.0 / np.pi) * np.arcsin(np.sin(0.5 * slow * t)))
    if motion == "trapezoid":
        return np.asarray(top * np.clip(3.0 * np.sin(slow * t), -1.0, 1.0))
    if motion == "steps":
        return np.asarray(top * np.array(STEPS)[(t / 2.0).astype(int) % len(STEPS)])
    return np.asarray(top * np.sin(2.0 * np.pi * (0.1 * t + t**2 / t[-1])))


def bristle(theta: Array, reach: float, dahl: bool) -> Array:
    """Return the share of its level that a bristle carries: one that unloads as a spring, or one of Dahl.

    Source: P. R. Dahl, AIAA Journal 14 (1976) 1675, with the exponent 1.
    """
    out, z = np.empty(len(theta)), 0.0
    for n, step in enumerate(np.diff(theta, prepend=theta[0]).tolist()):
        loading = dahl or z * step > 0.0
        z = min(max(z + step / reach * (1.0 - z * np.sign(step) if loading else 1.0), -1.0), 1.0)
        out[n] = z
    return out


def added(effect: str, rng: np.random.Generator, axis: Axis, motion: tuple[Array, Array, Array]) -> Array:
    """Return the torque of an effect along a motion (time, angle, speed), N m; zero for those of the measurement."""
    t, theta, omega = motion
    size, side, share = axis.F_c * rng.uniform(0.15, 0.6), np.sign(omega), omega / np.max(np.abs(omega))
    if effect.startswith("presliding"):
        reach = min(np.ptp(theta) * float(np.exp(rng.uniform(np.log(3e-4), np.log(1e-2)))), 0.1)
        return np.asarray(axis.F_c * (bristle(theta, reach, effect != "presliding") - side))
    laws = {
        "stribeck": lambda: size * side * np.exp(-((share / rng.uniform(0.05, 0.25)) ** 2)),
        "viscous_asymmetry": lambda: 0.3 * axis.F_v * np.abs(omega),
        "constant_load": lambda: size + 0.0 * t,
        "unbalance": lambda: size * np.sin(theta + 0.3),
        "cogging": lambda: size * np.sin(rng.choice(ORDERS) * theta + 0.4),
        "quadratic_drag": lambda: size * share * np.abs(share),
        "position_dependent_friction": lambda: size * side * np.sin(theta + 1.0),
        "thermal_drift": lambda: -size * side * (1.0 - np.exp(-3.0 * t / t[-1])),
        "viscous_power": lambda: size * side * np.abs(share) ** 0.4,
    }
    return np.asarray(laws[effect]() if effect in laws else 0.0 * t)


def drawn(seed: int, hidden: bool) -> Case:
    """Draw an axis, a motion and the noise, and work the log out."""
    from scipy.ndimage import gaussian_filter1d

    rng = np.random.default_rng([seed, int(hidden), 92])
    rate = float(rng.choice([500.0, 1000.0, 2000.0, 4000.0]))
    t = np.arange(0.0, rng.uniform(15.0, 40.0), 1.0 / (FINER * rate))
    motion, top = MOTIONS[rng.integers(len(MOTIONS))], float(np.exp(rng.uniform(np.log(3.0), np.log(150.0))))
    omega = gaussian_filter1d(speed_of(motion, t, top, rng), rng.uniform(4e-3, 2e-2) * FINER * rate)
    alpha, theta = np.gradient(omega, t), np.cumsum(omega) / (FINER * rate) + rng.uniform(0.0, 6.0)
    J = float(np.exp(rng.uniform(np.log(5e-5), np.log(1e-2))))
    F_c = J * float(np.sqrt(np.mean(alpha**2)) * np.exp(rng.uniform(np.log(0.2), np.log(5.0))))
    axis = Axis(J, F_c, F_c / float(np.max(np.abs(omega))) * rng.uniform(0.05, 1.0))
    torque = axis.J * alpha + axis.F_c * np.sign(omega) + axis.F_v * omega
    level = float(np.std(torque))
    noise = level * float(np.exp(rng.uniform(np.log(1e-3), np.log(3e-2))))
    effect = EFFECTS[seed % len(EFFECTS)] if hidden else ""
    torque = torque + added(effect, rng, axis, (t, theta, omega))
    if effect == "torque_saturation":  # the drive believes in a torque that is up to a tenth too large
        torque = torque * (1.0 + 0.1 * (torque / np.max(np.abs(torque))) ** 2)
    if effect == "delay":
        torque = np.interp(t - rng.uniform(2.5, 6.0) / rate - 1.5e-3, t, torque)
    step = 2.0 * np.pi / 2 ** int(rng.integers(14, 24))
    logged = slice(None, None, FINER)
    measured = torque[logged] + noise * rng.normal(size=t[logged].size)
    log = Log({"t": t[logged], "theta": np.floor(theta[logged] / step) * step, "torque": measured})
    near, friction = rng.uniform(0.93, 1.07), rng.uniform(0.4, 2.0, 2)
    effects = [{"id": "coulomb", "F_c": axis.F_c * friction[0]}, {"id": "viscous", "F_v": axis.F_v * friction[1]}]
    design = Design.from_dict({"motor": {"J": axis.J * near, "K_t": 1.0}, "effects": effects})
    return Case(design, log, effect, motion, noise / level)


def row_of(asked: tuple[int, bool]) -> dict[str, Any]:
    """Diagnose one log."""
    warnings.simplefilter("ignore")
    case = drawn(*asked)
    found = diagnose(case.design, case.log, plan=False)
    names = [{step.effect, *step.equivalents} for step in found.steps]
    good = SAME.get(case.effect, {case.effect})
    error, floor = (found.errors[of]["torque"]["relative"] for of in ("final", "noise_floor"))
    return {
        "seed": asked[0], "effect": case.effect, "motion": case.motion, "rate": case.log.rate, "noise": case.noise,
        "verdict": str(found.verdict), "named": [step.effect for step in found.steps],
        "flagged": [one.parameter for one in found.parameter_deviations if one.flagged],
        "first": bool(names) and bool(good & names[0]), "false": sum(not good & one for one in names),
        "error": error, "floor": floor,
    }  # fmt: skip


def judged(cases: list[tuple[int, bool]], jobs: int) -> Iterator[dict[str, Any]]:
    """Yield the answers, with a progress bar."""
    from rich.progress import track

    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        yield from track(pool.map(row_of, cases), description="logs", total=len(cases))


def main() -> None:
    """Print the shares, and every answer that is not right."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--first", type=int, default=1)
    options.add_argument("--count", type=int, default=70, help="clean logs, and as many hidden ones")
    options.add_argument("--jobs", type=int, default=os.cpu_count())
    chosen = options.parse_args()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    seeds = range(chosen.first, chosen.first + chosen.count)
    rows = list(judged([(seed, hidden) for hidden in (False, True) for seed in seeds], chosen.jobs))
    clean, hidden = ([row for row in rows if bool(row["effect"]) == wanted] for wanted in (False, True))
    wrong = [row for row in clean if row["named"] or row["flagged"]]
    print(f"clean: named or flagged {interval(len(wrong), len(clean))}; {dict(Counter(r['verdict'] for r in clean))}")
    print(f"hidden: first {interval(sum(r['first'] for r in hidden), len(hidden))}")
    print(f"hidden: a false name {interval(sum(r['false'] > 0 for r in hidden), len(hidden))}")
    print(f"hidden: consistent {interval(sum(r['verdict'] == 'consistent' for r in hidden), len(hidden))}")
    for row in [*wrong, *(row for row in clean if row["verdict"] == "unexplained"), *hidden]:
        if not row["effect"] or row["false"] or not row["first"]:
            print(
                f"  {row['seed']} {row['effect'] or 'clean'}, {row['motion']}, {row['rate']:.0f} Hz, noise "
                f"{100 * row['noise']:.1f} %: {row['verdict']} {' + '.join(row['named'])} "
                f"{' '.join(row['flagged'])} error {100 * row['error']:.2f} %, floor {100 * row['floor']:.2f} %"
            )


if __name__ == "__main__":
    main()

"""How often the tracker's 95 % bands hold F_c and F_v, over speed: ``python -m tests.benchmarks.bands --runs 30``.

Reversals of 10 s whose F_c and F_v are drawn from a prior of 20 % and walk as the filter assumes; what the bands hold
after the first 3 s is counted. States beside F_c and F_v are those that `track` chooses, or those of ``--estimate``.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.simulate import scenario, simulate
from pmsm_ctrl.track import Settings, track
from tests.unit.track.tracking_axes import TERMS, walk, wander

DESIGNS = Path(__file__).resolve().parents[2] / "designs"
PRIOR, DRIFT, SETTLED = 0.2, 0.01, 3.0
Array = NDArray[np.float64]


def walked(parameters: dict[str, float], name: str, t: Array) -> Array:
    """Return one walk of `wander` over time: "c" or "v"."""
    x = math.pi * t / parameters["T"]
    return np.sum([parameters[f"{name}{k}"] * np.sin((k + 0.5) * x) for k in range(TERMS)], axis=0)


def run(design: Design, speed: float, seed: int, estimate: tuple[str, ...] | None) -> tuple[Array, Array, Array]:
    """Return what the bands of (F_c, F_v) hold, their mean errors and stated deviations over the true mean."""
    rng, motion = np.random.default_rng([seed, 21]), scenario("reversal", design, speed=speed, cycles=5.0)
    level = np.array([design.parameters("coulomb")["F_c"], design.parameters("viscous")["F_v"]])
    true = level * (1.0 + PRIOR * rng.standard_normal(2))
    axis = design.with_effect("coulomb", {"F_c": true[0]}).with_effect("viscous", {"F_v": true[1]})
    parameters, *_ = walk(motion.duration, DRIFT * level[0], DRIFT * level[1], rng)
    axis = axis.with_own_effects(wander).with_effect("wander", parameters)
    log = simulate(design, motion, truth=axis, seed=seed)
    chosen = track(design, log).settings.estimate if estimate is None else estimate
    found = track(design, log, Settings(prior=PRIOR, drift=DRIFT, estimate=chosen))
    late = log.t > SETTLED
    rows = []
    for k, (name, short) in enumerate((("F_c", "c"), ("F_v", "v"))):
        error = (found.history[name] - true[k] - walked(parameters, short, log.t))[late]
        stated = found.stderr[name][late]
        rows.append((np.mean(np.abs(error) < 1.96 * stated), error.mean() / level[k], stated.mean() / level[k]))
    held, error_of, stated_of = np.array(rows).T
    return held, error_of, stated_of


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--runs", type=int, default=30)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--speeds", type=float, nargs="+", default=[1.0, 2.0, 5.0, 20.0, 100.0, 200.0], help="rad/s")
    parser.add_argument("--design", default="seed_motor")
    parser.add_argument("--estimate", help="states beside F_c and F_v, or none; as `track` chooses if left out")
    asked = parser.parse_args()
    estimate = asked.estimate and tuple(name for name in asked.estimate.split(",") if name != "none")
    design = Design.read(DESIGNS / f"{asked.design}.toml")
    print(
        "| speed, rad/s | F_c in its 95 % band | F_v in its 95 % band | mean error of F_v | stated deviation of F_v |"
    )
    print("|---|---|---|---|---|", flush=True)
    for speed in asked.speeds:
        rows = [run(design, speed, seed, estimate) for seed in range(asked.first, asked.first + asked.runs)]
        held, error, stated = (np.array(part) for part in zip(*rows, strict=True))
        spread = 100.0 * error[:, 1].std(ddof=1) / math.sqrt(len(rows))
        print(
            f"| {speed:g} | {100.0 * held[:, 0].mean():.1f} % | {100.0 * held[:, 1].mean():.1f} % | "
            f"{100.0 * error[:, 1].mean():+.1f} +- {spread:.1f} % | {100.0 * stated[:, 1].mean():.2g} % |",
            flush=True,
        )


if __name__ == "__main__":
    main()

r"""Where the diagnosis loses a hidden effect: the numbers of every criterion, round by round, for single worlds.

    python -m tests.benchmarks.worlds.trace 167000 168035 --margin 5
    python -m tests.benchmarks.worlds.trace 68030 --clean

For the hidden effect and those that explain most: gain and p-value after Holm, share of the balance and of the
residual, cross-validation, the same beside the rivals, the parameters, and what refused it.
"""

from __future__ import annotations

import argparse
import warnings
from typing import Any

import numpy as np

from tests.benchmarks.worlds.hidden import hidden_log, possible, simulate_world
from tests.benchmarks.worlds.judge import SAME
from tests.benchmarks.worlds.world import draw

SHOWN = 3  # candidates of a round beside the hidden effect


def lines_of(fit: Any, trial: Any, p_holm: float) -> list[str]:
    """Return what the criteria see of a candidate."""
    from pmsm_ctrl.diagnose.measures import beside_rivals, contribution, cross_validated, excess_of

    plain, white = excess_of(fit.plain, trial, trial.plain_gain), excess_of(fit.solved, trial, trial.gain)
    values = ", ".join(f"{v:.3g} +- {s:.2g}" for v, s in zip(trial.values, trial.stderr, strict=True))
    shape = ", ".join(f"{name} {value:.4g}" for name, value in trial.group.shape.items())
    out = [
        f"gain {trial.gain:.0f} (plain {trial.plain_gain:.0f}), p {p_holm:.1e}, {values} at {shape or 'no shape'}",
        f"share of the balance {contribution(fit, trial):.4f}, of the residual {plain[0]:.3f}, above the noise "
        f"{plain[1]:.2f}; prewhitened {white[0]:.3f}, {white[1]:.2f}",
    ]
    if not trial.singular and p_holm < 0.05:
        found, whole, _ = cross_validated(fit, trial)
        out.append(
            f"left out: {found.gain:.1f} +- {found.stderr:.1f} in {found.blocks} blocks, rank p {found.p_rank:.1e}, "
            f"of {whole:.0f} in all"
        )
        if (beside := beside_rivals(fit, trial)) is not None:
            p, share, found = beside
            out.append(f"beside rivals: p {p:.1e}, {share:.2f} of its gain, {found.gain:.1f} +- {found.stderr:.1f}")
    return out


def trace(seed: int, effect: str | None, margin: float) -> None:
    """Print the rounds of one world's diagnosis."""
    from pmsm_ctrl.diagnose import diagnose
    from pmsm_ctrl.diagnose.level import level_of
    from pmsm_ctrl.diagnose.selection import judged_trials, name_of

    world = draw(seed)
    if effect is None:
        log, reached = simulate_world(world), 0.0
    else:
        offered = possible(world)
        effect = offered[seed % len(offered)] if effect == "any" else effect
        made = hidden_log(world, effect, margin)
        if made is None:
            print(f"{seed}: {effect} cannot be had at margin {margin:g}")
            return
        log, reached, _ = made
    found = diagnose(world.design, log, plan=False)
    print(f"\n{seed}: {effect or 'clean'}, margin {reached:.1f}; {found.verdict}, {[s.effect for s in found.steps]}")
    print("  " + ", ".join(f"{name} {value}" for name, value in world.properties.items()))
    good = {effect, *SAME.get(effect or "", ())}
    for number, fit in enumerate(found.selection.fits):
        levels = [round(level_of(fit, row).left, 2) for row in range(len(fit.record.channels))]
        print(f"  round {number}: residual over noise {levels}, cutoff {fit.record.cutoff:.0f} Hz")
        for rank, (trial, p_holm, refusal) in enumerate(judged_trials(fit)):
            if rank < SHOWN or trial.candidate.effect.id in good:
                print(f"    {name_of(trial)}: {refusal or 'passes before the refit'}")
                for line in lines_of(fit, trial, p_holm):
                    print(f"      {line}")
    for name, refusal in found.selection.refused.items():
        if name.split(" ")[0] in good:
            print(f"  at last {name}: {refusal}")


def main() -> None:
    """Trace worlds by their seeds."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("seeds", type=int, nargs="+")
    parser.add_argument("--clean", action="store_true", help="nothing hidden")
    parser.add_argument("--effect", default="any", help="the one that the benchmark draws if left out")
    parser.add_argument("--margin", type=float, default=5.0)
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    with np.errstate(all="ignore"):
        for seed in args.seeds:
            trace(seed, None if args.clean else args.effect, args.margin)


if __name__ == "__main__":
    main()

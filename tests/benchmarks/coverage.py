r"""How often the 95 % intervals that `add` writes hold the truth: every parameter of every effect, shapes included.

    python -m tests.benchmarks.coverage --effects stribeck viscous_power --logs 40        minutes
    python -m tests.benchmarks.coverage --logs 200                                         the table of the page, hours

Each log is the reference drive simulated with one effect, its example values varied by up to 20 %, and with noise of
its own; of a detent force, a linear axis in closed form. The effect is added to the design without it, and the
estimates and their standard errors are held against what was simulated. An estimate without a standard error, at its
bound or never fitted, makes no interval; those are counted beside. Shares come with their 95 % interval (Clopper and
Pearson).
"""

from __future__ import annotations

import argparse
import json
import warnings
from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose.adding import added
from pmsm_ctrl.diagnose.addition import Addition
from pmsm_ctrl.effects.base import Effect
from pmsm_ctrl.effects.catalogue import CATALOGUE
from pmsm_ctrl.errors import PmsmCtrlError
from pmsm_ctrl.simulate import simulate
from tests.benchmarks.worlds.judge import interval
from tests.slides import slide

DESIGNS = Path(__file__).resolve().parents[2] / "designs"
HALF_WIDTH = 1.959964
VARIED = 0.2
WHOLE = ("coulomb", "viscous")  # the design has them already
ALONG_A_LINE = "detent_force"  # of a linear axis
LEFT = ("delay",)  # the time of sampling is a nuisance of the same column


def scores(effect_id: str, seed: int, scenario: str, polish: bool = False) -> dict[str, float]:
    """Return the error of every parameter over its standard error; NaN without one.

    Where the result gives an interval in place of a standard error, over that of its half on the true value's side.
    """
    effect = CATALOGUE[effect_id]
    rng = np.random.default_rng([seed, *effect_id.encode()])
    if effect_id == ALONG_A_LINE:
        return _along_a_line(effect, seed, rng, polish)
    design = Design.read(DESIGNS / "hand_tuned.toml")
    truth = {}
    for p in effect.parameters:
        varied = effect.example[p.symbol] * (1.0 if p.symbol == effect.order else rng.uniform(1 - VARIED, 1 + VARIED))
        truth[p.symbol] = float(np.clip(varied, p.lower, p.upper))
    log = simulate(design, scenario, truth=design.with_effect(effect_id, truth), seed=seed)
    whole = {entry.id: design.parameters(entry.id) for entry in design.effects} | {effect_id: truth}
    return _off(added(design, log, effect_id, polish=polish), effect, whole)


def _along_a_line(effect: Effect, seed: int, rng: np.random.Generator, polish: bool) -> dict[str, float]:
    """Return the same of a wave of 0.5 to 3 N and 12 to 48 mm along a linear axis with noise of 1 N."""
    truth = dict(zip(effect.amplitudes, rng.uniform(0.5, 2.0, 2).tolist(), strict=True)) | {
        effect.period: float(rng.uniform(0.012, 0.048))
    }
    size = tuple(truth[symbol] for symbol in effect.amplitudes)
    one = slide("moves" if seed % 2 else "sines", seed, {truth[effect.period]: (size[0], size[1])})
    base = {"coulomb": {"F_c": one.true["F_c"]}, "viscous": {"F_v": one.true["F_v"]}}
    return _off(added(one.design, one.log, effect.id, polish=polish), effect, base | {effect.id: truth})


def _off(found: Addition, effect: Effect, whole: Mapping[str, Mapping[str, float]]) -> dict[str, float]:
    out = {}
    for entry in found.design.effects:
        true = whole[entry.id]
        told = found.parameters if entry.id == effect.id else found.base
        for symbol, value in true.items():
            if symbol == effect.order:
                continue
            if symbol not in entry.parameters:  # not a parameter of this log's fit
                continue
            off, stderr = entry.parameters[symbol] - value, entry.stderr.get(symbol, float("nan"))
            if symbol in told and (interval := told[symbol].ends) is not None:
                stderr = abs(interval[0 if off > 0.0 else 1] - entry.parameters[symbol]) / HALF_WIDTH
            out[symbol] = off / stderr if stderr != 0.0 else np.inf  # the estimate is an end, the truth beyond it
    return out


def main() -> None:
    """Print the share of intervals that hold the truth, parameter by parameter."""
    from rich.progress import track

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--effects", nargs="*", default=[e for e in CATALOGUE if e not in (*WHOLE, *LEFT)])
    parser.add_argument("--logs", type=int, default=40, help="of each effect")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--scenario", default="identification")
    parser.add_argument("--polish", action="store_true", help="as `add --polish`, where it proves a gain")
    parser.add_argument("--json", type=Path, default=None)
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    table: dict[str, dict[str, list[float]]] = {}
    for effect in args.effects:
        found: dict[str, list[float]] = defaultdict(list)
        refused = 0
        for seed in track(range(args.first, args.first + args.logs), description=effect, transient=True):
            try:
                for symbol, score in scores(effect, seed, args.scenario, args.polish).items():
                    found[symbol].append(score)
            except PmsmCtrlError:
                refused += 1
        table[effect] = dict(found)
        for symbol, values in found.items():
            z = np.array(values)
            z = z[~np.isnan(z)]
            held = interval(int((np.abs(z) < HALF_WIDTH).sum()), len(z))
            finite = z[np.isfinite(z)]
            spread = f"{finite.mean():+.2f} | {finite.std():.2f}" if len(finite) else "- | -"
            print(f"| {effect} | {symbol} | {held} | {spread} | {len(values) - len(z)} |", flush=True)
        if refused:
            print(f"| {effect} | | refused: {refused} | | |", flush=True)
    if args.json:
        args.json.write_text(json.dumps(table, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()

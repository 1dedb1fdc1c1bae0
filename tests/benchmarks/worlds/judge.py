r"""The third simulator's judgement of the diagnosis, by world and not only on average.

    python -m tests.benchmarks.worlds.judge --clean 60 --hidden 90              short, minutes
    python -m tests.benchmarks.worlds.judge --clean 1000 --hidden 1500 --first 50000   the figures of the page

Of every clean log: whether anything is named or flagged, and the verdict. Of every hidden one: whether the effect, or
one that the answer declares equivalent, comes first; whether a false name stands beside it; whether the verdict is
`consistent`. Shares come with their 95 % interval (Clopper and Pearson) and by every property of the worlds.
"""

from __future__ import annotations

import argparse
import json
import os
from collections import Counter, defaultdict
from pathlib import Path
from typing import Any

import numpy as np

from tests.benchmarks.worlds.hidden import hidden_log, possible, simulate_world
from tests.benchmarks.worlds.speed_alone import UNTRIED, speed_alone
from tests.benchmarks.worlds.world import draw

# Names that a log of this kind cannot tell from the hidden one, whatever the diagnosis says of it.
SAME = {
    "cogging": {"torque_ripple"},
    "torque_ripple": {"cogging"},
    "current_offset": {"cogging"},
    "current_gain": {"cogging", "torque_ripple"},
}


def row_of(case: tuple[int, str | None, float, dict[str, Any]]) -> dict[str, Any] | None:
    """Diagnose one world; None where the effect cannot be had in it."""
    import warnings

    from pmsm_ctrl.diagnose import diagnose
    from pmsm_ctrl.errors import PmsmCtrlError

    warnings.simplefilter("ignore")
    seed, effect, wanted, fixed = case
    alone = bool(fixed.get("speed_alone"))
    world = draw(seed, **{name: value for name, value in fixed.items() if name != "speed_alone"})
    reached, values = 0.0, {}
    try:
        if effect is None:
            log = simulate_world(world)
        else:
            offered = [name for name in possible(world) if not (alone and name in UNTRIED)]
            effect = effect if effect != "any" else offered[seed % len(offered)]
            if effect not in offered:
                return None
            made = hidden_log(world, effect, wanted)
            if made is None:
                return None
            log, reached, values = made
    except ArithmeticError:
        return None
    row: dict[str, Any] = {"seed": seed, "hidden": effect, "margin": reached, "values": values, **world.properties}
    try:
        found = diagnose(world.design, speed_alone(log, seed) if alone else log, plan=False)
    except PmsmCtrlError as error:
        return row | {"verdict": "refused", "named": [], "first": "refused", "flagged": [], "why": str(error)}
    named = [s.effect for s in found.steps]
    equal = [list(s.equivalents) for s in found.steps]
    errors = found.errors["final"]["torque"]["relative"]
    flagged = [d.parameter for d in found.parameter_deviations if d.flagged]
    good = {effect, *SAME.get(effect or "", ())}
    first = bool(named) and bool(good & {named[0], *equal[0]})
    false = [n for n, e in zip(named, equal, strict=True) if not good & {n, *e}]
    return row | {
        "verdict": str(found.verdict), "named": named, "equivalents": equal, "right": first, "false": false,
        "flagged": flagged, "error": errors, "floor": found.errors["noise_floor"]["torque"]["relative"],
        "p": [s.evidence["p_holm"] for s in found.steps],
        "explained": [s.evidence["explained_share"] for s in found.steps],
        "chi2": [f.plain.chi2 / max(f.plain.rows, 1) for f in found.selection.fits],
        "before": [s.error_before["torque"]["relative"] for s in found.steps],
        "after": [s.error_after["torque"]["relative"] for s in found.steps],
    }  # fmt: skip


def interval(hits: int, total: int) -> str:
    """Return a share with its 95 % interval. Source: C. J. Clopper, E. S. Pearson, Biometrika 26 (1934) 404."""
    from scipy.stats import beta

    if total == 0:
        return "-"
    low = beta.ppf(0.025, hits, total - hits + 1) if hits else 0.0
    high = beta.ppf(0.975, hits + 1, total - hits) if hits < total else 1.0
    return f"{hits} of {total}, {100 * hits / total:.1f} % ({100 * low:.1f} to {100 * high:.1f})"


PROPERTIES = (
    "motor", "linear", "motion", "mode", "channel", "voltages", "log_rate", "f_control", "divider", "delay", "loop",
    "encoder_bits", "line_error", "reference_hold", "dropped", "runs", "coloured", "adc", "friction_known",
)  # fmt: skip


def report(rows: list[dict[str, Any]]) -> None:
    """Print the shares, and clean logs by every property."""
    clean = [r for r in rows if r["hidden"] is None]
    hidden = [r for r in rows if r["hidden"] is not None and r["verdict"] != "refused"]
    refused = [r for r in rows if r["verdict"] == "refused"]
    judged = [r for r in clean if r["verdict"] != "refused"]
    print(f"\nclean logs, something named: {interval(sum(bool(r['named']) for r in judged), len(judged))}")
    flagged = [r for r in judged if r["named"] or r["flagged"]]
    print(f"clean logs, named or a parameter flagged: {interval(len(flagged), len(judged))}")
    alarms = [r for r in judged if r in flagged or r["verdict"] in ("unexplained", "implausible")]
    print(f"clean logs, unexplained or implausible alone: {interval(len(alarms) - len(flagged), len(judged))}")
    print(f"clean logs, any of these: {interval(len(alarms), len(judged))}")
    print(f"clean logs, inconclusive: {interval(sum(r['verdict'] == 'inconclusive' for r in judged), len(judged))}")
    print(f"  verdicts {dict(Counter(r['verdict'] for r in clean))}")
    print(f"  names {dict(Counter(n for r in judged for n in r['named']).most_common())}")
    print(f"  flags {dict(Counter(n for r in judged for n in r['flagged']).most_common())}")
    strong = [r for r in hidden if r["margin"] >= 3.0]
    for label, part in (("margin 3 and more", strong), ("below 3", [r for r in hidden if r["margin"] < 3.0])):
        if part:
            print(f"hidden, {label}: first {interval(sum(r['right'] for r in part), len(part))}")
            print(f"  a false name beside or before it: {interval(sum(bool(r['false']) for r in part), len(part))}")
            missed = sum(r["verdict"] == "consistent" for r in part)
            print(f"  `consistent` over it: {interval(missed, len(part))}")
    print(f"refused as bad input: {len(refused)} {dict(Counter(r['why'][:70] for r in refused).most_common(4))}")
    if strong:
        print("\n| hidden (margin >= 3) | first | answers |\n|---|---|---|")
        for effect in sorted({r["hidden"] for r in strong}):
            part = [r for r in strong if r["hidden"] == effect]
            answers = Counter("+".join(r["named"]) or r["verdict"] for r in part).most_common(4)
            print(f"| {effect} | {sum(r['right'] for r in part)}/{len(part)} | {answers} |")
    print(
        "\n| property | clean: named or flagged | clean: or unexplained | hidden: false name | "
        "hidden: first (margin >= 3) |\n|---|---|---|---|---|"
    )
    for name in PROPERTIES:
        groups: dict[str, list[dict[str, Any]]] = defaultdict(list)
        for r in rows:
            if r["verdict"] != "refused":
                groups[str(r[name])].append(r)
        for value, part in sorted(groups.items()):
            c = [r for r in part if r["hidden"] is None]
            h = [r for r in part if r["hidden"] is not None]
            s = [r for r in h if r["margin"] >= 3.0]
            bad, all_bad = sum(r in flagged for r in c), sum(r in alarms for r in c)
            print(f"| {name} {value} | {bad}/{len(c)} | {all_bad}/{len(c)} | "
                  f"{sum(bool(r['false']) for r in h)}/{len(h)} | {sum(r['right'] for r in s)}/{len(s)} |")  # fmt: skip


def main() -> None:
    """Judge the diagnosis on worlds drawn at random and print the shares."""
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    from rich.progress import track

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--clean", type=int, default=60)
    parser.add_argument("--hidden", type=int, default=90)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--effects", nargs="*", default=None, help="any that fits the world if left out")
    parser.add_argument("--log-rate", type=float, default=None, help="Hz, in place of 250 to 8000 drawn")
    parser.add_argument("--motion", default=None)
    parser.add_argument("--mode", default=None)
    parser.add_argument("--speed-alone", action="store_true", help="a filtered speed in place of the angle")
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    parser.add_argument("--rows", type=Path, default=None, help="keeps every row: a run that was stopped goes on")
    args = parser.parse_args()
    fixed = {"log_rate": args.log_rate, "motion": args.motion, "mode": args.mode}
    fixed = {k: v for k, v in fixed.items() if v is not None} | ({"speed_alone": True} if args.speed_alone else {})
    cases: list[tuple[int, str | None, float, dict[str, Any]]] = [
        (args.first + k, None, 0.0, fixed) for k in range(args.clean)
    ]
    rng = np.random.default_rng([args.first, 37])
    for k in range(args.hidden):
        effect = args.effects[k % len(args.effects)] if args.effects else "any"
        cases.append((args.first + 100_000 + k, effect, float(np.exp(rng.uniform(np.log(1.0), np.log(15.0)))), fixed))
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    known = _read(args.rows)
    left = [case for case in cases if case[0] not in known]
    with ProcessPoolExecutor(args.jobs, mp_context=get_context("spawn")) as pool:
        for case, row in zip(left, track(pool.map(row_of, left), description="worlds", total=len(left)), strict=True):
            known[case[0]] = row
            if args.rows:
                with args.rows.open("a", encoding="utf-8") as file:
                    file.write(json.dumps([case[0], row], default=str) + "\n")
    rows = [row for case in cases if (row := known[case[0]]) is not None]
    report(rows)
    print(f"{len(rows)} of {len(cases)} worlds judged; the others cannot have the effect drawn for them")


def _read(path: Path | None) -> dict[int, dict[str, Any] | None]:
    """Return the rows by seed that a file holds; None where the world cannot have the effect."""
    if path is None or not path.exists():
        return {}
    return dict(json.loads(line) for line in path.read_text(encoding="utf-8").splitlines())


if __name__ == "__main__":
    main()

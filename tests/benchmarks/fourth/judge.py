r"""The fourth simulator's judgement of the diagnosis.

    python -m tests.benchmarks.fourth.judge --clean 100 --hidden 100                           some minutes
    python -m tests.benchmarks.fourth.judge --clean 100 --hidden 100 --first 300 --outside 32 --spoiled 30

Log number N has seed 1000+N where it is clean, 2000+N with one hidden effect, 3000+N with an effect outside the
catalogue, 4000+N where it was spoiled; from N = 1000 on, a million times the group and N. `--first N` is the number of
the first log of each group. Shares come with their 95 % interval.

A right name comes first, or is declared equivalent to the first. A false name is any that is neither the hidden effect
nor declared equivalent to it. The ratio is the rms of what inertia, friction, offset and timing cannot take of the
effect over the rms of the noise, below 50 Hz (`regression.py`).
"""

from __future__ import annotations

import argparse
import json
import os
from collections import Counter
from pathlib import Path
from typing import Any

from tests.benchmarks.fourth.cases import BROKEN, CLEAN, FOREIGN, HIDDEN, Case, build, group_of, name_of, seed_of
from tests.benchmarks.worlds.judge import interval

Row = dict[str, Any]
STRONG = 3.0  # ratio from which an effect counts as well visible
ALARMS = ("unexplained", "implausible", "refused")


def answer(case: Case) -> Row:
    """Write the log and its design, read both again and diagnose them."""
    import tempfile

    from pmsm_ctrl import Design, diagnose, read_log
    from pmsm_ctrl.errors import PmsmCtrlError
    from tests.benchmarks.fourth.recorder import write

    with tempfile.TemporaryDirectory() as folder:
        design_file, log_file = write(case.world, case.log, Path(folder) / f"s{case.seed}")
        try:
            design = Design.read(design_file)
            found = diagnose(design, read_log(log_file, design), plan=False)
        except PmsmCtrlError as error:
            return {"verdict": "refused", "named": [], "equivalents": [], "flagged": [], "why": str(error)}
    return {
        "verdict": str(found.verdict),
        "named": [step.effect for step in found.steps],
        "equivalents": [list(step.equivalents) for step in found.steps],
        "flagged": [d.parameter for d in found.parameter_deviations if d.flagged],
    }


def row_of(seed: int) -> Row | None:
    """Simulate and diagnose the log of a seed; None where none of its worlds fits."""
    import warnings

    warnings.simplefilter("ignore")
    case = build(seed)
    if case is None:
        return None
    world = {"family": case.world.family, "motion": case.world.motion, "log_rate": case.world.log_rate}
    true = {"sub_seed": case.sub_seed, "name": case.name, "terms": case.terms} | case.size
    return {"seed": seed} | true | world | answer(case)


def is_it(row: Row, place: int) -> bool:
    """Is the name at this place the hidden effect, or equivalent to it?"""
    return row["name"] in (row["named"][place], *row["equivalents"][place])


def first(row: Row) -> bool:
    return bool(row["named"]) and is_it(row, 0)


def false_name(row: Row) -> bool:
    return not all(is_it(row, place) for place in range(len(row["named"])))


def report_clean(rows: list[Row]) -> None:
    """Print the shares of the clean logs, and every one that is not silent."""
    print(f"\nclean logs: {len(rows)}, verdicts {dict(Counter(r['verdict'] for r in rows))}")
    named = sum(bool(r["named"]) for r in rows)
    loud = sum(bool(r["named"] or r["flagged"]) for r in rows)
    alarms = [r for r in rows if r["verdict"] in ALARMS and not (r["named"] or r["flagged"])]
    print(f"  named: {interval(named, len(rows))}")
    print(f"  named or flagged: {interval(loud, len(rows))}")
    print(f"  unexplained or implausible alone: {interval(len(alarms), len(rows))}")
    print(f"  any of these: {interval(loud + len(alarms), len(rows))}")
    print(f"  inconclusive: {interval(sum(r['verdict'] == 'inconclusive' for r in rows), len(rows))}")
    for r in rows:
        if r["named"] or r["flagged"] or r["verdict"] in ALARMS:
            print(f"  {r['seed']} {r['family']}, {r['motion']}: {_told(r)}")


def report_hidden(rows: list[Row]) -> None:
    """Print the shares of the logs with a hidden effect, by ratio and by effect, and every one that is not right."""
    print(f"\nhidden effects: {len(rows)}, verdicts {dict(Counter(r['verdict'] for r in rows))}")
    print("\n| hidden | first | false name | consistent |\n|---|---|---|---|")
    for label, part in ((f"ratio >= {STRONG:g}", [r for r in rows if r["ratio"] >= STRONG]), ("all", rows)):
        counts = (sum(first(r) for r in part), sum(false_name(r) for r in part), _consistent(part))
        print(f"| {label} | {' | '.join(interval(count, len(part)) for count in counts)} |")
    print("\n| effect | first | false name | consistent | answers |\n|---|---|---|---|---|")
    for effect in sorted({r["name"] for r in rows}):
        part = [r for r in rows if r["name"] == effect]
        counts = (sum(first(r) for r in part), sum(false_name(r) for r in part), _consistent(part))
        answers = dict(Counter("+".join(r["named"]) or r["verdict"] for r in part).most_common(4))
        print(f"| {effect} | {' | '.join(f'{count}/{len(part)}' for count in counts)} | {answers} |")
    print()
    for r in rows:
        if not first(r) or false_name(r):
            print(f"  {r['seed']} {r['name']}, ratio {r['ratio']:.1f}, {r['family']}, {r['motion']}: {_told(r)}")


def report_answers(title: str, rows: list[Row]) -> None:
    """Print what was answered to logs of which no name is right."""
    print(f"\n{title}: {len(rows)}, verdicts {dict(Counter(r['verdict'] for r in rows))}")
    print(f"  named: {interval(sum(bool(r['named']) for r in rows), len(rows))}")
    print(f"  consistent: {interval(_consistent(rows), len(rows))}")
    for name in sorted({r["name"] for r in rows}):
        part = [r for r in rows if r["name"] == name]
        print(f"  {name}: {dict(Counter('+'.join(r['named']) or r['verdict'] for r in part).most_common())}")


def _consistent(rows: list[Row]) -> int:
    return sum(r["verdict"] == "consistent" for r in rows)


def _told(row: Row) -> str:
    flags = f", flagged {', '.join(row['flagged'])}" if row["flagged"] else ""
    return f"{row['verdict']} {' + '.join(row['named'])}{flags} {row.get('why', '')[:100]}".rstrip()


def report(rows: list[Row]) -> None:
    """Print the shares of every group that was asked for."""
    groups = {group: [r for r in rows if group_of(r["seed"]) == group] for group in (CLEAN, HIDDEN, FOREIGN, BROKEN)}
    if groups[CLEAN]:
        report_clean(groups[CLEAN])
    if groups[HIDDEN]:
        report_hidden(groups[HIDDEN])
    if groups[FOREIGN]:
        report_answers("effects outside the catalogue", groups[FOREIGN])
    if groups[BROKEN]:
        report_answers("spoiled logs", groups[BROKEN])


def read_rows(path: Path | None) -> dict[int, Row | None]:
    """Return the rows by seed that a file holds."""
    if path is None or not path.exists():
        return {}
    return dict(json.loads(line) for line in path.read_text(encoding="utf-8").splitlines())


def judged(seeds: list[int], jobs: int | None, path: Path | None) -> list[Row]:
    """Return the rows of these seeds; those that the file holds are not judged again."""
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    from rich.progress import track

    known = read_rows(path)
    left = [seed for seed in seeds if seed not in known]
    os.environ["OPENBLAS_NUM_THREADS"] = "1"  # read by the processes that are started
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        for seed, row in zip(left, track(pool.map(row_of, left), description="logs", total=len(left)), strict=True):
            known[seed] = row
            if path is not None:
                with path.open("a", encoding="utf-8") as file:
                    file.write(json.dumps([seed, row], default=float) + "\n")
    for seed in seeds:
        if known[seed] is None:
            print(f"{seed} ({name_of(seed) or 'clean'}): none of its worlds fits")
    return [row for seed in seeds if (row := known[seed]) is not None]


def main() -> None:
    """Judge the diagnosis on the fourth simulator's logs and print the shares."""
    from tests.benchmarks.fourth.axis import gcc

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--clean", type=int, default=100, help="clean logs")
    parser.add_argument("--hidden", type=int, default=100, help="logs with one hidden effect of the catalogue")
    parser.add_argument("--outside", type=int, default=0, help="logs with an effect outside the catalogue")
    parser.add_argument("--spoiled", type=int, default=0, help="logs that were spoiled")
    parser.add_argument("--first", type=int, default=0, help="number of the first log of each group")
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    parser.add_argument("--rows", type=Path, default=None, help="keeps every row: a run that was stopped goes on")
    args = parser.parse_args()
    if gcc() is None:
        print("gcc not installed: the fourth simulator cannot be compiled, NOTHING JUDGED")
        return
    wanted = {CLEAN: args.clean, HIDDEN: args.hidden, FOREIGN: args.outside, BROKEN: args.spoiled}
    seeds = [seed_of(group, args.first + n) for group, count in wanted.items() for n in range(count)]
    report(judged(seeds, args.jobs, args.rows))


if __name__ == "__main__":
    main()

"""The rows of a run as the two tables of the page."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from tests.benchmarks.worlds.judge import interval

__all__ = ["merged", "report"]

Row = dict[str, Any]
STRONG = 3.0  # margin from which on an effect is plain to see
TIMING = "delay"  # when a channel was sampled, rather than what the drive does


def merged(*runs: Iterable[Row]) -> list[Row]:
    """Return the rows of several runs; of the same method on the same log the later one counts."""
    out: dict[tuple[Any, ...], Row] = {}
    for row in (row for run in runs for row in run):
        out[row["method"], row["case"], row["seed"], row["hidden"]] = row
    return list(out.values())


def report(rows: list[Row]) -> None:
    """Print a table of the worlds, of what was named in clean ones, of failures, and of EMPS."""
    worlds = [row for row in rows if row["case"] == "world"]
    methods = list(dict.fromkeys(row["method"] for row in rows))
    clean = {m: [r for r in worlds if r["method"] == m and r["hidden"] is None] for m in methods}
    hidden = {m: [r for r in worlds if r["method"] == m and r["hidden"] is not None] for m in methods}
    strong = {m: [r for r in hidden[m] if r["margin"] >= STRONG] for m in methods}
    print(
        "\n| method | clean logs with a name | other than `delay` | hidden, margin 3 and more: right name first |"
        " among the names | with a false name | other than `delay` | below 3: right first | with a false name |"
    )
    print("|---|" + "---|" * 8)
    for m in methods:
        if worlds and (clean[m] or hidden[m]):
            weak = [r for r in hidden[m] if r["margin"] < STRONG]
            print(f"| {m} | {_false(clean[m])} | {_false(clean[m], True)} | {_share(strong[m], 'first')} | "
                  f"{_share(strong[m], 'contained')} | {_false(strong[m])} | {_false(strong[m], True)} | "
                  f"{_share(weak, 'first')} | {_false(weak)} |")  # fmt: skip
    base = {_log(r): r for r in worlds if r["method"] == "base model alone" and r.get("held_out")}
    print(
        "\n| method | false names per clean log | error on the held-out record, in that of the base model: clean logs |"
        " hidden, margin 3 and more | 90 % below, clean | time per log, s (median) |"
    )
    print("|---|" + "---|" * 5)
    for m in methods:
        if clean[m]:
            count = np.mean([len(r["false"]) for r in clean[m]])
            at = [r["seconds"] for r in clean[m] + hidden[m]]
            print(f"| {m} | {count:.2f} | {_ratio(clean[m], base)} | {_ratio(strong[m], base)} | "
                  f"{_ratio(clean[m], base, 90)} | {np.median(at):.2f} |")  # fmt: skip
    for m in methods:
        names: dict[str, int] = {}
        for name in (n for r in clean[m] for n in r["false"]):
            names[name] = names.get(name, 0) + 1
        if names:
            often = sorted(names.items(), key=lambda item: -item[1])[:6]
            print(f"{m}, clean logs: {', '.join(f'{n} {k}' for n, k in often)}")
    for row in rows:
        if row.get("why"):
            print(f"failed: {row['method']}, seed {row['seed']}: {row['why'][:120]}")
    _itself(strong)
    _emps([row for row in rows if row["case"] == "emps"])


def _itself(strong: dict[str, list[Row]]) -> None:
    for m, part in strong.items():
        if any(e for r in part for e in r["equivalents"]):
            print(f"{m}, margin 3 and more: right name first without equivalents {_share(part, 'first_itself')}")


def _emps(rows: list[Row]) -> None:
    if not rows:
        return
    print("\n| method on EMPS | names | torque error, % | on the held-out pulses, % | time, s |\n|---|---|---|---|---|")
    for r in rows:
        errors = (f"{100 * r[k]:.2f}" if r.get(k) else "-" for k in ("error", "held_out"))
        print(f"| {r['method']} | {', '.join(r['named']) or r.get('why', 'none')} | {' | '.join(errors)} | "
              f"{r['seconds']:.1f} |")  # fmt: skip


def _log(row: Row) -> tuple[Any, ...]:
    return row["seed"], row["hidden"]


def _share(rows: list[Row], key: str) -> str:
    return interval(sum(bool(r[key]) for r in rows), len(rows))


def _false(rows: list[Row], but_timing: bool = False) -> str:
    hits = sum(any(n != TIMING or not but_timing for n in r["false"]) for r in rows)
    return interval(hits, len(rows))


def _ratio(rows: list[Row], base: dict[tuple[Any, ...], Row], percentile: float = 50) -> str:
    ratios = [r["held_out"] / base[_log(r)]["held_out"] for r in rows if r.get("held_out") and _log(r) in base]
    return f"{np.percentile(ratios, percentile):.3f}" if ratios else "-"

"""The rows of a run as the tables of the page."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from tests.benchmarks.peers.marks import TIMING, marks

__all__ = ["merged", "report"]

Row = dict[str, Any]
STRONG = 3.0  # margin from which on an effect is plain to see
BASE = "base model alone"


def merged(*runs: Iterable[Row]) -> list[Row]:
    """Return the rows of several runs; of the same method on the same log the later one counts."""
    out: dict[tuple[Any, ...], Row] = {}
    for row in (row for run in runs for row in run):
        out[row["method"], *_log(row)] = row
    return list(out.values())


def report(rows: list[Row]) -> None:
    """Print tables of clean and hidden worlds, what was named in clean ones, failures, and EMPS."""
    base = {_log(r): r["held_out"] for r in rows if r["method"] == BASE and r.get("held_out")}
    worlds = [row for row in rows if row["case"] == "world"]
    clean = _by_method(r for r in worlds if r["hidden"] is None)
    strong = _by_method(r for r in worlds if r["hidden"] is not None and r["margin"] >= STRONG)
    weak = _by_method(r for r in worlds if r["hidden"] is not None and r["margin"] < STRONG)
    _table(
        "clean logs | with a name | with another one than `delay` | names a log | held-out error | 90 % of logs below |"
        " time a log, s",
        [[m, *_of_clean(part, base)] for m, part in clean.items()],
    )
    for title, hidden in (("margin 3 and more", strong), ("margin below 3", weak)):
        _table(
            f"hidden, {title} | right name first | first, `delay` aside | among the names | with a false name |"
            " with another one than `delay` | held-out error",
            [[m, *_of_hidden(part, base)] for m, part in hidden.items()],
        )
    for m, part in strong.items():
        if any(e for r in part for e in r["equivalents"]):
            aside = _share(part, "first_itself")
            print(f"{m}, margin 3 and more: right name first, `delay` and equivalents aside, {aside}")
    for m, part in clean.items():
        names = Counter(n for r in part for n in marks(r).false).most_common(6)
        if names:
            print(f"{m}, clean logs: {', '.join(f'{n} {k}' for n, k in names)}")
    for row in rows:
        if row.get("why"):
            print(f"failed: {row['method']}, seed {row['seed']}: {row['why'][:120]}")
    _emps([row for row in rows if row["case"] == "emps"])


def _of_clean(part: list[Row], base: Mapping[tuple[Any, ...], float]) -> list[str]:
    names = np.mean([len(marks(r).false) for r in part])
    seconds = np.median([r["seconds"] for r in part])
    return [
        _false(part), _false(part, True), f"{names:.2f}", _ratio(part, base), _ratio(part, base, 90), f"{seconds:.2f}"
    ]  # fmt: skip


def _of_hidden(part: list[Row], base: Mapping[tuple[Any, ...], float]) -> list[str]:
    shares = [_share(part, key) for key in ("first", "first_but_timing", "contained")]
    return [*shares, _false(part), _false(part, True), _ratio(part, base)]


def _emps(rows: list[Row]) -> None:
    _table(
        "EMPS | names | torque error, % | on the held-out pulses, %",
        [
            [r["method"], ", ".join(r["named"]) or r.get("why", "none")]
            + [f"{100 * r[k]:.2f}" if r.get(k) else "-" for k in ("error", "held_out")]
            for r in rows
        ],
    )
    for r in rows:
        if "parameters" in r:
            print(f"{r['method']}: {', '.join(f'{k} {v:.4g}' for k, v in r['parameters'].items())}")


def _table(heading: str, lines: list[list[str]]) -> None:
    if lines:
        print(f"\n| {heading} |\n|" + "---|" * len(lines[0]))
        for line in lines:
            print(f"| {' | '.join(line)} |")


def _by_method(rows: Iterable[Row]) -> dict[str, list[Row]]:
    out: dict[str, list[Row]] = {}
    for row in rows:
        out.setdefault(row["method"], []).append(row)
    return out


def _log(row: Row) -> tuple[Any, ...]:
    return row["case"], row["seed"], row["hidden"]


def _share(rows: list[Row], key: str) -> str:
    return _counted(sum(getattr(marks(r), key) for r in rows), len(rows))


def _false(rows: list[Row], but_timing: bool = False) -> str:
    hits = sum(any(n != TIMING or not but_timing for n in marks(r).false) for r in rows)
    return _counted(hits, len(rows))


def _counted(hits: int, total: int) -> str:
    """Return a count with the 95 % interval of its share, after C. J. Clopper, E. S. Pearson, Biometrika 26 (1934)."""
    from scipy.stats import binomtest

    if total == 0:
        return "-"
    share = binomtest(hits, total).proportion_ci(0.95, "exact")
    return f"{hits} of {total} ({100 * share.low:.0f} to {100 * share.high:.0f} %)"


def _ratio(rows: list[Row], base: Mapping[tuple[Any, ...], float], percentile: float = 50) -> str:
    """Error on the held-out record over that of the base model, a percentile over the logs."""
    ratios = [r["held_out"] / base[_log(r)] for r in rows if r.get("held_out") and _log(r) in base]
    return f"{np.percentile(ratios, percentile):.3f}" if ratios else "-"

"""What was identified on one axis over the years: a small file that each study adds a line to, and its section.

An entry is known by what it was made from (log, design, version of the package), so that a study that is run
again replaces its own entry instead of adding another, and the page stays the same.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.result import Estimate, Section, jsonable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Entry", "extended", "history_section", "history_text", "read_history"]

SCHEMA = "pmsm-ctrl/history/1"
NOTABLE = 3.0  # standard errors between neighbours from which a change is pointed out
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00")


@dataclass(frozen=True)
class Entry:
    """One identification.

    Attributes
    ----------
    log : str
        Name of the record.
    key : tuple of str
        Hashes of log and design, and the version of the package.
    parameters : mapping of symbol to Estimate
    error : float
        Relative error that the identified model leaves, as a share of the torque.
    """

    log: str
    key: tuple[str, str, str]
    parameters: Mapping[str, Estimate]
    error: float


def read_history(path: str | os.PathLike[str]) -> tuple[Entry, ...]:
    """Return the entries of a history file, oldest first; none when there is no such file.

    Raises
    ------
    RequestError
        When the file cannot be read or is no history.
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
    except FileNotFoundError:
        return ()
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "not UTF-8 text"
        raise RequestError(f"{path}: cannot be read as a history ({reason})") from None
    try:
        data = json.loads(text)
        if data["schema"] != SCHEMA:
            raise ValueError
        return tuple(_entry(item) for item in data["entries"])
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise RequestError(
            f"{path}: not a history; a file that `pmsm-ctrl study --history` wrote was expected"
        ) from None


def _entry(item: Mapping[str, Any]) -> Entry:
    parameters = {
        str(symbol): Estimate(
            float(found["value"]), str(found["unit"]), math.nan if found["stderr"] is None else float(found["stderr"])
        )
        for symbol, found in item["parameters"].items()
    }
    log, design, version = (str(word) for word in item["key"])
    return Entry(str(item["log"]), (log, design, version), parameters, float(item["error"]))


def extended(entries: Sequence[Entry], new: Entry) -> tuple[Entry, ...]:
    """Return the entries with the new one last, or in the place of the one made from the same things."""
    if any(entry.key == new.key for entry in entries):
        return tuple(new if entry.key == new.key else entry for entry in entries)
    return (*entries, new)


def history_text(entries: Sequence[Entry]) -> str:
    """Return the content of a history file."""
    rows = [
        {"log": e.log, "key": list(e.key), "error": e.error, "parameters": jsonable(dict(e.parameters))}
        for e in entries
    ]
    return json.dumps({"schema": SCHEMA, "entries": rows}, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def history_section(entries: Sequence[Entry]) -> Section:
    """Return the section: a row an entry, what changed by more than its errors, and a picture."""
    symbols = tuple(dict.fromkeys(symbol for entry in entries for symbol in entry.parameters))
    units = {symbol: e.parameters[symbol].unit for symbol in symbols for e in entries if symbol in e.parameters}
    header = ("log", "version", *(f"{symbol} [{units[symbol]}]" for symbol in symbols), "error left")
    rows = tuple(
        (e.log, e.key[2], *(_cell(e.parameters.get(symbol)) for symbol in symbols), f"{100.0 * e.error:.2f} %")
        for e in entries
    )
    changes = _changes(entries, symbols)
    said = changes or (
        ("No parameter has changed by more than its standard errors allow.",)
        if len(entries) > 1
        else ("The first entry; the next study with this history stands beside it.",)
    )
    figures = ((_figure(entries, symbols), "Bars are two standard errors. A step larger than they are is a change."),)
    return Section("The parameters so far", said, ((header, rows),), figures if len(entries) > 1 else ())


def _cell(found: Estimate | None) -> str:
    if found is None:
        return "-"
    return f"{found.value:.5g}" + (f" ± {found.stderr:.1g}" if math.isfinite(found.stderr) else "")


def _changes(entries: Sequence[Entry], symbols: Sequence[str]) -> tuple[str, ...]:
    """Name the changes between neighbours that their standard errors do not explain."""
    found = []
    for before, after in pairwise(entries):
        for symbol in symbols:
            if symbol not in before.parameters or symbol not in after.parameters:
                continue
            a, b = before.parameters[symbol], after.parameters[symbol]
            spread = math.hypot(a.stderr, b.stderr)
            if spread > 0.0 and abs(b.value - a.value) > NOTABLE * spread:
                share = f"{100.0 * (b.value / a.value - 1.0):+.1f} %, " if a.value else ""
                found.append(
                    f"{symbol} changed from {a.value:.4g} ({before.log}) to {b.value:.4g} {b.unit} ({after.log}): "
                    f"{share}{abs(b.value - a.value) / spread:.1f} standard errors."
                )
    return tuple(found)


def _figure(entries: Sequence[Entry], symbols: Sequence[str]) -> Figure:
    """Draw each parameter relative to its first value, one panel each."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.6, 1.0 + 1.3 * len(symbols)), layout="constrained")
    panels = figure.subplots(len(symbols), 1, sharex=True, squeeze=False)[:, 0]
    for axes, symbol, colour in zip(panels, symbols, COLOURS * len(symbols), strict=False):
        places = [k for k, entry in enumerate(entries) if symbol in entry.parameters]
        shown = [entries[k].parameters[symbol] for k in places]
        bars = [2.0 * e.stderr if math.isfinite(e.stderr) else 0.0 for e in shown]
        axes.errorbar(places, [e.value for e in shown], bars, fmt="o-", color=colour, capsize=4)
        axes.set_ylabel(f"{symbol} [{shown[0].unit}]")
        axes.grid(alpha=0.3)
    panels[-1].set_xticks(range(len(entries)), [entry.log for entry in entries], rotation=20, ha="right")
    panels[-1].set_xlabel("record, in the order of the studies")
    return figure

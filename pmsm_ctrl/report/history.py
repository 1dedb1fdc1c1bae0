"""Identified parameters of one axis over time: a small file to which each study adds an entry.

An entry is identified by its log, its design and the version of the package, so that a repeated study replaces its own
entry and gives the same page.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.result import Estimate, jsonable

__all__ = ["Entry", "extended", "history_text", "read_history"]

SCHEMA = "pmsm-ctrl/history/1"


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

"""Identified parameters of one axis over time: a small file to which each study adds an entry.

An entry is identified by its log, its design and the version of the package, so that a repeated study replaces its own
entry and gives the same page. An entry is one line, added by one system call: two studies at once lose none.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.files import read_text
from pmsm_ctrl.result import Estimate, jsonable

__all__ = ["Entry", "add_entry", "extended", "read_history"]

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

    Of several entries made from the same things the last one counts, in the place of the first. A line that was never
    finished, because the disk was full or the machine went down, is left out.

    Raises
    ------
    RequestError
        When the file cannot be read or is no history.
    """
    try:
        text = read_text(path)
    except FileNotFoundError:
        return ()
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "not UTF-8 text"
        raise RequestError(f"{path}: cannot be read as a history ({reason})") from None
    entries: tuple[Entry, ...] = ()
    try:
        for item in _finished(text):
            if item["schema"] != SCHEMA:
                raise ValueError
            entries = extended(entries, _entry(item))
        if text and not entries:
            raise ValueError
        return entries
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise RequestError(
            f"{path}: not a history; a file that `pmsm-ctrl study --history` wrote was expected"
        ) from None


def _finished(text: str) -> Iterator[Any]:
    """Yield what the lines say, but for those that were never finished."""
    for line in text.split("\n"):
        with suppress(json.JSONDecodeError):
            yield json.loads(line)


def _entry(item: Mapping[str, Any]) -> Entry:
    def number(value: Any) -> float:
        return math.nan if value is None else float(value)

    parameters = {
        str(symbol): Estimate(
            float(found["value"]), str(found["unit"]), number(found["stderr"]),
            None if found.get("nominal") is None else float(found["nominal"]),
        )
        for symbol, found in item["parameters"].items()
    }  # fmt: skip
    log, design, version = (str(word) for word in item["key"])
    return Entry(str(item["log"]), (log, design, version), parameters, float(item["error"]))


def extended(entries: Sequence[Entry], new: Entry) -> tuple[Entry, ...]:
    """Return the entries with the new one last, or in the place of the one made from the same things."""
    if any(entry.key == new.key for entry in entries):
        return tuple(new if entry.key == new.key else entry for entry in entries)
    return (*entries, new)


def add_entry(path: str | os.PathLike[str], new: Entry) -> tuple[Entry, ...]:
    """Add an entry to a history file and return all of its entries; one that stands there already is not added again.

    Parameters
    ----------
    path : path
        A file that `read_history` accepts, or one that does not exist yet.
    new : Entry

    Returns
    -------
    tuple of Entry

    Raises
    ------
    RequestError
        When the file is no history, or cannot be written.
    """
    entries = read_history(path)
    if all(_line(entry) != _line(new) for entry in entries):
        try:
            _append(path, _line(new))
        except OSError as error:
            raise RequestError(f"{path}: cannot be written ({error.strerror})") from None
    return extended(entries, new)


def _line(entry: Entry) -> str:
    row = {"schema": SCHEMA, "log": entry.log, "key": list(entry.key), "error": entry.error}
    return json.dumps(row | {"parameters": jsonable(dict(entry.parameters))}, ensure_ascii=False, allow_nan=False)


def _append(path: str | os.PathLike[str], line: str) -> None:
    """Write one line at the end of a file with one call, which the system does not mix with that of another process."""
    handle = os.open(path, os.O_RDWR | os.O_APPEND | os.O_CREAT, 0o666)
    try:
        unfinished = os.fstat(handle).st_size > 0 and not Path(path).read_bytes().endswith(b"\n")
        start = "\n" if unfinished else ""
        os.write(handle, f"{start}{line}\n".encode(errors="backslashreplace"))
    finally:
        os.close(handle)

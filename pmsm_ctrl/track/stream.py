"""Samples that arrive: lines of a growing file or of standard input, as channels in SI units.

A source may restart: a file that is replaced or cut is opened again, and its header is read again.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TextIO

from pmsm_ctrl.errors import LogError
from pmsm_ctrl.importers.names import guess_channel, split_header, unit_of
from pmsm_ctrl.log import CHANNELS

__all__ = ["IDLE", "REOPENED", "Header", "follow", "lines_of", "read_header"]

POLL = 0.1  # s between two looks at a file
SEPARATORS = (";", "\t", ",")
# What a source says beside its lines: nothing came for a while; it was opened again.
IDLE, REOPENED = "\x00idle", "\x00reopened"


class Header:
    """The columns of a stream that are channels.

    Parameters
    ----------
    separator : str
    columns : dict of str to (int, float)
        Channel to column and factor to SI units.
    """

    def __init__(self, separator: str, columns: Mapping[str, tuple[int, float]]) -> None:
        self.separator, self.columns = separator, dict(columns)

    def values(self, line: str) -> dict[str, float] | None:
        """Return the channels of a line; None for a line that is damaged.

        Parameters
        ----------
        line : str

        Returns
        -------
        dict of str to float, or None
        """
        cells = line.split(self.separator)
        out = {}
        for name, (column, factor) in self.columns.items():
            if column >= len(cells):
                return None
            text = cells[column].strip()
            try:
                out[name] = factor * float(text if self.separator == "," else text.replace(",", "."))
            except ValueError:
                return None
        return out


def read_header(line: str, mapping: Mapping[str, str] | None = None, motion: str = "rotary") -> Header | None:
    """Return the columns that a line of labels names; None for a line that is no header.

    Parameters
    ----------
    line : str
    mapping : dict of str to str, optional
        Channel to column, ``speed [rpm]``.
    motion : {"rotary", "linear"}

    Returns
    -------
    Header or None

    Raises
    ------
    LogError
        When a mapped column is not there, or a unit does not belong to its channel.
    """
    separator = next((one for one in SEPARATORS if one in line), ",")
    labels = [split_header(cell.strip().strip('"')) for cell in line.strip().split(separator)]
    wanted = {split_header(column): channel for channel, column in (mapping or {}).items()}
    by_name = {name: (channel, unit) for (name, unit), channel in wanted.items()}
    columns: dict[str, tuple[int, float]] = {}
    for k, (name, unit) in enumerate(labels):
        channel, stated = by_name[name] if name in by_name else (guess_channel(name), "")
        if channel is None or channel in columns:
            continue
        own = CHANNELS[channel][1 if motion == "linear" else 0]
        found = unit_of(stated or unit) if (stated or unit) else (own, 1.0)
        if found is None or found[0] != own:
            raise LogError(f"column '{name} [{stated or unit}]': {own} or a unit that converts to it was expected")
        columns[channel] = (k, found[1])
    missing = [channel for channel in mapping or {} if channel not in columns]
    if len(columns) < 2:
        return None
    if missing:
        raise LogError(f"--map: no column for {', '.join(missing)} (columns: {line.strip()})")
    return Header(separator, columns)


def lines_of(stream: TextIO | Iterable[str]) -> Iterator[str]:
    """Yield the lines of a stream until it ends.

    Parameters
    ----------
    stream : text stream or iterable of str

    Yields
    ------
    str
    """
    yield from (line for line in stream if line.strip())


def follow(path: str | os.PathLike[str], *, poll: float = POLL) -> Iterator[str]:
    """Yield the lines of a growing file, for ever; `IDLE` where nothing came, `REOPENED` where the file is a new one.

    Parameters
    ----------
    path : path
        Need not exist yet.
    poll : float
        Time between two looks, s.

    Yields
    ------
    str
        Whole lines.
    """
    target, known, first = Path(path), (-1, -1), True
    while True:
        try:
            stream = open(target, encoding="utf-8", errors="replace", newline="")  # noqa: SIM115 - kept over yields
        except FileNotFoundError:
            yield IDLE
            time.sleep(poll)
            continue
        with stream:
            if not first:
                yield REOPENED
            first = False
            rest = ""
            known = _identity(os.fstat(stream.fileno()))
            while True:
                piece = stream.read(1 << 16)
                if piece:
                    *whole, rest = (rest + piece).split("\n")
                    yield from (line for line in whole if line.strip())
                    continue
                yield IDLE
                if _replaced(target, known, stream.tell()):
                    break
                time.sleep(poll)


def _identity(found: os.stat_result) -> tuple[int, int]:
    return found.st_dev, found.st_ino


def _replaced(target: Path, known: tuple[int, int], read: int) -> bool:
    try:
        found = os.stat(target)
    except OSError:  # it is gone, and may come back
        return True
    return _identity(found) != known or found.st_size < read

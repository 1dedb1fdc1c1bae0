"""Samples that arrive: lines of a growing file or of standard input, as channels in SI units.

A source may restart: a file that is replaced or cut is opened again, and its header is read again.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

from pmsm_ctrl.design_parts import LogMap
from pmsm_ctrl.errors import LogError
from pmsm_ctrl.importers.clock import is_clock
from pmsm_ctrl.importers.mapping import find_column, stated_factor
from pmsm_ctrl.importers.names import counts_of, guess_channel, split_header, unit_of
from pmsm_ctrl.importers.table import Column, Table
from pmsm_ctrl.log import CHANNELS
from pmsm_ctrl.units import encoder_step

__all__ = ["IDLE", "MISSING", "REOPENED", "Header", "decoded", "follow", "lines_of", "read_header", "with_units"]

POLL = 0.1  # s between two looks at a file
SEPARATORS = (";", "\t", ",")
USED = ("t", "theta", "omega", "i_q", "i_d", "torque", "T_load")  # channels that a tracker takes
# What a source says beside its lines: nothing came for a while; it is not there; it was opened again.
IDLE, MISSING, REOPENED = "\x00idle", "\x00missing", "\x00reopened"


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


def read_header(
    line: str, mapping: Mapping[str, str] | None = None, motion: str = "rotary", *, design: LogMap | None = None,
    counts: int = 0,
) -> Header | None:  # fmt: skip
    """Return the columns that a line of labels names; None for a line that is no header.

    Parameters
    ----------
    line : str
    mapping : dict of str to str, optional
        Channel to column, ``speed [rpm]``; takes precedence over that of the design.
    motion : {"rotary", "linear"}
    design : LogMap, optional
        The [log] table of the design. What it states of columns that the stream does not have is left out.
    counts : int
        Encoder counts of a turn, or a metre, where the design states them.

    Returns
    -------
    Header or None

    Raises
    ------
    LogError
        When a mapped column is not there, or a unit does not belong to its channel.
    """
    separator = next((one for one in SEPARATORS if one in line), ",")
    cells = [cell.strip().strip('"') for cell in line.strip().lstrip("\ufeff").split(separator)]
    labels = tuple(Column(*split_header(cell), header=cell) for cell in cells)
    table = Table("--map", "stream", labels, lambda _: [], lambda *_: "")
    chosen = _mapped(table, design.channels if design is not None else {}, mapping or {})
    stated, taken = {*chosen} - {*(mapping or {})}, {column for column, _, _ in chosen.values()}
    for k, label in enumerate(labels):  # as in a file: where the design names the columns, no other name is guessed
        channel = (label.name if label.name in CHANNELS else None) if stated else guess_channel(label.name)
        if channel is not None and channel not in chosen and k not in taken:
            chosen[channel] = (k, "", 1.0)
    if len(chosen) < 2:
        return None
    missing = [channel for channel in mapping or {} if channel not in chosen]
    if missing:
        raise LogError(f"--map: no column for {', '.join(missing)} (columns: {line.strip()})")
    scale = design.scale if design is not None else {}
    columns = {}
    for channel, (k, unit, factor) in chosen.items():
        if channel in USED:
            own = CHANNELS[channel][1 if motion == "linear" else 0]
            counted = counts > 0 and counts_of(unit or labels[k].unit) == CHANNELS[channel][0]
            factor *= encoder_step(counts, motion) if counted else _to_own(labels[k], unit, own, channel in scale)
            columns[channel] = (k, factor * scale.get(channel, 1.0))
    return Header(separator, columns)


def with_units(labels: str, line: str) -> str | None:
    """Return a line of labels with the units that the line below it states; None where that is no row of units.

    Parameters
    ----------
    labels, line : str

    Returns
    -------
    str or None
    """
    separator = next((one for one in SEPARATORS if one in labels), ",")
    names, cells = ([cell.strip() for cell in one.split(separator)] for one in (labels, line))
    units = [cell.strip('"').strip("[]()").strip() for cell in cells]
    stated = [unit for unit in units if unit not in ("", "-")]
    if len(names) != len(units) or not any(map(str.isalpha, "".join(stated))):
        return None
    if any(unit_of(unit) is None for unit in stated):
        return None
    quoted = ((name.strip('"'), unit if unit in stated else "") for name, unit in zip(names, units, strict=True))
    return separator.join(f"{name} [{unit}]" if unit and "[" not in name else name for name, unit in quoted)


def _mapped(table: Table, stated: Mapping[str, str], given: Mapping[str, str]) -> dict[str, tuple[int, str, float]]:
    """Return column, unit and factor of every channel that a mapping names and the header has.

    A header with the package's own names is right about them, whatever the design states of the drive's files.
    """
    found = {}
    canonical = all(column.name in CHANNELS and column.unit for column in table.columns)
    for channel, spec in {**stated, **given}.items():
        if channel not in CHANNELS or is_clock(spec):
            continue
        factor, name = stated_factor(table, spec)
        with suppress(LogError):  # a column that is not there
            column, unit = find_column(table, channel, name)
            if channel in given or not canonical or table.columns[column].name == channel:
                found[channel] = (column, unit, factor)
    return found


def _to_own(column: Column, stated: str, own: str, scaled: bool) -> float:
    """Return the factor from the unit of a column to the channel's own; one where the design gives a scale alone."""
    unit = stated or column.unit
    found = unit_of(unit) if unit else (own, 1.0)
    if scaled:
        return 1.0 if found is None else found[1]
    if found is None or found[0] != own:
        raise LogError(f"column '{column.name} [{unit}]': {own} or a unit that converts to it was expected")
    return found[1]


def lines_of(stream: IO[Any] | Iterable[str]) -> Iterator[str]:
    """Yield the lines of a stream until it ends.

    Parameters
    ----------
    stream : stream or iterable of str
        Of bytes as well: UTF-8, or Latin-1 where a line is none.

    Yields
    ------
    str
    """
    yield from (decoded(line) if isinstance(line, bytes) else line for line in stream if line.strip())


def decoded(line: bytes) -> str:
    """Return a line as text: UTF-8, or Latin-1 where it is none.

    Parameters
    ----------
    line : bytes

    Returns
    -------
    str
    """
    try:
        return line.decode("utf-8")
    except UnicodeDecodeError:
        return line.decode("latin-1")


def follow(path: str | os.PathLike[str], *, poll: float = POLL) -> Iterator[str]:
    """Yield the lines of a growing file, for ever.

    `IDLE` stands where nothing came, `MISSING` where there is no file, `REOPENED` where the file is a new one.

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
            stream = open(target, "rb")  # noqa: SIM115 - kept over yields
        except FileNotFoundError:
            yield MISSING
            time.sleep(poll)
            continue
        with stream:
            if not first:
                yield REOPENED
            first = False
            rest = b""
            known = _identity(os.fstat(stream.fileno()))
            while True:
                piece = stream.read(1 << 16)
                if piece:
                    *whole, rest = (rest + piece).split(b"\n")
                    yield from (decoded(line) for line in whole if line.strip())
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

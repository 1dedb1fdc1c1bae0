"""CSV and other text files of numbers as a `Table`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise, zip_longest
from pathlib import Path
from typing import Literal, cast

import numpy as np

from pmsm_ctrl.errors import LogError
from pmsm_ctrl.importers import twincat
from pmsm_ctrl.importers.ending import last_lines, without_ending
from pmsm_ctrl.importers.header_rate import header_period
from pmsm_ctrl.importers.layout import Layout, is_number, opening, place_header, separator_name, split_line
from pmsm_ctrl.importers.names import guess_channel, split_header, unit_of
from pmsm_ctrl.importers.numbers import line_of_row, read_columns
from pmsm_ctrl.importers.stamps import with_stamps
from pmsm_ctrl.importers.table import Array, Column, Table, one_line
from pmsm_ctrl.importers.vocabulary import begins_with_time
from pmsm_ctrl.log import CHANNELS

__all__ = ["open_text"]

Decimal = Literal[".", ","]


def open_text(path: Path, file: str, separator: str | None = None, decimal: str | None = None) -> Table:
    """Open a text file; a given separator or decimal mark is used as it is.

    Raises
    ------
    LogError
        When the file is not text, is empty, or holds no rows of numbers.
    """
    lines, encoding, found = opening(path, file, separator)
    scope = twincat.recognise(lines, found, encoding, file)
    if scope is not None:
        layout, columns = scope
        kind = "TwinCAT Scope CSV"
    else:
        layout = with_stamps(place_header(lines, found, encoding, file), lines)
        columns = _columns(layout, lines)
        canonical = all(column.name in CHANNELS and column.unit for column in columns)
        kind = "canonical CSV" if canonical else "CSV"
        if any(column.group for column in columns):
            layout, kind = replace(layout, ragged=True), "CSV with repeated time columns"
    if decimal is not None:
        layout = replace(layout, decimal=cast(Decimal, decimal))
    layout = without_ending(path, layout)
    if layout.ragged and scope is None:
        layout, columns = _with_as_many(path, layout, columns)
    table = _table(path, file, layout, columns, kind)
    return replace(table, header_period=header_period(lines[: layout.first_line - 1]))


def _columns(layout: Layout, lines: Sequence[str]) -> tuple[Column, ...]:
    """Name and unit of every column; a time column that is not the only one begins a group of its own."""
    named = []
    for i in range(layout.width):
        header = layout.header[i] if i < len(layout.header) else ""
        name, unit = split_header(header)
        if i < len(layout.units) and layout.units[i] not in ("", "-"):
            unit = layout.units[i]
        named.append(Column(name=name, unit=unit, header=header, is_text=i in layout.text_columns))
    if layout.stamps is not None:
        at = layout.stamps.column
        named[at] = replace(named[at], unit="s", is_time=True, is_date=True)
        return tuple(named)
    is_time = [guess_channel(column.name) == "t" and not column.is_text for column in named]
    if sum(is_time) < 2:
        is_time = _worded_times(named, layout, lines)
    if sum(is_time) < 2 or not is_time[0]:
        return tuple(named)
    groups = np.cumsum(is_time) - 1
    return tuple(
        replace(column, group=int(group), is_time=time)
        for column, group, time in zip(named, groups, is_time, strict=True)
    )


def _worded_times(named: Sequence[Column], layout: Layout, lines: Sequence[str]) -> list[bool]:
    """Return which columns are times of those that follow, by their names, units and numbers: ``Time current [ms]``.

    One that has no other column behind it is no such time, nor one that does not increase.
    """
    cells = [split_line(line, layout.separator) for line in lines[layout.first_line - 1 :]]
    out = []
    for i, column in enumerate(named):
        worded = begins_with_time(column.name) and (unit_of(column.unit) or ("",))[0] == "s" and not column.is_text
        out.append(worded and _increases([row[i] for row in cells if len(row) == layout.width and row[i]]))
    return [here and not after for here, after in zip(out, [*out[1:], True], strict=True)]


def _increases(cells: Sequence[str]) -> bool:
    try:
        values = [float(cell.replace(",", ".")) for cell in cells]
    except ValueError:
        return False
    return len(values) > 1 and all(b > a for a, b in pairwise(values))


def _with_as_many(path: Path, layout: Layout, columns: tuple[Column, ...]) -> tuple[Layout, tuple[Column, ...]]:
    """Give a column that goes on where the time before it has ended to the first time, if that is as long."""
    rows = (split_line(line, layout.separator) for line in reversed(last_lines(path, layout.encoding)))
    last = next((row for row in rows if _is_row(row, layout)), [])
    filled = [bool(cell) for _, cell in zip_longest(columns, last, fillvalue="")]
    times = {column.group: i for i, column in enumerate(columns) if column.is_time}
    first = columns[0]
    longer = [i for i, column in enumerate(columns) if filled[i] and not filled[times[column.group]]]
    if not longer or not filled[0]:
        return layout, columns
    names = ", ".join(f"'{columns[i].label}'" for i in longer)
    note = f"{names} read with the time '{first.label}', which has as many rows: the time before has ended earlier"
    moved = tuple(replace(column, group=first.group) if i in longer else column for i, column in enumerate(columns))
    return replace(layout, notes=(*layout.notes, note)), moved


def _is_row(row: Sequence[str], layout: Layout) -> bool:
    """Whether a line holds numbers, and nothing else but in columns of text."""
    cells = [cell for i, cell in enumerate(row) if cell and i not in layout.text_columns]
    return len(row) <= layout.width and bool(cells) and all(map(is_number, cells))


def _table(path: Path, file: str, layout: Layout, columns: tuple[Column, ...], kind: str) -> Table:
    mark = "comma" if layout.decimal == "," else "point"
    facts = {
        "encoding": layout.encoding,
        "separator": separator_name(layout.separator),
        "decimal mark": mark,
        "first row of numbers": f"line {layout.first_line}",
    }
    if layout.end_line:
        facts["text below, not used"] = layout.ending
    notes = [*layout.notes, *_text_note(layout.header, layout.text_columns)]
    if kind != "canonical CSV":
        notes.insert(0, f"read as {layout.encoding} text, separator {facts['separator']}, decimal {mark}")

    def locate(column: int, row: int) -> str:
        return f"line {line_of_row(path, layout, row)}, column {column + 1} ('{columns[column].label}')"

    def load(indices: Sequence[int]) -> list[Array]:
        if not layout.ragged:
            return read_columns(path, file, layout, indices)
        return _load_ragged(path, file, layout, columns, indices)

    return Table(file, kind, columns, load, locate, tuple(notes), facts)


def _text_note(header: Sequence[str], columns: Sequence[int]) -> list[str]:
    """Return the note on columns that hold words; none where there are none."""
    names = (f"'{header[i]}'" if i < len(header) else f"#{i + 1}" for i in columns)
    return [f"text columns not used: {', '.join(names)}"] if columns else []


def _load_ragged(
    path: Path, file: str, layout: Layout, columns: tuple[Column, ...], indices: Sequence[int]
) -> list[Array]:
    """Load columns of unequal length: every group ends where its time column does.

    Raises
    ------
    LogError
        For numbers behind the end of their time.
    """

    def header(index: int) -> str:
        return one_line(columns[index].label)

    times = {c.group: i for i, c in enumerate(columns) if c.is_time}
    own = [times[columns[i].group] for i in indices]
    wanted = list(dict.fromkeys([*indices, *own]))
    values = dict(zip(wanted, read_columns(path, file, layout, wanted), strict=True))
    out = []
    for index, time in zip(indices, own, strict=True):
        there = np.flatnonzero(~np.isnan(values[time]))
        stop = int(there[-1]) + 1 if there.size else 0
        beyond = np.flatnonzero(~np.isnan(values[index][stop:]))
        if beyond.size:
            place = f"line {line_of_row(path, layout, stop + int(beyond[0]))}, column {index + 1} ('{header(index)}')"
            what = f"{beyond.size} numbers without a time, for the time before them ('{header(time)}') has ended"
            raise LogError(f"{file}: {place}: {what}; a time column of as many rows was expected before this one")
        part = values[index][:stop].copy()
        if index == time and columns[index].header == twincat.FILETIME:
            part = twincat.milliseconds(part)
        out.append(part)
    return out

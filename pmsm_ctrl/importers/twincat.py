"""The CSV export of TwinCAT Scope.

A block on the project (name, file, start and end as FILETIME), then rows that each begin a group of channels with
their own keyword (``Name``, ``SampleTime[ms]``, ``Unit``, ...), then numbers: every group has a time column under
its keyword, in ms or as FILETIME, and ends where its channels end. Header cells may use a decimal comma where the
numbers use a point. The last row may be ``EOF``.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace

from pmsm_ctrl.errors import LogError
from pmsm_ctrl.importers.layout import Layout, decimal_mark, is_number, split_line
from pmsm_ctrl.importers.table import Array, Column

__all__ = ["FILETIME", "milliseconds", "recognise"]

FILETIME = "Time (FILETIME)"  # header given to such a time column; its unit becomes ms on loading
_TICKS_PER_MS = 10_000.0
_KEYS = (
    "SymbolComment", "Data-Type", "SampleTime[ms]", "VariableSize", "SymbolBased", "IndexGroup", "IndexOffset",
    "SymbolName", "NetID", "NetId", "Port", "Offset", "ScaleFactor", "BitMask", "Unit", "Unit ScaleFactor",
    "Unit Offset", "StartTime", "EndTime",
)  # fmt: skip
_NOT_A_UNIT = ("(none)", "none", "")


def recognise(lines: list[str], separator: str, encoding: str, file: str) -> tuple[Layout, tuple[Column, ...]] | None:
    """Return layout and columns when these lines are a TwinCAT Scope export, else None.

    Raises
    ------
    LogError
        When it is one, but holds no numbers.
    """
    rows = [split_line(line, separator) for line in lines]
    name_row = _name_row(rows)
    if name_row is None:
        return None
    names = rows[name_row]
    starts = [i for i, cell in enumerate(names) if cell == "Name"]
    meta: dict[str, list[str]] = {}
    first = name_row + 1
    while first < len(rows) and not (any(rows[first]) and all(not c or is_number(c) for c in rows[first])):
        if rows[first] and rows[first][0] in _KEYS:
            meta[rows[first][0]] = rows[first]
        first += 1
    if first == len(rows):
        raise LogError(f"{file}: line {name_row + 1}: a TwinCAT Scope header without rows of numbers below it")
    width = max(len(names), len(rows[first]))
    ticks = any(_number(cell.strip('"'), 0.0) > 1e16 for cell in rows[first])
    columns, notes = _columns(names, starts, meta, width, FILETIME if ticks else "Time")
    layout = Layout(
        encoding=encoding,
        separator=separator,
        decimal=decimal_mark(lines[first:], separator),
        header=tuple(column.header for column in columns),
        units=(),
        first_line=first + 1,
        width=width,
        ragged=True,
        notes=tuple(notes),
    )
    return layout, columns


def _name_row(rows: list[list[str]]) -> int | None:
    """The row with the channels' names: the last that begins with Name, followed by a keyword or another Name."""
    found = None
    for i, row in enumerate(rows[:200]):
        if not row or row[0] != "Name" or len(row) < 2:
            continue
        below = rows[i + 1][0] if i + 1 < len(rows) and rows[i + 1] else ""
        if row.count("Name") > 1 or below in _KEYS:
            found = i
    if found is None and any(row[0] == "Starttime of export" for row in rows[:20] if row):
        found = max((i for i, row in enumerate(rows[:200]) if row and row[0] == "Name" and i > 2), default=None)
    return found


def _columns(
    names: list[str], starts: list[int], meta: dict[str, list[str]], width: int, time_header: str
) -> tuple[tuple[Column, ...], list[str]]:
    columns: list[Column] = []
    notes: list[str] = []

    def cell(key: str, i: int) -> str:
        row = meta.get(key, [])
        return row[i] if i < len(row) else ""

    group, begins = -1, set(starts)
    for i in range(width):
        group += i in begins
        if i in begins:
            columns.append(Column(name="Time", unit="ms", header=time_header, group=group, is_time=True))
            continue
        name = names[i] if i < len(names) else f"#{i + 1}"
        # Scope writes the quantity behind the unit: "V (Voltage)"
        unit = cell("Unit", i).split(" (")[0].strip()
        column = Column(name=name, unit="" if unit.casefold() in _NOT_A_UNIT else unit, header=name, group=group)
        columns.append(column)
        neutral = {"ScaleFactor": 1.0, "Offset": 0.0, "Unit ScaleFactor": 1.0, "Unit Offset": 0.0}
        scaled = [f"{key} {cell(key, i)}" for key, value in neutral.items() if _number(cell(key, i), value) != value]
        if scaled:
            notes.append(f"'{name}' has {' and '.join(scaled)} in the header, taken as applied already to the numbers")
    return _unique(columns, meta), notes


def _unique(columns: list[Column], meta: dict[str, list[str]]) -> tuple[Column, ...]:
    """Tell channels of one name apart by their symbol."""
    times = Counter(column.name for column in columns)
    symbols = meta.get("SymbolName", [])
    return tuple(
        replace(column, header=symbols[i])
        if not column.is_time and times[column.name] > 1 and i < len(symbols) and symbols[i]
        else column
        for i, column in enumerate(columns)
    )


def _number(text: str, default: float) -> float:
    try:
        return float(text.replace(",", ".")) if text else default
    except ValueError:
        return default


def milliseconds(ticks: Array) -> Array:
    """Turn FILETIME (100 ns since 1601) into ms since the day of the first stamp began.

    A double holds today's FILETIME to 1.6 us only, which is all that the text can give here.
    """
    if ticks.size == 0:
        return ticks
    ticks_per_day = 86_400_000 * _TICKS_PER_MS
    day = math.floor(float(ticks[0]) / ticks_per_day) * ticks_per_day
    return (ticks - day) / _TICKS_PER_MS

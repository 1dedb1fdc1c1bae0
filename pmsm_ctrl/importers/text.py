"""CSV and other text files of numbers as a `Table`."""

from __future__ import annotations

from pathlib import Path

from pmsm_ctrl.importers.layout import Layout, separator_name, sniff
from pmsm_ctrl.importers.names import split_header
from pmsm_ctrl.importers.numbers import line_of_row, read_columns
from pmsm_ctrl.importers.table import Column, Table
from pmsm_ctrl.log import CHANNELS

__all__ = ["open_text"]


def open_text(path: Path, file: str, separator: str | None = None, decimal: str | None = None) -> Table:
    """Open a text file; a separator or decimal mark that is given is not questioned.

    Raises
    ------
    LogError
        When the file is not text, is empty, or holds no rows of numbers.
    """
    layout = sniff(path, file, separator, decimal)
    return table_of(path, file, layout, _columns(layout), "")


def table_of(path: Path, file: str, layout: Layout, columns: tuple[Column, ...], dialect: str) -> Table:
    """Return the table of a text file whose layout and columns are known."""
    canonical = all(column.name in CHANNELS and column.unit for column in columns)
    facts = {
        "encoding": layout.encoding,
        "separator": separator_name(layout.separator),
        "decimal mark": "comma" if layout.decimal == "," else "point",
        "first row of numbers": f"line {layout.first_line}",
    }
    notes = list(layout.notes)
    if not canonical or dialect:
        mark = facts["decimal mark"]
        notes.insert(0, f"read as {layout.encoding} text, separator {facts['separator']}, decimal {mark}")

    def locate(column: int, row: int) -> str:
        return f"line {line_of_row(path, layout, row)}, column {column + 1} ('{columns[column].header}')"

    return Table(
        file=file,
        format=dialect or ("canonical CSV" if canonical else "CSV"),
        columns=columns,
        load=lambda indices: read_columns(path, file, layout, indices),
        locate=locate,
        notes=tuple(notes),
        facts=facts,
    )


def _columns(layout: Layout) -> tuple[Column, ...]:
    columns = []
    for i in range(layout.width):
        header = layout.header[i] if i < len(layout.header) else ""
        name, unit = split_header(header)
        if i < len(layout.units) and layout.units[i] not in ("", "-"):
            unit = layout.units[i]
        columns.append(Column(name=name, unit=unit, header=header))
    return tuple(columns)

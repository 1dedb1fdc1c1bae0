"""Rows of numbers from a text file, read in pieces; errors name line and column.

`parse_rows` is the plain-Python reference that handles every case and writes every message. Large pieces go to the
parser of pyarrow where it is installed, else to that of NumPy; `parse_rows` takes over what these refuse.
"""

from __future__ import annotations

import io
import os
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from pmsm_ctrl.errors import LogError, NextCommand
from pmsm_ctrl.importers.layout import Layout, expected, pieces, split_line
from pmsm_ctrl.importers.stamps import dated
from pmsm_ctrl.importers.table import Array, one_line

__all__ = ["line_of_row", "parse_numpy", "parse_pyarrow", "parse_rows", "read_columns"]

NUMPY_FROM = 1 << 16  # bytes; below, `parse_rows` is as fast
PYARROW_FROM = 1 << 23  # bytes; below, loading pyarrow takes longer than parsing
PIECE = 1 << 23  # larger pieces cost more memory than they save time


def read_columns(path: str | Path, file: str, layout: Layout, columns: Sequence[int]) -> list[Array]:
    """Return these columns, one array each, shape (rows,); a missing cell is NaN.

    Raises
    ------
    LogError
        With line and column for a cell that is not a number and for a row of the wrong length.
    """
    if not columns:
        return []
    rows, capacity = 0, _estimated_rows(path, layout)
    out = [np.empty(capacity) for _ in columns]
    for block in _row_blocks(path, file, layout, columns):
        stop = rows + block[0].size
        if stop > capacity:
            capacity = max(stop, capacity * 3 // 2)
            for column in out:
                column.resize(capacity, refcheck=False)
        for column, values in zip(out, block, strict=True):
            column[rows:stop] = values
        rows = stop
    for column in out:
        column.resize(rows, refcheck=False)
    return out


def _estimated_rows(path: str | Path, layout: Layout) -> int:
    """Return about how many rows a file holds, judged by lines at its begin and middle; memory is taken once."""
    size = os.path.getsize(path)
    with open(path, "rb") as stream:
        seen = stream.read(1 << 16)
        stream.seek(size // 2)
        seen += stream.read(1 << 16)
    length = len(seen) / max(1, seen.count(b"\n") - layout.first_line)
    return int(1.05 * size / max(2.0 * layout.width, length)) + 16


def _row_blocks(path: str | Path, file: str, layout: Layout, columns: Sequence[int]) -> Iterator[list[Array]]:
    """Yield the rows in blocks, one array per column."""
    for c in columns:
        if c in layout.text_columns:
            message = f"{file}: column {c + 1} ('{one_line(layout.header[c][:60])}') holds text; numbers were expected"
            raise LogError(message, next_command=NextCommand.IMPORT)
    large = os.path.getsize(path) >= PYARROW_FROM
    clock = (0, 0)
    for index, piece in enumerate(_data_pieces(path, layout)):
        if layout.stamps is not None:
            piece, clock = dated(piece, file, layout, partial(_first_line, path, layout, index), clock)
        blocks = parse_pyarrow(piece, layout, columns) if large else None
        if blocks is None and len(piece) >= NUMPY_FROM:
            blocks = parse_numpy(piece, layout, columns)
        if blocks is not None:
            yield from blocks
            continue
        rows, ended = parse_rows(piece, file, layout, _first_line(path, layout, index), columns)
        yield [rows[:, c].copy() for c in columns]
        if ended:
            return


def _with_points(piece: bytes, layout: Layout) -> bytes:
    """Turn decimal commas into points where a comma can be nothing else."""
    return piece.replace(b",", b".") if layout.separator != "," and b"," in piece else piece


def parse_pyarrow(piece: bytes, layout: Layout, columns: Sequence[int]) -> list[list[Array]] | None:
    """Parse whole lines with pyarrow; None when it is not installed or refuses the text."""
    try:
        import pyarrow
        import pyarrow.csv
    except ImportError:
        return None
    if layout.separator == " ":
        return None
    names = [str(c) for c in range(layout.width)]
    wanted = [names[c] for c in columns]
    try:
        table = pyarrow.csv.read_csv(
            pyarrow.BufferReader(_with_points(piece, layout)),
            read_options=pyarrow.csv.ReadOptions(column_names=names, block_size=1 << 21),
            parse_options=pyarrow.csv.ParseOptions(delimiter=layout.separator),
            convert_options=pyarrow.csv.ConvertOptions(
                column_types={name: pyarrow.float64() for name in wanted},
                include_columns=list(dict.fromkeys(wanted)),
                null_values=[""],
                decimal_point=layout.decimal if layout.separator == "," else ".",
            ),
        )
    except pyarrow.ArrowException:
        return None
    # chunk by chunk: the table's own conversion would load pandas and copy once more
    chunks = [table[name].chunks for name in wanted]
    return [[part.to_numpy(zero_copy_only=False) for part in parts] for parts in zip(*chunks, strict=True)]


def parse_numpy(piece: bytes, layout: Layout, columns: Sequence[int]) -> list[list[Array]] | None:
    """Parse whole lines with NumPy; None when it refuses the text."""
    if layout.text_columns or (layout.separator == "," and layout.decimal == ","):
        return None
    try:
        # every column is parsed: with `usecols` a row that is too long would pass unnoticed
        rows = np.loadtxt(
            io.BytesIO(_with_points(piece, layout)),
            delimiter=None if layout.separator == " " else layout.separator,
            comments=None,
            quotechar='"',
            ndmin=2,
            encoding="latin-1",
        )
    except (ValueError, UserWarning):
        return None
    return [[rows[:, c].copy() for c in columns]] if rows.shape[1] == layout.width else None


def _data_pieces(path: str | Path, layout: Layout) -> Iterator[bytes]:
    """Yield the file from the first row of numbers to the last one."""
    skip = layout.first_line - 1
    left = layout.end_line - layout.first_line  # rows and blank lines up to the text at the end
    for piece in pieces(path, layout.encoding, PIECE):
        start = 0
        while skip and start < len(piece):
            start = piece.find(b"\n", start) + 1 or len(piece)
            skip -= 1
        rows = piece[start:] if start else piece
        if layout.end_line:
            count = rows.count(b"\n")
            if count >= left:
                yield b"\n".join(rows.split(b"\n", left)[:left])
                return
            left -= count
        yield rows


def _first_line(path: str | Path, layout: Layout, index: int) -> int:
    """Return the line number at which a piece begins; counted only when a complaint needs it."""
    before = zip(range(index), _data_pieces(path, layout), strict=False)
    return layout.first_line + sum(piece.count(b"\n") for _, piece in before)


def parse_rows(
    piece: bytes, file: str, layout: Layout, first_line: int, columns: Sequence[int] | None = None
) -> tuple[Array, bool]:
    """Parse whole lines; return the rows, shape (rows, width), and whether an end-of-file row was met.

    Cells of other columns than `columns` that hold no number are NaN.

    Raises
    ------
    LogError
        With line and column for a cell that is not a number and for a row of the wrong length.
    """
    encoding = "latin-1" if layout.encoding == "latin-1" else "utf-8"
    text = piece.decode(encoding, errors="replace").replace("\r\n", "\n").replace("\r", "\n")
    rows: list[list[float]] = []
    width = layout.width
    wanted = frozenset(range(width) if columns is None else columns)
    skipped = frozenset(layout.text_columns) | (frozenset(range(width)) - wanted)
    for number, line in enumerate(text.split("\n"), first_line):
        if not line or line.isspace() or line == "\x1a":
            continue
        cells = split_line(line, layout.separator)
        if cells[0].casefold() == "eof" and not any(cells[1:]):
            return _stack(rows, width), True
        if len(cells) != width:
            cells = _fit(cells, width, file, layout, number)
        try:
            if layout.text_columns or "," in line or "_" in line:
                raise ValueError
            rows.append([float(cell) if cell else np.nan for cell in cells])
        except ValueError:
            rows.append(
                [np.nan if c in skipped else _cell(cell, file, layout, number, c) for c, cell in enumerate(cells)]
            )
    return _stack(rows, width), False


def _stack(rows: list[list[float]], width: int) -> Array:
    return np.array(rows, dtype=np.float64).reshape(len(rows), width)


def _fit(cells: list[str], width: int, file: str, layout: Layout, line: int) -> list[str]:
    """Bring a row to the file's width where that loses nothing."""
    while len(cells) > width and not cells[-1]:
        cells = cells[:-1]
    if len(cells) < width and layout.ragged:
        return cells + [""] * (width - len(cells))
    if len(cells) != width:
        what = f"{len(cells)} cell{'' if len(cells) == 1 else 's'} found; {width} were expected"
        raise LogError(f"{file}: line {line}: {what}, as in line {layout.first_line}")
    return cells


def _cell(cell: str, file: str, layout: Layout, line: int, column: int) -> float:
    text = cell.strip().strip('"').strip()
    if not text:
        return float("nan")
    if layout.accepts_comma and text.count(",") + text.count(".") == 1:
        text = text.replace(",", ".")
    try:
        if "_" in text or not text.isascii():
            raise ValueError
        return float(text)
    except ValueError:
        name = one_line(layout.header[column][:60]) if column < len(layout.header) else f"#{column + 1}"
        place = f"{file}: line {line}, column {column + 1} ('{name}')"
        raise LogError(f"{place}: '{one_line(cell[:40])}' found; {expected(text)}") from None


def line_of_row(path: str | Path, layout: Layout, row: int) -> int:
    """Return the line number, counted from 1, of a row of numbers counted from 0."""
    seen, number = -1, layout.first_line - 1
    for piece in _data_pieces(path, layout):
        for text in piece.split(b"\n"):
            number += 1
            seen += bool(text.strip())
            if seen == row:
                return number
        number -= piece.endswith(b"\n")
    return layout.first_line + row

"""Rows of numbers from a text file, in pieces, with the place of whatever is wrong.

`parse_rows` is the readable twin that decides every case and words every complaint. Large files go through
`pmsm_ctrl.importers.number_kernel`, which hands any piece that is out of the ordinary back to the twin.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import numpy as np

from pmsm_ctrl.errors import LogError
from pmsm_ctrl.importers.layout import Layout, pieces, split_line
from pmsm_ctrl.importers.table import Array

__all__ = ["line_of_row", "parse_rows", "read_columns", "row_blocks"]

KERNEL_FROM = 8 << 20  # bytes; below, loading the compiler would take longer than parsing
PIECE = 1 << 24


def read_columns(path: str | Path, file: str, layout: Layout, columns: Sequence[int]) -> list[Array]:
    """Return these columns, one array each, shape (rows,); a cell that is not there is NaN.

    Raises
    ------
    LogError
        With line and column for a cell that is not a number and for a row of the wrong length.
    """
    blocks = list(row_blocks(path, file, layout, columns))
    if not blocks:
        return [np.empty(0) for _ in columns]
    return [np.concatenate([block[:, c] for block in blocks]) for c in range(len(columns))]


def row_blocks(path: str | Path, file: str, layout: Layout, columns: Sequence[int]) -> Iterator[Array]:
    """Yield the rows in blocks, shape (rows, len(columns)), so that a file may be larger than memory."""
    large = os.path.getsize(path) >= KERNEL_FROM
    wanted = [c for c in columns if c not in layout.text_columns]
    if len(wanted) != len(columns):
        text = next(c for c in columns if c in layout.text_columns)
        raise LogError(f"{file}: column {text + 1} ('{layout.header[text]}') holds text; numbers were expected")
    if not large:
        for piece, line in _data_pieces(path, layout):
            rows, ended = parse_rows(piece, file, layout, line)
            yield rows[:, columns]
            if ended:
                return
        return
    from pmsm_ctrl.importers.number_kernel import parse_piece

    def work(piece: bytes) -> Array | None:
        return parse_piece(piece, layout, columns)

    # The kernel releases the interpreter lock: a second thread parses while the first result is collected.
    with ThreadPoolExecutor(max_workers=min(2, os.cpu_count() or 1)) as pool:
        waiting: deque[tuple[Future[Array | None], bytes, int]] = deque()
        source = _data_pieces(path, layout)
        while True:
            while len(waiting) < 3 and (item := next(source, None)) is not None:
                waiting.append((pool.submit(work, item[0]), *item))
            if not waiting:
                return
            future, piece, line = waiting.popleft()
            block = future.result()
            if block is not None:
                yield block
                continue
            rows, ended = parse_rows(piece, file, layout, line)
            yield rows[:, columns]
            if ended:
                return


def _data_pieces(path: str | Path, layout: Layout) -> Iterator[tuple[bytes, int]]:
    """Yield (bytes, line number of their first line) from the first row of numbers on."""
    line = 1
    for piece in pieces(path, layout.encoding, PIECE):
        count = piece.count(b"\n")
        while line < layout.first_line and piece:
            cut = piece.find(b"\n") + 1 or len(piece)
            piece = piece[cut:]
            line, count = line + 1, count - 1
        if piece:
            yield piece, line
        line += max(count, 0)


def parse_rows(piece: bytes, file: str, layout: Layout, first_line: int) -> tuple[Array, bool]:
    """Parse whole lines; return the rows, shape (rows, width), and whether an end-of-file row was met.

    Raises
    ------
    LogError
        With line and column for a cell that is not a number and for a row of the wrong length.
    """
    encoding = "latin-1" if layout.encoding == "latin-1" else "utf-8"
    text = piece.decode(encoding, errors="replace").replace("\r\n", "\n").replace("\r", "\n")
    rows: list[list[float]] = []
    width = layout.width
    skipped = frozenset(layout.text_columns)
    for number, line in enumerate(text.split("\n"), first_line):
        if not line or line.isspace() or line == "\x1a":
            continue
        cells = split_line(line, layout.separator)
        if cells[0].casefold() == "eof" and not any(cells[1:]):
            return _stack(rows, width), True
        if len(cells) != width:
            cells = _fit(cells, width, file, layout, number)
        try:
            if skipped or "," in line or "_" in line:
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
        what = f"{len(cells)} cells found; {width} were expected"
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
        name = layout.header[column] if column < len(layout.header) else f"#{column + 1}"
        raise LogError(
            f"{file}: line {line}, column {column + 1} ('{name}'): '{cell[:40]}' found; a number was expected"
        ) from None


def line_of_row(path: str | Path, layout: Layout, row: int) -> int:
    """Return the line number, counted from 1, of a row of numbers counted from 0."""
    seen = -1
    for piece, line in _data_pieces(path, layout):
        for number, text in enumerate(piece.splitlines(), line):
            seen += bool(text.strip())
            if seen == row:
                return number
    return layout.first_line + row

"""A section as plain text for a terminal: aligned tables, wrapped to the width, complete at 80 columns."""

from __future__ import annotations

import re
import shutil
import unicodedata
from collections.abc import Iterator
from itertools import groupby

from pmsm_ctrl.files import printable
from pmsm_ctrl.rendering.cells import numeric_columns
from pmsm_ctrl.section import Block, Notice, Picture, Section, Table, Traces

__all__ = ["to_text"]

NARROWEST = 80
_UNIT = re.compile(r"\bm?N (m s/rad|s/m|m)\b")
WIDEST_PROSE = 100  # longer lines are hard to read
GAPS = (2, 1)  # blanks between two columns; the narrow gap where the table fits only so


def to_text(section: Section, width: int | None = None) -> str:
    """Return a section as text.

    Folded blocks and pictures are left out. A table too wide for the page is written row by row.

    Parameters
    ----------
    section : Section
    width : int, optional
        Columns of the page; those of the terminal, and at least 80, if left out.

    Returns
    -------
    str
        Without a line feed at the end.
    """
    if width is None:
        width = max(NARROWEST, shutil.get_terminal_size().columns)
    return printable("\n\n".join("\n".join(paragraph) for paragraph in _section(section, width, "=")))


def _section(section: Section, width: int, rule: str) -> Iterator[list[str]]:
    """Yield the paragraphs of a section, each as its lines."""
    heading = _wrap(section.title, width)
    yield [*heading, rule * max(map(_columns, heading))]
    shown = [block for block in section.blocks if not getattr(block, "folded", False)]
    for doubt, group in groupby(shown, lambda block: isinstance(block, Notice)):
        if doubt:
            yield [line for block in group if isinstance(block, Notice) for line in _notice(block, width)]
        else:
            for block in group:
                yield from _block(block, width)


def _block(block: Block, width: int) -> Iterator[list[str]]:
    match block:
        case Section():
            yield from _section(block, width, "-")
        case Table():
            yield _table(block, width)
        case Picture() | Traces():
            return
        case str() if "\n" in block:  # set as it is, like code
            yield block.splitlines()
        case _:
            yield _wrap(str(block), min(width, WIDEST_PROSE))


def _notice(notice: Notice, width: int) -> list[str]:
    code = f" [{notice.code}]" if notice.code else ""
    first, *rest = _wrap(f"warning: {notice.text}{code}", min(width, WIDEST_PROSE) - 2)
    return [first, *(f"  {line}" for line in rest)]


def _table(table: Table, width: int) -> list[str]:
    caption = _wrap(table.caption, width) if table.caption else []
    if not table.rows:
        return [*caption, "(no rows)"]
    count = len(table.header)
    rows = [(*row, *("",) * (count - len(row))) for row in table.rows]
    right = numeric_columns(table)
    for gap in GAPS:
        widths = _widths(list(zip(table.header, *rows, strict=True)), width - gap * (count - 1))
        if widths is not None:
            ruled = (table.header, tuple("-" * w for w in widths), *rows)
            return [*caption, *(line for row in ruled for line in _row(row, widths, right, gap))]
    return [*caption, *_records(table.header, rows, width)]


def _widths(columns: list[tuple[str, ...]], room: int) -> list[int] | None:
    """Return the columns' widths: as wide as their cells, else shrunk down to their longest words; None if too wide.

    A column of width w wraps a text of n characters into about n / w lines, so that the column to shrink is the one
    with the smallest sum of n / w^2.
    """
    natural = [max(_columns(cell) for cell in column) for column in columns]
    least = [max((_columns(word) for cell in column for word in _words(cell)), default=0) for column in columns]
    if sum(least) > room:
        return None
    text = [sum(map(_columns, column)) for column in columns]
    widths = list(natural)
    while sum(widths) > room:
        wide = (k for k in range(len(widths)) if widths[k] > least[k])
        widths[min(wide, key=lambda k: text[k] / widths[k] ** 2)] -= 1
    # a wrapped cell rarely fills its column: the rest goes to the columns that gain most from it
    widths = [max(_columns(line) for cell in column for line in _wrap(cell, max(1, w)))
              for column, w in zip(columns, widths, strict=True)]  # fmt: skip
    while sum(widths) < min(room, sum(natural)):
        narrow = (k for k in range(len(widths)) if widths[k] < natural[k])
        widths[max(narrow, key=lambda k: text[k] / widths[k] ** 2)] += 1
    return widths


def _row(cells: tuple[str, ...], widths: list[int], right: tuple[bool, ...], gap: int) -> Iterator[str]:
    """Yield the lines of one row, its cells wrapped to their columns."""
    wrapped = [_wrap(cell, max(1, w)) for cell, w in zip(cells, widths, strict=True)]
    for k in range(max(map(len, wrapped))):
        parts = []
        for lines, w, r in zip(wrapped, widths, right, strict=True):
            text = lines[k] if k < len(lines) else ""
            blank = " " * (w - _columns(text))
            parts.append(blank + text if r else text + blank)
        yield (" " * gap).join(parts).rstrip()


def _records(header: tuple[str, ...], rows: list[tuple[str, ...]], width: int) -> Iterator[str]:
    """Yield a table row by row, one line a cell; the first cell heads its record."""
    margin = 2 + max(map(_columns, header)) + GAPS[0]
    for row in rows:
        yield from _wrap(f"{header[0]}: {row[0]}", width)
        for name, cell in zip(header[1:], row[1:], strict=True):
            if not cell:
                continue
            first, *rest = _wrap(cell, max(20, width - margin))
            yield "  " + name + " " * (margin - 2 - _columns(name)) + first
            yield from (" " * margin + line for line in rest)


def _wrap(text: str, width: int) -> list[str]:
    """Break a text at its blanks, and a word only when it is longer than a line; at least one line."""
    lines: list[str] = []
    line = ""
    for word in _words(text):
        while _columns(word) > width:
            if line:
                lines.append(line)
                line = ""
            fits = 1
            while fits < len(word) and _columns(word[: fits + 1]) <= width:
                fits += 1
            lines.append(word[:fits])
            word = word[fits:]
        if line and _columns(line) + 1 + _columns(word) > width:
            lines.append(line)
            line = word
        elif word:
            line = f"{line} {word}" if line else word
    return [*lines, line] if line or not lines else lines


def _words(text: str) -> list[str]:
    """Split a text at its blanks, but not within a unit or between a number and its percent sign."""
    return [word.replace("\0", " ") for word in _UNIT.sub(_bound, text.replace(" %", "\0%")).split()]


def _bound(unit: re.Match[str]) -> str:
    return unit.group().replace(" ", "\0")


def _columns(text: str) -> int:
    """Columns of a terminal that a text takes: wide characters two, combining ones none."""
    if text.isascii():
        return len(text)
    return sum(0 if unicodedata.combining(c) else 2 if unicodedata.east_asian_width(c) in "WF" else 1 for c in text)

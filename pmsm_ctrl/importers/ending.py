"""Lines of text behind the last row of numbers: a summary of the recorder, left out with a note."""

from __future__ import annotations

import os
import re
from collections import deque
from dataclasses import replace
from pathlib import Path

from pmsm_ctrl.importers.layout import Layout, is_number, pieces, split_line
from pmsm_ctrl.importers.table import one_line

__all__ = ["last_lines", "without_ending"]

MOST = 8  # lines of a summary; more of them are rows that cannot be read
TAIL = 1 << 13  # bytes in which they stand
# Words, or nothing but marks. "1.000,0", "12 ms" and "0x1F" begin with a digit: numbers that are not written well.
_WORDS = re.compile(r"[\W_]*+(?:[^\W\d_].*)?", re.DOTALL)
_COUNT_OF = re.compile(r"\d++\s++[^\W\d_]{3,}+")  # "30000 rows"


def without_ending(path: str | Path, layout: Layout) -> Layout:
    """Return the layout that ends before the lines of text at the end of a file.

    Parameters
    ----------
    path : path
    layout : Layout

    Returns
    -------
    Layout
        The same where the file ends with a row of numbers, with an end of file, or with more text than a summary has.
    """
    lines = last_lines(path, layout.encoding)
    found: list[str] = []
    above = 0  # lines from the first one of the text to the end of the file
    for number, line in enumerate(reversed(lines), 1):
        if not line.strip() or line == "\x1a":
            continue
        if not _is_text(line, layout):
            break
        found.insert(0, line)
        above = number
    else:
        return layout
    if not found or len(found) > MOST or any(split_line(one, layout.separator)[0].casefold() == "eof" for one in found):
        return layout
    first = _count(path, layout.encoding) - above + 1
    if first <= layout.first_line:
        return layout
    last = first + len(found) - 1
    place = f"line {first}" if first == last else f"{len(found)} lines from line {first} on"
    place += f" ('{one_line(found[0])[:40]}')"
    note = f"text below the numbers not used: {place}"
    return replace(layout, end_line=first, ending=place, notes=(*layout.notes, note))


def _is_text(line: str, layout: Layout) -> bool:
    """Whether a line holds words, and none of the numbers or dates with which a row begins."""
    cells = split_line(line, layout.separator)
    if layout.stamps is not None:
        start = layout.stamps.column
    else:
        start = next((c for c in range(layout.width) if c not in layout.text_columns), 0)
    begin = cells[start] if start < len(cells) else ""
    if layout.stamps is not None and begin:
        try:
            layout.stamps.form.read([begin])
        except (ValueError, OverflowError):
            pass
        else:
            return False
    return (not begin or _is_word(begin)) and any(_is_word(cell) for cell in cells)


def _is_word(cell: str) -> bool:
    text = cell.strip().strip('"').strip()
    return bool(text) and not is_number(text) and bool(_WORDS.fullmatch(text) or _COUNT_OF.match(text))


def last_lines(path: str | Path, encoding: str) -> list[str]:
    """Return the last lines of a file, all of them whole.

    Parameters
    ----------
    path : path
    encoding : str

    Returns
    -------
    list of str
    """
    if encoding.startswith("utf-16"):
        tail = b"".join(deque(pieces(path, encoding, TAIL), maxlen=2))
        whole, codec = False, "utf-8"
    else:
        size = os.path.getsize(path)
        with open(path, "rb") as stream:
            stream.seek(max(0, size - TAIL))
            tail = stream.read()
        whole, codec = size <= TAIL, encoding.replace("-sig", "")
    lines = (tail if b"\n" in tail else tail.replace(b"\r", b"\n")).decode(codec, errors="replace").split("\n")
    return (lines if lines[-1] else lines[:-1])[0 if whole else 1 :]


def _count(path: str | Path, encoding: str) -> int:
    """Return how many lines a file has."""
    count, last = 0, b""
    for piece in pieces(path, encoding):
        count, last = count + piece.count(b"\n"), piece[-1:]
    return count + (last != b"\n")

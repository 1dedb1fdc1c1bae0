"""Layout of a text file: encoding, separator, decimal mark, header, units, first line of numbers.

Everything here looks only at the beginning of the file.
"""

from __future__ import annotations

import codecs
import csv
import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.errors import LogError
from pmsm_ctrl.importers.names import guess_channel, is_unit, split_header
from pmsm_ctrl.importers.table import one_line
from pmsm_ctrl.log import CHANNELS

__all__ = [
    "SAMPLE",
    "Form",
    "Layout",
    "Stamps",
    "decimal_mark",
    "encoding_of",
    "expected",
    "is_number",
    "opening",
    "pieces",
    "place_header",
    "separator_name",
    "split_line",
]

SAMPLE = 1 << 18  # bytes that are read to find the layout
MAX_LINE = 1 << 24  # bytes; a file with longer lines is no table
SEPARATORS = (";", "\t", ",", "|", " ")
# Digits are never given back: a cell of 20,000 of them is refused in linear time.
_NUMBER = re.compile(r"\s*+[+-]?(?:(\d++[.,]?\d*+|[.,]\d++)([eE][+-]?\d++)?|nan|inf|infinity)\s*+$", re.IGNORECASE)
_THOUSANDS = re.compile(r"[+-]?\d{1,3}(?:([.,' \xa0\u2019\u202f])\d{3})(?:\1\d{3})*+(?:(?!\1)[.,]\d++)?")
_JUNK = re.compile(rb"[\x00-\x08\x0b\x0e-\x19\x1b-\x1f]")  # what no text holds


@dataclass(frozen=True)
class Form:
    """One way to write a time stamp: its name, and what turns cells into ns since 1970 (or since midnight), shape (n,).

    `read` raises `ValueError` with the index of the first bad cell.
    """

    name: str
    read: Callable[[Sequence[str]], NDArray[np.int64]]


@dataclass(frozen=True)
class Stamps:
    """A column of dates: its form, and the moment that becomes t = 0, in ns."""

    column: int
    form: Form
    origin: int
    only_date: str = ""  # where day and month are ambiguous, the only date that may appear


@dataclass(frozen=True)
class Layout:
    """Layout of a text file.

    Parameters
    ----------
    encoding, separator, decimal : str
    header, units : tuple of str
        Cells of these lines; empty where there is none.
    first_line : int
        Line number of the first row of numbers, counted from 1.
    width : int
        Cells per row.
    text_columns : tuple of int
        Columns that hold no numbers at all.
    ragged : bool
        Whether rows may end early because channels have unequal lengths.
    notes : tuple of str
        What was guessed.
    stamps : Stamps or None
        The column that gives the time as dates.
    end_line : int
        Line number at which text follows the last row of numbers; 0 where none does.
    ending : str
        Which lines of text these are, for a message.
    """

    encoding: str
    separator: str
    decimal: str
    header: tuple[str, ...]
    units: tuple[str, ...]
    first_line: int
    width: int
    text_columns: tuple[int, ...] = ()
    ragged: bool = False
    notes: tuple[str, ...] = ()
    stamps: Stamps | None = None
    end_line: int = 0
    ending: str = ""

    @property
    def accepts_comma(self) -> bool:
        """Whether a comma inside a cell can only be a decimal mark."""
        return self.separator != "," or self.decimal == ","


def separator_name(separator: str) -> str:
    """Return a separator in words."""
    return {";": "semicolon", "\t": "tab", ",": "comma", "|": "bar", " ": "blanks"}.get(separator, repr(separator))


def is_number(cell: str) -> bool:
    """Whether a cell holds one number, with a decimal point or a decimal comma."""
    return _NUMBER.match(cell.strip().strip('"')) is not None


def expected(cell: str) -> str:
    """Return what belongs in place of a cell that is no number."""
    if _THOUSANDS.fullmatch(cell.strip().strip('"')):
        return "a number without marks of thousands was expected; export the file without them"
    return "a number was expected"


def encoding_of(head: bytes, file: str) -> str:
    """Return the encoding of a text that begins with `head`.

    Raises
    ------
    LogError
        When the bytes are not text.
    """
    for mark, name in (
        (codecs.BOM_UTF8, "utf-8-sig"),
        (codecs.BOM_UTF16_LE, "utf-16"),
        (codecs.BOM_UTF16_BE, "utf-16"),
    ):
        if head.startswith(mark):
            return name
    if b"\0" in head:
        for offset, name in ((1, "utf-16-le"), (0, "utf-16-be")):
            half = head[offset::2]
            if half and half.count(0) > 0.9 * len(half):
                return name
    junk = _JUNK.search(head)
    if junk is not None:
        raise LogError(
            f"{file}: byte {junk.start()} is 0x{junk[0][0]:02x}: neither text nor a known format "
            "(accepted: CSV and other text, MAT, MDF4, TDMS, Parquet, NumPy)"
        )
    try:
        codecs.getincrementaldecoder("utf-8")().decode(head)
        return "utf-8"
    except UnicodeDecodeError:
        return "latin-1"


def pieces(path: str | Path, encoding: str, size: int = 1 << 25) -> Iterator[bytes]:
    """Yield the file in pieces that end at line ends, with digits and separators in ASCII.

    Raises
    ------
    LogError
        For a line longer than `MAX_LINE`.
    """
    with open(path, "rb") as stream:
        stream.seek(3 if encoding == "utf-8-sig" else 0)
        decoder = codecs.getincrementaldecoder(encoding)("replace") if encoding.startswith("utf-16") else None
        bare_returns: bool | None = None
        rest = b""
        while block := stream.read(size):
            if decoder is not None:
                block = decoder.decode(block).encode("utf-8")
            if bare_returns is None:
                bare_returns = b"\r" in block and b"\n" not in block
            if bare_returns:
                block = block.replace(b"\r", b"\n")
            cut = block.rfind(b"\n") + 1
            if not cut:
                rest += block
                if len(rest) > MAX_LINE:
                    raise LogError(f"{path}: a line longer than {MAX_LINE >> 20} MB; rows of numbers were expected")
                continue
            yield rest + block[:cut] if rest else block[:cut]
            rest = block[cut:]
        if rest:
            yield rest


def decode_sample(path: str | Path, file: str) -> tuple[list[str], str]:
    """Return the first lines of a text file and its encoding."""
    with open(path, "rb") as stream:
        head = stream.read(SAMPLE)
        whole = not stream.read(1)
    encoding = encoding_of(head, file)
    first = next(pieces(path, encoding, SAMPLE), b"")
    text = first.decode("utf-8" if encoding.startswith("utf-16") else encoding.replace("-sig", ""), errors="replace")
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    return (lines if whole else lines[:-1]), encoding


def split_line(line: str, separator: str) -> list[str]:
    """Split one line into cells without the blanks around them; quoted cells may hold the separator."""
    if separator == " ":
        return line.split()
    if '"' in line:
        try:
            return [cell.strip() for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True))]
        except (csv.Error, StopIteration):
            pass
    return list(map(str.strip, line.split(separator)))


def _trimmed(cells: list[str]) -> list[str]:
    while cells and not cells[-1]:
        cells = cells[:-1]
    return cells


def _score(lines: list[str], separator: str) -> tuple[float, int]:
    """Return (numeric cells per line in the second half of the sample, most common number of cells)."""
    rows = [split_line(line, separator) for line in lines]
    width = Counter(len(row) for row in rows).most_common(1)[0][0]
    if width < 2:
        return 0.0, width
    fitting = [row for row in rows if len(row) == width]
    numeric = sum(is_number(cell) for row in fitting for cell in row)
    # cells that are neither empty nor a number count against a separator
    text = sum(bool(cell) for row in fitting for cell in row) - numeric
    return (numeric - text) / len(rows), width


def opening(path: str | Path, file: str, separator: str | None = None) -> tuple[list[str], str, str]:
    """Return the first lines of a text file, its encoding and its separator; a given one is used as it is.

    Raises
    ------
    LogError
        When the file is empty or not text.
    """
    if separator is not None and (len(separator) != 1 or separator.isalnum() or separator in '\r\n".+-_'):
        raise LogError(f"{file}: [log] separator {separator!r}; one of ';', ',', '|', a tab or a blank was expected")
    lines, encoding = decode_sample(path, file)
    filled = [line for line in lines if line.strip()]
    if not filled:
        raise LogError(f"{file}: empty; a header line and rows of numbers were expected")
    tail = filled[len(filled) // 2 :][:400] if len(filled) > 3 else filled[-1:]
    candidates = SEPARATORS if separator is None else (separator,)
    scores = {candidate: _score(tail, candidate) for candidate in candidates}
    best = max(candidates, key=lambda candidate: scores[candidate][0])
    if scores[best][0] <= 0 or scores[best][1] < 2:
        if separator is not None:
            _refuse_separator(tail, separator, file)
        best = next((s for s in candidates if len(split_line(filled[0], s)) > 1), best)
    return lines, encoding, best


def _refuse_separator(tail: list[str], stated: str, file: str) -> None:
    """Refuse a separator of [log] that yields no numbers where another one does."""
    scores = {other: _score(tail, other) for other in SEPARATORS if other != stated}
    other = max(scores, key=lambda one: scores[one][0])
    if scores[other][0] > 0 and scores[other][1] > 1:
        marks = f"the file has {other!r}, and a decimal {'comma' if decimal_mark(tail, other) == ',' else 'point'}"
        message = f"{file}: not one row of numbers with the separator {stated!r} that [log] of the design states; "
        raise LogError(f"{message}{marks}: correct separator and decimal there, or leave them out")


def decimal_mark(lines: list[str], separator: str) -> str:
    """Return the decimal mark of rows of numbers: the one more cells use, a point where none does."""
    cells = [cell for line in lines[:400] for cell in split_line(line, separator) if is_number(cell)]
    commas, points = (sum(mark in cell for cell in cells) for mark in ",.")
    return "," if commas > points else "."


def place_header(lines: list[str], separator: str, encoding: str, file: str) -> Layout:
    """Find header, units and the first row of numbers of a plain table.

    Raises
    ------
    LogError
        When there are no rows of numbers, or rows between header and numbers hold text where numbers belong.
    """
    rows = [split_line(line, separator) for line in lines]
    numbered = [row for row in rows if len(list(islice(filter(is_number, row), 2))) == 2]
    widths = Counter(map(len, numbered))
    if not widths:
        raise LogError(
            f"{file}: line 1: no row of numbers below it, in {len(rows)} lines that were looked at; "
            "a header line and rows of numbers were expected"
        )
    width = widths.most_common(1)[0][0]
    text_columns = _text_columns([row for row in numbered if len(row) == width])
    first = next((i for i, row in enumerate(rows) if _is_data(row, width, text_columns)), None)
    if first is None:
        raise LogError(f"{file}: line 1: no row below it holds numbers only; a header line and numbers were expected")
    if separator == " ":
        rows[:first] = [_blank_header(line, width) for line in lines[:first]]
    above = _above(rows, first, width)
    _refuse_text_above(rows, first, above, file)
    header, units, _ = above
    notes = [] if header else ["no header line found; columns are #1, #2, ..."]
    unused = sum(1 for line in lines[:first] if line.strip()) - bool(header) - bool(units)
    if unused:
        notes.append(f"{unused} line{'s' if unused > 1 else ''} above the numbers not used")
    cells = tuple(header) if header else tuple(f"#{i + 1}" for i in range(width))
    return Layout(
        encoding,
        separator,
        decimal_mark(lines[first:], separator),
        cells,
        tuple(units),
        first + 1,
        width,
        text_columns,
        False,
        tuple(notes),
    )


def _text_columns(fitting: list[list[str]]) -> tuple[int, ...]:
    """Columns without a single number in the rows that are mostly numbers, all of one width."""
    return tuple(
        c for c in range(len(fitting[0]))
        if not any(is_number(row[c]) for row in fitting) and any(row[c] for row in fitting)
    )  # fmt: skip


def _is_data(row: list[str], width: int, text_columns: tuple[int, ...]) -> bool:
    cells = [cell for i, cell in enumerate(row) if i not in text_columns]
    return len(row) == width and any(cells) and all(not cell or is_number(cell) for cell in cells)


def _blank_header(line: str, width: int) -> list[str]:
    """Split a line above columns of blanks: names and units may hold single blanks, ``Act speed [rpm]``."""
    text = line.strip().lstrip("#%").strip()
    joined = re.sub(r"(?<!\s)\s++(?=[\[(][^\s\[\]()]*+[\])])", "\x00", text)
    ways = (text.split(), joined.split(), re.split(r"\s{2,}|\t", text))
    cells = next((way for way in ways if len(way) == width), ways[0])
    return [cell.replace("\x00", " ") for cell in cells]


def _is_header(row: list[str], width: int) -> bool:
    cells = _trimmed(row)
    return width - 1 <= len(cells) <= width and all(cells) and not any(map(is_number, cells))


def _is_units(row: list[str], width: int) -> bool:
    cells = [cell.strip("[]()").strip() for cell in row]
    return len(row) <= width and any(cells) and all(not cell or cell == "-" or is_unit(cell) for cell in cells)


def _above(rows: list[list[str]], first: int, width: int) -> tuple[list[str], list[str], int]:
    """Return header cells, units cells and the header's row index, -1 where there is none."""
    block: list[int] = []
    for i in range(first - 1, -1, -1):
        if any(rows[i]) and (_is_header(rows[i], width) or _is_units(rows[i], width)):
            block.insert(0, i)
        elif any(rows[i]) or block:
            break
    heads = [i for i in block if _is_header(rows[i], width)]
    if not heads:
        return [], [], -1

    def known(i: int) -> tuple[int, int]:
        # the header is the row with the most known names; among equals the last one that is no row of units
        names = [split_header(cell)[0] for cell in rows[i]]
        return sum(guess_channel(name) is not None for name in names), i - first * _is_units(rows[i], width)

    head = max(heads, key=known)
    units = next((i for i in block if i != head and _is_units(rows[i], width)), None)
    cells = [] if units is None else [cell.strip("[]()").strip() for cell in rows[units]]
    return _trimmed(rows[head]), cells, head


def _refuse_text_above(rows: list[list[str]], first: int, above: tuple[list[str], list[str], int], file: str) -> None:
    """Refuse rows between a header and the first good row of numbers: they are data with a bad cell."""
    top = next((i for i, row in enumerate(rows[:first]) if _looks_canonical(row)), None)
    if top is None:
        filled = [i for i in range(first) if any(rows[i])]
        heads = [i for i in filled if _is_header(rows[i], len(rows[first]))]
        top = heads[-1] if heads and not above[0] else None
    if top is None or (above[0] and top == above[2]):
        return
    for i in range(top + 1, first):
        row = rows[i]
        column = next((c for c, cell in enumerate(row) if cell and not is_number(cell)), None)
        if len(row) == len(rows[first]) and column is not None:
            name = split_header(rows[top][column])[0] if column < len(rows[top]) else f"#{column + 1}"
            place = f"line {i + 1}, column {column + 1} ('{name}')"
            raise LogError(f"{file}: {one_line(place)}: '{one_line(row[column][:40])}' found; {expected(row[column])}")
        if any(row):
            raise LogError(f"{file}: line {i + 1}: {len(row)} cells found; {len(rows[first])} were expected")


def _looks_canonical(row: list[str]) -> bool:
    return len(row) > 1 and all(
        re.fullmatch(r"(\w+) \[[^\]]+\]", cell) and cell.split(" ")[0] in CHANNELS for cell in row
    )

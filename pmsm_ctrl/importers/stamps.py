"""Time as dates: ISO 8601, German and US dates, the time of day, FILETIME and counts since 1970.

A date column becomes seconds counted from its first row; the notes name the form. A date whose day and month are
ambiguous is accepted within one day, where the order makes no difference, and refused beyond.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.errors import LogError
from pmsm_ctrl.importers.layout import Form, Layout, Stamps, split_line
from pmsm_ctrl.importers.names import guess_channel, split_header
from pmsm_ctrl.importers.table import one_line

__all__ = ["FORMS", "dated", "form_of", "with_stamps"]

Nanoseconds = NDArray[np.int64]
DAY = 86_400_000_000_000  # ns
OF_DAY = "time of day"
FIRST_YEAR, LAST_YEAR = "1700", "2250"  # 64 bits of ns since 1970 hold no more, and numpy overflows without an error
LOOKED_AT = 400  # rows that determine the form

_CLOCK = r"(\d{1,2}:\d{2}(?::\d{2}(?:[.,]\d{1,9})?)?)"
_ISO = re.compile(
    rf"(\d{{4}})-(\d{{2}})-(\d{{2}})[T ]\s*{_CLOCK}\s*(Z|[+-][01]\d:?[0-5]\d)?", re.IGNORECASE
)  # fmt: skip
_COMPACT = re.compile(
    r"(\d{4})(\d{2})(\d{2})T(\d{2})(\d{2})(\d{2}(?:[.,]\d{1,9})?)(Z|[+-][01]\d:?[0-5]\d)?", re.IGNORECASE
)
_YEAR_FIRST = re.compile(rf"(\d{{4}})/(\d{{1,2}})/(\d{{1,2}})\s+{_CLOCK}")
_DOTTED = re.compile(rf"(\d{{1,2}})\.(\d{{1,2}})\.(\d{{4}}),?\s+{_CLOCK}")
_SLASHED = re.compile(rf"(\d{{1,2}})/(\d{{1,2}})/(\d{{4}}),?\s+{_CLOCK}\s*(AM|PM)?", re.IGNORECASE)
_OF_DAY = re.compile(_CLOCK)
_COUNT = re.compile(r"\d{12,19}")


def _moments(cells: Sequence[str], pattern: re.Pattern[str], write: Callable[[re.Match[str]], str]) -> Nanoseconds:
    texts, shifts = [], []
    for k, cell in enumerate(cells):
        match = pattern.fullmatch(cell)
        if match is None:
            raise ValueError(k)
        texts.append(write(match).replace(",", "."))
        if not FIRST_YEAR <= texts[-1][:4] <= LAST_YEAR:
            raise ValueError(k)
        shifts.append(_offset(match[match.re.groups]) if pattern in (_ISO, _COMPACT) else 0)
    try:
        read = np.array(texts, dtype="datetime64[ns]")
    except ValueError:
        raise ValueError(next(k for k, text in enumerate(texts) if not _possible(text))) from None
    return read.astype(np.int64) - np.array(shifts, dtype=np.int64)


def _possible(text: str) -> bool:
    try:
        np.datetime64(text, "ns")
    except ValueError:
        return False
    return True


def _offset(zone: str | None) -> int:
    """Return ns from UTC to the zone's time."""
    if not zone or zone in "Zz":
        return 0
    minutes = int(zone[1:3]) * 60 + int(zone[-2:])
    return (-1 if zone[0] == "-" else 1) * minutes * 60_000_000_000


def _padded(clock: str) -> str:
    hours, _, rest = clock.partition(":")
    return f"{hours:0>2}:{rest}"


def _slashed(day: int, month: int) -> Callable[[Sequence[str]], Nanoseconds]:
    def write(match: re.Match[str]) -> str:
        clock = _padded(match[4])
        if match[5]:  # 12 AM is midnight, 12 PM is noon
            clock = f"{int(clock[:2]) % 12 + 12 * (match[5].upper() == 'PM'):02}{clock[2:]}"
        return f"{match[3]}-{match[month]:0>2}-{match[day]:0>2}T{clock}"

    return lambda cells: _moments(cells, _SLASHED, write)


def _counts(start: int, ns: int) -> Callable[[Sequence[str]], Nanoseconds]:
    def read(cells: Sequence[str]) -> Nanoseconds:
        bad = next((k for k, cell in enumerate(cells) if not _COUNT.fullmatch(cell)), None)
        if bad is not None:
            raise ValueError(bad)
        return (np.array([int(cell) for cell in cells], dtype=np.int64) - start) * ns

    return read


FORMS = (
    Form("ISO 8601", lambda cells: _moments(cells, _ISO, lambda m: f"{m[1]}-{m[2]}-{m[3]}T{_padded(m[4])}")),
    Form("ISO 8601, compact", lambda cells: _moments(
        cells, _COMPACT, lambda m: f"{m[1]}-{m[2]}-{m[3]}T{m[4]}:{m[5]}:{m[6]}"
    )),
    Form("yyyy/mm/dd", lambda cells: _moments(
        cells, _YEAR_FIRST, lambda m: f"{m[1]}-{m[2]:0>2}-{m[3]:0>2}T{_padded(m[4])}"
    )),
    Form("dd.mm.yyyy", lambda cells: _moments(
        cells, _DOTTED, lambda m: f"{m[3]}-{m[2]:0>2}-{m[1]:0>2}T{_padded(m[4])}"
    )),
    Form("mm/dd/yyyy", _slashed(2, 1)),
    Form("dd/mm/yyyy", _slashed(1, 2)),
    Form(OF_DAY, lambda cells: _moments(cells, _OF_DAY, lambda m: f"1970-01-01T{_padded(m[1])}")),
)  # fmt: skip
_EITHER = "dd/mm/yyyy or mm/dd/yyyy"
# the ranges for the years 2000 to 2100 do not overlap
_COUNTED = (
    (946_684_800_000, 4_102_444_800_000, Form("ms since 1970", _counts(0, 1_000_000))),
    (946_684_800_000_000, 4_102_444_800_000_000, Form("us since 1970", _counts(0, 1_000))),
    (125_911_584_000_000_000, 157_469_184_000_000_000, Form("FILETIME", _counts(116_444_736_000_000_000, 100))),
    (630_822_816_000_000_000, 662_380_416_000_000_000, Form("ticks of .NET", _counts(621_355_968_000_000_000, 100))),
    (946_684_800_000_000_000, 4_102_444_800_000_000_000, Form("ns since 1970", _counts(0, 1))),
)


def form_of(cells: Sequence[str]) -> Form | None:
    """Return the one form that fits all cells, None where there is none.

    Dates with slashes that fit both orders are returned under a name with both.
    """
    found = []
    for form in FORMS:
        try:
            form.read(cells)
        except (ValueError, OverflowError):
            continue
        found.append(form)
    if len(found) == 2:  # only the two with slashes can both fit
        if any(match[5] for cell in cells if (match := _SLASHED.fullmatch(cell))):
            return found[0]  # AM and PM are written where the month comes first
        return replace(found[0], name=_EITHER)
    return found[0] if found else None


def _counted(cell: str) -> Form | None:
    if not _COUNT.fullmatch(cell):
        return None
    return next((form for low, high, form in _COUNTED if low <= int(cell) < high), None)


def with_stamps(layout: Layout, lines: Sequence[str]) -> Layout:
    """Return the layout with the column of dates that gives its time, where there is one.

    Dates are ignored where a column already gives the time as a number with a unit or a plausible size.
    """
    rows = [split_line(line, layout.separator) for line in lines[layout.first_line - 1 :][:LOOKED_AT] if line.strip()]
    rows = [row for row in rows if len(row) == layout.width]
    if not rows:
        return layout
    headers = [split_header(layout.header[c]) if c < len(layout.header) else ("", "") for c in range(layout.width)]
    timed = [c for c, (name, _) in enumerate(headers) if guess_channel(name) == "t"]
    numeric = [c for c in timed if c not in layout.text_columns]
    if len(numeric) == 1 and not headers[numeric[0]][1] and not _unit(layout, numeric[0]):
        form = _counted(rows[0][numeric[0]])
        if form is not None:
            return _stamped(layout, numeric[0], form, rows)
    if numeric:
        return layout
    for c in (*(c for c in timed if c in layout.text_columns), *(c for c in layout.text_columns if c not in timed)):
        form = form_of([row[c] for row in rows])
        if form is not None:
            return _stamped(layout, c, form, rows)
    return layout


def _unit(layout: Layout, column: int) -> str:
    return layout.units[column] if column < len(layout.units) else ""


def _stamped(layout: Layout, column: int, form: Form, rows: list[list[str]]) -> Layout:
    origin = int(form.read([rows[0][column]])[0])
    begin = str(np.datetime_as_string(np.datetime64(origin, "ns"), unit="us"))
    begin = begin.split("T")[1] if form.name == OF_DAY else begin.replace("T", " ")
    header = layout.header[column] if column < len(layout.header) else f"#{column + 1}"
    left = tuple(c for c in layout.text_columns if c != column)
    note = f"t from '{one_line(header)}', read as {form.name}, counted from its first row, {begin}"
    date = rows[0][column].split()[0] if form.name == _EITHER else ""
    return replace(layout, text_columns=left, notes=(*layout.notes, note), stamps=Stamps(column, form, origin, date))


def dated(
    piece: bytes, file: str, layout: Layout, first_line: Callable[[], int], before: tuple[int, int]
) -> tuple[bytes, tuple[int, int]]:
    """Return whole lines with the dates replaced by seconds.

    Parameters
    ----------
    piece : bytes
    file : str
    layout : Layout
        With stamps.
    first_line : function
        Returns the number of the piece's first line; called only for a complaint.
    before : (int, int)
        Midnights passed and the last time of day (ns) of the lines before.

    Returns
    -------
    (bytes, (int, int))
        The lines, and midnights and time of day after them.

    Raises
    ------
    LogError
        With line and column for a cell that is no date of the column's form.
    """
    stamps = layout.stamps
    assert stamps is not None
    encoding = "latin-1" if layout.encoding == "latin-1" else "utf-8"
    lines = piece.decode(encoding, errors="replace").replace("\r\n", "\n").replace("\r", "\n").split("\n")
    rows = {}
    for k, text in enumerate(lines):
        cells = split_line(text, layout.separator) if text.strip() and text != "\x1a" else []
        if len(cells) > stamps.column and not (cells[0].casefold() == "eof" and not any(cells[1:])):
            rows[k] = cells
    places, cells = list(rows), [row[stamps.column] for row in rows.values()]

    def refuse(k: int, why: str) -> LogError:
        name = one_line(layout.header[stamps.column][:60]) if stamps.column < len(layout.header) else "no name"
        place = f"line {first_line() + places[k]}, column {stamps.column + 1} ('{name}')"
        return LogError(f"{file}: {place}: '{one_line(cells[k][:40])}' {why}")

    if stamps.only_date:
        other = next((k for k, cell in enumerate(cells) if cell.split()[:1] != [stamps.only_date]), None)
        if other is not None:
            raise refuse(other, "could be day first or month first; write yyyy-mm-dd, or map t = 'every 1 ms'")
    if not cells:
        return piece, before
    try:
        moments = stamps.form.read(cells)
    except ValueError as error:
        raise refuse(int(error.args[0]), f"found; a date was expected, {stamps.form.name}") from None
    midnights, last = before
    if stamps.form.name == OF_DAY:
        # a step back by more than half a day means that the log runs past midnight
        passed = midnights + np.cumsum(np.diff(moments, prepend=last) < -DAY // 2)
        midnights, last = int(passed[-1]), int(moments[-1])
        moments = moments + DAY * passed
    for (k, row), ns in zip(rows.items(), (moments - stamps.origin).tolist(), strict=True):
        row[stamps.column] = repr(ns / 1e9)
        lines[k] = layout.separator.join(f'"{cell}"' if layout.separator in cell else cell for cell in row)
    return "\n".join(lines).encode(encoding, errors="replace"), (midnights, last)

"""Files of measured Bode diagrams, as drives and analysers write them: which column is what, and in which unit.

Known are tables of a frequency with magnitude and phase, or with real and imaginary part, one or several sets beside
each other: the recordings of TwinCAT's Bode plot (open loop, closed loop, process), exports of drive tools and
analysers with names in English or German, and tables without a header. What the file does not state is found from the
numbers, and is a doubt that has to be confirmed.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.errors import LogError
from pmsm_ctrl.importers.layout import is_number, opening, place_header, split_line

__all__ = ["BodeFile", "BodeSet", "is_bode_file", "read_bode"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

LARGEST = 1 << 26  # bytes of such a file
FEWEST = 12  # frequencies that are worth a fit
_NAMED = re.compile(r"^(?P<name>.*?)[\[(](?P<unit>[^\[\]()]*)[\])]\s*$")
_SUFFIX = re.compile(r"^(?P<name>.+?)[ _/](?P<unit>hz|khz|rad_s|rad/s|db|deg|grad|rad)$", re.IGNORECASE)
# Parts of a name, lower case; the first role that has one is taken.
_ROLES = {
    "coherence": ("coher", "kohär", "kohaer"),
    "frequency": ("freq", "fréq", "frec"),
    "phase": ("phase", "phas", "fase", "winkel", "angle", "arg"),
    "real": ("real", "reell"),
    "imaginary": ("imag",),
    "magnitude": ("magn", "mag", "ampl", "amp", "gain", "betrag", "verst", "modul", "db"),
}
_WHOLE = {
    "f": "frequency", "w": "frequency", "omega": "frequency", "hz": "frequency", "re": "real", "im": "imaginary",
    "abs": "magnitude", "g": "magnitude", "phi": "phase", "deg": "phase", "°": "phase", "coh": "coherence",
}  # fmt: skip
_SETS = {
    "closed": ("closed", "geschlossen", "führung", "fuehrung", "reference"),
    "open": ("open", "offen"),
    "plant": ("process", "plant", "strecke", "mechan", "controlled system"),
}


@dataclass(frozen=True, eq=False)
class BodeSet:
    """One frequency response of a file.

    Attributes
    ----------
    kind : str
        "plant", "open" or "closed" where the file says so, else empty.
    frequency : array, shape (n,)
        Hz, rising.
    value : complex array, shape (n,)
    coherence : array, shape (n,)
        NaN where the file has none.
    unit : str
        Of the magnitude as its header states it, without dB; empty where it does not.
    """

    kind: str
    frequency: Array
    value: Complex
    coherence: Array
    unit: str = ""


@dataclass(frozen=True, eq=False)
class BodeFile:
    """A file of measured frequency responses.

    Attributes
    ----------
    file : str
    sets : tuple of BodeSet
    columns : tuple of str
        Which column is what, in words.
    doubts : tuple of str
        What the file does not state and the numbers suggest.
    """

    file: str
    sets: tuple[BodeSet, ...]
    columns: tuple[str, ...]
    doubts: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Column:
    index: int
    role: str
    unit: str
    kind: str
    label: str


def is_bode_file(path: str | os.PathLike[str]) -> bool:
    """Return whether a text file has a column of frequencies and none of time.

    Parameters
    ----------
    path : path
    """
    try:
        header, units, _, _ = _table(Path(path), str(path), rows=False)
    except (LogError, OSError):
        return False
    found = [one.role for one in _named(header, units)]
    return "frequency" in found and len(set(found)) > 1 and not _timed(header)


def _timed(header: Sequence[str]) -> bool:
    return any(_split(cell)[0].lower() in ("t", "time", "zeit", "timestamp") for cell in header)


def read_bode(path: str | os.PathLike[str]) -> BodeFile:
    """Read a file of measured frequency responses.

    Parameters
    ----------
    path : path
        Text: a column of frequencies, with magnitude and phase or real and imaginary part.

    Returns
    -------
    BodeFile

    Raises
    ------
    LogError
        When it is no such table.
    """
    file = os.fspath(path)
    header, units, rows, doubts = _table(Path(path), file)
    columns: list[_Column] = [] if _timed(header) else _named(header, units)
    if not any(one.role == "frequency" for one in columns):
        columns = [] if header else _unnamed(rows)
        if not columns:
            raise LogError(
                f"{file}: no column of frequencies; a table of frequency with magnitude and phase, or with real and "
                "imaginary part, was expected"
            )
        doubts.append("without a header: the columns are taken as frequency, magnitude and phase")
    sets: list[BodeSet] = []
    used: list[str] = []
    for group in _groups(columns):
        one, shown, unsure = _set(group, rows, file)
        sets.append(one)
        used += shown
        doubts += unsure
    if not sets:
        raise LogError(f"{file}: a frequency, but neither magnitude and phase nor real and imaginary part")
    return BodeFile(file, tuple(sets), tuple(dict.fromkeys(used)), tuple(dict.fromkeys(doubts)))


def _table(path: Path, file: str, *, rows: bool = True) -> tuple[Sequence[str], Sequence[str], Array, list[str]]:
    """Return header, units, numbers, and what is left out: text below the numbers, and any numbers below that.

    An empty cell is NaN: sets beside each other may have different lengths.
    """
    try:
        if path.exists() and not path.is_file():
            raise LogError(f"{file}: is no file; a measured frequency response was expected")
        if path.stat().st_size > LARGEST:
            raise LogError(f"{file}: larger than {LARGEST >> 20} MB; a measured frequency response was expected")
        lines, encoding, separator = opening(path, file)
    except FileNotFoundError:
        raise LogError(f"{file}: no such file") from None
    layout = place_header(lines, separator, encoding, file)
    header = () if all(cell.startswith("#") for cell in layout.header) else layout.header
    if not rows:
        return header, layout.units, np.empty((0, 0)), []
    every = path.read_text(encoding=encoding, errors="replace").splitlines()
    found: list[list[float]] = []
    stopped = below = 0
    for number, line in enumerate(every[layout.first_line - 1 :], start=layout.first_line):
        cells = split_line(line, separator)[: layout.width]
        values = _numbers(cells, layout.decimal)
        if not any(cell.strip() for cell in cells):
            continue
        if values is None or stopped:
            stopped = stopped or number
            below += values is not None
            continue
        found.append(values + [math.nan] * (layout.width - len(values)))
    left_out = [f"line {stopped} is no row of numbers; {below} rows below it are left out"] if below else []
    return header, layout.units, np.array(found, dtype=np.float64).reshape(-1, layout.width), left_out


def _numbers(cells: Sequence[str], decimal: str) -> list[float] | None:
    """Return the cells of a row as numbers, empty ones as NaN; None where one is a text or fewer than two are given."""
    given = [cell.strip() for cell in cells]
    if sum(map(bool, given)) < 2 or not all(is_number(cell) for cell in given if cell):
        return None
    return [float(cell.replace(",", ".") if decimal == "," else cell) if cell else math.nan for cell in given]


def _split(cell: str) -> tuple[str, str]:
    text = cell.strip().strip('"').strip()
    match = _NAMED.match(text) or _SUFFIX.match(text)
    return (match["name"].strip(), match["unit"].strip()) if match else (text, "")


def _named(header: Sequence[str], units: Sequence[str]) -> list[_Column]:
    found = []
    for index, cell in enumerate(header):
        name, unit = _split(cell)
        if index < len(units) and units[index] not in ("", "-"):
            unit = units[index]
        text = name.lower()
        role = _WHOLE.get(text) or next(
            (role for role, parts in _ROLES.items() if any(part in text for part in parts)), ""
        )
        if not role and unit.lower() == "db":
            role = "magnitude"
        kind = next((kind for kind, parts in _SETS.items() if any(part in text for part in parts)), "")
        if role:
            found.append(_Column(index, role, unit.lower(), kind, cell))
    return found


def _unnamed(rows: Array) -> list[_Column]:
    """Return the columns of a table of three without a header, the first of which rises from above zero."""
    if rows.shape[1] != 3 or len(rows) < FEWEST or rows[0, 0] <= 0.0 or not np.all(np.diff(rows[:, 0]) > 0.0):
        return []
    return [_Column(k, role, "", "", f"#{k + 1}") for k, role in enumerate(("frequency", "magnitude", "phase"))]


def _groups(columns: list[_Column]) -> list[dict[str, _Column]]:
    """Return the sets of a file: each has the last frequency before it."""
    groups: list[dict[str, _Column]] = []
    frequency = next(one for one in columns if one.role == "frequency")
    current: dict[str, _Column] = {}
    current_frequency = frequency
    for one in columns:
        if one.role == "frequency":
            frequency = one
            continue
        kinds = {other.kind for other in current.values()}
        if one.role in current or (one.kind and kinds - {one.kind}):
            groups.append({"frequency": current_frequency, **current})
            current = {}
        if not current:
            current_frequency = frequency
        current[one.role] = one
    if current:
        groups.append({"frequency": current_frequency, **current})
    return [
        group for group in groups if {"magnitude", "phase"} <= group.keys() or {"real", "imaginary"} <= group.keys()
    ]


def _set(group: dict[str, _Column], rows: Array, file: str) -> tuple[BodeSet, list[str], list[str]]:
    """Return one response, its columns in words, and what is doubtful."""
    doubts: list[str] = []
    shown = {role: f"{one.label}: {role}" for role, one in group.items()}
    indices = [one.index for role, one in group.items() if role != "coherence"]
    rows = rows[~np.isnan(rows[:, indices]).any(axis=1)]
    column = {role: rows[:, one.index] for role, one in group.items()}
    frequency = column["frequency"]
    if group["frequency"].unit in ("rad/s", "rad_s", "1/s") or group["frequency"].label.lower() in ("w", "omega"):
        frequency = frequency / (2.0 * math.pi)
    elif group["frequency"].unit == "khz":
        frequency = 1e3 * frequency
    if "real" in group and "imaginary" in group:
        value = column["real"] + 1j * column["imaginary"]
    else:
        sizes, unsure = _magnitudes(column["magnitude"], group["magnitude"])
        angle, of_angle, also = _phase(column["phase"], group["phase"])
        of_size = min(sizes, key=lambda name: _slope_less_phase(frequency, sizes[name], angle))
        size = sizes[of_size]
        shown["magnitude"] += f", {of_size}"
        shown["phase"] += f", {of_angle}"
        if unsure:
            label = group["magnitude"].label
            doubts.append(f"{label}: no unit is stated; taken as {of_size}, whose slope fits the phase better")
        if also:
            doubts.append(f"{group['phase'].label}: no unit is stated; taken as {of_angle}, the largest is {also:.3g}")
        value = size * np.exp(1j * angle)
    coherence = column.get("coherence", np.full(len(frequency), np.nan))
    good = (frequency > 0.0) & np.isfinite(frequency) & np.isfinite(value) & (np.abs(value) > 0.0)
    frequency, value, coherence = frequency[good], value[good], coherence[good]
    _, first = np.unique(frequency, return_index=True)
    if len(first) < FEWEST:
        raise LogError(f"{file}: {len(first)} frequencies; at least {FEWEST} are worth a fit")
    kind = next((one.kind for one in group.values() if one.kind), "")
    sized = group.get("magnitude") or group["real"]
    one = BodeSet(
        kind, frequency[first], np.asarray(value[first], dtype=np.complex128), coherence[first], _stated(sized)
    )
    return one, list(shown.values()), doubts


def _stated(column: _Column) -> str:
    """Return the unit in the brackets of a column's name, or that of a line of units; `dB re rpm/A` is rpm/A."""
    _, opened, rest = column.label.partition("[") if "[" in column.label else column.label.partition("(")
    text = rest.strip().strip('"').rstrip("])") if opened else column.unit
    text = re.sub(r"^db\b[\s:]*(re\b)?", "", text.strip(), flags=re.IGNORECASE).strip()
    return text + ")" * max(0, text.count("(") - text.count(")"))


def _magnitudes(values: Array, column: _Column) -> tuple[dict[str, Array], bool]:
    """Return the modulus by the units that it may have, and whether there is a choice."""
    stated = column.unit == "db" or "db" in re.split(r"[\W_]+", column.label.lower())
    in_db, linear = {"dB": 10.0 ** (np.clip(values, -600.0, 600.0) / 20.0)}, {"linear": values}
    if stated or np.any(values < 0.0):
        return in_db, False
    if _stated(column) not in ("", "-") or np.max(values, initial=0.0) > 300.0:  # 300 dB is no response
        return linear, False
    return {**in_db, **linear}, True


def _phase(values: Array, column: _Column) -> tuple[Array, str, float]:
    """Return the phase in rad, its unit, and the largest where no unit is stated, else 0.

    No axis and no loop stays within 12.6 deg over a decade, and none turns twice.
    """
    words = {column.unit, *re.split(r"[\W_]+", column.label.lower())}
    if "rad" in words:
        return values, "rad", 0.0
    if words & {"deg", "grad", "°", "degree", "degrees"}:
        return np.radians(values), "deg", 0.0
    largest = float(np.nanmax(np.abs(values), initial=0.0))
    return (values, "rad", largest) if largest <= 4.0 * math.pi else (np.radians(values), "deg", largest)


def _slope_less_phase(frequency: Array, size: Array, angle: Array) -> float:
    """Return how far the phase is from 90 deg per decade of slope: Bode's relation of responses of minimum phase."""
    good = (frequency > 0.0) & (size > 0.0)
    if good.sum() < FEWEST:
        return math.inf
    order = np.argsort(frequency[good], kind="stable")
    f, logarithm, phase = (part[order] for part in (np.log(frequency[good]), np.log(size[good]), angle[good]))
    ends = max(1, len(f) // 4)  # the level at either end; what lies between is resonances
    slope = (np.median(logarithm[-ends:]) - np.median(logarithm[:ends])) / (np.median(f[-ends:]) - np.median(f[:ends]))
    turn = np.angle(np.exp(1j * (phase - 0.5 * math.pi * slope)))
    return float(np.median(np.abs(turn)))

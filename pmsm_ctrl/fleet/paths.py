"""Axis, type and time of a log, from its path or from the first date in it."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import PurePath

from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.fleet.remote import head

__all__ = ["Pattern", "Place", "compiled", "first_date", "guessed"]

_FIELD = re.compile(r"\{(\w+)(?::([^}]*))?\}|\*\*/|\*|\?")
_DIGITS = {"Y": r"\d{4}", "m": r"\d{2}", "d": r"\d{2}", "H": r"\d{2}", "M": r"\d{2}", "S": r"\d{2}", "j": r"\d{3}",
           "y": r"\d{2}", "f": r"\d{1,6}", "z": r"(?:Z|[+-]\d{2}:?\d{2})", "%": "%"}  # fmt: skip
# A date in a name, with or without the time of day.
_DATE = re.compile(
    r"(?<!\d)(\d{4})[-_.]?(0[1-9]|1[0-2])[-_.]?(0[1-9]|[12]\d|3[01])"
    r"(?:[T_ -]?([01]\d|2[0-3])[-_.h:]?([0-5]\d)(?:[-_.m:]?([0-5]\d))?)?(?!\d)"
)
_LAST_NUMBER = re.compile(r"[-_ .]*\d+$")
_STAMP = re.compile(r"(\d{4}-\d{2}-\d{2})[T ](\d{2}:\d{2})(?::(\d{2}))?(?:[.,]\d+)?\s*(Z|[+-]\d{2}:?\d{2})?")
HEAD = 16384  # bytes in which the first row of numbers stands


@dataclass(frozen=True)
class Place:
    """What a path says of a log.

    Attributes
    ----------
    axis, type : str
    time : datetime or None
        UTC where the path states no zone.
    """

    axis: str
    type: str = ""
    time: datetime | None = None


@dataclass(frozen=True)
class Pattern:
    """The pattern of a manifest as a regular expression on the end of a path.

    Attributes
    ----------
    text : str
    regex : re.Pattern
    form : str
        Of `datetime.strptime`; empty for ISO 8601.
    """

    text: str
    regex: re.Pattern[str]
    form: str = ""

    @property
    def groupindex(self) -> Mapping[str, int]:
        """The fields that the pattern has."""
        return self.regex.groupindex

    def place(self, path: PurePath) -> Place | None:
        """Return what a path says; None where it does not match.

        Parameters
        ----------
        path : PurePath
        """
        match = self.regex.search(path.as_posix())
        if match is None:
            return None
        found = match.groupdict()
        return Place(found["axis"], found.get("type") or "", self._time(found["time"]) if "time" in found else None)

    def _time(self, text: str) -> datetime:
        try:
            moment = datetime.strptime(text, self.form) if self.form else datetime.fromisoformat(text)
        except ValueError:
            raise RequestError(f"'{text}' in a path is no time for path = '{self.text}'") from None
        return moment if moment.tzinfo else moment.replace(tzinfo=UTC)


def compiled(text: str) -> Pattern:
    """Return the pattern of a manifest, such as ``{type}/{axis}/{time:%Y-%m-%d}.csv``.

    Parameters
    ----------
    text : str
        Fields ``{axis}``, ``{type}`` and ``{time}`` or ``{time:FORM}``; ``*`` and ``?`` within a name.

    Returns
    -------
    Pattern

    Raises
    ------
    RequestError
        For an unknown field, one that is given twice, or no ``{axis}``.
    """
    out, form, last, seen = [], "", 0, []
    for match in _FIELD.finditer(text):
        out.append(re.escape(text[last : match.start()]))
        last = match.end()
        name = match[1]
        if name is None:
            out.append({"*": "[^/]*", "?": "[^/]", "**/": "(?:.*/)?"}[match[0]])
            continue
        if name not in ("axis", "type", "time") or name in seen:
            raise RequestError(f"path = '{text}': field '{name}'; axis, type and time, each once, were expected")
        seen.append(name)
        form = match[2] or "" if name == "time" else form
        out.append(f"(?P<{name}>{_of_form(match[2]) if name == 'time' and match[2] else '[^/]+?'})")
    if "axis" not in seen:
        raise RequestError(f"path = '{text}': no {{axis}} in it")
    return Pattern(text, re.compile(rf"(?:^|/){''.join(out)}{re.escape(text[last:])}$"), form)


def _of_form(form: str) -> str:
    """Return the regular expression of what a form of strptime matches."""
    parts = re.split(r"%(.)", form)
    return "".join(re.escape(part) if k % 2 == 0 else _DIGITS.get(part, r"[^/]+?") for k, part in enumerate(parts))


def guessed(path: PurePath, root: PurePath) -> Place:
    """Guess axis and time: the folder below `root` is the axis, else the name without its date; the time is a date.

    Parameters
    ----------
    path, root : PurePath

    Returns
    -------
    Place
    """
    parts = path.relative_to(root).parts if path.is_relative_to(root) else (path.name,)
    dates = list(_DATE.finditer("/".join(parts)[: -len(path.suffix)]))
    match = dates[-1] if dates else None
    time = None
    if match is not None:
        time = datetime(*(int(group or 0) for group in match.groups()), tzinfo=UTC)  # type: ignore[misc, arg-type]
    if len(parts) > 1:
        return Place(parts[0], "", time)
    stem = _DATE.sub("", path.stem).strip("-_ .")
    return Place(stem if time is not None and stem else _LAST_NUMBER.sub("", path.stem) or path.stem, "", time)


def first_date(path: str | os.PathLike[str]) -> datetime | None:
    """Return the first ISO 8601 date in a text file: that of its first row, or of its heading.

    Parameters
    ----------
    path : path
        Here or elsewhere.

    Returns
    -------
    datetime or None
        None where its first lines hold no date.
    """
    match = _STAMP.search(head(path, HEAD).decode("latin-1"))
    if match is None:
        return None
    try:
        moment = datetime.fromisoformat(f"{match[1]}T{match[2]}:{match[3] or '00'}{match[4] or ''}")
    except ValueError:
        return None
    return moment if moment.tzinfo else moment.replace(tzinfo=UTC)

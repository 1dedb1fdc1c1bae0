"""The sampling period that stands above the numbers of a text file: ``SamplePeriod;0.0005``, ``Abtastrate: 8 kHz``."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

from pmsm_ctrl.design import Design
from pmsm_ctrl.importers.names import guess_channel, unit_of
from pmsm_ctrl.importers.table import HeaderPeriod, Table, one_line

__all__ = ["ASSUMED_UNITS", "header_period", "timed_by_header"]

MOST_LINES, LONGEST = 400, 200  # lines above the numbers, and characters of a line, that are looked at
# Of a step without a unit: the unit, and the largest step that is taken for it.
ASSUMED_UNITS = (("s", 0.04), ("ms", 40.0), ("us", 4e4), ("ns", math.inf))
_PERIOD = (
    r"sampl(?:e|ing)[ _-]?(?:period|time|interval)|abtast(?:zeit|periode|intervall)|(?:tempo|periodo) di campionamento|"
    r"p[ée]riode d.[ée]chantillonnage"
)
_RATE = (
    r"sampl(?:e|ing)[ _-]?(?:rate|freq(?:uency)?)|abtast(?:rate|frequenz)|frequenza di campionamento|"
    r"fr[ée]quence d.[ée]chantillonnage"
)
_STATED = re.compile(
    rf"(?<![^\W_])(?:(?P<period>{_PERIOD})|(?P<rate>{_RATE}))[ _]?"
    r"(?:[\[(](?P<before>[^\W\d_]{1,9})[\])])?[\"\s:=;,|]*+"
    r"(?P<number>\d{1,15}+(?:[.,]\d{1,15}+)?(?:e[+-]?\d{1,2}+)?)\"?\s*+[;,|]?\s*+[\[(\"]?(?P<behind>[^\W\d_]{1,9}+)?",
    re.IGNORECASE,
)
_HERTZ = {"hz": 1.0, "khz": 1e3, "mhz": 1e6}


def header_period(lines: Sequence[str]) -> HeaderPeriod | None:
    """Return the first sampling period or rate that lines above the numbers state.

    Parameters
    ----------
    lines : sequence of str

    Returns
    -------
    HeaderPeriod or None
    """
    for line in lines[:MOST_LINES]:
        found = _STATED.search(line[:LONGEST])
        if found is None:
            continue
        value = float(found["number"].replace(",", "."))
        unit = found["before"] or found["behind"] or ""
        if not value > 0.0:
            continue
        text = one_line(line).strip()[:60]
        if found["rate"]:
            hertz = _HERTZ.get(unit.casefold(), 0.0 if unit else 1.0)
            if hertz:
                return HeaderPeriod(1.0 / (value * hertz), text)
            continue
        if not unit:
            assumed = next(name for name, top in ASSUMED_UNITS if value <= top)
            return HeaderPeriod(value * (unit_of(assumed) or ("", 1.0))[1], text, assumed)
        si, factor = unit_of(unit) or ("", 0.0)
        if si == "s":
            return HeaderPeriod(value * factor, text)
    return None


def timed_by_header(
    table: Table, design: Design | None, mapping: Mapping[str, str] | None
) -> tuple[Table, Mapping[str, str] | None]:
    """Return table and mapping, with the period of the header for a file that has no time by any other way.

    A period whose unit is not stated waits for somebody who confirms it.

    Parameters
    ----------
    table : Table
    design : Design, optional
    mapping : mapping of str to str, optional

    Returns
    -------
    (Table, mapping of str to str or None)
    """
    period = table.header_period
    if period is None or period.assumed or "t" in (mapping or {}):
        return table, mapping
    if design is not None and (design.log.rate is not None or "t" in design.log.channels):
        return table, mapping
    if any(column.is_time or column.is_date or guess_channel(column.name) == "t" for column in table.columns):
        return table, mapping
    note = f"t is {period.mapping}: the header says '{period.text}'"
    return replace(table, notes=(*table.notes, note)), {**(mapping or {}), "t": period.mapping}

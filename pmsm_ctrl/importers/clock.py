"""A time column for files that have none: ``t = "every 0.125 ms"`` in the mapping."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import LogError
from pmsm_ctrl.importers.names import split_header, unit_spelling
from pmsm_ctrl.importers.table import Array, Column, Table
from pmsm_ctrl.units import UNITS

__all__ = ["is_clock", "timed_by", "with_clock"]

_EVERY = re.compile(r"\s*every\s+(.*)", re.IGNORECASE)
_PERIOD = re.compile(r"(\d[\d.,]*+(?:e[+-]?\d++)?)\s*+([^\W\d]++)\s*+$", re.IGNORECASE)


def with_clock(
    table: Table, design: Design | None, mapping: Mapping[str, str] | None
) -> tuple[Table, Mapping[str, str] | None]:
    """Return the table with a computed time column where the mapping of `t` asks for one, and the mapping to it.

    A design's [log] table may state a rate instead, of files without time or whose time counts samples.

    Raises
    ------
    LogError
        When the period is not a positive time.
    """
    spec = (mapping or {}).get("t") or (design.log.channels.get("t") if design is not None else None)
    rate = design.log.rate if design is not None else None
    if rate is not None and spec and not is_clock(spec):  # a time that counts samples
        return table, {**(mapping or {}), "t": timed_by(rate, spec)}
    if rate is not None and not spec:
        spec = timed_by(rate)
    asked = _EVERY.match(spec) if spec else None
    if asked is None:
        return table, mapping
    match = _PERIOD.match(asked[1])
    period, unit = _seconds(match[1], match[2]) if match else (math.nan, "")
    if match is None or unit != "s" or not 0.0 < period < math.inf:
        raise LogError(f"{table.file}: [log] t = '{spec}': a period such as 'every 0.125 ms' was expected")
    last = len(table.columns)
    clock = Column(name="Time", unit="s", header=f"every {match[1]} {match[2]}", group=table.columns[0].group)

    def load(indices: Sequence[int]) -> list[Array]:
        values = table.load([i for i in indices if i != last] or [0])
        loaded = iter(values)
        # multiplied, because the rounding error of a running sum grows with the row
        clock: Array = np.arange(values[0].size, dtype=np.float64) * period
        return [clock if i == last else next(loaded) for i in indices]

    timed = replace(
        table,
        columns=(*table.columns, clock),
        load=load,
        locate=lambda column, row: f"row {row + 1}" if column == last else table.locate(column, row),
    )
    return timed, {**(mapping or {}), "t": f"#{last + 1}"}


def is_clock(spec: str) -> bool:
    """Return whether a mapping of `t` asks for a computed time: ``every 0.125 ms``.

    Parameters
    ----------
    spec : str
    """
    return _EVERY.match(spec) is not None


def timed_by(rate: float, column: str = "") -> str:
    """Return the mapping of `t` that this rate stands for.

    Parameters
    ----------
    rate : float
        Samples a second, above 0.
    column : str
        The column that counts samples; empty for a file without time.

    Returns
    -------
    str
    """
    period = f"{1.0 / rate:.17g}"
    return f"{period} * {split_header(column)[0]} [s]" if column else f"every {period} s"


def _seconds(number: str, unit: str) -> tuple[float, str]:
    si, factor = UNITS.get(unit_spelling(unit), ("", 0.0))
    try:
        return float(number.replace(",", ".")) * factor, si
    except ValueError:
        return math.nan, si

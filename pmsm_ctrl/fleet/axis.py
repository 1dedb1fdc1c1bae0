"""One axis of a fleet: what each of its records gave, from the stored rows alone."""

from __future__ import annotations

import hashlib
import os
import re
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime

from pmsm_ctrl.fleet.evaluate import DONE
from pmsm_ctrl.fleet.store import Row, Store

__all__ = ["AxisRecord", "AxisRows", "axis_records", "by_axis", "page_names", "records_of"]

KINDS = ("status", "verdict", "parameter", "finding", "quantity", "deviation", "doubt")


EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


@dataclass
class AxisRows:
    """Rows of one axis, by record.

    Attributes
    ----------
    name, type : str
    times : dict of str to datetime
        Of each record.
    rows : dict of str to list of Row
    """

    name: str
    type: str
    times: dict[str, datetime] = field(default_factory=dict)
    rows: dict[str, list[Row]] = field(default_factory=lambda: defaultdict(list))

    def ordered(self) -> list[str]:
        """Return the records by time."""
        return sorted(self.times, key=lambda record: (self.times[record], record))


def by_axis(rows: Iterable[Row]) -> list[AxisRows]:
    """Sort rows by axis and record; of each record the newest evaluation counts.

    Parameters
    ----------
    rows : iterable of Row

    Returns
    -------
    list of AxisRows
        By name.
    """
    newest: dict[str, tuple[datetime, str]] = {}
    by_key: dict[str, list[Row]] = defaultdict(list)
    for row in rows:
        by_key[row.key].append(row)
        newest[row.record] = max(newest.get(row.record, (EPOCH, "")), (row.evaluated, row.key))
    axes: dict[str, AxisRows] = {}
    for _, key in newest.values():
        of_key = by_key[key]
        first = of_key[0]
        axis = axes.setdefault(first.axis, AxisRows(first.axis, first.type))
        axis.times[first.record] = first.time
        axis.rows[first.record] = of_key
    return [axes[name] for name in sorted(axes)]


@dataclass(frozen=True)
class AxisRecord:
    """What one evaluation of an axis gave.

    Attributes
    ----------
    record : str
        The log file; of several together the last one.
    time : datetime
    verdict : str
        Of the diagnosis; the word of the status where it has none.
    reason : str
        Of the verdict, or why the log could not be evaluated.
    parameters : dict of str to Row
    effects : tuple of Row
        What the diagnosis named, in its order.
    deviations : tuple of Row
        Base parameters outside their tolerance.
    doubts : tuple of Row
    error : float or None
        Relative error of the torque by the final model.
    """

    record: str
    time: datetime
    verdict: str
    reason: str
    parameters: Mapping[str, Row]
    effects: tuple[Row, ...]
    deviations: tuple[Row, ...]
    doubts: tuple[Row, ...]
    error: float | None = None


def axis_records(results: str | os.PathLike[str]) -> dict[str, tuple[AxisRecord, ...]]:
    """Return the records of every axis by time; of each log the newest evaluation counts.

    Parameters
    ----------
    results : path
        A folder that `fleet` wrote.

    Returns
    -------
    dict of str to tuple of AxisRecord

    Raises
    ------
    RequestError
        When it is no such folder.
    """
    return records_of(Store(results, create=False).read(KINDS))


def records_of(rows: Iterable[Row]) -> dict[str, tuple[AxisRecord, ...]]:
    """Return the records of every axis by time.

    Parameters
    ----------
    rows : iterable of Row

    Returns
    -------
    dict of str to tuple of AxisRecord
    """
    return {axis.name: tuple(_record(axis.rows[name]) for name in axis.ordered()) for axis in by_axis(rows)}


def _record(rows: list[Row]) -> AxisRecord:
    of_kind: dict[str, list[Row]] = {kind: [] for kind in KINDS}
    for row in rows:
        of_kind.setdefault(row.kind, []).append(row)
    verdict = next((row for row in of_kind["verdict"] if row.source == "diagnose"), None)
    status = next(iter(of_kind["status"]), None)
    error = next((row.value for row in of_kind["quantity"] if row.name == "error_final_torque"), None)
    failed = status is not None and status.name != DONE
    said = status if failed or verdict is None else verdict
    return AxisRecord(
        rows[0].record, rows[0].time, said.name if said else "", said.text if said else "",
        {row.name: row for row in of_kind["parameter"]}, tuple(of_kind["finding"]),
        tuple(row for row in of_kind["deviation"] if row.flag), tuple(of_kind["doubt"]), error,
    )  # fmt: skip


def page_names(axes: Iterable[str]) -> dict[str, str]:
    """Return a file name for the page of every axis: its name, with a hash where files cannot have it.

    Parameters
    ----------
    axes : iterable of str

    Returns
    -------
    dict of str to str
        Different also where letters differ in case alone.
    """
    names = list(axes)
    folded = Counter(name.lower() for name in names)
    out = {}
    for name in names:
        plain = re.sub(r"[^A-Za-z0-9._-]", "_", name)[:80].lstrip(".")
        same = plain == name and folded[name.lower()] == 1
        out[name] = f"{plain}.html" if same else f"{plain}-{hashlib.sha256(name.encode()).hexdigest()[:8]}.html"
    return out

"""What a fleet says of single logs: those without an answer, those that are copies, and the one to look at next."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

from pmsm_ctrl.fleet.axis import AxisRows
from pmsm_ctrl.fleet.evaluate import DONE
from pmsm_ctrl.fleet.result import Lost
from pmsm_ctrl.fleet.store import Row

__all__ = ["WORTHLESS", "latest_with", "unexplained", "without_copies", "worthless"]

WORTHLESS = ("not_excited", "implausible", "inconclusive")
UNEXPLAINED = "unexplained"


def worthless(axis: AxisRows) -> Iterator[Lost]:
    """Yield the records without an answer, and why.

    Parameters
    ----------
    axis : AxisRows
    """
    for record in axis.ordered():
        status = next((row for row in axis.rows[record] if row.kind == "status"), None)
        verdict = _verdict(axis.rows[record])
        if status is not None and status.name != DONE:
            yield Lost(record, axis.name, status.text, status.name != "failed")
        elif verdict is not None and verdict.name in WORTHLESS:
            yield Lost(record, axis.name, f"{verdict.name.replace('_', ' ')}: {verdict.text}")


def unexplained(axis: AxisRows) -> Iterator[Lost]:
    """Yield the records whose residual no effect of the catalogue explains, and what is said of it.

    Parameters
    ----------
    axis : AxisRows
    """
    for record in axis.ordered():
        verdict = _verdict(axis.rows[record])
        if verdict is not None and verdict.name == UNEXPLAINED:
            yield Lost(record, axis.name, verdict.text)


def _verdict(rows: Iterable[Row]) -> Row | None:
    return next((row for row in rows if row.kind == "verdict" and row.source == "diagnose"), None)


def without_copies(axes: Iterable[AxisRows], digests: Mapping[str, str]) -> list[str]:
    """Take every log off an axis that is byte for byte an earlier one of it, and return their names.

    The second one is no second measurement: it would confirm whatever the first one shows.

    Parameters
    ----------
    axes : iterable of AxisRows
        Changed in place.
    digests : dict of str to str
        Hash of a log by its name, where it is known.

    Returns
    -------
    list of str
    """
    out = []
    for axis in axes:
        seen: set[str] = set()
        for record in axis.ordered():
            digest = digests.get(record, "")
            if digest and digest in seen:
                out.append(record)
                del axis.times[record], axis.rows[record]
            seen.add(digest)
    return out


def latest_with(axes: Sequence[AxisRows], name: str, effect: str = "") -> str:
    """Return the last log of an axis, or the last one that shows an effect; empty where there is none.

    Parameters
    ----------
    axes : sequence of AxisRows
    name : str
        Of the axis.
    effect : str
    """
    for axis in axes:
        if axis.name != name:
            continue
        for record in reversed(axis.ordered()):
            rows = axis.rows[record]
            if not effect or any(row.kind == "finding" and row.name == effect for row in rows):
                return record
    return ""

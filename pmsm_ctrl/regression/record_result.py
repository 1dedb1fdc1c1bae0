"""What a joint fit says of each record: its errors, its own friction and offset, and whether it disagrees."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.evidence.tests import f_tail
from pmsm_ctrl.evidence.whitening import Whitener
from pmsm_ctrl.regression import notices
from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.regression.model import Solved
from pmsm_ctrl.regression.records import COUNTS, LEVELS, members, usual_spread
from pmsm_ctrl.regression.spread import Levels, disagreement, levels_of
from pmsm_ctrl.result import Estimate
from pmsm_ctrl.section import Notice
from pmsm_ctrl.units import axis_unit

__all__ = [
    "Errors",
    "RecordResult",
    "RecordSpread",
    "errors_of",
    "own_rows",
    "record_notices",
    "record_spreads",
    "zero_of",
]

Array = NDArray[np.float64]
Errors = Mapping[str, Mapping[str, Any]]  # balance -> rms, unit, relative

UNITS = {"dF_c": "N m", "dF_v": "N m s/rad", "offset": "N m"}
MEANS = {"dF_c": "F_c", "dF_v": "F_v"}  # what a level deviates from
TOLD = 0.05  # significance from which on records differ by more than their errors
MANY = 10**6  # degrees of freedom of the errors, which are taken as known
RAISED = 1.2  # times what the assumption alone makes of the spread, from which on the records make it
WITHIN = 1.96  # standard errors of a deviation in which it lies, at 95 %
SURE = 0.01  # family-wise significance from which on a record disagrees


@dataclass(frozen=True)
class RecordResult:
    """One record of several.

    Attributes
    ----------
    name : str
    held_out : bool
        Whether nothing was fitted to it.
    duration, rate : float
        s, Hz.
    before, after : dict of balance to rms, unit and relative error
    deviations : dict of symbol to Estimate
        Of its dry friction, viscous friction and constant torque from the mean over the records.
    angle : Estimate or None
        What has to be added to its position, rad (m), for the zero of all records.
    p_value : float
        That it shares inertia and friction with the others, their spread allowed for; corrected for the number of
        records.
    level_before, level_after : dict of balance to rms, unit and relative error
        Of a held-out record, dry friction, viscous friction and a constant torque refitted to it.
    """

    name: str
    held_out: bool
    duration: float
    rate: float
    before: Errors
    after: Errors
    deviations: Mapping[str, Estimate] = field(default_factory=dict)
    angle: Estimate | None = None
    p_value: float = float("nan")
    level_before: Errors = field(default_factory=dict)
    level_after: Errors = field(default_factory=dict)

    @property
    def disagrees(self) -> bool:
        """Whether its inertia or friction is not that of the other records, at a family-wise significance of 0.01."""
        return self.p_value < SURE

    def to_dict(self) -> dict[str, Any]:
        """Return plain values fit for JSON."""
        return {**vars(self), "disagrees": self.disagrees}


@dataclass(frozen=True)
class RecordSpread:
    """By how much one thing differs between records.

    Attributes
    ----------
    symbol : str
        ``dF_c``, ``dF_v`` or ``offset``.
    value : float
        Standard deviation between records, in `unit`.
    unit : str
    relative : float or None
        As a share of the mean; None where there is none to be compared with.
    assumed : float
        What is assumed before the records speak, in `unit`; it counts as one more record.
    below : float or None
        Where the records do not differ by more than their errors, or by little beside what was assumed: what no record
        deviates by, in `unit`, at 95 %. The value is then the assumption, and was not measured. None where it was, or
        nothing tells.
    """

    symbol: str
    value: float
    unit: str
    relative: float | None = None
    assumed: float = 0.0
    below: float | None = None


def own_rows(
    record: Record, residuals: tuple[Array, Array], fit: tuple[Solved, Whitener, Whitener], name: str
) -> list[RecordResult]:
    """Return a row for every record that was fitted.

    Parameters
    ----------
    record : Record
    residuals : (array, array), shape (channels, m)
        Before and after.
    fit : (Solved, Whitener, Whitener)
        The estimate, its weights and the prewhitener.
    name : str
        Of a log that is one record.
    """
    if len(record.records) < 2:
        everything = np.ones(len(record.mask), dtype=bool)
        before, after = (errors_of(record, left, everything) for left in residuals)
        return [RecordResult(name, False, record.duration, record.prepared.rate, before, after)]
    estimate, weights, whitener = fit
    levels = levels_of(record, estimate, weights, whitener)
    p_values = disagreement(record, estimate.model, weights, whitener)
    rows = []
    for k, (one, here) in enumerate(zip(record.records, members(record), strict=True)):
        before, after = (errors_of(record, left, here) for left in residuals)
        own = _deviations(levels, k, record.prepared.motion)
        rows.append(
            RecordResult(one.name, False, one.duration, one.rate, before, after, own, zero_of(record, k), p_values[k])
        )
    return rows


def zero_of(record: Record, number: int) -> Estimate | None:
    """Return what was added to the position of one of its records; None where one zero serves all, or it has none.

    Parameters
    ----------
    record : Record
    number : int
    """
    if not (record.shifts and record.angle):
        return None
    value, stderr = record.shifts[number]
    return Estimate(value, axis_unit("rad", record.prepared.motion), stderr)


def _deviations(levels: Levels, k: int, motion: str) -> dict[str, Estimate]:
    out = {}
    for symbol in LEVELS:
        value, stderr = float(levels.deviation[symbol][k]), float(levels.stderr[symbol][k])
        out[symbol] = Estimate(value, axis_unit(UNITS[symbol], motion), stderr)
    return out


def errors_of(record: Record, left: Array, here: NDArray[np.bool_] | None = None) -> Errors:
    """Return rms error and its share of each balance.

    Parameters
    ----------
    record : Record
    left : array, shape (channels, m)
        Measured less predicted.
    here : bool array, shape (m,), optional
        Samples that count; all that take part when left out.
    """
    used = record.mask if here is None else record.mask & here
    out = {}
    for row, name in enumerate(record.channels):
        size, rms = (_rms(values[row][used]) for values in (record.target, left))
        out[name] = {"rms": rms, "unit": record.unit(name), "relative": rms / size if size > 0.0 else float("nan")}
    return out


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")


def record_spreads(record: Record, fit: Solved, rows: Sequence[RecordResult] = ()) -> tuple[RecordSpread, ...]:
    """Return by how much each level differs between records; nothing for a log that is one record.

    Parameters
    ----------
    record : Record
    fit : Solved
    rows : sequence of RecordResult
        Of the records, whose deviations tell whether they differ by more than their errors.
    """
    count = len(record.records)
    if count < 2:
        return ()
    from pmsm_ctrl.regression.spread import spreads

    values, assumed = dict(zip(fit.model.names, fit.values.tolist(), strict=True)), usual_spread(record)
    out = []
    for symbol, spread in spreads(fit.model, count).items():
        mean = values.get(MEANS.get(symbol, ""), 0.0)
        relative = abs(spread / mean) if mean else None
        unit = axis_unit(UNITS[symbol], record.prepared.motion)
        alone = assumed[symbol] * (COUNTS / (COUNTS + count - 1.0)) ** 0.5
        own = [row.deviations[symbol] for row in rows if symbol in row.deviations]
        below = _bound(own) if own and (spread <= RAISED * alone or _within_errors(own, symbol)) else None
        out.append(RecordSpread(symbol, spread, unit, relative, assumed[symbol], below))
    return tuple(out)


def _within_errors(deviations: Sequence[Estimate], symbol: str) -> bool:
    """Whether the deviations of all records together are within their errors.

    Deviations from a mean of the records have one degree of freedom less, and a smaller error for it.
    """
    if not all(one.stderr > 0.0 for one in deviations):
        return False
    count = len(deviations)
    free, share = (count - 1, 1.0 - 1.0 / count) if symbol in MEANS else (count, 1.0)
    square = share * sum((one.value / one.stderr) ** 2 for one in deviations)
    return f_tail(square / free, free, MANY) >= TOLD


def _bound(deviations: Sequence[Estimate]) -> float:
    return max(abs(one.value) + WITHIN * one.stderr for one in deviations)


def record_notices(rows: Iterable[RecordResult]) -> Iterator[Notice]:
    """Yield which records disagree with the others, the worst first, and whose angles were counted from another zero.

    Parameters
    ----------
    rows : iterable of RecordResult
    """
    every = list(rows)
    odd: Sequence[RecordResult] = sorted((row for row in every if row.disagrees), key=lambda row: row.p_value)
    if odd:
        yield notices.RECORD_DISAGREES(records=", ".join(row.name for row in odd), p=odd[0].p_value)
    turned = [
        f"{row.name} (by {row.angle.value:.2g} {row.angle.unit})"
        for row in every
        if row.angle is not None and row.angle.value != 0.0
    ]
    if turned:
        yield notices.OTHER_ZERO(records=", ".join(turned))

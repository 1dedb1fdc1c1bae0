"""The table `[evaluated]` of a fitted design: how its log was read, written and read again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from pmsm_ctrl.design import Design, Evaluated
from pmsm_ctrl.effects.catalogue import catalogue_of
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.angle_zero import turned_by
from pmsm_ctrl.regression.balances import STANDSTILL, Record, make_record
from pmsm_ctrl.regression.conditioning import Processing
from pmsm_ctrl.regression.drive_timing import DriveTiming
from pmsm_ctrl.regression.spread import with_counts
from pmsm_ctrl.regression.timed_record import timed_record

__all__ = ["as_compared", "record_as_evaluated", "with_evaluation", "without_stretches"]

AROUND = 2.0  # periods of the cutoff that are left out on either side of a stretch


def with_evaluation(design: Design, record: Record, log: Log) -> Design:
    """Return the design with how the log that it was fitted to was read.

    Parameters
    ----------
    design : Design
    record : Record
        As it was judged.
    log : Log
        The log that the record was made from.
    """
    made = Evaluated(
        log=log.fingerprint,
        cutoff=record.cutoff,
        late=record.timing.late,
        filter=record.timing.lag,
        reversals=record.timing.reversals,
        stepped=record.timing.stepped,
        commanded=record.commanded,
        in_step=record.in_step,
        age=None if record.age is None else record.age.late,
        speed_filter=0.0 if record.age is None else record.age.lag,
        weight=record.wrong,
        edges=record.edges,
        encoder_lines=record.lines,
        left_out=record.left_out,
        changes=record.changes,
        counts=record.counts,
        zeros=record.shifts,
    )
    return design.model_copy(update={"evaluated": made})


def record_as_evaluated(design: Design, log: Log) -> Record:
    """Condition a log: as it was read when the design was fitted to it, or as every fit reads it.

    Parameters
    ----------
    design : Design
    log : Log
    """
    known = design.evaluated
    if not known.log or known.log != log.fingerprint:
        return timed_record(design, log)
    processing = Processing(standstill=STANDSTILL, cutoff=known.cutoff)
    age = None if known.age is None else DriveTiming(known.age, known.speed_filter)
    timing = DriveTiming(known.late, known.filter, reversals=known.reversals, stepped=known.stepped)
    record = make_record(design, log, processing, age, timing, known.weight, known.edges)
    record = replace(record, commanded=known.commanded, in_step=known.in_step)
    record = without_stretches(record, known.left_out, known.changes)
    record = with_counts(record, known.counts) if known.counts else record
    record = turned_by(record, known.zeros) if known.zeros else record
    return replace(record, lines=known.encoder_lines, memo={}, kept={})


def as_compared(design: Design, record: Record, log: Log) -> Record:
    """Return a record as `compare` makes it of the design that is written: a delay in that moves the reversals.

    Parameters
    ----------
    design : Design
        As it is written.
    record : Record
        As it was judged.
    log : Log
        The log that the record was made from.
    """
    effects = catalogue_of(design)
    if not any(entry.id in effects and effects[entry.id].structure.delays for entry in design.effects):
        return record
    return record_as_evaluated(with_evaluation(design, record, log), log)


def without_stretches(
    record: Record, stretches: Sequence[tuple[float, float]], changes: Sequence[float] = ()
) -> Record:
    """Return the record with stretches of time masked, and with steps of the dry friction as changes that are fitted.

    Parameters
    ----------
    record : Record
    stretches : sequence of (float, float)
        Begin and end, s.
    changes : sequence of float
        s.
    """
    mask, around = record.mask.copy(), AROUND / record.cutoff
    for start, stop in stretches:
        mask &= (record.t < start - around) | (record.t > stop + around)
    return replace(
        record, mask=mask, left_out=(*record.left_out, *stretches), changes=(*record.changes, *changes), memo={},
        kept={},
    )  # fmt: skip

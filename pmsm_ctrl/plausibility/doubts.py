"""Everything that is doubtful about logs: what their import found, and what their design says of them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import LogError
from pmsm_ctrl.log import Log, Logs, as_logs
from pmsm_ctrl.plausibility.examination import examine
from pmsm_ctrl.plausibility.result import Plausibility
from pmsm_ctrl.regression.joining import joined, name_of, with_records
from pmsm_ctrl.section import Notice

__all__ = ["ACCOUNTED", "doubts_about", "of_holdout"]

# Doubts of the import that the evaluation takes care of: steps and jitter are noise, gaps are left out, and a limit
# of the drive is no fault of the log. They are reported, and forbid no verdict.
ACCOUNTED = frozenset(
    ("angle_unwrapped", "few_digits", "irregular_time", "quantised_channel", "saturated_channel", "time_gaps")
)
HOLDOUT = "hold-out record: "


def doubts_about(design: Design, log: Logs) -> Plausibility:
    """Return the examination of a log, with the doubts of its import among the doubts; of several, of each by itself.

    Parameters
    ----------
    design : Design
    log : Log or sequence of Log

    Returns
    -------
    Plausibility
        A doubt of the import that the examination states as well stands once. Its log holds all records.

    Raises
    ------
    LogError
        When the logs are not records of one axis, or of another kind of axis than the design's; the line names the
        file.
    """
    logs = [with_records(_of_its_kind(design, one, number), number) for number, one in enumerate(as_logs(log), start=1)]
    found = [_doubts_about_one(design, one) for one in logs]
    if len(found) == 1:
        return found[0]
    whole, left_out = joined(design, [one.log for one in found])
    names = [name_of(one, number) for number, one in enumerate(logs, start=1)]
    return Plausibility(
        whole,
        _by_record(names, [one.contradictions for one in found]),
        (*_by_record(names, [one.doubts for one in found]), *left_out),
        tuple(stretch for one in found for stretch in one.excluded),
        _by_record(names, [one.repairs for one in found]),
    )


def _of_its_kind(design: Design, log: Log, number: int) -> Log:
    if log.motion != design.motion:
        raise LogError(
            f"{name_of(log, number)}: found a log of a {log.motion} axis; one of a {design.motion} axis, as design "
            f"'{design.name}' is, was expected: Log(..., motion='{design.motion}')"
        )
    return log


def _by_record(names: Sequence[str], notices: Iterable[Sequence[Notice]]) -> tuple[Notice, ...]:
    """Return every notice once, with the records that it concerns where that is not all of them."""
    concerned: dict[Notice, list[str]] = {}
    for name, some in zip(names, notices, strict=True):
        for notice in some:
            concerned.setdefault(notice, []).append(name)
    return tuple(
        notice if len(which) == len(names) else replace(notice, text=f"{', '.join(which)}: {notice.text}")
        for notice, which in concerned.items()
    )


def _doubts_about_one(design: Design, log: Log) -> Plausibility:
    found = examine(design, log)
    known = {notice.code for notice in found.notices}
    imported = (notice for notice in log.provenance.notices if notice.code not in known)
    return replace(found, doubts=(*found.doubts, *imported))


def of_holdout(notice: Notice) -> Notice:
    """Return a notice that says that it concerns the hold-out record.

    Parameters
    ----------
    notice : Notice
    """
    return replace(notice, text=f"{HOLDOUT}{notice.text}")

"""Everything that is doubtful about a log: what its import found, and what its design says of it."""

from __future__ import annotations

from dataclasses import replace

from pmsm_ctrl.design import Design
from pmsm_ctrl.log import Log
from pmsm_ctrl.plausibility.examination import examine
from pmsm_ctrl.plausibility.result import Plausibility
from pmsm_ctrl.section import Notice

__all__ = ["ACCOUNTED", "doubts_about", "of_holdout"]

# Doubts of the import that the evaluation takes care of: steps and jitter are noise, gaps are left out, and a limit
# of the drive is no fault of the log. They are reported, and forbid no verdict.
ACCOUNTED = frozenset(
    ("angle_unwrapped", "few_digits", "irregular_time", "quantised_channel", "saturated_channel", "time_gaps")
)
HOLDOUT = "hold-out record: "


def doubts_about(design: Design, log: Log) -> Plausibility:
    """Return the examination of a log, with the doubts of its import among the doubts.

    Parameters
    ----------
    design : Design
    log : Log

    Returns
    -------
    Plausibility
        A doubt of the import that the examination states as well stands once.
    """
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

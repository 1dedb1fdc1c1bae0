"""Readers of measured logs: one file per format, each of which only reads.

The format is detected from the content, not from the name. Nothing in a file is executed, and no pickle is read.
Guesses stand in ``log.provenance.notes``, doubts in ``log.provenance.notices``.
"""

from __future__ import annotations

from pmsm_ctrl.importers import present as present
from pmsm_ctrl.importers.confirmation import require_confirmed, unconfirmed
from pmsm_ctrl.importers.folders import log_files
from pmsm_ctrl.importers.plausibility import check
from pmsm_ctrl.importers.proposal import Proposal, propose
from pmsm_ctrl.importers.reading import open_table, read_all, read_log
from pmsm_ctrl.importers.report import ImportReport, describe

__all__ = [
    "ImportReport", "Proposal", "check", "describe", "log_files", "open_table", "propose", "read_all", "read_log",
    "require_confirmed", "unconfirmed",
]  # fmt: skip

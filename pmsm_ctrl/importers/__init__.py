"""Readers of measured logs: one file per format, each of which only reads.

The format is found from the content, never from the name alone. Nothing in a file is ever executed, and no
pickle is read. What had to be guessed stands in ``log.provenance.notes``; what looks wrong in
``log.provenance.notices``.
"""

from __future__ import annotations

from pmsm_ctrl.importers import present as present
from pmsm_ctrl.importers.plausibility import check
from pmsm_ctrl.importers.reading import open_table, read_all, read_log
from pmsm_ctrl.importers.report import ImportReport, describe

__all__ = ["ImportReport", "check", "describe", "open_table", "read_all", "read_log"]

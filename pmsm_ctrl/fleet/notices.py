"""The words of the fleet's notices."""

from __future__ import annotations

from pmsm_ctrl.section import Template

__all__ = ["COPIES", "FAILED", "SET_ASIDE", "SILENT", "WORTHLESS"]

COPIES = Template(
    "logs_are_copies",
    "{count} of the logs: byte for byte an earlier log of the same axis, and left out, as a copy measures nothing "
    "again: {names}",
)
FAILED = Template("logs_failed", "{count} of {logs} logs could not be evaluated; the first: {reason}")
SET_ASIDE = Template(
    "logs_set_aside", "{count} logs were set aside, because each ended its worker process three times: {names}"
)
SILENT = Template("axes_without_an_answer", "{count} axes have no log that gives an answer: {names}")
WORTHLESS = Template("logs_without_an_answer", "{count} of {logs} logs give no answer; they are listed with the reason")

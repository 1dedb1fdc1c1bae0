"""Frequency responses measured from logs, beside the design's own."""

from pmsm_ctrl.frf import present as _present  # noqa: F401 - registers the section
from pmsm_ctrl.frf.frf import frf
from pmsm_ctrl.frf.result import Band, FrequencyResponse, Response

__all__ = ["Band", "FrequencyResponse", "Response", "frf"]

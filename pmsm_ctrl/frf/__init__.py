"""Frequency responses measured from logs or by a drive, beside the design's own."""

from pmsm_ctrl.frf import present as _present  # noqa: F401 - registers the section
from pmsm_ctrl.frf.bode import is_bode_file
from pmsm_ctrl.frf.frf import frf
from pmsm_ctrl.frf.from_bode import MeasuredBode
from pmsm_ctrl.frf.reading import read_response
from pmsm_ctrl.frf.result import Band, FrequencyResponse, Response

__all__ = ["Band", "FrequencyResponse", "MeasuredBode", "Response", "frf", "is_bode_file", "read_response"]

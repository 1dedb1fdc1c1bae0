"""Diagnosis: which physical effect is missing from a design, how sure that is, and what would settle it."""

from pmsm_ctrl.diagnose.adding import add
from pmsm_ctrl.diagnose.diagnosis import Diagnosis, DiagnosisStep, Ranked, diagnose

__all__ = ["Diagnosis", "DiagnosisStep", "Ranked", "add", "diagnose"]

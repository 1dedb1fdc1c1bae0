"""Diagnosis: which physical effect is missing from a design, how sure that is, and what would settle it."""

from pmsm_ctrl.diagnose import present_stepwise as present_stepwise  # as below
from pmsm_ctrl.diagnose.adding import add
from pmsm_ctrl.diagnose.by_hand import ModelErrors, Stepwise, stepwise
from pmsm_ctrl.diagnose.contributions import Contributions
from pmsm_ctrl.diagnose.diagnosis import diagnose
from pmsm_ctrl.diagnose.policy import POLICY, Policy
from pmsm_ctrl.diagnose.present import verdict_text  # the import registers how a `Diagnosis` is presented
from pmsm_ctrl.diagnose.result import Diagnosis, DiagnosisStep, Ranked, Verdict

__all__ = [
    "POLICY",
    "Contributions",
    "Diagnosis",
    "DiagnosisStep",
    "ModelErrors",
    "Policy",
    "Ranked",
    "Stepwise",
    "Verdict",
    "add",
    "diagnose",
    "stepwise",
    "verdict_text",
]

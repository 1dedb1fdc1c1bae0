"""Compensation: what feeding friction forward gains, and up to which gain it is safe."""

from pmsm_ctrl.compensate.metrics import Metrics, measure
from pmsm_ctrl.compensate.motions import study_motions
from pmsm_ctrl.compensate.study import CompensationStudy, baseline, compensate, compensated
from pmsm_ctrl.compensate.window import GainWindow, gain_window

__all__ = [
    "CompensationStudy", "GainWindow", "Metrics", "baseline", "compensate", "compensated", "gain_window", "measure",
    "study_motions",
]  # fmt: skip

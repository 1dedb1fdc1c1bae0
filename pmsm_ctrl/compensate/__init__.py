"""Compensation: what feeding friction forward gains, and up to which gain it is safe."""

from pmsm_ctrl.compensate.acceptance import Verdict, accept
from pmsm_ctrl.compensate.adaptive import AdaptiveRun, simulate_adaptive
from pmsm_ctrl.compensate.metrics import Metrics, measure, measure_contour
from pmsm_ctrl.compensate.motions import Trial, named_trial, study_trials
from pmsm_ctrl.compensate.runs import judge, run_trial
from pmsm_ctrl.compensate.stickslip import Hunting, hunting
from pmsm_ctrl.compensate.study import CompensationStudy, compensate
from pmsm_ctrl.compensate.variants import baseline, compensated
from pmsm_ctrl.compensate.window import GainWindow, gain_window

__all__ = [
    "AdaptiveRun", "CompensationStudy", "GainWindow", "Hunting", "Metrics", "Trial", "Verdict", "accept", "baseline",
    "compensate", "compensated", "gain_window", "hunting", "judge", "measure", "measure_contour", "named_trial",
    "run_trial", "simulate_adaptive", "study_trials",
]  # fmt: skip

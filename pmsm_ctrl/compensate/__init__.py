"""Compensation: what feeding friction forward gains, and the highest safe gain."""

from pmsm_ctrl.compensate import present as _present  # noqa: F401 - registers the results
from pmsm_ctrl.compensate.acceptance import Verdict, accept
from pmsm_ctrl.compensate.adaptive import AdaptiveRun, simulate_adaptive
from pmsm_ctrl.compensate.metrics import Metrics, measure, measure_contour
from pmsm_ctrl.compensate.motions import Trial, named_trial, study_trials
from pmsm_ctrl.compensate.result import CompensationStudy, Row, Variant
from pmsm_ctrl.compensate.runs import baseline, compensated, judge, run_trial
from pmsm_ctrl.compensate.safety import GainVerdict, gain_verdict
from pmsm_ctrl.compensate.study import compensate
from pmsm_ctrl.compensate.theory import Hunting, hunting
from pmsm_ctrl.compensate.window import GainWindow, gain_window, sweep_gains

__all__ = [
    "AdaptiveRun", "CompensationStudy", "GainVerdict", "GainWindow", "Hunting", "Metrics", "Row", "Trial", "Variant",
    "Verdict",
    "accept", "baseline", "compensate", "compensated", "gain_verdict", "gain_window", "hunting", "judge", "measure",
    "measure_contour", "named_trial", "run_trial", "simulate_adaptive", "study_trials", "sweep_gains",
]  # fmt: skip

"""Identification: the speed sweep, and inverse-dynamics regression on any log."""

from pmsm_ctrl.identify.identification import Identification, identify
from pmsm_ctrl.identify.problem import Column, Problem, build_problem, effect_columns
from pmsm_ctrl.identify.regression import Fit, solve
from pmsm_ctrl.identify.signals import Prepared, Processing, prepare

__all__ = [
    "Column", "Fit", "Identification", "Prepared", "Problem", "Processing", "build_problem", "effect_columns",
    "identify", "prepare", "solve",
]  # fmt: skip

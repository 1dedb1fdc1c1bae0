"""Identification: the speed sweep; inverse-dynamics regression, instrumental variables and output error on any log."""

from pmsm_ctrl.identify.identification import Identification, Method, identify
from pmsm_ctrl.identify.instrumental import BiasTest
from pmsm_ctrl.identify.paper import PaperTable, paper_table
from pmsm_ctrl.identify.problem import Column, Problem, build_problem, effect_columns
from pmsm_ctrl.identify.regression import Fit, solve
from pmsm_ctrl.identify.staircase import SweepResult, evaluate_sweep, sweep
from pmsm_ctrl.regression.conditioning import Prepared, Processing, prepare

__all__ = [
    "BiasTest", "Column", "Fit", "Identification", "Method", "PaperTable", "Prepared", "Problem", "Processing",
    "SweepResult", "build_problem", "effect_columns", "evaluate_sweep", "identify", "paper_table", "prepare", "solve",
    "sweep",
]  # fmt: skip

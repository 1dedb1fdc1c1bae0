"""Identification: the speed sweep; inverse-dynamics regression, instrumental variables and output error on any log."""

from pmsm_ctrl.identify import present as _present  # noqa: F401 - registers the sections
from pmsm_ctrl.identify.identification import Identification, Method, identify
from pmsm_ctrl.identify.instrumental import BiasTest
from pmsm_ctrl.identify.paper import PaperTable, paper_table
from pmsm_ctrl.identify.staircase import SweepResult, evaluate_sweep, sweep
from pmsm_ctrl.regression.conditioning import Processing

__all__ = [
    "BiasTest", "Identification", "Method", "PaperTable", "Processing", "SweepResult", "evaluate_sweep", "identify",
    "paper_table", "sweep",
]  # fmt: skip

"""One self-contained HTML file per report, and `study`, the whole chain that ends in one."""

from pmsm_ctrl.report.chain import report_path, study
from pmsm_ctrl.report.headline import of_result as headline_of
from pmsm_ctrl.report.page import render
from pmsm_ctrl.report.result import Headline, Study

__all__ = ["Headline", "Study", "headline_of", "render", "report_path", "study"]

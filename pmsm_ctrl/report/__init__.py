"""One self-contained HTML file per report, and `study`, the whole chain that ends in one."""

from pmsm_ctrl.report.chain import Study, study
from pmsm_ctrl.report.page import Headline, render

__all__ = ["Headline", "Study", "render", "study"]

"""One self-contained HTML file per report, and `study`, the whole chain that ends in one.

The chain and the headlines know every verb; they are imported when they are asked for, so that a page of one verb does
not wait for all.
"""

from typing import TYPE_CHECKING, Any

from pmsm_ctrl.report.page import render
from pmsm_ctrl.report.result import Headline, Study

if TYPE_CHECKING:
    from pmsm_ctrl.report.chain import report_path, study
    from pmsm_ctrl.report.headline import of_result as headline_of

__all__ = ["Headline", "Study", "headline_of", "render", "report_path", "study"]


def __getattr__(name: str) -> Any:
    if name in ("report_path", "study"):
        from pmsm_ctrl.report import chain

        return getattr(chain, name)
    if name == "headline_of":
        from pmsm_ctrl.report.headline import of_result

        return of_result
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

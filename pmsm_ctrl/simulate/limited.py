"""Whether a simulated drive followed its motion, or ran into its limit of the current."""

from __future__ import annotations

import numpy as np

from pmsm_ctrl.design import Design
from pmsm_ctrl.log import Log
from pmsm_ctrl.section import Notice
from pmsm_ctrl.simulate.notices import AT_CURRENT_LIMIT

__all__ = ["doubts_of_simulation"]

OFTEN = 0.2  # share of the samples; steps of a position or a speed take less


def doubts_of_simulation(design: Design, log: Log) -> tuple[Notice, ...]:
    """Return why a simulated log is not of the motion that was asked for.

    Parameters
    ----------
    design : Design
        The controller's.
    log : Log

    Returns
    -------
    tuple of Notice
        Empty where the drive followed.
    """
    if "i_q_ref" not in log or not np.isfinite(design.drive.i_max):
        return ()
    share = float(np.mean(np.abs(log["i_q_ref"]) > 0.999 * design.drive.i_max))
    if share < OFTEN:
        return ()
    reached = float(np.max(np.abs(log["omega"])))
    return (AT_CURRENT_LIMIT(limit=design.drive.i_max, percent=100.0 * share, speed=reached, unit=log.unit("omega")),)

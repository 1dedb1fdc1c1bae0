"""A torque that was sampled in step with a held position reference: it falls with the speed, as no friction does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pmsm_ctrl.diagnose.case import Case
from pmsm_ctrl.diagnose.fit import Fitted
from pmsm_ctrl.regression.filter_profile import LOWERED
from pmsm_ctrl.regression.model import Solved
from pmsm_ctrl.regression.sampling_terms import in_step
from pmsm_ctrl.regression.timed_record import FRICTION

__all__ = ["sampled_in_step"]


def sampled_in_step(case: Case, fit: Fitted) -> Case | None:
    """Return the case with a part of the torque in proportion to the speed that is no friction; None without need.

    Parameters
    ----------
    case : Case
    fit : Fitted
        Of the design, with nothing named.
    """
    name = FRICTION["viscous"]
    column = fit.model.names.index(name) if name in fit.model.names else -1
    if column not in fit.estimate.held or not _left(fit, fit.plain) < LOWERED * _left(fit, fit.estimate):
        return None
    record = in_step(case.record, name, float(fit.plain.values[column]), float(fit.plain.stderr[column]))
    if record is None:
        return None
    others = tuple(replace(one, in_step=True, memo={}, kept={}) for one in case.holdouts)
    return replace(case, record=record, holdouts=others, fits=[], bands={})


def _left(fit: Fitted, solved: Solved) -> float:
    """Weighted norm of what a solution leaves of the torque."""
    left = fit.record.target[0] - solved.predicted()[0]
    return float(np.linalg.norm(fit.record.weight[0] * fit.record.mask * left))

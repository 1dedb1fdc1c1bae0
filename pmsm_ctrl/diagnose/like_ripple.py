"""An effect that may be the reluctance torque of a current ripple: see `regression.reluctance`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.diagnose import criteria
from pmsm_ctrl.diagnose.case import Case
from pmsm_ctrl.diagnose.fit import Fitted
from pmsm_ctrl.diagnose.measures import judged_gain
from pmsm_ctrl.diagnose.refusal import Refusal
from pmsm_ctrl.diagnose.search import Trial
from pmsm_ctrl.regression.columns import Group
from pmsm_ctrl.regression.model import solve_model
from pmsm_ctrl.regression.reluctance import holds_ripple, logged_ripple_torques, ripple_torques

__all__ = ["like_ripple"]

Array = NDArray[np.float64]


def like_ripple(case: Case, fit: Fitted, trial: Trial) -> Refusal | None:
    """Return that a ripple of the current explains as much as an effect on the torque, and none that the log lacks.

    Parameters
    ----------
    case : Case
    fit : Fitted
    trial : Trial
        One of its trials.
    """
    if [row for row, _ in trial.group.entering] != [0]:
        return None
    gain, any_ripple = judged_gain(fit, trial)[1], ripple_torques(fit.record)
    if not any_ripple or case.believed is None or not holds_ripple(case.believed.log):
        ripple = _gain(fit, trial, any_ripple)
        return criteria.beside_ripple(gain, ripple, ripple, case.policy)
    # how it grows with the speed hangs on the loops, which may swing with what excites it
    shown = logged_ripple_torques(fit.record, fit.record.timing.undone(case.believed.log))
    ripple, logged = (_gain(fit, trial, torques) for torques in ([*any_ripple, *shown], shown))
    return criteria.beside_ripple(gain, ripple, logged, case.policy)


def _gain(fit: Fitted, trial: Trial, torques: Sequence[Array]) -> float:
    """Return the fall of the sum of squares that judged a trial by drags in its place, as far as they are drags."""
    solved, whitener = (fit.plain, fit.weights) if trial.by_weights else (fit.solved, fit.whitener)
    parts: list[Mapping[str, Array]] = [{"torque": torque} for torque in torques]
    while parts:
        symbols = tuple(f"ripple {k + 1}" for k in range(len(parts)))
        model = fit.model.plus(Group(None, symbols, fit.record.stack_all(parts), {}), 1.0)
        beside = solve_model(fit.record, model, whitener, solved)
        drags = beside.values[-len(parts) :] >= 0.0
        if drags.all():
            return solved.chi2 - beside.chi2
        parts = [part for part, drag in zip(parts, drags, strict=True) if drag]
    return 0.0

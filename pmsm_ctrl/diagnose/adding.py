"""add: put one effect into a design, fitted to a log."""

from __future__ import annotations

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose.case import Case
from pmsm_ctrl.diagnose.fit import Accepted, fit_design
from pmsm_ctrl.diagnose.fitted_design import fitted_design
from pmsm_ctrl.diagnose.refine import refine
from pmsm_ctrl.effects.catalogue import catalogue_of, lookup
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.log import Log
from pmsm_ctrl.plausibility import examine
from pmsm_ctrl.regression.balances import make_record

__all__ = ["add"]


def add(design: Design, log: Log, effect: str) -> Design:
    """Return the design with an effect added, all parameters fitted to the log, standard errors included.

    The effect is added whether or not the log calls for it: whether it does is what `diagnose` says.

    Parameters
    ----------
    design : Design
    log : Log
    effect : str
        Id of an effect of the catalogue, or of the design's own.

    Raises
    ------
    LogError
        When a channel is missing or the axis hardly moves.
    RequestError
        For an unknown effect, one that is in the design already, or one that this log cannot determine.
    """
    effects = catalogue_of(design)
    wanted = lookup(effect, effects)
    case = Case(design, make_record(design, examine(design, log).log), effects)
    fit = case.fit(())
    trial = next((t for t in fit.trials if t.candidate.effect.id == effect), None)
    if trial is None:
        why = next((c.why_not for c in fit.closed if c.effect.id == effect), "the design has it already")
        raise RequestError(f"effect '{effect}': {why or 'it has no column on this log'}; it needs {wanted.needs}")
    if trial.singular:
        raise RequestError(
            f"effect '{effect}': not distinguishable from the design's on this log; it needs {wanted.needs}"
        )
    shape = refine(fit.record, fit.solved, fit.whitener, trial).group.shape
    return fitted_design(design, fit_design(design, case.record, (Accepted(wanted, shape),), effects, explore=False))

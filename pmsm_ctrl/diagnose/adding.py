"""add: take one effect into a design, fitted to a log."""

from __future__ import annotations

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose.fit import Accepted, fit_design
from pmsm_ctrl.diagnose.outcome import fitted_design
from pmsm_ctrl.diagnose.refine import refine
from pmsm_ctrl.effects.base import Effect
from pmsm_ctrl.effects.catalogue import catalogue_of, lookup
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.balances import make_record

__all__ = ["add"]


def add(design: Design, log: Log, effect: str) -> Design:
    """Return the design with an effect added, all parameters fitted to the log, standard errors included.

    The effect is taken whether or not the log calls for it: whether it does is what `diagnose` says.

    Raises
    ------
    RequestError
        For an unknown effect, one that is in the design already, or one that this log cannot determine.
    """
    wanted = lookup(effect, catalogue_of(design))
    record = make_record(design, log)
    fit = fit_design(design, record, (), catalogue_of(design))
    for trial in fit.trials:
        if trial.candidate.effect.id != effect:
            continue
        if trial.singular:
            raise RequestError(f"effect '{effect}': this log cannot tell it from what the design has; {_need(wanted)}")
        trial = refine(fit.record, fit.solved, fit.whitener, trial)
        accepted = (Accepted(wanted, trial.group.shape),)
        after = fit_design(design, record, accepted, catalogue_of(design), explore=False)
        return fitted_design(design, after, accepted, record)
    why = next((c.why_not for c in fit.closed if c.effect.id == effect), "the design has it already")
    raise RequestError(f"effect '{effect}': {why or 'it has no column on this log'}; {_need(wanted)}")


def _need(effect: Effect) -> str:
    return f"it needs {effect.needs}"

"""add: put one effect into a design, fitted to a log."""

from __future__ import annotations

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose.case import Case
from pmsm_ctrl.diagnose.fit import Accepted, Fitted, fit_design
from pmsm_ctrl.diagnose.fitted_design import at_bounds, fitted_design
from pmsm_ctrl.diagnose.measures import squares
from pmsm_ctrl.diagnose.polish import polished
from pmsm_ctrl.diagnose.refine import refine
from pmsm_ctrl.diagnose.search import Trial, try_candidate
from pmsm_ctrl.diagnose.shapes import with_shapes_fitted
from pmsm_ctrl.effects.catalogue import catalogue_of, lookup
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.log import Logs
from pmsm_ctrl.plausibility import doubts_about
from pmsm_ctrl.regression.bounds import holding
from pmsm_ctrl.regression.evaluated import with_evaluation
from pmsm_ctrl.regression.kept import worse_than_given
from pmsm_ctrl.regression.timed_record import timed_record
from pmsm_ctrl.section import Notice

__all__ = ["add", "added"]


def add(design: Design, log: Logs, effect: str, *, polish: bool = False) -> Design:
    """Return the design with an effect added, all parameters fitted to the log, standard errors included.

    The effect is added whether or not the log calls for it: whether it does is what `diagnose` says. No parameter
    leaves its bounds: one at its bound stays there, the others are fitted beside it, and it has no standard error. A
    design that would be worse on this log than the given one is not returned: the given one is.

    Parameters
    ----------
    design : Design
    log : Log or sequence of Log
        Records of one axis, fitted together.
    effect : str
        Id of an effect of the catalogue, or of the design's own.
    polish : bool
        Whether to refine all parameters by simulation, where that predicts left-out stretches better.

    Raises
    ------
    LogError
        When a channel is missing or the axis hardly moves.
    RequestError
        For an unknown effect, one that is in the design already, or one that this log cannot determine.
    """
    return added(design, log, effect, polish)[0]


def added(design: Design, log: Logs, effect: str, polish: bool = False) -> tuple[Design, tuple[Notice, ...]]:
    """Return the same as `add`, which parameters stay at their bounds, and whether the design stays as it was.

    Parameters
    ----------
    design, log, effect, polish
        As in `add`.

    Raises
    ------
    RequestError
        As in `add`.
    """
    effects = catalogue_of(design)
    wanted = lookup(effect, effects)
    believed = doubts_about(design, log).log
    case = Case(design, timed_record(design, believed), effects)
    fit = case.fit(())
    trial = next((t for t in fit.trials if t.candidate.effect.id == effect), None)
    if trial is None:
        why = next((c.why_not for c in fit.closed if c.effect.id == effect), "the design has it already")
        raise RequestError(f"effect '{effect}': {why or 'it has no column on this log'}; it needs {wanted.needs}")
    if trial.singular:
        raise RequestError(
            f"effect '{effect}': not distinguishable from the design's on this log; it needs {wanted.needs}"
        )
    made = _made(case, refine(fit.record, fit.solved, fit.whitener, trial))
    base = {k: bound for k, bound in made.estimate.held.items() if k < len(fit.model.names)}
    if base:  # beside parameters that stay at their bounds another shape is the best one
        held = holding(fit.plain, base)
        again = try_candidate(fit.record, held, fit.weights, trial.candidate)
        if again is not None:
            other = _made(case, refine(fit.record, held, fit.weights, again))
            made = min(made, other, key=lambda one: squares(one, one.residual, fit.weights.sigma))
    written, said = fitted_design(design, made), tuple(at_bounds(made))
    if polish:
        written, how = polished(written, case.record, believed)
        said = (*said, *how)
    written = with_evaluation(written, case.record, believed)
    if worse := worse_than_given(design, written, case.record):
        return design, (worse, *said)
    return written, said


def _made(case: Case, trial: Trial) -> Fitted:
    """Fit the design with an effect of this trial's shape."""
    accepted = Accepted(trial.candidate.effect, trial.group.shape, trial.candidate.grid)
    fit = fit_design(case.design, case.record, (accepted,), case.effects, explore=False)
    return with_shapes_fitted(case.design, fit)

"""add: put one effect into a design, fitted to a log."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose.addition import Addition
from pmsm_ctrl.diagnose.case import Case
from pmsm_ctrl.diagnose.driven import driven_one_way
from pmsm_ctrl.diagnose.fit import Accepted, Fitted, fit_design
from pmsm_ctrl.diagnose.fitted_design import base_parameters, fitted_design, fitted_parameters
from pmsm_ctrl.diagnose.late import with_its_delay
from pmsm_ctrl.diagnose.made_ready import condition
from pmsm_ctrl.diagnose.measures import squares
from pmsm_ctrl.diagnose.notices import at_bounds
from pmsm_ctrl.diagnose.outcome import errors_table, record_rows
from pmsm_ctrl.diagnose.policy import POLICY
from pmsm_ctrl.diagnose.polish import Polish, polished
from pmsm_ctrl.diagnose.profiles import with_profiles
from pmsm_ctrl.diagnose.refine import refine
from pmsm_ctrl.diagnose.search import Trial, try_candidate
from pmsm_ctrl.diagnose.selection import not_supported
from pmsm_ctrl.diagnose.shapes import with_shapes_fitted
from pmsm_ctrl.effects.catalogue import catalogue_of, lookup
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.log import Logs, as_logs, names_of
from pmsm_ctrl.plausibility import with_inertia
from pmsm_ctrl.regression.bounds import holding
from pmsm_ctrl.regression.evaluated import as_compared, with_evaluation
from pmsm_ctrl.regression.prediction import errors, predict
from pmsm_ctrl.regression.record_result import record_notices, record_spreads
from pmsm_ctrl.regression.timed_record import FRICTION
from pmsm_ctrl.regression.worse_than_given import torque_error, worse_by_error
from pmsm_ctrl.result import Estimate

__all__ = ["add", "added"]


def add(
    design: Design, log: Logs, effect: str, *, polish: bool = False, progress: Callable[[float], None] | None = None
) -> Design:
    """Return the design with an effect added, all parameters fitted to the log, standard errors included.

    The effect is added whether or not the log calls for it: `added` says whether it does. No parameter leaves its
    bounds: one at its bound stays there, the others are fitted beside it, and it has no standard error. A design that
    would be worse on this log than the given one is not returned: the given one is.

    Parameters
    ----------
    design : Design
    log : Log or sequence of Log
        Records of one axis, fitted together.
    effect : str
        Id of an effect of the catalogue, or of the design's own.
    polish : bool
        Whether to refine all parameters by simulation, where that predicts left-out stretches better.
    progress : function, optional
        Called with the share of the work that is done; an exception that it raises ends the work.

    Raises
    ------
    LogError
        When a channel is missing or the axis hardly moves.
    RequestError
        For an unknown effect, one that is in the design already, or one that this log cannot determine.
    """
    return added(design, log, effect, polish=polish, progress=progress).design


def added(
    design: Design, log: Logs, effect: str, *, holdout: Logs | None = None, polish: bool = False,
    progress: Callable[[float], None] | None = None,
) -> Addition:  # fmt: skip
    """Add an effect to a design, with the errors before and after, and what speaks against it.

    Parameters
    ----------
    design, log, effect
        As in `add`.
    holdout : Log or sequence of Log, optional
        Other records of the axis, to which nothing is fitted.
    polish : bool
        As in `add`.
    progress : function, optional
        Called with the share done, 0 to 1.

    Returns
    -------
    Addition

    Raises
    ------
    LogError, RequestError
        As in `add`.
    """
    advance = progress or (lambda share: None)
    effects = catalogue_of(design)
    wanted = lookup(effect, effects)
    advance(0.01)
    logs, holdouts = as_logs(log), () if holdout is None else as_logs(holdout, "holdout")
    design = with_inertia(design, logs)
    case = condition(design, logs, holdouts, effects, POLICY)
    if wanted.structure.delays:
        case = with_its_delay(case) or case
    if effect in FRICTION:
        case = replace(case, design=design)  # it is to be added, not part of the base model
    case = driven_one_way(case)
    advance(0.2)
    fit = case.fit(())
    advance(0.4)
    trial = next((t for t in fit.trials if t.candidate.effect.id == effect), None)
    if trial is None:
        why = next((c.why_not for c in fit.closed if c.effect.id == effect), "the design has it already")
        raise RequestError(f"effect '{effect}': {why or 'it has no column on this log'}; it needs {wanted.needs}")
    if trial.singular:
        raise RequestError(
            f"effect '{effect}': not distinguishable from the design's on this log; it needs {wanted.needs}"
        )
    made = _best_made(case, fit, trial)
    if trial.candidate.effect.structure.delays:
        case, fit, trial, made = _with_reversals_in_time(case, fit, trial, made)
    made = with_profiles(case.design, made, None if case.believed is None else case.believed.log)
    advance(0.7)
    judged = _judged(case, fit, trial, made, polish, names_of(holdouts, "the held-out log"))
    advance(1.0)
    return judged


def _with_reversals_in_time(case: Case, fit: Fitted, trial: Trial, made: Fitted) -> tuple[Case, Fitted, Trial, Fitted]:
    """Fit a delay again on the log conditioned with it: the moments of reversal were found from a late torque."""
    if case.conditioned_with is None:
        return case, fit, trial, made
    other = case.conditioned_with(fitted_design(case.design, made), case)
    again = other.fit(())
    there = next((t for t in again.trials if t.candidate.effect.id == trial.candidate.effect.id), None)
    if there is None or there.singular:
        return case, fit, trial, made
    return other, again, there, _made(other, there)


def _best_made(case: Case, fit: Fitted, trial: Trial) -> Fitted:
    """Fit the design with the effect, at the shape that is best with parameters at their bounds held there."""
    made = _made(case, refine(fit.record, fit.solved, fit.whitener, trial))
    base = {k: bound for k, bound in made.estimate.held.items() if k < len(fit.model.names)}
    if base:
        held = holding(fit.plain, base)
        again = try_candidate(fit.record, held, fit.weights, trial.candidate)
        if again is not None:
            other = _made(case, refine(fit.record, held, fit.weights, again))
            made = min(made, other, key=lambda one: squares(one, one.residual, fit.weights.sigma))
    return made


def _judged(case: Case, fit: Fitted, trial: Trial, made: Fitted, polish: bool, holdout_name: str) -> Addition:
    """Compare the fitted design with the given one, and judge the effect by the criteria of the diagnosis."""
    assert case.believed is not None  # `condition` examines it
    written, said = fitted_design(case.design, made), tuple(at_bounds(made))
    parameters, base_values = fitted_parameters(made, 0), base_parameters(case.as_given, made)
    refined = Polish(written, ())
    if polish:
        refined = polished(written, case.record, case.believed.log, base_values["J"].stderr)
    if refined.design is not written:
        parameters = refined.told(parameters, len(written.effects) - 1)
        base_values = _refined(base_values, refined)
    written = refined.design
    written = with_evaluation(written, case.record, case.believed.log)
    prediction = predict(case.as_given, case.record)
    base = fit.held_alike(made)
    table = {
        "nominal": errors_table(case.record, errors(prediction.record, prediction.residual)),
        "base": errors_table(case.record, errors(base.record, base.left)),
        "final": errors_table(case.record, errors(made.record, made.left)),
    }
    rms, relative = torque_error(written, as_compared(written, case.record, case.believed.log))
    own = {"rms": rms, "unit": case.record.unit("torque"), "relative": relative}
    table["final"] = {**table["final"], "torque": own}
    worse = worse_by_error(relative, table["nominal"]["torque"]["relative"])
    against = [str(refusal)] if (refusal := not_supported(case, fit, made, trial)) is not None else []
    against += [one.text for one in case.believed.contradictions]
    held = {
        which: errors_table(case.record, case.holdout_errors(one)) for which, one in (("base", base), ("final", made))
    }
    rows = record_rows(case, base, made)
    return Addition(
        effect=trial.candidate.effect.id,
        title=trial.candidate.effect.title_on(case.record.prepared.motion),
        design=case.as_given if worse else written,
        parameters=parameters,
        base=base_values,
        errors=table,
        holdout=held if case.holdouts else {},
        against=tuple(against),
        notices=(*([worse] if worse else []), *case.believed.notices, *record_notices(rows), *case.remarks, *said),
        records=rows,
        spreads=record_spreads(made.record, made.estimate, rows),
        improved=worse is None,
        remarks=refined.said,
        log_name=case.name,
        holdout_name=holdout_name if case.holdouts else "",
        level_refitted=case.level_refitted,
    )


def _refined(base: Mapping[str, Estimate], refined: Polish) -> dict[str, Estimate]:
    """Return the estimates of the base model as the refined design has them, of what it has once."""
    out = dict(base)
    for position, entry in enumerate(refined.design.effects[:-1]):
        out |= refined.told({symbol: out[symbol] for symbol in entry.parameters if symbol in out}, position)
    return out | {"J": replace(base["J"], value=refined.design.J)}


def _made(case: Case, trial: Trial) -> Fitted:
    """Fit the design with an effect of this trial's shape."""
    accepted = Accepted(trial.candidate.effect, trial.group.shape, trial.candidate.grid)
    fit = fit_design(case.design, case.record, (accepted,), case.effects, explore=False)
    return with_shapes_fitted(case.design, fit)

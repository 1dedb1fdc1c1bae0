"""Errors of the designs that a diagnosis finds, evaluated as `compare` does, instead of those of its fits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose.case import Case
from pmsm_ctrl.diagnose.fit import Fitted
from pmsm_ctrl.diagnose.fitted_design import fitted_design
from pmsm_ctrl.diagnose.outcome import errors_table, strangers
from pmsm_ctrl.diagnose.refusal import Reason, Refusal
from pmsm_ctrl.diagnose.result import Diagnosis, DiagnosisStep, Errors
from pmsm_ctrl.diagnose.selection import Selection, name_of
from pmsm_ctrl.log import Log, names_of
from pmsm_ctrl.regression.evaluated import as_compared, with_evaluation
from pmsm_ctrl.regression.prediction import Prediction, predict
from pmsm_ctrl.regression.prediction import errors as errors_of
from pmsm_ctrl.regression.record_result import RecordResult
from pmsm_ctrl.regression.records import members
from pmsm_ctrl.regression.worse_than_given import worse_by_error

__all__ = ["as_written", "astray", "finished", "lowering"]


def lowering(case: Case, selection: Selection) -> Selection:
    """Return the selection without its last effects as long as these do not lower the error that a user will see.

    A fit weighs the samples, and has times of sampling of its own: what it gains by them is no gain of the design.
    Where most of what is left is noise, they decide which of two designs leaves less of it, and nothing is told.
    Beside a fit that is astray an effect may only lead it back, unless it lowers what the given design leaves.

    Parameters
    ----------
    case : Case
    selection : Selection
    """
    if case.believed is None or not selection.steps:
        return selection
    designs = [fitted_design(case.design, fit) for fit in selection.fits]
    left, kept = [rms for rms, _ in _as_compared(case, designs)], len(selection.steps)
    enough = case.policy.explained_torque
    if astray(case, selection.fits[0]) and left[-1] ** 2 >= enough * _of(case, case.as_given) ** 2:
        return _without(case, selection, 0, Refusal(Reason.REFIT_WORSE))
    while kept and left[kept] > case.policy.unchanged * left[kept - 1]:
        kept -= 1
    if kept == len(selection.steps):
        return selection
    return _without(case, selection, kept, Refusal(Reason.BALANCE_WORSE, {"balance": "torque"}))


def astray(case: Case, fit: Fitted) -> bool:
    """Return whether most of what the refitted design leaves of the torque is not left by the given one.

    The fit follows the samples that count. Where these are few, of a log that misses most of the edges, the parameters
    are those of the samples' errors.

    Parameters
    ----------
    case : Case
    fit : Fitted
        Without any effect.
    """
    if case.believed is None:
        return False
    given, refitted = _of(case, case.as_given), _of(case, fitted_design(case.design, fit))
    return given**2 < case.policy.explained_torque * refitted**2


def _of(case: Case, design: Design) -> float:
    """Return the rms of what a design leaves of the torque."""
    return predict(design, case.record).torque_error[0]


def _without(case: Case, selection: Selection, kept: int, why: Refusal) -> Selection:
    """Return the selection with its first effects alone."""
    refused = {**selection.refused, **{name_of(step.trial): why for step in selection.steps[kept:]}}
    last = case.fit(selection.fits[kept].accepted)
    return Selection((*selection.fits[:kept], last), selection.steps[:kept], refused)


def as_written(case: Case, found: Diagnosis) -> Diagnosis:
    """Return the answer with the torque errors of the given design and of the one that is written.

    Where that is worse than the given one, the given one stays.

    Parameters
    ----------
    case : Case
    found : Diagnosis
    """
    if case.believed is None:
        return found
    record = found.record
    prediction = predict(case.as_given, record)
    nominal = errors_table(record, errors_of(prediction.record, prediction.residual))
    found = replace(found, errors={**found.errors, "nominal": nominal})
    if found.design is case.as_given:
        return found
    before = [fitted_design(case.design, fit) for fit in found.selection.fits[:-1]]
    shown = _predicted(case, [*before, found.design])
    each = [one.torque_error for one in shown]
    ladder = [{"rms": rms, "unit": record.unit("torque"), "relative": part} for rms, part in each]
    relative = each[-1][1]
    rows = _rows(found.records, shown[0], shown[-1])
    found = replace(found, errors=_evaluated(found.errors, ladder), steps=_between(found.steps, ladder), records=rows)
    worse = worse_by_error(relative, nominal["torque"]["relative"])
    if worse is None:
        return replace(found, design=with_evaluation(found.design, record, case.believed.log))
    warned = dict.fromkeys((*found.reasons, worse, *found.notices))
    unsure = tuple(
        replace(one, flagged=False, note="not sure: the given design leaves less of the torque") if one.flagged else one
        for one in found.parameter_deviations
    )
    return replace(found, design=case.as_given, improved=False, notices=tuple(warned), parameter_deviations=unsure)


def finished(case: Case, found: Diagnosis, holdouts: tuple[Log, ...]) -> Diagnosis:
    """Return a diagnosis with the names of its logs, and what `compare` will say of its design.

    Parameters
    ----------
    case : Case
    found : Diagnosis
    holdouts : tuple of Log

    Returns
    -------
    Diagnosis
    """
    found = as_written(case, found)
    others = strangers(found.records, found.errors["final"]["torque"]["rms"], case.policy)
    for record in (case.record, *case.holdouts):
        record.kept.clear()  # what was remembered of the log stays with no result
    found = replace(found, notices=(*found.notices, *others))
    return replace(found, log_name=case.name, holdout_name=names_of(holdouts, "the held-out log"))


def _as_compared(case: Case, designs: Sequence[Design]) -> list[tuple[float, float]]:
    """Return rms and relative error of the torque of each design, and of those before it."""
    return [one.torque_error for one in _predicted(case, designs)]


def _predicted(case: Case, designs: Sequence[Design]) -> list[Prediction]:
    """Return what each design predicts, as `compare` will evaluate it.

    Noise of the acceleration may be taken for a filter of the torque, which leaves less of it whatever the design. A
    design is evaluated with the sampling found beside the next one where either sampling, held alike, says that what
    the next one adds lowers the error.
    """
    assert case.believed is not None
    records = [as_compared(design, case.record, case.believed.log) for design in designs]
    found = [predict(design, record) for design, record in zip(designs, records, strict=True)]
    for k in range(len(designs) - 2, -1, -1):
        before, after = (found[number].torque_error[0] for number in (k, k + 1))
        if before < after and predict(designs[k + 1], records[k], found[k]).torque_error[0] < before:
            alike = predict(designs[k], records[k + 1], found[k + 1])
            found[k] = alike if alike.torque_error[0] > after else found[k]
    return found


def _rows(rows: tuple[RecordResult, ...], before: Prediction, after: Prediction) -> tuple[RecordResult, ...]:
    """Return the rows of the records that were fitted with the torque errors of two designs."""
    spans = after.record.records
    if not spans:
        return rows
    out = list(rows)
    for k, here in enumerate(members(after.record)):
        if not np.any(after.record.mask & here):  # it stands still
            continue
        new = {}
        for which, one in (("before", before), ("after", after)):
            torque = errors_of(replace(one.record, mask=one.record.mask & here), one.residual, ("torque",))
            new[which] = {**getattr(rows[k], which), **errors_table(one.record, torque)}
        out[k] = replace(rows[k], before=new["before"], after=new["after"])
    return tuple(out)


def _evaluated(errors: Mapping[str, Errors], ladder: Sequence[Mapping[str, Any]]) -> dict[str, Errors]:
    """Return errors with those of the torque of the first and the last design."""
    return {
        **errors,
        "base": {**errors["base"], "torque": ladder[0]},
        "final": {**errors["final"], "torque": ladder[-1]},
    }


def _between(steps: tuple[DiagnosisStep, ...], ladder: Sequence[Mapping[str, Any]]) -> tuple[DiagnosisStep, ...]:
    """Return the steps with the errors of the torque around each."""
    return tuple(
        replace(
            step,
            error_before={**step.error_before, "torque": before},
            error_after={**step.error_after, "torque": after},
        )
        for step, (before, after) in zip(steps, pairwise(ladder), strict=True)
    )

"""From the selection to the answer: errors, parameters with standard errors, the design, the ranking, the verdict."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from pmsm_ctrl.compare.free_run import over_parts
from pmsm_ctrl.diagnose import notices
from pmsm_ctrl.diagnose.case import Case
from pmsm_ctrl.diagnose.deviations import deviation_notices, parameter_deviations, winding_substitutes
from pmsm_ctrl.diagnose.excitation import hidden_by_motion, not_excited
from pmsm_ctrl.diagnose.fit import Fitted
from pmsm_ctrl.diagnose.fitted_design import base_parameters, fitted_design, fitted_parameters
from pmsm_ctrl.diagnose.judging import Evidence
from pmsm_ctrl.diagnose.level import floor_of
from pmsm_ctrl.diagnose.limits import amounts_that_gain, detection_limits
from pmsm_ctrl.diagnose.policy import Policy
from pmsm_ctrl.diagnose.refusal import NEVER_SEEN, Reason, Refusal
from pmsm_ctrl.diagnose.result import Diagnosis, DiagnosisStep, Errors, Ranked, Structure, Verdict
from pmsm_ctrl.diagnose.search import Trial
from pmsm_ctrl.diagnose.selection import Selection, name_of
from pmsm_ctrl.diagnose.verdict import judged
from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.regression.model import LOAD_SCALE
from pmsm_ctrl.regression.notices import ENCODER_LINES, RESOLVER_ERROR
from pmsm_ctrl.regression.prediction import errors
from pmsm_ctrl.regression.record_result import (
    RecordResult,
    errors_of,
    own_rows,
    record_notices,
    record_spreads,
    zero_of,
)
from pmsm_ctrl.result import Estimate
from pmsm_ctrl.section import Notice
from pmsm_ctrl.units import axis_unit

__all__ = ["errors_table", "noise_floor", "outcome", "strangers"]


def outcome(
    case: Case, selection: Selection, structure: Structure | None, experiment: Mapping[str, Any] | None
) -> Diagnosis:
    """Return the answer.

    Parameters
    ----------
    case : Case
    selection : Selection
    structure : Structure or None
        What of the residual no effect explains.
    experiment : dict or None
        The next experiment.
    """
    final, policy = selection.fit, case.policy
    told = selection.held_alike()
    steps = list(_steps(case, told))
    design = fitted_design(case.design, final)
    left = structure.notice if structure is not None else next((event.notice for event in case.events), None)
    blind = not_excited(final, policy)
    offered = {name: effect for name, effect in case.effects.items() if name not in {step.effect for step in steps}}
    hidden = hidden_by_motion(final, offered, policy)
    deviations = parameter_deviations(case.design, selection, policy)
    records = record_rows(case, told.fits[0], told.fit)
    asides = (blind, *((None, left) if structure is not None and not structure.confirmed else (left, None)))
    verdict, reasons = judged(selection, case.believed, asides, deviations, policy)
    if steps and verdict not in (Verdict.IMPLAUSIBLE, Verdict.EFFECTS_MISSING):
        verdict, reasons = Verdict.EFFECTS_MISSING, ()
    if verdict is Verdict.IMPLAUSIBLE:  # no name and no parameter would mean anything
        selection = told = Selection(selection.fits[:1])
        steps, design, left, structure = [], case.as_given, None, None
    warned = (
        *reasons,
        *(case.believed.notices if case.believed else ()),
        *record_notices(records),
        *case.remarks,
        *(event.notice for event in case.events),
        *notices.of_log((*_without_false_lines(case.record.notes, final, policy), *final.notes)),
        *deviation_notices(deviations, final, policy),
        *([blind] if blind is not None else []),
        *(notices.EFFECT_NOT_EXCITED(effect=name, why=str(why)) for name, why in hidden.items()),
        *winding_substitutes(selection, policy),
        *notices.at_bounds(final),
        *_limits(selection),
        *([left] if left is not None else []),
    )
    return Diagnosis(
        verdict=verdict,
        design=design,
        errors=_errors(case.record, told),
        steps=tuple(steps),
        ranking=tuple(_ranking(selection, hidden, policy)),
        parameter_deviations=deviations,
        next_experiment=experiment,
        notices=tuple(dict.fromkeys(warned)),
        reasons=reasons,
        left=left,
        structure=structure,
        events=case.events,
        free_run={
            "nominal": _free_run(case, None),
            "base": (base_run := _free_run(case, told.fits[0])),
            "final": steps[-1].free_run if steps else base_run,
        },
        base=base_parameters(case.as_given, told.fits[0]),
        records=records,
        spreads=record_spreads(final.record, final.estimate, records),
        record=case.record,
        selection=told,
        holdouts=case.holdouts,
    )


def record_rows(case: Case, first: Fitted, last: Fitted) -> tuple[RecordResult, ...]:
    """Return a row for every record, those that were held out last.

    Parameters
    ----------
    case : Case
    first, last : Fitted
        Before and after.
    """
    fitted = (last.estimate, last.weights, last.whitener)
    rows = own_rows(last.record, (first.left, last.left), fitted, case.name)
    for number, holdout in enumerate(case.holdouts):
        found = [
            errors_of(*case.held_out(fit, number, refitted)) for refitted in (False, True) for fit in (first, last)
        ]
        name, rate = case.holdout_names[number], holdout.prepared.rate
        rows.append(
            RecordResult(
                name, True, holdout.duration, rate, found[0], found[1], angle=zero_of(holdout, 0),
                level_before=found[2], level_after=found[3],
            )
        )  # fmt: skip
    return tuple(rows)


def strangers(rows: Sequence[RecordResult], rms: float, policy: Policy) -> tuple[Notice, ...]:
    """Return which held-out records are not described by a model that describes the fitted ones.

    Parameters
    ----------
    rows : sequence of RecordResult
    rms : float
        What the model leaves of the torque of the fitted records, N m (N).
    policy : Policy
    """
    ratios = ((row.name, row.level_after["torque"]["rms"] / max(rms, 1e-300)) for row in rows if row.held_out)
    found = (one for one in ratios if one[1] > policy.implausible_factor)
    return tuple(notices.HELD_OUT_DISAGREES(record=name, ratio=ratio) for name, ratio in found)


def _without_false_lines(notes: Iterable[Notice], final: Fitted, policy: Policy) -> Iterator[Notice]:
    """Yield what was said of a log but an error of the angle that the final model has no use for.

    The log was conditioned without the effects that were found, and what they leave resembles lines of an encoder.
    """
    sizes = np.abs(final.plain.values) / np.maximum(final.plain.stderr, 1e-300)
    size = dict(zip(final.model.names, sizes.tolist(), strict=True))
    for note in notes:
        symbol = {ENCODER_LINES.code: "lines", RESOLVER_ERROR.code: "order"}.get(note.code)
        waves = () if symbol is None else (f"{wave} {note.detail[symbol]}" for wave in ("sin", "cos"))
        found = [size[name] for name in waves if name in size]
        if not found or max(found) > policy.sure_errors:
            yield note


def _limits(selection: Selection) -> Iterator[Notice]:
    """Yield what the accepted effects do not tell.

    The commutation angle, a spring that resonates above the band, a change that goes on after the log; and
    errors after single steps.
    """
    names = [step.trial.candidate.effect.id for step in selection.steps if step.together]
    if names:
        yield notices.TAKEN_TOGETHER(effects=", ".join(dict.fromkeys(names)))
    fit = selection.fit
    band = fit.record.prepared.cutoff
    for one in fit.accepted:
        structure = one.effect.structure
        if one.effect.as_sensor:
            yield notices.AS_SENSOR(effect=one.effect.id, sensor=one.effect.as_sensor)
        if structure.commutation_apart(one.shape):
            yield notices.OTHER_ANGLE(effect=one.effect.id)
        for p in one.effect.searched:
            if p.within_grid and one.shape[p.symbol] >= max(shape[p.symbol] for shape in one.grid):
                yield notices.BEYOND_LOG(effect=one.effect.id, parameter=p.symbol, value=one.shape[p.symbol])
        resonance = structure.resonance(one.shape)
        if resonance is not None and resonance > band:
            yield notices.BEYOND_BAND(effect=one.effect.id, resonance=resonance, band=band)


def _steps(case: Case, selection: Selection) -> Iterator[DiagnosisStep]:
    """Yield every accepted effect with its final parameters, and the errors around it on both records."""
    own = [errors_table(case.record, errors(fit.record, fit.left)) for fit in selection.fits]
    other = [errors_table(case.record, case.holdout_errors(fit)) for fit in selection.fits]
    for k, step in enumerate(selection.steps):
        effect, parameters = step.trial.candidate.effect, fitted_parameters(selection.fit, k)
        name = effect.label({symbol: found.value for symbol, found in parameters.items()})
        yield DiagnosisStep(
            effect.id, name, effect.title_on(case.record.prepared.motion), step.equivalents, parameters,
            own[k], own[k + 1], other[k], other[k + 1], _evidence(step.evidence),
            _free_run(case, selection.fits[k + 1]),
        )  # fmt: skip


def _evidence(e: Evidence) -> dict[str, Any]:
    cv = e.cross_validation
    return {
        "chi2_gain": e.gain, "p_value": e.p_value, "p_holm": e.p_holm, "blocks": cv.blocks,
        "block_gain": cv.gain, "block_stderr": cv.stderr, "p_rank": cv.p_rank, "material_share": e.size,
        "explained_share": e.explained,
    }  # fmt: skip


def _free_run(case: Case, fit: Fitted | None) -> dict[str, Any]:
    """Return the error of the position when every record is simulated; of the design as given without a fit."""
    record = case.record
    spans, prepared = record.records, record.prepared
    between = sum(after.start - before.stop - 1.0 / prepared.rate for before, after in pairwise(spans))
    if record.unseen - between > 0.5 / prepared.rate:
        return {}  # what bridges a gap drives nothing
    design = case.design if fit is None else fitted_design(case.design, fit)
    if fit is not None and LOAD_SCALE in fit.model.names:
        scale = 1.0 + float(fit.estimate.values[fit.model.names.index(LOAD_SCALE)])
        prepared = replace(prepared, signals={**prepared.signals, "T_load": scale * prepared.signals["T_load"]})
    half = 0.5 / prepared.rate
    parts = [slice(*np.searchsorted(prepared.t, [one.start - half, one.stop + half])) for one in spans]
    found = over_parts(design, prepared, parts or [slice(None)])
    return {} if found is None else {"rms": found[0], "unit": axis_unit("rad", prepared.motion), "fit": found[1]}


def errors_table(record: Record, found: Mapping[str, tuple[float, float]]) -> Errors:
    """Return rms error and its share by balance, with units.

    Parameters
    ----------
    record : Record
    found : dict of balance to (float, float)
    """
    return {name: {"rms": rms, "unit": record.unit(name), "relative": part} for name, (rms, part) in found.items()}


def _errors(record: Record, selection: Selection) -> dict[str, Errors]:
    first, last = selection.fits[0], selection.fit
    nominal = first.model.nominal.copy()
    for k in range(len(nominal)):  # nuisances have no nominal value
        group = first.model.group_of(k)
        free = not np.isfinite(first.model.sigma[k]) or group.effect is None
        if group.sampling or (free and nominal[k] == 0.0):
            nominal[k] = first.plain.values[k]
    residual = first.record.target - first.model.matrix @ nominal
    return {
        "nominal": errors_table(record, errors(first.record, residual)),
        "base": errors_table(record, errors(first.record, first.left)),
        "final": errors_table(record, errors(last.record, last.left)),
        "noise_floor": noise_floor(record, last),
    }


def noise_floor(record: Record, fit: Fitted) -> Errors:
    """Return the noise floor of each balance, from the whitened residual of a fit.

    Where the balance is known to have more noise, of which candidates explain a part, it is that noise. It is never
    more than the residual: a slow load that no effect explains is taken for noise.

    Parameters
    ----------
    record : Record
        Whose measured balances the relative error is taken of.
    fit : Fitted
    """
    floor = {}
    for row, name in enumerate(record.channels):
        size = max(float(np.sqrt(np.mean(record.target[row][record.mask] ** 2))), 1e-300)
        left = float(np.sqrt(np.mean(fit.residual[row][fit.record.mask] ** 2)))
        rms = min(floor_of(fit, row), left)
        floor[name] = (rms, rms / size)
    return errors_table(record, floor)


def _ranking(selection: Selection, hidden: Mapping[str, Refusal], policy: Policy) -> Iterator[Ranked]:
    """Yield accepted effects in order, then the candidates of the last round, best first."""
    start, last = selection.fits[0].solved.chi2, selection.fit
    for step in selection.steps:
        yield Ranked(step.trial.candidate.effect.id, _explained(step.trial, start), step.trial.p_value)
    for trial in last.trials:
        name = trial.candidate.effect.id
        why = hidden.get(name) or selection.refused.get(name_of(trial)) or Refusal(Reason.NOT_NEEDED)
        amounts = _shown_from(last, trial, policy) if why.reason in NEVER_SEEN else {}
        yield Ranked(name, _explained(trial, start), trial.p_value, why, amounts)
    for candidate in last.closed:
        why = Refusal(Reason.UNAVAILABLE, {"why": candidate.why_not or "it has no column on this log"})
        yield Ranked(candidate.effect.id, 0.0, 1.0, why)


def _shown_from(fit: Fitted, trial: Trial, policy: Policy) -> dict[str, Estimate]:
    """From which amount on the log would show an effect that it does not show: absence of evidence is not evidence."""
    effect, motion = trial.candidate.effect, fit.record.prepared.motion
    if not effect.structure.amounts_are_linear:
        return {}  # the size of their column is not their amount
    level = policy.significance / max(len(fit.trials), 1)
    amounts = detection_limits(fit.solved, fit.whitener, trial.group, level)
    # without it the error is so much higher that it is worth a name
    left = sum(float(rest @ rest) for rest in (fit.plain.rest_of(row) for row, _ in trial.group.entering))
    worth = left * (policy.lowered**-2 - 1.0)
    amounts = np.maximum(amounts, amounts_that_gain(fit.plain, fit.weights, trial.group, worth))
    shown = {}
    for symbol, amount in zip(trial.group.symbols, amounts.tolist(), strict=True):
        p = effect.parameter(symbol)
        inside = amount < max(abs(p.lower), abs(p.upper))
        shown[symbol] = Estimate(amount if inside else float("inf"), axis_unit(p.unit, motion))
    return shown


def _explained(trial: Trial, start: float) -> float:
    return float(min(1.0, max(0.0, trial.gain / start))) if start > 0 else 0.0

"""From the selection to the answer: errors, parameters with standard errors, the design, the ranking, the verdict."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose.candidates import REPEATED
from pmsm_ctrl.diagnose.fit import Accepted, Fitted, errors
from pmsm_ctrl.diagnose.gates import OUTSIDE, SIGNIFICANCE, UNSEEN
from pmsm_ctrl.diagnose.search import Trial, least_shown
from pmsm_ctrl.diagnose.selection import Selection, Step, holdout_error
from pmsm_ctrl.effects.base import Effect
from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.result import Estimate
from pmsm_ctrl.units import axis_unit

__all__ = ["build_outcome", "fitted_parameters"]

OTHER_ANGLE = (
    "encoder_eccentricity: the voltages do not follow the wrong angle, so the drive commutates by another one; the "
    "design has no word for that, and simulating it turns the drive's frame as well"
)


def build_outcome(
    design: Design, record: Record, holdout: Record | None, selection: Selection, effects: Mapping[str, Effect],
    plan: bool = True,
) -> dict[str, Any]:  # fmt: skip
    """Return the fields of a `Diagnosis`; without `plan` no next experiment is looked for."""
    from pmsm_ctrl.diagnose.deviations import parameter_deviations, stood_in
    from pmsm_ctrl.diagnose.excitation import hidden_by_motion, not_excited
    from pmsm_ctrl.diagnose.experiment import next_experiment
    from pmsm_ctrl.diagnose.ironloss import friction_excess, step_of, unexplained_excess, with_excess
    from pmsm_ctrl.diagnose.leftover import leftover, resembled, stands_in

    final = selection.fits[-1]
    steps = _steps(design, record, holdout, selection, effects)
    fitted = fitted_design(design, final, selection.accepted, record)
    deviations, hints = parameter_deviations(design, final)
    excess = None if steps else friction_excess(design, final)
    grown = ""
    if excess is not None and "iron_loss" not in effects:
        grown = unexplained_excess(design, final)
    elif excess is not None:
        steps.append(step_of(record, excess, table))
        fitted = with_excess(design, fitted, excess)
    left = leftover(final) or resembled(selection) or stands_in(final)
    verdict = "effects_missing" if steps else "consistent"
    blind = not_excited(final)
    if blind:
        hints = (*hints, blind)
        verdict = verdict if steps else "not_excited"
    hidden = hidden_by_motion(final, effects)
    hints = (*hints, *(f"{name}: {why}" for name, why in hidden.items()))
    unexplained = left.text if left is not None else grown
    if unexplained and verdict == "consistent":
        verdict = "unexplained"
    hints = (*hints, *stood_in(selection))
    if any(one.shape.get("frame") == 0.0 for one in selection.accepted):
        hints = (*hints, OTHER_ANGLE)
    hints = (*hints, *_beyond_the_band(record, selection.accepted))
    reasons = [*map(str, record.notes), *final.notes, *hints]
    if unexplained:
        reasons.append(unexplained)
    return {
        "verdict": verdict,
        "design": fitted,
        "errors": _errors(design, record, selection),
        "steps": tuple(steps),
        "ranking": _ranking(selection, hidden),
        "parameter_deviations": deviations,
        "next_experiment": next_experiment(design, fitted, selection, effects) if plan else None,
        "reasons": tuple(reasons),
        "unexplained": unexplained,
        "left": left,
    }


def _beyond_the_band(record: Record, accepted: tuple[Accepted, ...]) -> Iterator[str]:
    """Say of a spring that rings above the band what a log can tell of it: alpha / w_a^2 is all that is left there."""
    for one in accepted:
        rings, band = one.shape.get("w_a", 0.0) / (2.0 * np.pi), record.prepared.cutoff
        if one.effect.structure == "transmission" and "gap" not in one.shape and rings > band:
            yield (
                f"{one.effect.id}: its load rings at {rings:.0f} Hz, above the band of this log ({band:.0f} Hz): "
                "J_load^2 / k is known, the two apart are not"
            )


def _steps(
    design: Design, record: Record, holdout: Record | None, selection: Selection, effects: Mapping[str, Effect],
) -> list[Any]:  # fmt: skip
    """Every accepted effect with its final parameters, and the errors around it on both records."""
    from pmsm_ctrl.diagnose.diagnosis import DiagnosisStep

    final = selection.fits[-1]
    steps: list[Any] = []
    for number, step in enumerate(selection.steps):
        before, after = selection.fits[number], selection.fits[number + 1]
        old, new = selection.accepted[:number], selection.accepted[: number + 1]
        ahead = behind = {}
        if holdout is not None:
            ahead = table(record, holdout_error(design, holdout, old, before, effects))
            behind = table(record, holdout_error(design, holdout, new, after, effects))
        steps.append(
            DiagnosisStep(
                effect=step.trial.candidate.effect.id,
                equivalents=step.equivalents,
                parameters=fitted_parameters(final, selection.accepted, number, record),
                error_before=table(record, errors(before.record, before.residual)),
                error_after=table(record, errors(after.record, after.residual)),
                holdout_before=ahead,
                holdout_after=behind,
                evidence=_evidence(step),
            )
        )
    return steps


def table(record: Record, found: Mapping[str, tuple[float, float]]) -> dict[str, dict[str, Any]]:
    """Errors per balance as rms, unit and relative."""
    return {name: {"rms": rms, "unit": record.unit(name), "relative": part} for name, (rms, part) in found.items()}


def _errors(design: Design, record: Record, selection: Selection) -> dict[str, Any]:
    first, last = selection.fits[0], selection.fits[-1]
    nominal = first.model.nominal.copy()
    free = ~np.isfinite(first.model.sigma) & (nominal == 0.0)
    nominal[free] = first.plain.values[free]  # nuisances have no nominal value
    for k, name in enumerate(first.model.names):
        if name.startswith("tau_"):
            nominal[k] = first.plain.values[k]
    residual = first.record.target - first.model.matrix @ nominal
    floor = {
        name: (float(last.whitener.sigma[row]), float(last.whitener.sigma[row] / _size(record, row)))
        for row, name in enumerate(record.channels)
    }
    return {
        "nominal": table(record, errors(first.record, residual)),
        "base": table(record, errors(first.record, first.residual)),
        "final": table(record, errors(last.record, last.residual)),
        "noise_floor": table(record, floor),
    }


def _size(record: Record, row: int) -> float:
    return max(float(np.sqrt(np.mean(record.target[row][record.mask] ** 2))), 1e-300)


def _evidence(step: Step) -> dict[str, Any]:
    e = step.evidence
    return {
        "chi2_gain": e.gain, "p_value": e.p_value, "p_holm": e.p_holm, "blocks": e.blocks,
        "block_gain": e.block_gain, "block_stderr": e.block_stderr, "p_rank": e.p_rank, "material_share": e.material,
    }  # fmt: skip


def fitted_parameters(fit: Fitted, accepted: tuple[Accepted, ...], number: int, record: Record) -> dict[str, Estimate]:
    """Parameters of the accepted effect at this position, in the effect's own symbols."""
    one = accepted[number]
    linear = dict(one.shape)
    stderr: dict[str, float] = {}
    position = _position(fit, accepted, number)
    if position is not None:
        columns = fit.model.columns_of(position)
        for symbol, value, error in zip(
            fit.model.groups[position].symbols, fit.plain.values[columns], fit.plain.stderr[columns], strict=True
        ):
            linear[symbol] = float(value)
            stderr[symbol] = float(error)
    values = own_symbols(one.effect, linear)
    return {
        p.symbol: Estimate(
            values[p.symbol], axis_unit(p.unit, record.prepared.motion), stderr.get(p.symbol, float("nan"))
        )
        for p in one.effect.parameters
        if p.symbol in values
    }


def own_symbols(effect: Effect, found: Mapping[str, float]) -> dict[str, float]:
    """Translate what the columns use into the effect's own parameters, inside their bounds."""
    values = dict(found)
    if effect.structure == "transmission":
        J_load, w, zeta = values["J_load"], values.pop("w_a"), values.pop("zeta")
        values["k"], values["d"] = J_load * w * w, 2.0 * zeta * w * J_load
    values.pop("level", None)
    return {
        p.symbol: float(min(max(values[p.symbol], p.lower), p.upper)) for p in effect.parameters if p.symbol in values
    }


def _position(fit: Fitted, accepted: tuple[Accepted, ...], number: int) -> int | None:
    """Where the accepted effect stands among the model's groups."""
    if accepted[number].effect.structure == "bristle":
        return None
    wired = [k for k, a in enumerate(accepted) if a.effect.structure != "bristle"]
    return len(fit.model.groups) - len(wired) + wired.index(number)


def fitted_design(design: Design, fit: Fitted, accepted: tuple[Accepted, ...], record: Record) -> Design:
    """The design with refitted friction and the accepted effects; the machine's own data stay the datasheet's."""
    entries = list(design.effects)
    for position, group in enumerate(fit.model.groups):
        if group.entry < 0 or group.effect is None:
            continue
        columns = fit.model.columns_of(position)
        entry = entries[group.entry]
        found, stderr = dict(entry.parameters), dict(entry.stderr)
        if group.effect.structure == "term":
            for symbol, value, error in zip(
                group.symbols, fit.plain.values[columns], fit.plain.stderr[columns], strict=True
            ):
                p = group.effect.parameter(symbol)
                if np.isfinite(error):
                    found[symbol] = float(min(max(value, p.lower), p.upper))
                    stderr[symbol] = float(error)
        entries[group.entry] = entry.model_copy(update={"parameters": found, "stderr": stderr})
    out = design.replace_effects(tuple(entries))
    J = dict(zip(fit.model.names, fit.plain.values, strict=True))["J"]
    if design.load.J / design.load.gear**2 < J:
        out = out.with_parameters(J=float(J))
    for number, one in enumerate(accepted):
        found_parameters = fitted_parameters(fit, accepted, number, record)
        values = {symbol: e.value for symbol, e in found_parameters.items()}
        errors_ = {symbol: e.stderr for symbol, e in found_parameters.items() if np.isfinite(e.stderr)}
        add = out.add_effect if one.effect.id in REPEATED else out.with_effect
        out = add(one.effect.id, values, errors_)
    return out


def _ranking(selection: Selection, hidden: Mapping[str, str]) -> tuple[Any, ...]:
    """Accepted effects in order, then the candidates of the last round, best first."""
    from pmsm_ctrl.diagnose.diagnosis import Ranked

    start = selection.fits[0].solved.chi2
    rows = [
        Ranked(s.trial.candidate.effect.id, _share(s.trial, start), s.trial.p_value, True, "") for s in selection.steps
    ]
    last = selection.fits[-1]
    for trial in last.trials:
        name = trial.candidate.effect.id
        order = trial.group.shape.get("order")
        key = f"{name} {order:g}" if name in REPEATED and order else name
        why = hidden.get(name) or selection.refused.get(key, "what is left does not need it")
        unseen = why.startswith((UNSEEN, OUTSIDE)) and name not in hidden
        amounts = _shown_from(last, trial) if unseen else {}
        rows.append(Ranked(name, _share(trial, start), trial.p_value, False, why, amounts))
    rows += [Ranked(c.effect.id, 0.0, 1.0, False, c.why_not or "it has no column on this log") for c in last.closed]
    return tuple(rows)


def _shown_from(fit: Fitted, trial: Trial) -> dict[str, Estimate]:
    """From which amount on the log would show an effect that it does not show: absence of evidence is not evidence."""
    effect, motion = trial.candidate.effect, fit.record.prepared.motion
    if effect.structure == "bristle" or "gap" in trial.group.shape:
        return {}  # the size of their column is not their amount
    amounts = least_shown(fit.solved, fit.whitener, trial.group, SIGNIFICANCE / max(len(fit.trials), 1))
    shown = {}
    for symbol, amount in zip(trial.group.symbols, amounts.tolist(), strict=True):
        p = effect.parameter(symbol)
        inside = amount < max(abs(p.lower), abs(p.upper))
        shown[symbol] = Estimate(amount if inside else float("inf"), axis_unit(p.unit, motion))
    return shown


def _share(trial: Trial, start: float) -> float:
    return float(min(1.0, max(0.0, trial.gain / start))) if start > 0 else 0.0

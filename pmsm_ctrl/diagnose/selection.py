"""Forward selection with gates: effects are accepted one at a time, everything refitted and rewhitened each time."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose.candidates import Candidate
from pmsm_ctrl.diagnose.fit import Accepted, Fitted, errors, fit_design, predicted_elsewhere
from pmsm_ctrl.diagnose.gates import BLOCK_ERRORS, LEAST_ERRORS, gates, name_of, objection
from pmsm_ctrl.diagnose.refine import refine
from pmsm_ctrl.diagnose.search import Evidence, Trial, try_group
from pmsm_ctrl.effects.base import Effect
from pmsm_ctrl.evidence.tests import holm
from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.regression.columns import effect_group

__all__ = ["Selection", "Step", "fitted_before", "holdout_error", "select", "tied"]

MOST_STEPS = 8


@dataclass(frozen=True, eq=False)
class Step:
    """One accepted effect: the trial that won, its evidence and the rivals it cannot be told from."""

    trial: Trial
    evidence: Evidence
    equivalents: tuple[str, ...]
    before: Fitted
    after: Fitted | None = None


@dataclass(frozen=True, eq=False)
class Selection:
    """The whole way: fits before and after every step, and why the rest was refused."""

    fits: tuple[Fitted, ...]
    steps: tuple[Step, ...]
    accepted: tuple[Accepted, ...]
    refused: Mapping[str, str] = field(default_factory=dict)


def select(
    design: Design,
    record: Record,
    effects: Mapping[str, Effect],
    holdout: Record | None = None,
    progress: Callable[[float], None] | None = None,
    order: tuple[str, ...] = (),
    known: Iterable[Fitted] = (),
) -> Selection:
    """Accept effects until nothing passes the gates.

    With `order` the first ones are these, or none at all when one of them does not pass. What is `known` of the same
    design, record and candidates is not fitted again.
    """
    accepted: tuple[Accepted, ...] = ()
    known = tuple(known)
    fit = fitted_before(known, accepted) or fit_design(design, record, accepted, effects)
    fits, steps = [fit], []
    refused: dict[str, str] = {}
    for number in range(MOST_STEPS):
        refused = {}
        only = order[number] if number < len(order) else ""
        # what an effect taken in is not exactly is left in every block, and can look like a small one
        least = BLOCK_ERRORS if accepted else LEAST_ERRORS
        won = _winner(fit, refused, least, only)
        while won is not None:
            trial, evidence = won
            new = (*accepted, Accepted(trial.candidate.effect, trial.group.shape, trial.candidate.grid))
            new = _reshaped(design, record, new, effects)
            after = fitted_before(known, new) or fit_design(design, record, new, effects)
            # what is to come next may be what brings a parameter back inside its bounds
            why = "" if number + 1 < len(order) else objection(after, fit, trial.candidate.effect)
            why = why or _holdout_objection(design, holdout, accepted, new, fit, after, effects)
            if not why:
                break
            refused[name_of(trial)] = why
            won = _winner(fit, refused, least, only)
        if won is None:
            if only:
                return Selection((fits[0],), (), (), refused)
            break
        steps.append(Step(trial, evidence, _equivalents(fit, trial), fit, after))
        accepted, fit = new, after
        fits.append(fit)
        if progress is not None:
            progress(min(0.9, 0.2 + 0.7 * (number + 1) / MOST_STEPS))
    return Selection(tuple(fits), tuple(steps), accepted, refused)


def fitted_before(known: Iterable[Fitted], accepted: tuple[Accepted, ...]) -> Fitted | None:
    """Return the fit with these effects, in this order and of these shapes; None where there is none yet."""
    asked = [(one.effect.id, one.shape) for one in accepted]
    return next((fit for fit in known if [(one.effect.id, one.shape) for one in fit.accepted] == asked), None)


def _reshaped(
    design: Design, record: Record, accepted: tuple[Accepted, ...], effects: Mapping[str, Effect],
) -> tuple[Accepted, ...]:  # fmt: skip
    """Refine the nonlinear parameters of the effects taken earlier, now that another one is in.

    Those of a spring just taken as well: it was judged without what is noise.
    """
    out = list(accepted)
    for k, one in enumerate(accepted):
        spring = one.effect.structure == "transmission" and "gap" not in one.shape
        if k == len(accepted) - 1 and not spring:
            continue
        if len(one.grid) < 2 or set(one.shape) <= {"order"} or one.effect.structure == "bristle":
            continue
        others = (*out[:k], *out[k + 1 :])
        fit = fit_design(design, record, others, {})
        candidate = Candidate(one.effect, (*one.grid, one.shape), len(one.grid))
        trial = try_group(fit.plain, fit.weights, candidate, effect_group(fit.record, one.effect, one.shape))
        best = refine(fit.record, fit.plain, fit.weights, trial)
        if not best.wrong_sign:
            out[k] = Accepted(one.effect, best.group.shape, one.grid)
    return tuple(out)


def _winner(fit: Fitted, refused: dict[str, str], least: float, only: str = "") -> tuple[Trial, Evidence] | None:
    """Return the best candidate that passes every gate, writing down why the ones before it do not."""
    p_holm = dict(zip(map(id, fit.trials), holm([t.p_value for t in fit.trials]), strict=True))
    for trial in fit.trials:
        name = name_of(trial)
        if name in refused or (only and trial.candidate.effect.id != only):
            continue
        why, evidence = gates(fit, trial, p_holm[id(trial)], least)
        if evidence is not None and not why:
            return trial, evidence
        refused[name] = why
    return None


def _equivalents(fit: Fitted, trial: Trial) -> tuple[str, ...]:
    """Effects whose best explanation of the same rows is nearly as good and nearly the same."""
    own = trial.direction
    size = float(own @ own)
    found = []
    for other in fit.trials:
        if (
            other is trial
            or other.wrong_sign
            or other.singular
            or other.candidate.effect.id == trial.candidate.effect.id
        ):
            continue
        # what the rival leaves of what this one explains
        along = float(own @ other.direction)
        left = size - along**2 / max(float(other.direction @ other.direction), 1e-300)
        if left < tied(size):
            found.append(other.candidate.effect.id)
    ids = [*found]
    for effect in trial.candidate.effect.look_alikes:
        singular = next(
            (t for t in fit.trials if t.candidate.effect.id == effect and t.singular and not t.candidate.free), None
        )
        if singular is not None and effect not in ids:
            ids.append(effect)
    return tuple(ids)


def tied(gain: float) -> float:
    """By how much two explanations of so large a gain may differ and still be the same to this log."""
    return max(20.0, 0.01 * gain)


def _holdout_objection(
    design: Design, holdout: Record | None, old: tuple[Accepted, ...], new: tuple[Accepted, ...],
    before: Fitted, after: Fitted, effects: Mapping[str, Effect],
) -> str:  # fmt: skip
    if holdout is None:
        return ""
    first = holdout_error(design, holdout, old, before, effects)
    second = holdout_error(design, holdout, new, after, effects)
    worse = {name: (first[name][0], second[name][0]) for name in first}
    if sum(b / a for a, b in worse.values() if a > 0) / len(worse) < 1.0:
        return ""
    return "makes the held-out record worse"


def holdout_error(
    design: Design, holdout: Record, accepted: tuple[Accepted, ...], fit: Fitted, effects: Mapping[str, Effect],
) -> dict[str, tuple[float, float]]:  # fmt: skip
    """Return rms error and its share per balance on another record, with the parameters of the fit."""
    record, predicted = predicted_elsewhere(design, holdout, accepted, fit, effects)
    common = [name for name in record.channels if name in fit.record.channels]
    return errors(record, record.target - predicted, common)

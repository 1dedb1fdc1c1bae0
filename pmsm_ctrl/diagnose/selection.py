"""Forward selection: the best candidate that passes every criterion, before and after the refit with it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

from pmsm_ctrl.diagnose import criteria
from pmsm_ctrl.diagnose.above_band import unlike_above
from pmsm_ctrl.diagnose.bands import unlike_in_half
from pmsm_ctrl.diagnose.candidates import Candidate
from pmsm_ctrl.diagnose.case import Case
from pmsm_ctrl.diagnose.fast_torque import of_fast_torque
from pmsm_ctrl.diagnose.fit import Accepted, Fitted
from pmsm_ctrl.diagnose.judging import (
    Evidence,
    judge_holdout,
    judge_refit,
    judge_sampling,
    judge_size,
    judge_trial,
    own_sampling,
)
from pmsm_ctrl.diagnose.like_ripple import like_ripple
from pmsm_ctrl.diagnose.look_alikes import equivalents, nearly_in_model, same_order
from pmsm_ctrl.diagnose.measures import slight
from pmsm_ctrl.diagnose.policy import POLICY, Policy
from pmsm_ctrl.diagnose.refine import refine
from pmsm_ctrl.diagnose.refusal import Reason, Refusal
from pmsm_ctrl.diagnose.search import Trial, try_group
from pmsm_ctrl.effects.base import Effect
from pmsm_ctrl.evidence.tests import holm
from pmsm_ctrl.regression.columns import SINGLE, effect_group
from pmsm_ctrl.regression.two_stage import beside_held

__all__ = [
    "Found", "Selection", "Step", "best", "judged_trials", "name_of", "passes", "significant", "with_p_values",
    "with_sampling_told", "with_trial",
]  # fmt: skip

# What refuses a significant effect before the refit with it.
BEFORE_REFIT = (
    Reason.PARAMETER_AT_BOUND, Reason.TOO_SMALL, Reason.MINOR, Reason.BESIDE_LARGER, Reason.NOT_CONFIRMED,
    Reason.EXPLAINED_BY_RIVALS, Reason.LIKE_RIPPLE,
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Step:
    """One accepted effect: its trial, its evidence, and the candidates that it cannot be told from.

    `together` is whether it was accepted for what it explains beside effects that came after it.
    """

    trial: Trial
    evidence: Evidence
    equivalents: tuple[str, ...]
    together: bool = False


@dataclass(frozen=True, eq=False)
class Found:
    """Outcome of one round.

    Attributes
    ----------
    step, fit : Step and Fitted, or None
        The accepted effect, and everything fitted again with it.
    refused : dict of name to Refusal
        Candidates that were better, or all of them where none was accepted.
    """

    step: Step | None
    fit: Fitted | None
    refused: Mapping[str, Refusal]

    @property
    def accepted(self) -> bool:
        """Whether an effect was found."""
        return self.step is not None


@dataclass(frozen=True, eq=False)
class Selection:
    """Everything accepted so far.

    Attributes
    ----------
    fits : tuple of Fitted
        Before the first step and after each.
    steps : tuple of Step
    refused : dict of name to Refusal
        Why the remaining candidates were refused.
    """

    fits: tuple[Fitted, ...]
    steps: tuple[Step, ...] = ()
    refused: Mapping[str, Refusal] = field(default_factory=dict)

    @property
    def fit(self) -> Fitted:
        """The last fit."""
        return self.fits[-1]

    @property
    def accepted(self) -> tuple[Accepted, ...]:
        """The effects, with the nonlinear parameters of the last fit."""
        return self.fit.accepted

    def plus(self, found: Found) -> Selection:
        """Return the selection after one more round.

        Parameters
        ----------
        found : Found
        """
        if found.step is None or found.fit is None:
            return replace(self, refused=found.refused)
        if len(found.fit.record.mask) <= SINGLE:
            return Selection((*self.fits, found.fit), (*self.steps, found.step), found.refused)
        step = replace(found.step, trial=found.step.trial.light())  # its model's bases are large
        return Selection((*(fit.spared() for fit in self.fits), found.fit), (*self.steps, step), found.refused)

    def largest_beside(self, trial: Trial) -> float:
        """Return the largest contribution of accepted effects to the balances in which a candidate acts; 0 of none.

        Those count whose model error may look like the candidate: a drag by the speed is no error of a wave of the way.

        Parameters
        ----------
        trial : Trial
        """
        own, effect = {row for row, _ in trial.group.entering}, trial.candidate.effect
        beside = (step for step in self.steps if own & {row for row, _ in step.trial.group.entering})
        akin = (step for step in beside if _akin(effect, step.trial.candidate.effect))
        return max((step.evidence.size for step in akin), default=0.0)

    def held_alike(self) -> Selection:
        """Return the selection whose fits hold the nuisance parameters that the last one holds: they are compared."""
        fits = [self.fit]
        for fit in reversed(self.fits[:-1]):
            fits.insert(0, fit.held_alike(fits[0]))
        return replace(self, fits=tuple(fits))

    def with_last_candidates(self) -> Selection:
        """Return the selection without what all rounds but the last were tested by: on a long log it is large."""
        steps = tuple(replace(step, trial=step.trial.light()) for step in self.steps)
        return replace(self, fits=(*(fit.light() for fit in self.fits[:-1]), self.fit), steps=steps)

    def light(self) -> Selection:
        """Return the selection with what is shown of it: no bases, and no columns of candidates."""
        return replace(self, fits=(*(fit.light() for fit in self.fits[:-1]), self.fit.spared()))


def name_of(trial: Trial) -> str:
    """Return the effect, with its order where an axis can have several.

    Parameters
    ----------
    trial : Trial
    """
    return trial.candidate.effect.label(trial.group.shape)


def best(case: Case, selection: Selection, start: tuple[str, ...] = ()) -> Found:
    """Return the first candidate, in the order of what they explain, that passes every criterion.

    Parameters
    ----------
    case : Case
    selection : Selection
        Its last fit holds the effects accepted so far, and every candidate tried on its residual.
    start : tuple of str
        Ids that the selection begins with: no other one is looked at before these are in.
    """
    fit, number = selection.fit, len(selection.steps)
    if number == case.policy.most_steps:
        return Found(None, None, selection.refused)
    only = start[number] if number < len(start) else ""
    refused: dict[str, Refusal] = {}
    for trial, p_holm in with_p_values(fit):
        name = name_of(trial)
        if name in refused or (only and trial.candidate.effect.id != only):
            continue
        passed = passes(case, selection, trial, p_holm, more_to_come=number + 1 < len(start))
        if not isinstance(passed, Refusal):
            return Found(*passed, refused)
        refused[name] = passed
    return Found(None, None, refused)


def passes(
    case: Case, selection: Selection, trial: Trial, p_holm: float, more_to_come: bool = False
) -> tuple[Step, Fitted] | Refusal:
    """Return the step that a candidate makes and everything fitted again with it, or what refuses it.

    Parameters
    ----------
    case : Case
    selection : Selection
    trial : Trial
        One of its last fit's.
    p_holm : float
        Corrected for all candidates.
    more_to_come : bool
        Whether an effect that is still to come may be what brings a parameter back inside its bounds.

    Returns
    -------
    (Step, Fitted) or Refusal
    """
    fit, number = selection.fit, len(selection.steps)
    minor_too = case.minor_too and not number
    largest, barely_too = selection.largest_beside(trial), not (number or minor_too or case.surely)
    judged = judge_trial(fit, trial, p_holm, case.policy, largest, minor_too, barely_too)
    judged = judged if isinstance(judged, Refusal) else _look_alike(case, fit, trial) or judged
    if isinstance(judged, Refusal):
        return judged
    after = with_trial(case, fit, trial)
    refusal = None if more_to_come else judge_refit(fit, after, trial, case.policy)
    refusal = refusal or judge_holdout(case, fit, after)
    sure = minor_too or (case.surely and not number) or slight(fit, trial) or judged.barely
    if refusal is None and not more_to_come:
        refusal = unlike_in_half(case, fit, after, sure) or judge_size(case, after)
        refusal = refusal or unlike_above(case, after)
    if refusal is None and case.nameable is not None and trial.candidate.effect.id not in case.nameable:
        refusal = Refusal(Reason.LIKE_COMMAND)
    if refusal is not None:
        return refusal
    alike = (*equivalents(trial, fit.trials, case.policy), *same_order(case, fit, trial))
    alike = (*alike, *nearly_in_model(fit, trial, case.policy))
    return Step(trial, judged, tuple(dict.fromkeys(alike))), after


def _akin(one: Effect, other: Effect) -> bool:
    """Whether two effects depend on something alike: on a signal, on the past, or on how something was measured.

    Whatever the error of a model depends on, it has a mean, as a constant has.
    """
    if any(e.structure.has_memory or e.enters == "measurement" or not e.signals for e in (one, other)):
        return True
    read = [{"omega" if signal == "direction" else signal for signal in e.signals} - {"p"} for e in (one, other)]
    return bool(read[0] & read[1])


def _look_alike(case: Case, fit: Fitted, trial: Trial) -> Refusal | None:
    """Return that something else makes the same columns: a ripple of the current, or edges that the log missed."""
    return like_ripple(case, fit, trial) or of_fast_torque(fit, trial, case.policy)


def with_p_values(fit: Fitted) -> Iterator[tuple[Trial, float]]:
    """Yield the candidates of a fit, the one that explains most first, with p-values corrected for their number.

    Parameters
    ----------
    fit : Fitted
    """
    return zip(fit.trials, holm([t.p_value for t in fit.trials]), strict=True)


def with_sampling_told(case: Case, selection: Selection) -> Selection:
    """Return the selection with sampling as the reason, before any other, why a significant delay within it is refused.

    A delay that the sampling of the base model takes up is as long as that says. What a delay explains beside a
    sampling that is held is otherwise an error of the model around edges.

    Parameters
    ----------
    case : Case
    selection : Selection
        Complete: it takes a refit of everything to tell, and only the last refusals are shown.
    """
    fit, refused = selection.fit, dict(selection.refused)
    for trial in fit.trials:
        refusal = refused.get(name_of(trial))
        if not trial.candidate.effect.structure.delays or refusal is None:
            continue
        if refusal.reason is Reason.NOT_INDEPENDENT:
            refused[name_of(trial)] = own_sampling(fit, case.policy) or refusal
        elif refusal.reason in BEFORE_REFIT:
            after = case.fit_beside(_with(case, fit, trial), fit)
            refused[name_of(trial)] = judge_sampling(after, case.policy) or refusal
    return replace(selection, refused=refused)


def judged_trials(
    fit: Fitted, policy: Policy = POLICY, case: Case | None = None
) -> list[tuple[Trial, float, Refusal | None]]:
    """Return every candidate, its p-value corrected for their number, and what refuses it before a refit.

    Parameters
    ----------
    fit : Fitted
        With its trials.
    policy : Policy
    case : Case, optional
        For the ripple of the current that the log shows.

    Returns
    -------
    list of (Trial, float, Refusal or None)
        The one that explains most first.
    """
    out = []
    for trial, p_holm in with_p_values(fit):
        judged = judge_trial(fit, trial, p_holm, policy)
        refusal = judged if isinstance(judged, Refusal) else None
        if refusal is None and case is not None:
            refusal = _look_alike(case, fit, trial)
        out.append((trial, p_holm, refusal))
    return out


def significant(fit: Fitted, policy: Policy = POLICY) -> set[str]:
    """Return the names of the candidates that are significant, whatever else speaks against them.

    Parameters
    ----------
    fit : Fitted
        With its trials.
    policy : Policy
    """
    return {name_of(trial) for trial, p in with_p_values(fit) if criteria.significance(p, policy) is None}


def not_supported(case: Case, before: Fitted, after: Fitted, trial: Trial) -> Refusal | None:
    """Return what speaks against an effect that somebody chose, by the criteria of the diagnosis; None where nothing.

    Parameters
    ----------
    case : Case
    before, after : Fitted
        Everything fitted without and with it.
    trial : Trial
        One of those of `before`.
    """
    p_values = dict(zip(map(id, before.trials), holm([t.p_value for t in before.trials]), strict=True))
    p_holm, first, minor_too = p_values[id(trial)], not before.accepted, False
    judged = judge_trial(before, trial, p_holm, case.policy, barely_too=first)
    if isinstance(judged, Refusal) and judged.reason is Reason.MINOR and first:
        minor_too, small = True, judge_trial(before, trial, p_holm, case.policy, minor_too=True)
        judged = judged if isinstance(small, Refusal) else small
    judged = judged if isinstance(judged, Refusal) else _look_alike(case, before, trial) or judged
    if isinstance(judged, Refusal):
        return judged
    refusal = judge_refit(before, after, trial, case.policy) or judge_holdout(case, before, after)
    refusal = refusal or unlike_in_half(case, before, after, minor_too or slight(before, trial) or judged.barely)
    return refusal or judge_size(case, after) or unlike_above(case, after)


def with_trial(case: Case, fit: Fitted, trial: Trial) -> Fitted:
    """Return the fit with one more effect, the nonlinear parameters of the others refined beside it.

    Parameters
    ----------
    case : Case
    fit : Fitted
    trial : Trial
        One of its trials.
    """
    return case.fit(_with(case, fit, trial))


def _with(case: Case, fit: Fitted, trial: Trial) -> tuple[Accepted, ...]:
    """Return the accepted effects and a new one, the nonlinear parameters of the earlier ones refined beside it.

    Those of a spring just accepted as well: it was judged without what is noise.
    """
    out = [*fit.accepted, Accepted(trial.candidate.effect, trial.group.shape, trial.candidate.grid)]
    for k, one in enumerate(out):
        structure = one.effect.structure
        if k == len(out) - 1 and not structure.refined_when_taken:
            continue
        if len(one.grid) < 2 or not structure.refined_later(one.effect, one.shape):
            continue
        rest = case.without_candidates((*out[:k], *out[k + 1 :]))
        candidate = Candidate(one.effect, (*one.grid, one.shape), len(one.grid))
        group = beside_held(effect_group(rest.record, one.effect, one.shape), rest.model.responses)
        trial = try_group(rest.plain, rest.weights, candidate, group)
        refined = refine(rest.record, rest.plain, rest.weights, trial)
        if not refined.wrong_sign:
            out[k] = Accepted(one.effect, refined.group.shape, one.grid)
    return tuple(out)

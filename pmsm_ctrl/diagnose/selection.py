"""Forward selection: the best candidate that passes every criterion, before and after the refit with it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

from pmsm_ctrl.diagnose import criteria
from pmsm_ctrl.diagnose.above_band import unlike_above
from pmsm_ctrl.diagnose.bands import unlike_in_half
from pmsm_ctrl.diagnose.candidates import Candidate
from pmsm_ctrl.diagnose.case import Case
from pmsm_ctrl.diagnose.contradictions import contradicting
from pmsm_ctrl.diagnose.criteria import CrossValidation
from pmsm_ctrl.diagnose.fit import Accepted, Fitted
from pmsm_ctrl.diagnose.look_alikes import equivalents, nearly_in_model, same_order
from pmsm_ctrl.diagnose.measures import (
    beside_rivals,
    contribution,
    cross_validated,
    excess_of,
    has_own_order,
    in_band,
    in_doubt,
    judged_gain,
    left_inside,
    machine_of,
    plain_errors,
    prewhitened_error,
    record_deviation,
    ripple_gain,
    sized,
    slight,
    sound_error,
    typical_error,
    weighted_errors,
    winding_deviation,
)
from pmsm_ctrl.diagnose.policy import POLICY, Policy
from pmsm_ctrl.diagnose.refine import refine
from pmsm_ctrl.diagnose.refusal import Reason, Refusal
from pmsm_ctrl.diagnose.search import Trial, try_group
from pmsm_ctrl.diagnose.shapes import sizes_in_shape
from pmsm_ctrl.evidence.tests import f_tail, holm
from pmsm_ctrl.regression.bounds import bounded, column_bounds
from pmsm_ctrl.regression.columns import SINGLE, effect_group
from pmsm_ctrl.regression.model import Solved
from pmsm_ctrl.regression.two_stage import beside_held

__all__ = [
    "Evidence", "Found", "Selection", "Step", "best", "judged_trials", "name_of", "significant",
    "with_sampling_told", "with_trial",
]  # fmt: skip

# What refuses a significant effect before the refit with it.
BEFORE_REFIT = (
    Reason.PARAMETER_AT_BOUND, Reason.TOO_SMALL, Reason.MINOR, Reason.BESIDE_LARGER, Reason.NOT_CONFIRMED,
    Reason.EXPLAINED_BY_RIVALS, Reason.LIKE_RIPPLE,
)  # fmt: skip


@dataclass(frozen=True)
class Evidence:
    """The numbers with which a candidate passed.

    Attributes
    ----------
    gain : float
        Fall of the sum of squares, in units of the noise.
    p_value, p_holm : float
        Of the F-test, the searched shapes paid for; and corrected for the number of candidates.
    size : float
        Contribution over the rms of the balance.
    explained : float
        Share of the residual's weighted sum of squares that it explains.
    cross_validation : CrossValidation
    """

    gain: float
    p_value: float
    p_holm: float
    size: float
    explained: float
    cross_validation: CrossValidation


@dataclass(frozen=True, eq=False)
class Step:
    """One accepted effect: its trial, its evidence, and the candidates that it cannot be told from."""

    trial: Trial
    evidence: Evidence
    equivalents: tuple[str, ...]


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
        """Return the largest contribution of the accepted effects to the balances in which a candidate acts; 0 of none.

        Parameters
        ----------
        trial : Trial
        """
        own = {row for row, _ in trial.group.entering}
        beside = (step for step in self.steps if own & {row for row, _ in step.trial.group.entering})
        return max((step.evidence.size for step in beside), default=0.0)

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
    minor_too = case.minor_too and not number
    if number == case.policy.most_steps:
        return Found(None, None, selection.refused)
    only = start[number] if number < len(start) else ""
    refused: dict[str, Refusal] = {}
    for trial, p_holm in zip(fit.trials, holm([t.p_value for t in fit.trials]), strict=True):
        name = name_of(trial)
        if name in refused or (only and trial.candidate.effect.id != only):
            continue
        judged = _judge_trial(fit, trial, p_holm, case.policy, selection.largest_beside(trial), minor_too)
        if isinstance(judged, Refusal):
            refused[name] = judged
            continue
        after = with_trial(case, fit, trial)
        # an effect that is still to come may be what brings a parameter back inside its bounds
        refusal = None if number + 1 < len(start) else _judge_refit(fit, after, trial, case.policy)
        refusal = refusal or _judge_holdout(case, fit, after)
        sure = minor_too or (case.surely and not number) or slight(fit, trial)
        if refusal is None and number + 1 >= len(start):
            refusal = unlike_in_half(case, fit, after, sure) or _judge_size(case, after)
            refusal = refusal or unlike_above(case, after)
        if refusal is None:
            alike = (*equivalents(trial, fit.trials, case.policy), *same_order(case, fit, trial))
            alike = (*alike, *nearly_in_model(fit, trial, case.policy))
            return Found(Step(trial, judged, tuple(dict.fromkeys(alike))), after, refused)
        refused[name] = refusal
        del after  # a fit of a long log is large: the next one takes its place
    return Found(None, None, refused)


def with_sampling_told(case: Case, selection: Selection) -> Selection:
    """Return the selection with sampling as the reason, before any other, why a significant delay within it is refused.

    A delay is judged where the torque changes faster than noise, and the sampling of the base model everywhere. What
    the one explains beside the other is then an error of the model around edges.

    Parameters
    ----------
    case : Case
    selection : Selection
        Complete: it takes a refit of everything to tell, and only the last refusals are shown.
    """
    fit, refused = selection.fit, dict(selection.refused)
    for trial in fit.trials:
        refusal = refused.get(name_of(trial))
        if trial.candidate.effect.structure.delays and refusal is not None and refusal.reason in BEFORE_REFIT:
            after = case.fit_beside(_with(case, fit, trial), fit)
            refused[name_of(trial)] = _judge_sampling(after, case.policy) or refusal
    return replace(selection, refused=refused)


def _judge_sampling(after: Fitted, policy: Policy) -> Refusal | None:
    """Return what speaks against a delay that was accepted last: that sampling can cause it."""
    effect, number = after.accepted[-1].effect, len(after.accepted) - 1
    position = after.position(number)
    if not effect.structure.delays or position is None:
        return None
    first = after.model.columns_of(position).start
    value, error = float(after.estimate.values[first]), float(after.plain.stderr[first])
    return criteria.beyond_sampling(value, error, (-after.record.early, after.record.sampling), policy)


def judged_trials(fit: Fitted, policy: Policy = POLICY) -> list[tuple[Trial, float, Refusal | None]]:
    """Return every candidate, its p-value corrected for their number, and what refuses it before a refit.

    Parameters
    ----------
    fit : Fitted
        With its trials.
    policy : Policy

    Returns
    -------
    list of (Trial, float, Refusal or None)
        The one that explains most first.
    """
    out = []
    for trial, p_holm in zip(fit.trials, holm([t.p_value for t in fit.trials]), strict=True):
        judged = _judge_trial(fit, trial, p_holm, policy)
        out.append((trial, p_holm, judged if isinstance(judged, Refusal) else None))
    return out


def significant(fit: Fitted, policy: Policy = POLICY) -> set[str]:
    """Return the names of the candidates that are significant, whatever else speaks against them.

    Parameters
    ----------
    fit : Fitted
        With its trials.
    policy : Policy
    """
    p_values = zip(fit.trials, holm([t.p_value for t in fit.trials]), strict=True)
    return {name_of(trial) for trial, p in p_values if criteria.significance(p, policy) is None}


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
    judged, minor_too = _judge_trial(before, trial, p_values[id(trial)], case.policy), False
    if isinstance(judged, Refusal) and judged.reason is Reason.MINOR and not before.accepted:
        minor_too, small = True, _judge_trial(before, trial, p_values[id(trial)], case.policy, minor_too=True)
        judged = judged if isinstance(small, Refusal) else small
    if isinstance(judged, Refusal):
        return judged
    refusal = _judge_refit(before, after, trial, case.policy) or _judge_holdout(case, before, after)
    refusal = refusal or unlike_in_half(case, before, after, minor_too or slight(before, trial))
    return refusal or _judge_size(case, after) or unlike_above(case, after)


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


def _judge_trial(
    fit: Fitted, trial: Trial, p_holm: float, policy: Policy, largest: float = 0.0, minor_too: bool = False
) -> Refusal | Evidence:
    """Return what a candidate's columns tell, the cheapest criterion first, beside effects of this size at most.

    One that is a minor part of the residual, or owes most to samples in which noise could be it, has to be confirmed as
    a later effect is; with a memory, twice as surely: edges that no sample caught are shaped by what it does as well.
    """
    refusal = criteria.signs(not trial.singular, not trial.wrong_sign) or criteria.significance(p_holm, policy)
    if refusal is not None:
        return refusal
    share = contribution(fit, trial)
    explained, excess = excess_of(fit.plain, trial, trial.plain_gain)
    memory = trial.candidate.effect.structure.has_memory
    if not memory:  # in coloured noise, or beside a rest at other frequencies, its share of everything says little
        band = in_band(fit, trial)
        told = band > policy.excess and not trial.by_weights
        excess = max(excess, band, excess_of(fit.solved, trial, trial.gain)[1] if told else 0.0)
    refusal = criteria.size(share, explained, excess, policy, minor_too)
    if refusal is not None and (larger := sized(fit, trial, policy.left_inside)) is not trial:
        share, (explained, excess) = contribution(fit, larger), excess_of(fit.plain, larger, larger.plain_gain)
        refusal, minor_too = criteria.size(share, explained, excess, policy), True
    if refusal is None and not has_own_order(fit, trial):
        refusal = criteria.beside_larger(share, largest, policy)
    if refusal is not None:
        return refusal
    minor_too = minor_too or in_doubt(fit, trial, policy.left_inside)
    found, whole, returned = cross_validated(fit, trial)
    first, surely = not (fit.accepted or minor_too), minor_too and memory
    refusal = criteria.cross_validation(found, whole, returned, first, policy, twice=surely)
    if refusal is None and (beside := beside_rivals(fit, trial)) is not None:
        refusal = criteria.beside_rivals(*beside, policy, surely)
    if refusal is None and [row for row, _ in trial.group.entering] == [0]:
        refusal = criteria.beside_ripple(judged_gain(fit, trial)[1], ripple_gain(fit, trial), policy)
    return refusal or Evidence(trial.gain, trial.p_value, p_holm, share, explained, found)


def _judge_size(case: Case, after: Fitted) -> Refusal | None:
    """Return the size of the last effect that its shape carries, and that the log does not determine."""
    return criteria.size_of_shape(sizes_in_shape(case.design, after), case.policy)


def _judge_refit(before: Fitted, after: Fitted, trial: Trial, policy: Policy) -> Refusal | None:
    """Return what speaks against an effect once everything was fitted again with it.

    The errors are those of two fits that differ by the effect alone; where it has a memory, as what lies between the
    logged drive signal and the torque has, other nuisances are its doing, and the fit before counts.
    """
    memory = trial.candidate.effect.structure.has_memory
    beside = before if memory else after.without_last() or before
    old, new = plain_errors(beside), plain_errors(after)
    noise = dict(zip(after.record.channels, after.weights.sigma.tolist(), strict=True))
    refusal = criteria.no_balance_worse(weighted_errors(beside), weighted_errors(after), noise, policy)
    returned = (
        winding_deviation(before.plain)
        - winding_deviation(after.plain)
        + record_deviation(before.plain)
        - record_deviation(after.plain)
    )
    explained = excess_of(before.plain, trial, trial.plain_gain)[0]
    if returned > policy.impossible and explained > policy.explained_torque:
        refusal = None  # a winding so far off its datasheet has served some balance better than the truth does
    elif refusal is None and trial.candidate.effect.enters == "voltage":
        voltages = [name for name in new if name != "torque"]
        refusal = criteria.no_voltage_worse({n: old[n] for n in voltages}, {n: new[n] for n in voltages}, policy)
    elif refusal is None and [row for row, _ in trial.group.entering] == [0]:
        # what shows in a voltage as well may change the torque's error by chance: its balances were judged together
        was, now = (sound_error(fit, policy.sound_weight) for fit in (beside, after))
        refusal = criteria.no_plain_error_worse(was, now, policy=policy)
        reported = before.held_alike(after)  # edges included
        was, now = (plain_errors(fit)["torque"] for fit in (reported, after))
        typical = typical_error(after) / max(typical_error(reported), 1e-300)
        refusal = refusal or criteria.no_plain_error_worse(was, now, typical, policy)
    old, new = (
        plain | {f"{name}, weighted": rms for name, rms in weighted_errors(fit).items()}
        for fit, plain in ((beside, old), (after, new))
    )
    if not (trial.by_weights or memory):
        old["all, prewhitened"], new["all, prewhitened"] = (prewhitened_error(before, fit) for fit in (beside, after))
    return (
        refusal or criteria.error_lowered(old, new, returned, policy) or _judge_parameters(before, after, trial, policy)
    )


def _judge_together(before: Fitted, after: Fitted, policy: Policy) -> Refusal | None:
    """Return a parameter by which log and design do not belong together with an effect, though they do without it."""
    found = contradicting(after, policy)
    return criteria.no_contradiction(contradicting(before, policy), found) if found else None


def _judge_parameters(before: Fitted, after: Fitted, trial: Trial, policy: Policy) -> Refusal | None:
    """Return which parameter of the refitted model speaks against an effect.

    The effects that were accepted have to keep their own bounds, the base parameters inside theirs. A base parameter
    beyond its bounds does so only where the effect explains nothing that is possible.
    """
    model = after.model
    columns = range(len(model.names))
    base = [k for k in columns if model.group_of(k).effect is None or model.group_of(k).entry >= 0]
    inside = bounded(after.plain, base)
    stderr = after.plain.stderr.tolist()

    def outside(solved: Solved, which: Iterable[int]) -> Refusal | None:
        bounds = dict(zip(model.names, column_bounds(model, solved.values), strict=True))
        values = {model.names[k]: (float(solved.values[k]), stderr[k]) for k in which}
        return criteria.inside_bounds(values, bounds, policy)

    refusal = outside(inside, [k for k in columns if k not in base])
    was, now = (machine_of(after.record.design, fit, policy.tolerance) for fit in (before, after))
    refusal = refusal or criteria.inside_tolerance(was, now, policy) or _judge_together(before, after, policy)
    if refusal is not None:
        return refusal
    last = after.accepted[-1]
    own = columns[-len(trial.values) :] if after.position(len(after.accepted) - 1) is not None else ()
    amplitudes = {model.names[k]: (float(inside.values[k]), stderr[k]) for k in own}
    refusal = criteria.determined(amplitudes, _ran_out(last), policy) or _judge_sampling(after, policy)
    beyond = outside(after.plain, base)
    if refusal is not None or beyond is None:
        return refusal
    share, k = left_inside(before, after), len(trial.values)
    p = f_tail(trial.gain * share / k, k, max(after.solved.rows - after.solved.rank, 1))
    return criteria.left_inside(share, p * trial.candidate.searched * len(before.trials), beyond, policy)


def _ran_out(one: Accepted) -> bool:
    """Whether the shape wants to be outside of what is searched: shorter than a log can tell, or at a bound."""
    shortest = any(
        p.within_grid and len(one.grid) > 1 and one.shape[p.symbol] <= min(shape[p.symbol] for shape in one.grid)
        for p in one.effect.searched
    )
    return shortest or one.effect.structure.at_bound(one.effect, one.shape)


def _judge_holdout(case: Case, before: Fitted, after: Fitted) -> Refusal | None:
    if not case.holdouts:
        return None
    old, new = ({name: rms for name, (rms, _) in case.holdout_errors(fit).items()} for fit in (before, after))
    return criteria.holdout(old, new, case.policy)


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

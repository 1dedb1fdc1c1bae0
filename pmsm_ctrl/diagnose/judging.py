"""What the criteria say of a candidate: from its columns alone, and once everything was fitted again with it."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from pmsm_ctrl.diagnose import criteria
from pmsm_ctrl.diagnose.case import Case
from pmsm_ctrl.diagnose.contradictions import contradicting
from pmsm_ctrl.diagnose.criteria import CrossValidation
from pmsm_ctrl.diagnose.fit import Accepted, Fitted
from pmsm_ctrl.diagnose.held_reference import shows_in_inertia
from pmsm_ctrl.diagnose.measures import (
    beside_rivals,
    contribution,
    cross_validated,
    excess_of,
    has_own_order,
    in_band,
    in_doubt,
    left_inside,
    machine_of,
    plain_errors,
    prewhitened_error,
    record_deviation,
    sized,
    sound_error,
    typical_error,
    weighted_errors,
    winding_deviation,
)
from pmsm_ctrl.diagnose.policy import Policy
from pmsm_ctrl.diagnose.refusal import Reason, Refusal
from pmsm_ctrl.diagnose.search import Trial
from pmsm_ctrl.diagnose.shapes import sizes_in_shape
from pmsm_ctrl.diagnose.where_seen import where_seen
from pmsm_ctrl.evidence.tests import f_tail
from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.regression.base_fit import reads_torque
from pmsm_ctrl.regression.bounds import bounded, column_bounds
from pmsm_ctrl.regression.drive_timing import LATENESS, SPREAD, SURE, filter_behind
from pmsm_ctrl.regression.lateness import lateness
from pmsm_ctrl.regression.model import MOST_NOISE, Solved, noise_share

__all__ = [
    "Evidence", "judge_holdout", "judge_refit", "judge_sampling", "judge_size", "judge_trial", "own_sampling",
]  # fmt: skip


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
    barely : bool
        Whether cross-validation alone does not confirm it, so that it has to be surely the same in half the band.
    """

    gain: float
    p_value: float
    p_holm: float
    size: float
    explained: float
    cross_validation: CrossValidation
    barely: bool = False


def judge_trial(
    fit: Fitted, trial: Trial, p_holm: float, policy: Policy, largest: float = 0.0, minor_too: bool = False,
    barely_too: bool = False,
) -> Refusal | Evidence:  # fmt: skip
    """Return what a candidate's columns tell, the cheapest criterion first.

    One that is a minor part of the residual, or owes most to samples in which noise could be it, has to be confirmed as
    a later effect is; with a memory, twice as surely: edges that no sample caught are shaped by what it does as well.

    Parameters
    ----------
    fit : Fitted
    trial : Trial
        One of its trials.
    p_holm : float
        Its p-value, corrected for all candidates.
    policy : Policy
    largest : float
        Contribution of the largest accepted effect of the same balance.
    minor_too : bool
        Whether it may be a minor part of the residual.
    barely_too : bool
        Whether cross-validation may confirm a first effect barely that is a wave, or most of the whole residual; a
        delay has no size to compare in half the band.

    Returns
    -------
    Refusal or Evidence
    """
    refusal = criteria.signs(not trial.singular, trial.outside) or criteria.significance(p_holm, policy)
    if refusal is not None:
        return refusal
    minor_too = minor_too and not trial.candidate.effect.structure.never_minor(trial.group.shape)
    share = contribution(fit, trial)
    explained, excess = excess_of(fit.plain, trial, trial.plain_gain)
    most = excess >= policy.above_floor or has_own_order(fit, trial)
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
    # what is in no catalogue resembles others in part
    barely = refusal is not None and first and barely_too and most and not trial.candidate.effect.structure.delays
    if barely:
        refusal = criteria.barely_confirmed(found, policy)
    if refusal is None and "theta" in trial.candidate.effect.signals and not fit.record.records:
        refusal = criteria.along_the_way(cross_validated(fit, trial, position=True)[0], found, policy)
    if refusal is None and (beside := beside_rivals(fit, trial)) is not None:
        surely = surely or any(one.effect.structure.replaces_direction for one in fit.accepted)
        refusal = criteria.beside_rivals(*beside, policy, surely, not trial.candidate.effect.structure.unlike_rivals)
    return refusal or Evidence(trial.gain, trial.p_value, p_holm, share, explained, found, barely)


def judge_size(case: Case, after: Fitted) -> Refusal | None:
    """Return the size of the last effect that its shape carries, and that the log does not determine.

    Parameters
    ----------
    case : Case
    after : Fitted
    """
    return criteria.size_of_shape(sizes_in_shape(case.design, after), case.policy)


def judge_refit(before: Fitted, after: Fitted, trial: Trial, policy: Policy) -> Refusal | None:
    """Return what speaks against an effect once everything was fitted again with it.

    The errors are those of two fits that differ by the effect alone; where it has a memory, as what lies between the
    logged drive signal and the torque has, other nuisances are its doing, and the fit before counts.

    Parameters
    ----------
    before, after : Fitted
        Without and with it.
    trial : Trial
    policy : Policy
    """
    memory = trial.candidate.effect.structure.has_memory
    if before.record.in_step and reads_torque(trial.candidate.effect) and shows_in_inertia(before, policy):
        return Refusal(Reason.IN_STEP, {"what": "the inertia is"})
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
        if returned > policy.returned and shows_in_inertia(before, policy):
            return Refusal(Reason.IN_STEP, {"what": "the winding without it and the inertia are"})
        refusal = criteria.no_voltage_worse({n: old[n] for n in voltages}, {n: new[n] for n in voltages}, noise, policy)
    elif refusal is None and [row for row, _ in trial.group.entering] == [0]:
        # what shows in a voltage as well may change the torque's error by chance: its balances were judged together
        was, now = (sound_error(fit, policy.sound_weight) for fit in (beside, after))
        refusal = criteria.no_plain_error_worse(was, now, policy=policy)
        reported = before.held_alike(after)  # edges included
        was, now = (plain_errors(fit)["torque"] for fit in (reported, after))
        typical = typical_error(after) / max(typical_error(reported), 1e-300)
        if trial.candidate.effect.structure.never_minor(after.accepted[-1].shape):
            typical = 1.0  # it acts at the very edges, and has to lower their error
        refusal = refusal or criteria.no_plain_error_worse(was, now, typical, policy)
    old, new = (
        plain | {f"{name}, weighted": rms for name, rms in weighted_errors(fit).items()}
        for fit, plain in ((beside, old), (after, new))
    )
    if not (trial.by_weights or memory):
        old["all, prewhitened"], new["all, prewhitened"] = (prewhitened_error(before, fit) for fit in (beside, after))
    refusal = refusal or criteria.error_lowered(old, new, returned, policy)
    return refusal or where_seen(beside, after, policy) or _judge_parameters(before, after, trial, policy)


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
    tried = max(trial.candidate.searched, 1) * len(before.trials)
    refusal = criteria.determined(amplitudes, tried, _ran_out(last, after.record), policy)
    refusal = refusal or judge_sampling(after, policy) or _judge_noise(after)
    beyond = outside(after.plain, base)
    if refusal is not None or beyond is None:
        return refusal
    share, k = left_inside(before, after), len(trial.values)
    p = f_tail(trial.gain * share / k, k, max(after.solved.rows - after.solved.rank, 1))
    return criteria.left_inside(share, p * tried, beyond, policy)


def _ran_out(one: Accepted, record: Record) -> bool:
    """Whether the shape wants to be outside of what is searched: shorter than a log can tell, or at a bound.

    A wave that wants to be longer than the longest is a constant and a slope, and a friction that bends above the
    highest speed is a slope.
    """
    bends = one.effect.bends_over
    if bends and one.shape[bends] > float(np.max(np.abs(record.at_grid(record.signals["omega"])[record.mask]))):
        return True
    shortest = any(
        p.within_grid and len(one.grid) > 1 and one.shape[p.symbol] <= min(shape[p.symbol] for shape in one.grid)
        for p in one.effect.searched
    )
    known = (
        one.effect.period if any(p.symbol == one.effect.period and p.within_grid for p in one.effect.searched) else ""
    )
    longest = known and one.shape[known] >= max(shape[known] for shape in one.grid)
    return bool(shortest or longest) or one.effect.structure.at_bound(one.effect, one.shape)


def judge_holdout(case: Case, before: Fitted, after: Fitted) -> Refusal | None:
    """Return that the held-out record, where there is one, is predicted worse with the last effect.

    Parameters
    ----------
    case : Case
    before, after : Fitted
        Without and with it.
    """
    if not case.holdouts:
        return None
    old, new = ({name: rms for name, (rms, _) in case.holdout_errors(fit).items()} for fit in (before, after))
    return criteria.holdout(old, new, case.policy)


def own_sampling(fit: Fitted, policy: Policy) -> Refusal | None:
    """Return that the delay of the base model's own sampling is within what sampling can cause; None without one.

    Parameters
    ----------
    fit : Fitted
    policy : Policy
    """
    if LATENESS not in fit.model.names:
        return None
    k = fit.model.names.index(LATENESS)
    late = fit.record.timing.late + lateness(fit.model, fit.plain.values)
    return criteria.beyond_sampling(late, float(fit.plain.stderr[k]), (-fit.record.early, fit.record.sampling), policy)


def judge_sampling(after: Fitted, policy: Policy) -> Refusal | None:
    """Return what speaks against a delay that was accepted last: that sampling, or a filter, can cause it.

    Parameters
    ----------
    after : Fitted
    policy : Policy
    """
    effect, number = after.accepted[-1].effect, len(after.accepted) - 1
    position = after.position(number)
    if not effect.structure.delays or position is None:
        return None
    first = after.model.columns_of(position).start
    value, error = float(after.estimate.values[first]), float(after.plain.stderr[first])
    refusal = criteria.beyond_sampling(value, error, (-after.record.early, after.record.sampling), policy)
    if refusal is not None or after.record.sampling_stated or SPREAD not in after.model.names:
        return refusal
    k = after.model.names.index(SPREAD)
    spread = float(after.plain.values[k]), float(after.plain.stderr[k])
    filtered = filter_behind(value, spread, after.record.sampling) is not None
    return Refusal(Reason.LIKE_FILTER, {"value": 1e3 * value}) if filtered else None


def _judge_noise(after: Fitted) -> Refusal | None:
    """Return that what a spring explains is noise of the acceleration.

    Least squares make the inertia small where the acceleration is noise. Where the inertia is held, a spread of the
    drive signal does so at high frequencies, and a load on a spring undoes it where the motion is.
    """
    model, record, last = after.model, after.record, after.accepted[-1]
    if last.effect.structure.resonance(last.shape) is None or SPREAD not in model.names:
        return None
    if noise_share(record, record.acceleration(), record.shaft_noise()) < MOST_NOISE:
        return None
    k = model.names.index(SPREAD)
    spread, stderr = float(after.plain.values[k]), float(after.plain.stderr[k])
    if spread < SURE * (float(model.sigma[k]) + stderr):
        return None
    return Refusal(Reason.LIKE_NOISE, {"spread": 1e3 * math.sqrt(2.0 * spread)})

"""The effects that a log cannot tell from an accepted one."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.diagnose.candidates import Candidate
from pmsm_ctrl.diagnose.case import Case
from pmsm_ctrl.diagnose.fit import Fitted
from pmsm_ctrl.diagnose.policy import POLICY, Policy
from pmsm_ctrl.diagnose.search import Trial, direction_of, try_group
from pmsm_ctrl.effects.base import Effect
from pmsm_ctrl.regression.columns import effect_group
from pmsm_ctrl.regression.two_stage import beside_held

__all__ = ["equivalents", "nearly_in_model", "same_order"]

Array = NDArray[np.float64]

# The least share of a column that the model has not for it to be compared: a tenth of what it takes to be tried.
BARELY = 1e-3
SAME_PERIOD = 0.01  # share by which the period of a wave may differ from that of the poles


def equivalents(trial: Trial, trials: Iterable[Trial], policy: Policy = POLICY) -> tuple[str, ...]:
    """Return the effects whose best explanation of the same rows is nearly the same, or as good and mostly the same.

    As good by the estimate's weights or prewhitened: what lies between the two is the model's own error. A rival may be
    as good with a shape at its bound, or with columns that one of the two weightings takes for the model's.

    Parameters
    ----------
    trial : Trial
        The accepted one.
    trials : iterable of Trial
        All of the round.
    policy : Policy
    """
    effect = trial.candidate.effect
    ours, plain = trial.direction, trial.plain_direction
    found, singular = [], []
    for other in trials:
        rival = other.candidate.effect.id
        if other.singular and not other.candidate.free(other.group.shape):
            singular.append(rival)
            continue
        if other is trial or other.wrong_sign or rival == effect.id:
            continue
        if _alike(ours, other.direction, policy) or _alike(plain, other.plain_direction, policy):
            found.append(rival)
    return (*found, *(one for one in effect.look_alikes if one in singular and one not in found))


def _alike(ours: Array, theirs: Array, policy: Policy, scatter: float = 1.0) -> bool:
    """Whether what another effect explains is nearly the same, or as much and mostly the same.

    Where ours explains no more than two that are the same may differ by, any other would be as good.
    """
    size, gain = float(ours @ ours), float(theirs @ theirs)
    left = size - float(ours @ theirs) ** 2 / max(gain, 1e-300)
    tie = policy.tie(size, scatter)
    if size <= tie:
        return False
    return left < tie or (gain > size - tie and left < policy.excess * size)


def nearly_in_model(fit: Fitted, trial: Trial, policy: Policy = POLICY) -> tuple[str, ...]:
    """Return the look-alikes of an accepted effect that the model nearly has, and that explain as much all the same.

    Where a motion has one speed, any friction that depends on the speed is nearly the dry and the viscous one. One of
    these curves leaves a little more than the others and is tried; the rest of all of them is the same.

    Parameters
    ----------
    fit : Fitted
        In which the effect was tried.
    trial : Trial
        The accepted one.
    policy : Policy
    """
    known, found = trial.candidate.effect.look_alikes, []
    for other in fit.trials:
        one = other.candidate
        if not (other.singular and one.effect.id in known and one.free(other.group.shape)):
            continue  # one that is not free `equivalents` has
        solved, whitener = trial.judge
        groups = (effect_group(fit.record, one.effect, shape) for shape in one.grid)
        theirs = (direction_of(solved, whitener, beside_held(group, fit.model.responses), BARELY) for group in groups)
        scatter = max(1.0, float(np.mean(solved.rest[: solved.rows] ** 2)))
        if _alike(trial.direction, max(theirs, key=lambda part: float(part @ part)), policy, scatter):
            found.append(one.effect.id)
    return tuple(found)


def same_order(case: Case, fit: Fitted, trial: Trial) -> tuple[str, ...]:
    """Return the look-alikes of an accepted effect that are the same at its order in a turn, not at their own best one.

    Where the pole pairs are not known, any order may be the electrical one. A look-alike that cannot be tried, for want
    of a channel, or that explains nearly as much, is the same where the order is its own.

    Parameters
    ----------
    case : Case
    fit : Fitted
        In which the effect was tried.
    trial : Trial
        The accepted one.
    """
    effect, found = trial.candidate.effect, []
    for rival in (case.effects[name] for name in effect.look_alikes if name in case.effects):
        p = case.design.motor.p
        if (effect.order or effect.period) and rival.electrical_order:
            order = _electrical_order(effect, trial.group.shape, p)
            its_own = order is not None and abs(order / rival.electrical_order - 1.0) < SAME_PERIOD
            if p is None or (its_own and _as_much(fit, trial, rival, case.policy)):
                found.append(rival.id)
        elif not rival.falsifies_current and (shape := _at_order(case, effect, rival)):
            group = beside_held(effect_group(fit.record, rival, shape), fit.model.responses)
            other = try_group(*trial.judge, Candidate(rival, (shape,)), group)
            found += equivalents(trial, [replace(other, plain_judge=trial.plain_judge)], case.policy)
    return tuple(found)


def _as_much(fit: Fitted, trial: Trial, rival: Effect, policy: Policy) -> bool:
    """Whether a wave of the same order explains nearly as much, or cannot be tried for want of a channel.

    The torque of the two is the same up to what the model has of the current: a tenth is its error.
    """
    tried = [one.gain for one in fit.trials if one.candidate.effect.id == rival.id]
    untried = any(one.effect.id == rival.id for one in fit.closed)
    return untried or any(gain > (1.0 - policy.refused_share) * trial.gain for gain in tried)


def _electrical_order(effect: Effect, shape: Mapping[str, float], p: float | None) -> float | None:
    """Return how often a wave repeats in an electrical turn; None where that is not known."""
    if effect.period:
        return None if p is None else 2.0 * math.pi / (p * shape[effect.period])
    turn = 1.0 if "p" in effect.signals else p  # of the electrical angle, or of the shaft
    return None if turn is None else shape[effect.order] / turn


def _at_order(case: Case, effect: Effect, rival: Effect) -> dict[str, float]:
    """Return the shape at which a wave has the electrical order of an effect; empty where it has none."""
    p = case.design.motor.p
    if not effect.electrical_order or p is None:
        return {}
    linear = case.record.linear
    if linear and rival.period:
        return {rival.period: 2.0 * math.pi / (p * effect.electrical_order)}
    if not rival.order or (linear and "p" not in rival.signals):
        return {}
    return {rival.order: float((1 if "p" in rival.signals else p) * effect.electrical_order)}

"""Replacing accepted effects: an effect that was accepted early may only imitate two others together.

Where effects are accepted one at a time, the most flexible one comes first. Friction that falls with speed and with
time looks like a Stribeck curve with a wide bend, until one of the two is in the model. So each accepted effect is
removed again. Where another one then explains more, or as much with fewer parameters, the selection is repeated with
that one in its place. A transmission is tried with and without a gap. Where a single effect was accepted, those that
explained nearly as much are fitted in its place: a full refit says more than the columns beside the base model.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from pmsm_ctrl.diagnose.case import Case
from pmsm_ctrl.diagnose.fit import Accepted
from pmsm_ctrl.diagnose.measures import squares
from pmsm_ctrl.diagnose.policy import POLICY, Policy
from pmsm_ctrl.diagnose.refusal import Reason
from pmsm_ctrl.diagnose.search import Trial
from pmsm_ctrl.diagnose.selection import Selection, name_of

__all__ = ["Rest", "better", "equals", "rival_ids", "swap"]


@dataclass(frozen=True)
class Rest:
    """Residual of a selection with Schwarz's penalty for its parameters, in units of the noise.

    Attributes
    ----------
    plain, white : float
        Sum of squares of the residual as the estimate weighs it, and prewhitened as the design's own residual is.
    gain : float
        Fall of the plain sum of squares from the design, without the price.
    effects : Counter of id
    unconfirmed : set of id
        Effects that cross-validation alone refused beside these.
    scatter : float
        Mean square of what is left, in units of the noise, and at least 1: beside an error of the model, chance makes
        differences as many times as large as beside noise alone.
    """

    plain: float
    white: float
    gain: float
    effects: Counter[str]
    unconfirmed: frozenset[str] = frozenset()
    scatter: float = 1.0


def swap(case: Case, found: Selection, select: Callable[[Case, tuple[str, ...]], Selection]) -> Selection:
    """Return the selection with the effects replaced that another one explains better, and ties declared equivalent.

    Parameters
    ----------
    case : Case
    found : Selection
    select : function
        Repeats the forward selection, beginning with these effects.
    """
    chosen, rest = found, _rest(found)
    tried: dict[tuple[str, ...], tuple[Selection, Rest]] = {}
    for start in _starts(case, found):
        if start in tried:
            continue
        other = select(case, start)
        tried[start] = other, _rest(other)
        if other.accepted and better(tried[start][1], rest, case.policy):
            chosen, rest = tried[start]
    return _with_equals(chosen, rest, [_rest(found), *(left for _, left in tried.values())], case.policy)


def better(other: Rest, present: Rest, policy: Policy = POLICY) -> bool:
    """Whether a selection leaves less; where that is a tie, whether it leaves less of what prewhitening brings out.

    One that has all effects of the other and more must leave less, and those were refused beside the other because they
    were not confirmed: what is no effect beside the right one is none because it came first. One that has fewer of them
    may leave as much, what its parameters cost allowed for.

    Parameters
    ----------
    other, present : Rest
    policy : Policy
    """
    less = present.plain - other.plain
    tie = policy.tie(max(other.gain, present.gain), min(other.scatter, present.scatter))
    if present.effects < other.effects:
        return less > tie and present.unconfirmed.issuperset(other.effects - present.effects)
    fewer = policy.tied_gain if other.effects < present.effects and less > 0.0 else 0.0
    return less > 0.0 if abs(less) > tie else other.white < present.white + fewer


def rival_ids(found: Rest, other: Rest, policy: Policy = POLICY) -> tuple[str, str] | None:
    """Return the one effect that differs and what stands in its place, where both explain the log equally well.

    Parameters
    ----------
    found, other : Rest
    policy : Policy
    """
    ours, theirs = (list(a.elements()) for a in (found.effects - other.effects, other.effects - found.effects))
    tie = policy.tie(found.gain, min(found.scatter, other.scatter))
    if len(ours) != 1 or len(theirs) != 1 or other.plain > found.plain + tie or other.white > found.white + tie:
        return None
    return ours[0], theirs[0]


def _with_equals(found: Selection, rest: Rest, others: list[Rest], policy: Policy) -> Selection:
    steps = list(found.steps)
    for pair in filter(None, (rival_ids(rest, other, policy) for other in others)):
        for k, step in enumerate(steps):
            if step.trial.candidate.effect.id == pair[0] and pair[1] not in step.equivalents:
                steps[k] = replace(step, equivalents=(*step.equivalents, pair[1]))
    return replace(found, steps=tuple(steps))


def _starts(case: Case, found: Selection) -> Iterator[tuple[str, ...]]:
    """Ids of the effects to begin with instead of those of the selection, the strongest first."""
    present = {one.effect.id for one in found.accepted}
    blocked = [name for name, why in found.refused.items() if why.reason is Reason.MODEL_OUT_OF_BOUNDS]
    waiting = [
        Accepted(trial.candidate.effect, trial.group.shape, trial.candidate.grid)
        for trial in found.fit.trials
        if trial.candidate.effect.id in blocked and not trial.wrong_sign
    ]
    if len(found.accepted) == 1:
        yield from _rivals(found, case.policy)
    else:
        yield from equals(case, found)
    alone = {trial.candidate.effect.id: trial.plain_gain for trial in found.fits[0].trials}
    for k, one in enumerate(found.accepted):
        if one.effect.structure.splits_inertia:
            for rival in case.effects.values():
                if rival.structure.splits_inertia and rival.id != one.effect.id:
                    yield tuple(rival.id if j == k else a.effect.id for j, a in enumerate(found.accepted[: k + 1]))
            continue
        if one.effect.repeated or len(found.accepted) + len(waiting) < 2:
            continue
        others = (*found.accepted[:k], *found.accepted[k + 1 :], *waiting)
        first = case.first_beside(others)
        instead = first.candidate.effect.id if first is not None and not first.wrong_sign else one.effect.id
        if instead in present or case.effects[instead].repeated:
            continue
        ids = [other.effect.id for other in others] + [instead]
        yield tuple(sorted(ids, key=lambda name: -alone.get(name, 0.0)))


def equals(case: Case, found: Selection) -> Iterator[tuple[str, ...]]:
    """Ids of the effects up to an accepted one, with an equivalent in its place: alone it may do for two.

    A drag with the exponent 1.7 is nearly a quadratic one, and a Stribeck curve takes the small rest.

    Parameters
    ----------
    case : Case
    found : Selection
    """
    ids = tuple(step.trial.candidate.effect.id for step in found.steps)
    for k, step in enumerate(found.steps):
        for rival in step.equivalents:
            if rival in case.effects and rival not in ids and not case.effects[rival].repeated:
                yield (*ids[:k], rival)


def _rivals(found: Selection, policy: Policy) -> Iterator[tuple[str, ...]]:
    """Ids of effects that might have been accepted in the place of a single one."""
    first = found.steps[0].trial
    close = [t for t in found.fits[0].trials if not (t.wrong_sign or t.singular or t.at_bound)]
    close = [t for t in close if not t.candidate.effect.repeated and _share(t, first) > policy.rival_share]
    for trial in sorted(close, key=lambda t: -_share(t, first))[: policy.most_rivals + 1]:
        if trial.candidate.effect.id != first.candidate.effect.id:
            yield (trial.candidate.effect.id,)


def _share(trial: Trial, first: Trial) -> float:
    """What a trial explains of what the first one does, whichever way it explains more."""
    return max(trial.plain_gain / max(first.plain_gain, 1e-300), trial.gain / max(first.gain, 1e-300))


def _rest(found: Selection) -> Rest:
    first, last = found.fits[0], found.fit
    columns = len(last.model.names) - len(first.model.names) + sum(len(one.shape) for one in found.accepted)
    price = columns * float(np.log(max(int(last.record.mask.sum()), 2)))
    white = first.whitener(last.record.target - last.solved.predicted())
    sizes = first.weights.sigma
    before, after = squares(first, first.residual, sizes), squares(last, last.residual, sizes)
    effects = Counter(one.effect.id for one in found.accepted)
    unconfirmed = [t.candidate.effect.id for t in last.trials if _unconfirmed(found, name_of(t))]
    scatter = max(1.0, after / max(int(last.record.mask.sum()) * len(sizes), 1))
    return Rest(after + price, float(white @ white) + price, before - after, effects, frozenset(unconfirmed), scatter)


def _unconfirmed(found: Selection, name: str) -> bool:
    return name in found.refused and found.refused[name].reason is Reason.NOT_CONFIRMED

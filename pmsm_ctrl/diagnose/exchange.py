"""Second thoughts: an effect taken early may only have stood in for two that belong together.

Taken one at a time, the most flexible effect comes first: a friction that falls with speed and with time at once looks
like a Stribeck curve with a wide bend, until one of the two is in. So each accepted effect is taken out again, and
where another one now explains more, or as much with less freedom, the selection is repeated with that one in its place.
A transmission is tried with and without a gap. And where one effect was taken alone, those that explained nearly as
much are fitted as well: columns tell less than everything refitted.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace

import numpy as np

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose.candidates import REPEATED
from pmsm_ctrl.diagnose.fit import Accepted, Fitted, fit_design
from pmsm_ctrl.diagnose.gates import BEYOND, TELLING
from pmsm_ctrl.diagnose.search import Trial
from pmsm_ctrl.diagnose.selection import Selection, fitted_before, select, tied
from pmsm_ctrl.effects.base import Effect
from pmsm_ctrl.regression.balances import Record

__all__ = ["select_with_exchange"]

# Share of the gain of the effect that was taken from which on another one is fitted as well, and how many more are.
CLOSE, MOST_RIVALS = 0.6, 3


def select_with_exchange(
    design: Design, record: Record, effects: Mapping[str, Effect], holdout: Record | None,
    progress: Callable[[float], None] | None,
) -> Selection:  # fmt: skip
    """Select effects one at a time, then exchange those that another one can replace."""
    found = best = select(design, record, effects, holdout, progress)
    tried: set[tuple[str, ...]] = set()
    every = [found]
    for order in _orders(design, record, every, effects):
        if order in tried:
            continue
        tried.add(order)
        # the bar does not run twice
        other = select(design, record, effects, holdout, None, order, _fits(every))
        every.append(other)
        if other.accepted and _better(other, best):
            best = other
    return _with_equals(best, every)


def _fits(every: Iterable[Selection]) -> Iterator[Fitted]:
    return (fit for selection in every for fit in selection.fits)


def _better(other: Selection, best: Selection) -> bool:
    """Whether a selection leaves less; where that is a tie, whether it leaves less of what prewhitening brings out.

    One that has all that the other one has, and more that did not hold when it came last, has to leave much less.
    """
    first = best.fits[0]
    less = _left(best) - _left(other)
    tie = tied(_squares(first, first) - min(_squares(f.fits[-1], first) for f in (other, best)))
    present, theirs = (Counter(one.effect.id for one in found.accepted) for found in (best, other))
    if present < theirs:
        return less > max(tie, TELLING * _left(best))
    return less > 0.0 if abs(less) > tie else _whitened(other) < _whitened(best)


def _with_equals(best: Selection, others: list[Selection]) -> Selection:
    """Declare equivalent what explains the log as well in the place of an effect, everything refitted."""
    steps = list(best.steps)
    present = Counter(one.effect.id for one in best.accepted)
    left, whitened, first = _left(best), _whitened(best), best.fits[0]
    gain = _squares(first, first) - _squares(best.fits[-1], first)
    for other in others:
        theirs = Counter(one.effect.id for one in other.accepted)
        ours, rivals = list((present - theirs).elements()), list((theirs - present).elements())
        if len(ours) != 1 or len(rivals) != 1:
            continue
        if _left(other) > left + tied(gain) or _whitened(other) > whitened + tied(gain):
            continue
        steps = [
            replace(step, equivalents=(*step.equivalents, *rivals))
            if step.trial.candidate.effect.id == ours[0] and rivals[0] not in step.equivalents
            else step
            for step in steps
        ]
    return replace(best, steps=tuple(steps))


def _orders(
    design: Design, record: Record, every: list[Selection], effects: Mapping[str, Effect]
) -> Iterator[tuple[str, ...]]:
    """Ids of the effects to begin with instead of those of the first selection, the strongest first."""
    found = every[0]
    present = {one.effect.id for one in found.accepted}
    blocked = [name for name, why in found.refused.items() if why.endswith(BEYOND) and name in effects]
    waiting = [
        Accepted(trial.candidate.effect, trial.group.shape, trial.candidate.grid)
        for trial in found.fits[-1].trials
        if trial.candidate.effect.id in blocked and not trial.wrong_sign
    ]
    if len(found.accepted) == 1:
        yield from _rivals(found)
    alone = {trial.candidate.effect.id: trial.plain_gain for trial in found.fits[0].trials}
    for k, one in enumerate(found.accepted):
        if one.effect.structure == "transmission":
            for rival in effects.values():
                if rival.structure == "transmission" and rival.id != one.effect.id:
                    yield tuple(rival.id if j == k else a.effect.id for j, a in enumerate(found.accepted[: k + 1]))
            continue
        if one.effect.id in REPEATED or len(found.accepted) + len(waiting) < 2:
            continue
        others = (*found.accepted[:k], *found.accepted[k + 1 :], *waiting)
        trials = (fitted_before(_fits(every), others) or fit_design(design, record, others, effects)).trials
        better = trials[0].candidate.effect.id if trials and not trials[0].wrong_sign else one.effect.id
        if better in present or better in REPEATED:
            continue
        ids = [other.effect.id for other in others] + [better]
        yield tuple(sorted(ids, key=lambda name: -alone.get(name, 0.0)))


def _rivals(found: Selection) -> Iterator[tuple[str, ...]]:
    """Ids of effects that might have been taken in the place of a single one."""
    first = found.steps[0].trial
    close = [t for t in found.fits[0].trials if not (t.wrong_sign or t.singular or t.at_bound)]
    close = [t for t in close if t.candidate.effect.id not in REPEATED and _share(t, first) > CLOSE]
    for trial in sorted(close, key=lambda t: -_share(t, first))[: MOST_RIVALS + 1]:
        if trial.candidate.effect.id != first.candidate.effect.id:
            yield (trial.candidate.effect.id,)


def _share(trial: Trial, first: Trial) -> float:
    """What a trial explains of what the first one does, whichever way it explains more."""
    return max(trial.plain_gain / max(first.plain_gain, 1e-300), trial.gain / max(first.gain, 1e-300))


def _left(found: Selection) -> float:
    """Sum of squares that is left, in units of the noise, with what each column costs (Schwarz)."""
    return _squares(found.fits[-1], found.fits[0]) + _price(found)


def _whitened(found: Selection) -> float:
    """The same, prewhitened as the design's own residual is."""
    last, first = found.fits[-1], found.fits[0]
    rest = first.whitener(last.record.target - last.solved.predicted())
    return float(rest @ rest) + _price(found)


def _price(found: Selection) -> float:
    last, first = found.fits[-1], found.fits[0]
    shapes = sum(len(one.shape) for one in found.accepted)
    columns = len(last.model.names) - len(first.model.names) + shapes
    return columns * float(np.log(max(int(last.record.mask.sum()), 2)))


def _squares(fit: Fitted, first: Fitted) -> float:
    sizes = np.array(first.weights.sigma)[:, None]
    return float(np.sum(((fit.residual * fit.record.weight * fit.record.mask) / sizes) ** 2))

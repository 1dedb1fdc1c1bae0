"""Refining a candidate's nonlinear parameters around the best point of its grid."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from pmsm_ctrl.diagnose.search import Trial, try_group
from pmsm_ctrl.evidence.whitening import Whitener
from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.regression.columns import SINGLE, Group, UnavailableError, effect_group, forget_effects
from pmsm_ctrl.regression.model import Solved
from pmsm_ctrl.regression.two_stage import beside_held

__all__ = ["refine"]

MOVES = 4  # of the search for each halving of its steps, at most
BETTER = 1e-9  # share by which a gain must grow to be more than rounding


def refine(
    record: Record,
    solved: Solved,
    whitener: Whitener,
    trial: Trial,
    seen: Callable[[Record, Group], Group] | None = None,
) -> Trial:
    """Return the trial with its nonlinear parameters improved by a pattern search in their logarithm.

    `seen` returns what of a group's columns is to be used; all of it when left out. The steps begin at half the
    distance of the grid and are halved whenever nothing gets better.
    """
    grid = trial.candidate.grid
    effect = trial.candidate.effect
    structure, fixed = effect.structure, effect.structure.fixed(effect)
    free = [n for n in trial.candidate.free(trial.group.shape) if n not in fixed]
    if not free:
        return trial
    step = {name: _spacing(name, trial.group.shape, grid) for name in free}
    rounds = structure.halvings(effect, free)
    best = trial
    halved = 0
    for _ in range(MOVES * rounds):
        better = False
        for name in free:
            for sign in (1.0, -1.0):
                shape = dict(best.group.shape)
                wanted = shape[name] * float(np.exp(sign * step[name]))
                shape[name] = _searched(structure.inside(effect, trial.group.shape, name, wanted), name, trial)
                tried = _tried(record, solved, whitener, best, shape, seen)
                if tried is not None and not tried.wrong_sign and tried.gain > best.gain * (1.0 + BETTER):
                    best, better = tried, True
                    break
        if not better:
            step = {name: 0.5 * size for name, size in step.items()}
            halved += 1
            if halved >= rounds:
                break
    if len(record.mask) > SINGLE:
        forget_effects(record)  # columns of shapes on the way, large on a long record
    return best


def _searched(value: float, name: str, trial: Trial) -> float:
    """Return a value, limited to the ends of the grid where nothing beyond them can be determined."""
    if not any(p.symbol == name and p.within_grid for p in trial.candidate.effect.parameters):
        return value
    ends = [shape[name] for shape in trial.candidate.grid]
    return min(max(value, min(ends)), max(ends))


def _tried(
    record: Record, solved: Solved, whitener: Whitener, trial: Trial, shape: Mapping[str, float],
    seen: Callable[[Record, Group], Group] | None,
) -> Trial | None:  # fmt: skip
    try:
        group = effect_group(record, trial.candidate.effect, shape)
    except UnavailableError:
        return None
    group = group if seen is None else seen(record, group)
    return try_group(solved, whitener, trial.candidate, beside_held(group, solved.model.responses))


def _spacing(name: str, shape: Mapping[str, float], grid: tuple[Mapping[str, float], ...]) -> float:
    values = sorted({s[name] for s in grid if name in s})
    # The nearest of the grid: a trial that was refined before has left it.
    position = int(np.argmin(np.abs(np.log(np.array(values) / shape[name]))))
    near = values[position + 1] if position + 1 < len(values) else values[position - 1]
    return 0.5 * abs(float(np.log(near / values[position])))

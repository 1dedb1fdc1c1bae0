"""Refining a candidate's nonlinear parameters around the best point of its grid."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from pmsm_ctrl.diagnose.search import OVERDAMPED, Trial, try_group
from pmsm_ctrl.evidence.whitening import Whitener
from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.regression.columns import Group, UnavailableError, effect_group
from pmsm_ctrl.regression.model import Solved

__all__ = ["refine"]

# How often the steps are halved. A spring that is hardly damped has a frequency as sharp as its damping: per mille.
USUAL, SHARP = 3, 7
FIXED = ("order", "frame")  # whole numbers
# A contact damped more than this does not bounce at all.
STUCK = 2.0
LINEAR = (0.85, 1.18)


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
    free = [n for n in trial.group.shape if n not in FIXED and len({s[n] for s in grid}) > 1]
    if not free:
        return trial
    step = {name: _spacing(name, trial.group.shape, grid) for name in free}
    rounds = SHARP if "w_a" in free and "gap" not in free else USUAL
    best = trial
    halved = 0
    for _ in range(4 * rounds):
        better = False
        for name in free:
            for sign in (1.0, -1.0):
                shape = dict(best.group.shape)
                shape[name] = _inside(trial, name, shape[name] * float(np.exp(sign * step[name])))
                tried = _tried(record, solved, whitener, best, shape, seen)
                if tried is not None and not tried.wrong_sign and tried.gain > best.gain * (1.0 + 1e-9):
                    best, better = tried, True
                    break
        if not better:
            step = {name: 0.5 * size for name, size in step.items()}
            halved += 1
            if halved >= rounds:
                break
    return best


def _tried(
    record: Record, solved: Solved, whitener: Whitener, trial: Trial, shape: Mapping[str, float],
    seen: Callable[[Record, Group], Group] | None,
) -> Trial | None:  # fmt: skip
    try:
        group = effect_group(record, trial.candidate.effect, shape)
    except UnavailableError:
        return None
    group = group if seen is None else seen(record, group)
    return try_group(solved, whitener, trial.candidate, group)


def _spacing(name: str, shape: Mapping[str, float], grid: tuple[Mapping[str, float], ...]) -> float:
    values = sorted({s[name] for s in grid})
    # The nearest of the grid: a trial that was refined before has left it.
    position = int(np.argmin(np.abs(np.log(np.array(values) / shape[name]))))
    near = values[position + 1] if position + 1 < len(values) else values[position - 1]
    return 0.5 * abs(float(np.log(near / values[position])))


def _inside(trial: Trial, name: str, value: float) -> float:
    if name == "zeta":
        return float(min(max(value, 1e-3), STUCK if "gap" in trial.group.shape else OVERDAMPED))
    if name == "n" and LINEAR[0] < value < LINEAR[1]:  # that is viscous friction, which the model has
        return LINEAR[0] if trial.group.shape[name] < 1.0 else LINEAR[1]
    for p in trial.candidate.effect.parameters:
        if p.symbol == name:
            return float(min(max(value, p.lower), p.upper))
    return value

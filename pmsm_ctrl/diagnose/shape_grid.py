"""Intervals of an effect's parameters over all of its shapes, where a walk from the fit does not reach them.

The sum of squares over the frequency and the damping of a load beyond the band has more than one valley, and often its
least value at a bound: of 67 springs of 97 Hz in a band of 40 Hz, 30 fits ended at a load that is not damped at all.
From there no slope says anything of a load that is. A spring has two parameters that are no amounts, so all its shapes
can be looked at: at each, the sum of squares is a parabola of the load's inertia, inside the bounds of that. A 95 %
interval holds every value of a parameter at which the sum of squares, least over all others, is above the least one by
no more than that of 1.96 standard errors.

Source: D. M. Bates, D. G. Watts, Nonlinear Regression Analysis and Its Applications (1988), section 6.1.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from pmsm_ctrl.diagnose.candidates import Candidate
from pmsm_ctrl.diagnose.fit import Accepted, Fitted
from pmsm_ctrl.diagnose.search import try_group
from pmsm_ctrl.regression.bounds import column_bounds, holding
from pmsm_ctrl.regression.columns import UnavailableError, effect_group, forget_effects
from pmsm_ctrl.regression.two_stage import beside_held

__all__ = ["over_all_shapes"]

Ends = Mapping[str, tuple[float, float]]

POINTS = 28, 9  # of the first and of the second of two shapes
PASSES = 2  # the second one over what the first one left
FEWEST = 3  # values of each shape that an interval must hold, for the grid to have seen it
PARTS = np.array([0.0, 0.5, 1.0])  # of a range of amounts
ALIKE = 1e-6  # rounding of the logarithm of a shape


@dataclass(frozen=True)
class _Point:
    """A shape, the least sum of squares there over an amount and all else, and the parabola over the amount."""

    shape: Mapping[str, float]
    least: float
    amount: float
    stderr: float

    def above(self, amount: float) -> float:
        """The sum of squares with an amount held."""
        return self.least + ((amount - self.amount) / self.stderr) ** 2


def over_all_shapes(fit: Fitted, number: int, scale: float, sigmas: float) -> dict[str, tuple[float, float]]:
    """Return the ends of the intervals of an effect's parameters; none where its shapes cannot all be looked at.

    Parameters
    ----------
    fit : Fitted
    number : int
        Position among the accepted effects.
    scale : float
        Variance of the amount over what it would be in white noise.
    sigmas : float
        Half of the interval of a parabola, in standard errors.
    """
    one, position = fit.accepted[number], fit.position(number)
    ranges = one.effect.structure.ranges(one.effect)
    if len(ranges) != len(POINTS) or position is None:
        return {}
    column = fit.model.columns_of(position).start
    bounds = column_bounds(fit.model, fit.estimate.values)[column]
    box: Ends = ranges
    for _ in range(PASSES):
        seen = list(_points(fit, number, column, box))
        least = [point.above(min(max(point.amount, bounds[0]), bounds[1])) for point in seen]
        limit = min(least) + scale * sigmas**2
        allowed = [point for point, size in zip(seen, least, strict=True) if size <= limit]
        box = {name: _around(name, allowed, box, ranges, count) for name, count in zip(ranges, POINTS, strict=True)}
    if any(len({point.shape[name] for point in allowed}) < FEWEST for name in ranges):
        return {}
    return _hull(one, allowed, limit, bounds)


def _points(fit: Fitted, number: int, column: int, box: Ends) -> Iterator[_Point]:
    """Yield the fit's own shape and a grid with their parabolas over the amount, but what the log cannot evaluate."""
    one, held = fit.accepted[number], {k: v for k, v in fit.estimate.held.items() if k != column}
    without = holding(fit.plain, {**held, column: 0.0})
    axes = [np.geomspace(*ends, count).tolist() for ends, count in zip(box.values(), POINTS, strict=True)]
    for values in (tuple(one.shape[name] for name in box), *itertools.product(*axes)):
        shape = {**one.shape, **dict(zip(box, values, strict=True))}
        try:
            group = beside_held(effect_group(fit.record, one.effect, shape), fit.model.responses)
        except UnavailableError:
            continue
        trial = try_group(without, fit.weights, Candidate(one.effect, (shape,)), group)
        forget_effects(fit.record)  # hundreds of columns, large on a long record
        if not trial.singular:
            yield _Point(shape, without.chi2 - trial.gain, float(trial.values[0]), float(trial.stderr[0]))


def _around(name: str, allowed: list[_Point], box: Ends, ranges: Ends, count: int) -> tuple[float, float]:
    """Return the ends of what is allowed of a shape, and a step of the grid beyond."""
    values, step = [point.shape[name] for point in allowed], (box[name][1] / box[name][0]) ** (1.0 / (count - 1))
    return max(min(values) / step, ranges[name][0]), min(max(values) * step, ranges[name][1])


def _hull(
    one: Accepted, allowed: list[_Point], limit: float, bounds: tuple[float, float]
) -> dict[str, tuple[float, float]]:
    """Return the ends of every parameter over what is allowed; open where the range of a shape is."""
    structure = one.effect.structure
    amount, ranges = structure.symbols(one.effect)[0], structure.ranges(one.effect)
    of = partial(structure.parameters, one.effect)
    found: dict[str, list[float]] = {}
    for point in allowed:
        half = point.stderr * math.sqrt(max(limit - point.least, 0.0))
        low, high = (min(max(point.amount + by, bounds[0]), bounds[1]) for by in (-half, half))
        for value in (low + PARTS * (high - low)).tolist():
            for symbol, told in of({**point.shape, amount: value}).items():
                found.setdefault(symbol, []).append(told)
    out = {}
    for symbol, values in found.items():
        low, high = min(values), max(values)
        for name, (lowest, highest) in ranges.items():
            moved = {**one.shape, amount: 1.0, name: 1.1 * one.shape[name]}
            if of({**one.shape, amount: 1.0})[symbol] == of(moved)[symbol]:
                continue  # it does not hang on this shape
            if min(point.shape[name] for point in allowed) <= lowest * (1.0 + ALIKE):
                low = 0.0
            ends = max(point.shape[name] for point in allowed) >= highest / (1.0 + ALIKE)
            if ends and structure.inside(one.effect, one.shape, name, 2.0 * highest) > highest:
                high = math.inf
        out[symbol] = (low, high)
    return out

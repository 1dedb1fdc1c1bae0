"""Intervals of an effect's parameters where the sum of squares over them is no parabola.

A standard error describes a parabola. A Stribeck speed that the log hardly holds has a steep side and a flat one: its
95 % interval is where the sum of squares, least over all other parameters, grows by that of 1.96 standard errors.

Source: D. M. Bates, D. G. Watts, Nonlinear Regression Analysis and Its Applications (1988), section 6.1, profile t.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose.bouncing import of_bouncing_load
from pmsm_ctrl.diagnose.fit import BASE, Fitted
from pmsm_ctrl.diagnose.shape_grid import over_all_shapes
from pmsm_ctrl.diagnose.shapes import (
    LONGEST,
    Free,
    moved_to,
    searched,
    shifted,
    straight_over,
    tangent_of,
    with_shapes_fitted,
)
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.bounds import bounded, column_bounds, holding
from pmsm_ctrl.regression.columns import UnavailableError

__all__ = ["with_profiles"]

Array = NDArray[np.float64]
Shape = Mapping[str, float]

NORMAL = 1.959964  # half of a 95 % interval, in standard errors
# Standard error of a shape's logarithm, in the step over which the prediction is a straight line, below which it is one
# over the interval.
KNOWN_WELL = 1.5
PARABOLA = 0.1  # part of the half-width by which a profile may differ from a parabola's
ROUNDS, HALVINGS, SETTLED = 6, 3, 1e-3  # of the other shapes beside what is held
TRIALS, CLOSE, FURTHEST, FASTEST = 12, 0.02, 6.0, 3.0  # of the search for an end, in half-widths
LOWER, RESTARTS = 0.1, 4  # fall of the sum of squares that is worth another fit; of such fits
SMALL, ALIKE = 1e-4, 1e-9  # step for a slope; what is rounding


@dataclass(frozen=True)
class _Parameter:
    """A parameter of an effect: one of its shapes, or what is proportional to the factor of one of its columns.

    A shape is walked along by its logarithm. `slope` is that of the walk over the fit's values and the logarithms of
    its shapes, `scale` the walk's variance over what it would be in white noise.
    """

    number: int
    symbol: str
    value: float
    slope: Array
    stderr: float
    scale: float
    free: Free | None
    column: int
    per_factor: Callable[[Shape], float]

    def at(self, step: float) -> float:
        """The parameter after a step."""
        return self.value * float(np.exp(step)) if self.free else self.value + step

    def shape_in(self, fit: Fitted) -> Shape:
        """The shape of its effect in a fit; none of the base model's."""
        return {} if self.number == BASE else fit.accepted[self.number].shape


class _LowerError(Exception):
    """A walk has come to a lower sum of squares: the fit was in a valley of its own."""

    def __init__(self, fit: Fitted) -> None:
        super().__init__()
        self.fit = fit


def with_profiles(design: Design, fit: Fitted, log: Log | None = None, restarts: int = RESTARTS) -> Fitted:
    """Return the fit with the intervals of those parameters of its effects whose profile is no parabola.

    Where a profile comes to a lower sum of squares, the shapes are fitted again from there.

    Parameters
    ----------
    design : Design
    fit : Fitted
        With its shapes fitted.
    log : Log, optional
        What was fitted, before any filter: loads behind gaps are followed along it, for seconds.
    restarts : int
        At most.
    """
    try:
        return _with_profiles(design, fit, log, surely_least=restarts == 0)
    except _LowerError as found:
        return with_profiles(design, with_shapes_fitted(design, found.fit), log, restarts - 1)


def _with_profiles(design: Design, fit: Fitted, log: Log | None, surely_least: bool) -> Fitted:
    walks = _Walks.over(design, fit, surely_least)
    if not walks.doubtful and not fit.rough:
        return fit
    try:  # what is straight over the shapes is straight over all
        profiles = ((partial(_profile, design, walks, one), NORMAL * one.stderr) for one in walks.vague())
        bent = walks.at_bound or any(_bend(profile, half) > 0.5 * PARABOLA for profile, half in profiles)
        doubtful = walks.doubtful if bent else ()
        seen: dict[int, dict[str, tuple[float, float]]]
        seen = {n: over_all_shapes(fit, n, walks.scale_of(n), NORMAL) for n in {*doubtful, *fit.rough}}
        if log is not None:
            seen |= {n: of_bouncing_load(fit, n, log, NORMAL) for n in fit.rough if not seen[n]}
        every = [one for number in doubtful if not seen[number] for one in walks.of_effect(number)]
        every += walks.base() if bent else ()
        found = {(one.number, one.symbol): _interval(design, walks, one) for one in every}
    except UnavailableError:
        return fit
    told = {which: ends for which, ends in found.items() if ends is not None}
    told |= {(number, symbol): ends for number, one in seen.items() for symbol, ends in one.items()}
    return replace(fit, profiles=told) if told else fit


@dataclass(frozen=True, eq=False)
class _Walks:
    """What of a fit can be walked along.

    `covariance` and `white`, the inverse factor of white noise, are over the fit's values and its `free` shapes.
    `shapes` are all that give way beside what is held: those at a bound as well, which may leave it. `doubtful` are
    the effects with a shape that is at a bound or not known well. `surely_least`: no lower sum is looked at.
    """

    fit: Fitted
    covariance: Array
    white: Array
    shapes: tuple[Free, ...]
    doubtful: tuple[int, ...]
    surely_least: bool

    @property
    def at_bound(self) -> set[Free]:
        """The shapes that are at a bound."""
        return set(self.shapes) - set(self.fit.free)

    @classmethod
    def over(cls, design: Design, fit: Fitted, surely_least: bool) -> _Walks:
        """Return what of a fit with its shapes fitted can be walked along."""
        count = len(fit.model.names)
        moving = ((n, s) for n, one in enumerate(fit.accepted) if n not in fit.rough for s in searched(one))
        shapes = tuple(one for one in moving if one not in fit.unmoved)
        alone = np.diag(np.nan_to_num(fit.estimate.stderr) ** 2)
        covariance = alone if fit.covariance is None else fit.covariance
        spread: Array = np.sqrt(np.maximum(np.diag(covariance)[count:], 0.0))
        vague = {free[0] for free, size in zip(fit.free, spread.tolist(), strict=True) if _is_vague(fit, free, size)}
        doubtful = tuple(sorted(vague | {n for n, _ in set(shapes) - set(fit.free)}))
        white = fit.plain.inverse
        if (doubtful or fit.rough) and fit.free:
            white = tangent_of(design, fit, fit.free).inverse
        return cls(fit, covariance, white, shapes, doubtful, surely_least)

    def scale_of(self, number: int) -> float:
        """The variance of an effect's first column over what it would be in white noise; one without a column."""
        if (position := self.fit.position(number)) is None:
            return 1.0
        column = self.fit.model.columns_of(position).start
        unit = self._unit(column)
        variance = float(unit @ self.covariance @ unit) or float(self.fit.plain.stderr[column]) ** 2  # at its bound
        return variance / max(float(np.linalg.norm(unit @ self.white)), 1e-300) ** 2

    def base(self) -> Iterator[_Parameter]:
        """Yield inertia and the linear parameters of the design's effects."""
        names = self.fit.model.names
        for k, name in enumerate(names):
            if (name == "J" or self.fit.model.group_of(k).entry >= 0) and k not in self.fit.estimate.held:
                yield self._parameter(BASE, name, float(self.fit.estimate.values[k]), self._unit(k), column=k)

    def vague(self) -> Iterator[_Parameter]:
        """Yield the shapes that are not known well, those of which parameters are made (a load's frequency) as well."""
        for k, (number, name) in enumerate(self.fit.free, len(self.fit.model.names)):
            one = self._parameter(number, name, self.fit.accepted[number].shape[name], self._unit(k), (number, name))
            if _is_vague(self.fit, (number, name), one.stderr):
                yield one

    def of_effect(self, number: int) -> Iterator[_Parameter]:
        """Yield the shapes of an effect, and what is proportional to the factor of a column of it."""
        fit, one = self.fit, self.fit.accepted[number]
        own = {name: len(fit.model.names) + k for k, (n, name) in enumerate(fit.free) if n == number}
        for name, k in own.items():
            if any(p.symbol == name for p in one.effect.parameters):
                yield self._parameter(number, name, one.shape[name], self._unit(k), free=(number, name))
        if (position := fit.position(number)) is None:
            return
        columns, symbols = fit.model.columns_of(position), fit.model.groups[position].symbols
        factors = dict(zip(symbols, fit.estimate.values[columns].tolist(), strict=True))
        for column, (name, factor) in enumerate(factors.items(), columns.start):
            for p in one.effect.parameters:
                if column in fit.estimate.held or p.symbol in own:
                    continue
                of = partial(one.effect.structure.parameters, one.effect)
                per_factor = partial(_proportional, of, p.symbol, name, factors)
                if not np.isfinite(now := per_factor(one.shape)) or not now:
                    continue
                slope = now * self._unit(column)
                for k, change in zip(own.values(), _slopes(per_factor, one.shape, own), strict=True):
                    slope = slope + factor * change * self._unit(k)
                yield self._parameter(number, p.symbol, now * factor, slope, column=column, per_factor=per_factor)

    def _unit(self, k: int) -> Array:
        return np.asarray(np.eye(1, len(self.covariance), k)[0], dtype=np.float64)

    def _parameter(
        self, number: int, symbol: str, value: float, slope: Array, free: Free | None = None, column: int = -1,
        per_factor: Callable[[Shape], float] = lambda shape: 1.0,
    ) -> _Parameter:  # fmt: skip
        stderr = math.sqrt(max(float(slope @ self.covariance @ slope), 0.0))
        scale = (stderr / max(float(np.linalg.norm(slope @ self.white)), 1e-300)) ** 2
        return _Parameter(number, symbol, value, slope, stderr, scale, free, column, per_factor)


def _is_vague(fit: Fitted, free: Free, stderr: float) -> bool:
    """Whether a shape with this standard error of its logarithm is not known well."""
    return stderr > KNOWN_WELL * float(straight_over(fit.accepted, (free,))[0])


def _proportional(
    of: Callable[[Shape], Shape], symbol: str, name: str, factors: Mapping[str, float], shape: Shape
) -> float:
    """Return a parameter over the factor of a column; NaN where it is not proportional to it."""
    factor = factors[name]
    value, more = (of({**shape, **factors, name: f}).get(symbol, 0.0) for f in (factor, 0.99 * factor))
    return value / factor if factor and abs(more - 0.99 * value) <= ALIKE * abs(value) else float("nan")


def _slopes(per_factor: Callable[[Shape], float], shape: Shape, names: Iterable[str]) -> list[float]:
    """Return the slopes over the logarithms of shapes."""
    return [
        (
            per_factor({**shape, name: shape[name] * np.exp(SMALL)})
            - per_factor({**shape, name: shape[name] * np.exp(-SMALL)})
        )
        / (2.0 * SMALL)
        for name in names
    ]


def _interval(design: Design, walks: _Walks, one: _Parameter) -> tuple[float, float] | None:
    """Return both ends; None where they are those of the standard error."""
    half = NORMAL * one.stderr
    profile = cache(partial(_profile, design, walks, one))
    if _bend(profile, half) <= PARABOLA:
        return None
    below, above = _end(lambda step: profile(-step), half), _end(profile, half)
    low, high = _bounds(walks.fit, one)
    return max(one.at(-below), low), min(one.at(above), high)


def _bounds(fit: Fitted, one: _Parameter) -> tuple[float, float]:
    """Return where a shape or an amount may lie: a load is a part of the inertia, however little is told of it."""
    if one.free is not None:
        p = fit.accepted[one.number].effect.parameter(one.symbol)
        return p.lower, p.upper
    if one.number == BASE or one.column < 0 or fit.model.names[one.column] != one.symbol:
        return -math.inf, math.inf
    return column_bounds(fit.model, fit.estimate.values)[one.column]


def _bend(profile: Callable[[float], float], half: float) -> float:
    """Return by what part of itself a profile differs from a parabola's at the ends of the 95 % interval."""
    return max(abs(profile(sign * half) / NORMAL - 1.0) for sign in (-1.0, 1.0))


def _profile(design: Design, walks: _Walks, one: _Parameter, step: float) -> float:
    """Return the root of what the sum of squares grows by, in standard errors."""
    grown = _least(design, walks, one, step) - walks.fit.estimate.chi2
    return math.sqrt(max(grown, 0.0) / one.scale)


def _end(profile: Callable[[float], float], half: float) -> float:
    """Return the step at which the profile is that of a 95 % interval; infinity beyond the furthest one tried."""
    near, far, step = (0.0, 0.0), (float("inf"), float("inf")), half
    for _ in range(TRIALS):
        root = profile(step)
        if abs(root - NORMAL) <= CLOSE * NORMAL:
            break
        if root < NORMAL:
            near = step, root
        else:
            far = step, root
        if np.isfinite(far[0]):
            part = (NORMAL - near[1]) / (far[1] - near[1])
            step = near[0] + (far[0] - near[0]) * min(max(part, 0.1), 0.9)
        elif step >= FURTHEST * half:
            return float("inf")
        else:
            step = min(step * min(FASTEST, 1.1 * NORMAL / max(root, NORMAL / FASTEST)), FURTHEST * half)
    return step


def _least(design: Design, walks: _Walks, one: _Parameter, step: float) -> float:
    """Return the least sum of squares with a parameter held, over all others."""
    fit, count = walks.fit, len(walks.fit.model.names)
    others = [free for free in walks.shapes if free != one.free]
    follow = dict(zip(fit.free, (walks.covariance @ one.slope / one.stderr**2 * step)[count:].tolist(), strict=True))
    guess = np.array([follow.get(free, 0.0) for free in others])
    held = [] if one.free is None else [one.free]
    best = _placed(design, fit, one, held, np.full(len(held), step), step)
    if others:
        best = min((best, _placed(design, best, one, others, guess, step)), key=lambda there: there.estimate.chi2)
    for _ in range(ROUNDS if others else 0):
        longest = LONGEST * straight_over(best.accepted, others)
        move = np.clip(_downhill(design, best, one, others), -longest, longest)
        steps = (_placed(design, best, one, others, move / 2.0**k, step) for k in range(HALVINGS))
        better = next((there for there in steps if there.estimate.chi2 < best.estimate.chi2), None)
        if better is None:
            break
        gained, best = best.estimate.chi2 - better.estimate.chi2, better
        if gained < SETTLED * one.scale:
            break
    most = fit.estimate.chi2 - LOWER * one.scale
    if not walks.surely_least and best.estimate.chi2 < most:
        there = moved_to(design, fit, best.accepted)
        there = replace(there, estimate=bounded(there.plain))
        if there.estimate.chi2 < most:  # inside all bounds
            raise _LowerError(there)
    return best.estimate.chi2


def _placed(design: Design, base: Fitted, one: _Parameter, which: Sequence[Free], by: Array, step: float) -> Fitted:
    """Return the fit at moved shapes, with the parameter held after a step where it is no shape."""
    there = moved_to(design, base, shifted(base.accepted, which, by)) if which else base
    if one.free:
        return replace(there, estimate=bounded(there.plain))
    factor = one.at(step) / one.per_factor(one.shape_in(there))
    if not np.isfinite(factor):
        raise UnavailableError("a shape at which the parameter has no factor")
    return replace(there, estimate=holding(there.plain, {one.column: factor}))


def _downhill(design: Design, fit: Fitted, one: _Parameter, others: Sequence[Free]) -> Array:
    """Return the Gauss-Newton step of the other shapes; the factor that is held follows them."""
    tangent, count = tangent_of(design, fit, others), len(fit.model.names)
    triangle, along = tangent.triangle.copy(), tangent.along.copy()
    if one.free is None:
        own = [(count + k, name) for k, (number, name) in enumerate(others) if number == one.number]
        shape = one.shape_in(fit)
        for k, change in zip((k for k, _ in own), _slopes(one.per_factor, shape, [n for _, n in own]), strict=True):
            follows = -fit.estimate.values[one.column] * change / one.per_factor(shape)
            triangle[:, k] += follows * triangle[:, one.column]
        along -= triangle[:, one.column] * fit.estimate.values[one.column]
        triangle[:, one.column] = 0.0
    return np.asarray(np.linalg.lstsq(triangle, along, rcond=None)[0][count:], dtype=np.float64)

"""The parameters with which the simulation in open loop leaves least, by a trust region from several starts."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects.catalogue import bound_effects
from pmsm_ctrl.identify import policy
from pmsm_ctrl.identify.noise_free import by_narrow_band
from pmsm_ctrl.identify.notices import NOT_CONVERGED
from pmsm_ctrl.identify.open_loop import OpenLoop, open_loop
from pmsm_ctrl.identify.profile import Optimum
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.drive_timing import LATENESS, SPREAD, DriveTiming, Sampling
from pmsm_ctrl.regression.inverse_dynamics import Problem
from pmsm_ctrl.regression.least_squares import Fit, solve
from pmsm_ctrl.section import Notice

__all__ = ["by_open_loop", "fitted", "profiled", "solved", "without_noise"]

Array = NDArray[np.float64]

HELD = 1e-3  # of its standard error, by which a parameter moves that is held


def fitted(
    loop: OpenLoop, prior: Mapping[str, float], starts: int = policy.STARTS, begin: Array | None = None,
    each: Callable[[], None] = lambda: None,
) -> tuple[Array, bool]:  # fmt: skip
    """Return the values with the smallest sum of squares, and whether the search converged.

    Parameters
    ----------
    loop : OpenLoop
    prior : dict of column name to float
        Standard errors of the design's values: they are drawn there, by little, as they come from the same log.
    starts : int
        Of the nonlinear parameters beside the design's: of each half, then twice its value.
    begin : array, shape (columns,), optional
        From where the search begins; the design's values when left out.
    each : function
        Called in every round.
    """
    best = _descent(loop, prior, loop.start if begin is None else begin, policy.FIT_ROUNDS, each)
    for other in _starts(loop)[:starts]:
        found = _descent(loop, prior, other, policy.TRIAL_ROUNDS, each)
        if found[1] < best[1]:
            best = _descent(loop, prior, found[0], policy.FIT_ROUNDS, each)
    return best[0], best[2]


def by_open_loop(
    designs: tuple[Design, Design], log: Log, ordinary: Fit, sampling: Sampling,
    each: Callable[[], None] = lambda: None,
) -> tuple[Problem, Fit, tuple[Notice, ...]]:  # fmt: skip
    """Fit all parameters by the simulation of a log, from the solution of its regression on.

    Parameters
    ----------
    designs : (Design, Design)
        As it was given, and with what the regression found.
    log : Log
        What is known of the sampling of its drive signal is undone here.
    ordinary : Fit
        Of the regression.
    sampling : Sampling
    each : function
        Called in every round.
    """
    sigma = dict(zip((LATENESS, SPREAD), sampling.sigma, strict=True))
    given, start = designs
    loop = open_loop(start, DriveTiming(sampling.late).undone(log), sigma, ordinary.stderr.get("J", np.nan))
    prior = {name: e for name, e in ordinary.stderr.items() if np.isfinite(e)}
    values, converged = fitted(loop, prior, each=each)
    problem, fit = without_noise(loop, prior, values, each)
    known = [{"J": given.J}, *(values for _, values in bound_effects(given))]
    columns = tuple(replace(c, nominal=known[c.entry + 1].get(c.symbol, c.nominal)) for c in problem.columns)
    problem = replace(problem, columns=columns)
    failed = NOT_CONVERGED(method="the fit by simulation", rounds=policy.FIT_ROUNDS, names="")
    return problem, fit, () if converged else (failed,)


def solved(loop: OpenLoop, values: Array) -> tuple[Problem, Fit]:
    """Return the problem that is linear at these values, and the fit with them and their standard errors.

    Parameters
    ----------
    loop : OpenLoop
    values : array, shape (columns,)
    """
    problem = loop.problem(values)
    fit = solve(problem, problem.matrix(), ratio=policy.LEAST_ACCELERATION)  # columns without noise are their own
    return problem, _with_values(loop, problem, fit, values)


def without_noise(
    loop: OpenLoop, prior: Mapping[str, float], values: Array, each: Callable[[], None] = lambda: None
) -> tuple[Problem, Fit]:  # fmt: skip
    """Return the problem and the fit with the inertia and the sampling by instruments, where they are not held.

    Parameters
    ----------
    loop : OpenLoop
    prior : dict of column name to float
        As in `fitted`.
    values : array, shape (columns,)
        With the smallest sum of squares.
    each : function
        Called in every round.
    """

    def again(held: OpenLoop, begin: Array) -> Array:
        return _descent(held, prior, begin, policy.FIT_ROUNDS, each)[0]

    made = by_narrow_band(loop, values, again)
    if made is None:
        return solved(loop, values)
    values, problem, fit = made
    return problem, _with_values(loop, problem, fit, values)


def _with_values(loop: OpenLoop, problem: Problem, fit: Fit, values: Array) -> Fit:
    own = dict(zip(problem.names, values.tolist(), strict=True))
    return replace(fit, values={name: own[name] for name in fit.values}, residual=loop.left(values))


def _starts(loop: OpenLoop) -> Sequence[Array]:
    """Return values with one nonlinear parameter at half, then at twice its value."""
    out = []
    for k in _nonlinear(loop):
        column = loop.columns[k]
        for factor in (0.5, 2.0):
            values = loop.start
            values[k] = column.clipped(factor * values[k])
            out.append(values)
    return out


def _nonlinear(loop: OpenLoop) -> list[int]:
    """Return the columns of parameters that are no factors."""
    linear = {effect.id: {p.symbol for p in effect.linear} for effect, _ in bound_effects(loop.design)}
    return [
        k
        for k, column in enumerate(loop.columns)
        if column.entry >= 0 and column.symbol not in linear[column.effect] and column.nominal != 0.0
    ]


def _prior_widths(loop: OpenLoop, prior: Mapping[str, float]) -> Array:
    """Return how far every parameter may lie from the design's value, shape (columns,); next to nothing if held."""
    held = [HELD * c.prior[1] if c.held and c.prior else np.nan for c in loop.columns]
    widths = [c.sigma if c.is_nuisance else policy.PRIOR * (prior.get(c.name) or np.inf) for c in loop.columns]
    return np.where(np.isnan(held), widths, held)


@dataclass(frozen=True, eq=False)
class _Squares:
    """What is squared, the priors included, over the parameters in units of their steps."""

    loop: OpenLoop
    width: Array

    @cached_property
    def scale(self) -> Array:
        """Units of the parameters, shape (columns,)."""
        return self.loop.steps / policy.DIFFERENCE

    @cached_property
    def noise(self) -> float:
        """Rms of what the design's values leave."""
        return max(float(np.sqrt(np.mean(self.loop.left(self.loop.start)[self.loop.used] ** 2))), 1e-300)

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """Of the parameters."""
        low, high = (np.array([getattr(c, side) for c in self.loop.columns]) for side in ("lower", "upper"))
        return low / self.scale, high / self.scale

    def residual(self, x: Array) -> Array:
        """Return what is squared."""
        loop, values = self.loop, x * self.scale
        return np.concatenate([loop.left(values)[loop.used] / self.noise, (values - loop.start) / self.width])

    def slopes(self, x: Array) -> Array:
        """Return its slopes."""
        made = -self.loop.slopes(x * self.scale)[self.loop.used] * self.scale / self.noise
        return np.vstack([made, np.diag(self.scale / self.width)])


def _descent(
    loop: OpenLoop, prior: Mapping[str, float], begin: Array, rounds: int, each: Callable[[], None]
) -> tuple[Array, float, bool]:
    """Return values, half the sum of squares and whether it converged, from these values on."""
    from scipy.optimize import least_squares

    squares = _Squares(loop, _prior_widths(loop, prior))

    def slopes(x: Array) -> Array:
        each()
        return squares.slopes(x)

    found = least_squares(
        squares.residual, np.clip(begin / squares.scale, *squares.bounds), jac=slopes, bounds=squares.bounds,
        x_scale="jac", xtol=1e-5, ftol=1e-6, max_nfev=rounds,
    )  # fmt: skip
    return found.x * squares.scale, float(found.cost), found.status > 0


def profiled(loop: OpenLoop, prior: Mapping[str, float], values: Array, fit: Fit) -> dict[str, tuple[float, float]]:
    """Return the ends of the 95 % intervals of the nonlinear parameters whose sum of squares is no parabola.

    Parameters
    ----------
    loop : OpenLoop
    prior : dict of column name to float
        As in `fitted`.
    values : array, shape (columns,)
        With the smallest sum of squares.
    fit : Fit
        Of the problem that is linear there.
    """
    squares = _Squares(loop, _prior_widths(loop, prior))
    stderr = np.array([fit.stderr.get(column.name, np.nan) for column in loop.columns]) / squares.scale
    x = values / squares.scale
    best = Optimum(squares.residual, x, squares.slopes(x), stderr, *squares.bounds)
    ends = best.ends(_nonlinear(loop))
    return {loop.columns[k].name: (low * squares.scale[k], high * squares.scale[k]) for k, (low, high) in ends.items()}

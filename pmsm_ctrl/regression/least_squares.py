"""Solving the inverse-dynamics regression: estimates, standard errors, and unidentifiable parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.evidence.blocks import block_sums, no_smaller_than_by_blocks
from pmsm_ctrl.evidence.linalg import OWN_SHARE, factored, own_shares
from pmsm_ctrl.evidence.noise import NoiseModel, degrees_of_freedom, fit_noise
from pmsm_ctrl.regression.inverse_dynamics import Column, Problem

__all__ = ["AtBound", "Cause", "Combination", "Fit", "Unidentifiable", "solve", "t_quantile"]

Array = NDArray[np.float64]

# An instrument this much smaller than the column it stands for says that the column is noise.
WEAK_INSTRUMENT = 1e-3
# Bias, in standard errors, that is not worth a word: half of one takes the coverage of a 95 % interval to 92 %, and
# the feedback biases least squares by a little on every log.
NEGLIGIBLE_BIAS = 0.5
HELD = 1e3  # times as stiff as its standard deviation says is a parameter that is held


class Cause(Enum):
    """Why a parameter gets no number."""

    NOT_EXCITED = "not_excited"
    COLLINEAR = "collinear"
    UNCERTAIN = "uncertain"
    NO_ACCELERATION = "no_acceleration"
    EFFECT_ABSENT = "effect_absent"
    IMPOSSIBLE = "impossible"


@dataclass(frozen=True)
class Combination:
    """Weighted sum of inseparable parameters, which alone is known."""

    weights: Mapping[str, float]
    value: float
    stderr: float
    unit: str


@dataclass(frozen=True)
class Unidentifiable:
    """A parameter that the log does not show.

    Attributes
    ----------
    cause : Cause
    effect : str
        Id of its effect; empty for the inertia.
    detail : dict of str to value
        The figures behind the cause.
    known : Combination or None
        Of it and the parameters from which it is inseparable.
    held : bool
        Whether the others were estimated with the design's value in its place.
    """

    cause: Cause
    effect: str = ""
    detail: Mapping[str, Any] = field(default_factory=dict)
    known: Combination | None = None
    held: bool = False


@dataclass(frozen=True)
class AtBound:
    """A parameter that was held at its bound.

    Attributes
    ----------
    bound, free, stderr : float
        The bound; the value that the fit without bounds finds beyond it, and its standard error.
    """

    bound: float
    free: float
    stderr: float


@dataclass(frozen=True, eq=False)
class Fit:
    """Least squares of a problem, inside the bounds of its parameters.

    Attributes
    ----------
    values, stderr : dict of column name to float
        Identifiable columns only. A parameter at its bound has no standard error: NaN.
    unidentifiable : dict of column name to Unidentifiable
        The others.
    coefficients : array, shape (columns,)
        Of all columns, those without a number of their own included.
    residual : array, shape (m,)
        Target less prediction, on the whole thinned grid, masked samples included.
    condition : float
        Condition number of the columns scaled to unit length.
    dof : float
        Effective degrees of freedom of the residual, its correlation allowed for.
    noise : NoiseModel
    spread : float
        Variance of the noise, in the target's unit squared.
    weights : array, shape (columns, samples of the mask)
        The estimates are these times the target; those of a parameter at its bound are zero.
    at_bound : dict of column name to AtBound
    nuisances : dict of column name to (float, float)
        What was found of the sampling, with standard errors.
    """

    values: Mapping[str, float]
    stderr: Mapping[str, float]
    unidentifiable: Mapping[str, Unidentifiable]
    coefficients: Array
    residual: Array
    condition: float
    dof: float
    noise: NoiseModel
    spread: float
    weights: Array
    at_bound: Mapping[str, AtBound] = field(default_factory=dict)
    nuisances: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def interval(self, name: str, coverage: float = 0.95) -> tuple[float, float]:
        """Return the two-sided interval of one value by Student's t; of one at its bound, the part inside."""
        quantile = t_quantile(coverage, self.dof)
        if name in self.at_bound:
            held = self.at_bound[name]
            inside = held.free + np.copysign(quantile * held.stderr, held.bound - held.free)
            side = max if held.free < held.bound else min
            low, high = sorted((held.bound, float(side(held.bound, inside))))
            return low, high
        half = quantile * self.stderr[name]
        return self.values[name] - half, self.values[name] + half


def t_quantile(coverage: float, dof: float) -> float:
    """Return the half-width of a two-sided interval in standard errors, by Student's t; normal for infinite `dof`."""
    from scipy.special import ndtri, stdtrit

    upper = 0.5 + coverage / 2.0
    return float(stdtrit(dof, upper)) if np.isfinite(dof) else float(ndtri(upper))


def solve(
    problem: Problem, instruments: Array | None = None, ratio: float | None = 1.0, by_blocks: bool = False
) -> Fit:
    """Solve by least squares, or by instrumental variables, with standard errors that allow for correlated residuals.

    Inseparable columns stay in the fit as a group, so that the other estimates are not biased; only their own values
    are withheld. Bounds are constraints: a parameter beyond its bound is held there, and the others are fitted with it.
    An impossible inertia is held at the design's.

    Parameters
    ----------
    problem : Problem
    instruments : array, shape (m, columns), optional
        The problem's columns as they would be without the log's noise. Every column of the problem is then replaced
        by what the instruments explain of it (two-stage least squares: ``(Z'X)^-1 Z'y``).
    ratio : float or None
        The inertia gets no number when its torque is less than this multiple of the residual: without instruments,
        so little acceleration may be the loops' answer to noise, and the inertia found from it falls short. None: no
        such limit.
    by_blocks : bool
        Whether no standard error is smaller than what blocks of the record differ by: errors of the model come so.
    """
    centred = _centred(problem)
    if centred is not problem:
        return _as_asked(solve(centred, instruments, ratio, by_blocks), problem)
    instruments = problem.instruments() if instruments is None else instruments
    fit = free = _solve_free(problem, instruments, ratio, by_blocks)
    held: dict[int, float] = {}
    # what one bound changes may bring another parameter to its own
    while beyond := _beyond(problem, instruments, fit, held):
        held |= beyond
        fit = _with_held(problem, instruments, (ratio, by_blocks), held, free)
    return fit


def _centred(problem: Problem) -> Problem:
    """Return the problem in the differences of its parameters from their expected values."""
    expected = _expected(problem)
    if not expected.any():
        return problem
    columns = tuple(
        replace(column, nominal=0.0) if column.is_nuisance
        else replace(column, prior=(0.0, column.prior[1]), lower=column.lower - at, upper=column.upper - at)
        if column.prior is not None else column
        for column, at in zip(problem.columns, expected.tolist(), strict=True)
    )  # fmt: skip
    return replace(problem, target=problem.target - problem.matrix() @ expected, columns=columns)


def _expected(problem: Problem) -> Array:
    return np.array([(column.expected or (0.0,))[0] for column in problem.columns])


def _as_asked(fit: Fit, problem: Problem) -> Fit:
    """Return a fit of differences as one of the values themselves."""
    expected = dict(zip(problem.names, _expected(problem).tolist(), strict=True))
    values = {name: expected[name] + value for name, value in fit.values.items()}
    nuisances = {name: (expected[name] + value, stderr) for name, (value, stderr) in fit.nuisances.items()}
    return replace(fit, values=values, coefficients=fit.coefficients + _expected(problem), nuisances=nuisances)


def _beyond(problem: Problem, instruments: Array | None, fit: Fit, held: Mapping[int, float]) -> dict[int, float]:
    """Return columns to hold, and where: those at a bound in the optimum inside the bounds (active set)."""
    from scipy.optimize import lsq_linear

    columns = problem.columns
    low, high = (np.array([getattr(c, side) for c in columns]) for side in ("lower", "upper"))
    known = np.array([c.name in fit.values and k not in held for k, c in enumerate(columns)])
    outside = known & ((fit.coefficients < low) | (fit.coefficients > high))
    if not outside.any():
        return {}
    k = problem.inertia
    if k is not None and outside[k]:
        return {k: columns[k].nominal}
    free = [k for k in range(len(columns)) if k not in held]
    mask = problem.mask
    x, target = problem.matrix(), problem.target - problem.matrix()[:, list(held)] @ np.array(list(held.values()))
    rows = x[mask][:, free]
    rows = rows if instruments is None else _projected(rows, instruments[mask][:, free])
    prior = _prior_rows([columns[k] for k in free], rows, target[mask])
    rows = np.vstack([rows, prior])
    size = np.linalg.norm(rows, axis=0)
    size[size == 0.0] = 1.0
    basis, triangle = np.linalg.qr(rows / size)
    wanted = basis[: len(rows) - len(prior)].T @ target[mask]
    low, high = np.where(known, low, -np.inf)[free] * size, np.where(known, high, np.inf)[free] * size
    inside = lsq_linear(triangle, wanted, (low, high), method="bvls").active_mask
    return {
        k: columns[k].lower if side < 0 else columns[k].upper
        for k, side in zip(free, inside.tolist(), strict=True)
        if side
    }


def _with_held(
    problem: Problem, instruments: Array | None, asked: tuple[float | None, bool], held: Mapping[int, float], free: Fit
) -> Fit:
    """Solve for the other columns, and return the fit of all of them; `free` is the one without bounds."""
    columns, x = problem.columns, problem.matrix()
    rest = [k for k in range(len(columns)) if k not in held]
    values = np.array(list(held.values()))
    target = problem.target - x[:, list(held)] @ values
    reduced = replace(problem, target=target, columns=tuple(columns[k] for k in rest))
    fit = _solve_free(reduced, None if instruments is None else instruments[:, rest], *asked)
    coefficients, weights = np.zeros(len(columns)), np.zeros((len(columns), fit.weights.shape[1]))
    coefficients[rest], weights[rest] = fit.coefficients, fit.weights
    coefficients[list(held)] = values
    found, stderr, lost, at_bound = dict(fit.values), dict(fit.stderr), dict(fit.unidentifiable), {}
    for k, bound in held.items():
        name = columns[k].name
        wanted = AtBound(bound, float(free.coefficients[k]), free.stderr.get(name, float("nan")))
        if columns[k].is_inertia:
            detail = {"value": wanted.free, "stderr": wanted.stderr, "unit": columns[k].unit}
            lost[name] = Unidentifiable(Cause.IMPOSSIBLE, detail=detail, held=True)
            continue
        at_bound[name] = wanted
        found[name], stderr[name] = bound, float("nan")
    in_order = [c.name for c in columns]
    return replace(
        fit,
        values={n: found[n] for n in in_order if n in found},
        stderr={n: stderr[n] for n in in_order if n in stderr},
        unidentifiable={n: lost[n] for n in in_order if n in lost},
        coefficients=coefficients,
        weights=weights,
        at_bound=at_bound,
    )


def _solve_free(problem: Problem, instruments: Array | None, ratio: float | None, by_blocks: bool) -> Fit:
    """Solve without bounds."""
    mask = problem.mask
    x, y = problem.matrix(), problem.target
    explained = x[mask] if instruments is None else _projected(x[mask], instruments[mask])
    prior = _prior_rows(problem.columns, explained, y[mask])
    factor = factored(np.vstack([explained, prior]))
    rows, beside = factor.basis[: len(explained)], factor.basis[len(explained) :]
    beta = factor.inverse @ (rows.T @ y[mask])
    residual = y - x @ beta
    basis = np.zeros((len(y), factor.basis.shape[1]))
    basis[mask] = rows
    noise = fit_noise(residual, mask, basis=basis)
    meat = basis.T @ noise.toeplitz(basis)  # U'RU, exact across gaps
    free = max(float(mask.sum()) - float(np.trace(meat)), 1.0)  # tr(M R)
    spread = float(residual[mask] @ residual[mask]) / free
    # a prior is as sure as its own standard deviation, whatever the noise is
    sure = beside.T @ (_prior_variances(problem.columns, prior)[:, None] * beside)
    covariance = factor.inverse @ (spread * meat + sure) @ factor.inverse.T
    if by_blocks:
        t = problem.t[mask]
        place = (t - t[0]) / max(float(t[-1] - t[0]), 1e-300)
        changes = block_sums(rows, residual[mask], place) @ factor.inverse.T
        covariance = no_smaller_than_by_blocks(covariance, changes, np.diag(factor.inverse @ sure @ factor.inverse.T))
    covariance += np.diag([column.bias**2 for column in problem.columns])
    stderr = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    dof = degrees_of_freedom(noise, free, int(mask.sum()))
    own = problem.physical
    physical = tuple(column for column in problem.columns if not column.is_nuisance)
    lost = _inseparable(physical, explained[:, own], beta[own], covariance[np.ix_(own, own)])
    lost |= _uncertain(problem, beta, stderr * t_quantile(0.95, dof), lost)
    if ratio is not None:
        lost |= _hardly_accelerating(problem, float(np.sqrt(np.mean(residual[mask] ** 2))), ratio, lost)
    good = [k for k, name in enumerate(problem.names) if name not in lost and own[k]]
    return Fit(
        values={problem.names[k]: float(beta[k]) for k in good},
        stderr={problem.names[k]: float(stderr[k]) for k in good},
        unidentifiable=lost,
        coefficients=beta,
        residual=residual,
        condition=factor.condition if own.all() else factored(explained[:, own]).condition,
        dof=dof,
        noise=noise,
        spread=spread,
        weights=factor.inverse @ rows.T,
        nuisances={problem.names[k]: (float(beta[k]), float(stderr[k])) for k in np.flatnonzero(~own).tolist()},
    )


def _prior_rows(columns: Sequence[Column], x: Array, y: Array) -> Array:
    """Return the rows of the priors, with mean zero and in units of the noise; shape (priors, columns)."""
    places = [k for k, column in enumerate(columns) if column.expected is not None]
    rows = np.zeros((len(places), len(columns)))
    if places:
        left = y - x @ factored(x).solve(y)
        noise = float(np.sqrt(np.mean(left**2)))
        stiff = np.array([HELD if columns[k].held else 1.0 for k in places])
        rows[range(len(places)), places] = noise * stiff / _prior_widths(columns)
    return rows


def _prior_widths(columns: Sequence[Column]) -> Array:
    return np.array([column.expected[1] for column in columns if column.expected is not None])


def _prior_variances(columns: Sequence[Column], prior: Array) -> Array:
    """Return the variance of every row of the priors."""
    return np.asarray((np.sum(prior, axis=1) * _prior_widths(columns)) ** 2)


def _projected(x: Array, z: Array) -> Array:
    """Return what instruments z, shape (n, k), explain of the columns x, shape (n, m).

    A column of which its own instrument moves less than `WEAK_INSTRUMENT` is noise, and explained by nothing.
    """
    size = np.sqrt(np.mean(z**2, axis=0))
    enough = size > WEAK_INSTRUMENT * np.sqrt(np.mean(x**2, axis=0))
    alive = z[:, enough]
    basis = factored(alive).basis
    return np.where(enough, basis @ (basis.T @ x), 0.0)


def _inseparable(columns: tuple[Column, ...], x: Array, beta: Array, covariance: Array) -> dict[str, Unidentifiable]:
    """Return the columns, values of shape (n, columns), that the motion does not excite, or not apart from others."""
    size = np.sqrt(np.mean(x**2, axis=0))
    shares = own_shares(x)
    lost: dict[str, Unidentifiable] = {}
    alike: dict[int, tuple[str, ...]] = {}
    for k, column in enumerate(columns):
        if size[k] == 0.0:
            lost[column.name] = Unidentifiable(Cause.NOT_EXCITED, column.effect)
        elif shares[k] < OWN_SHARE:
            weights = factored(np.delete(x, k, axis=1)).solve(x[:, k]) * np.delete(size, k) / size[k]
            alike[k] = tuple(np.array([c.name for c in columns if c is not column])[np.abs(weights) > 0.05].tolist())
    sums = _combinations(columns, x, beta, covariance, list(alike))
    for k, partners in alike.items():
        name = columns[k].name
        lost[name] = Unidentifiable(Cause.COLLINEAR, columns[k].effect, {"partners": partners}, sums.get(name))
    return {column.name: lost[column.name] for column in columns if column.name in lost}


def _combinations(
    columns: tuple[Column, ...], x: Array, beta: Array, covariance: Array, left: list[int]
) -> dict[str, Combination]:
    """Return the weighted sum of each group of columns that are alike, where it is known."""
    size = np.sqrt(np.mean(x**2, axis=0))
    found: dict[str, Combination] = {}
    while left:
        first = left[0]
        cosine = x.T @ x[:, first] / (len(x) * np.where(size > 0.0, size, 1.0) * size[first])
        group = [k for k in left if abs(cosine[k]) > 1.0 - OWN_SHARE**2]
        left = [k for k in left if k not in group]
        if len(group) < 2:
            continue
        weights = np.zeros(len(columns))
        weights[group] = np.sign(cosine[group]) * size[group] / size[first]
        value, stderr = float(weights @ beta), float(np.sqrt(abs(weights @ covariance @ weights)))
        if stderr > abs(value):
            continue
        named = {columns[k].name: float(weights[k]) for k in sorted(group)}
        found |= dict.fromkeys(named, Combination(named, value, stderr, columns[first].unit))
    return found


def _uncertain(
    problem: Problem, values: Array, half_width: Array, known: Mapping[str, Unidentifiable]
) -> dict[str, Unidentifiable]:
    """Return the columns known less well than before.

    Their intervals reach beyond the design's value, or, where that is zero, beyond the value that would explain the
    whole torque by itself.
    """
    mask = problem.mask
    force = float(np.sqrt(np.mean(problem.target[mask] ** 2)))
    lost = {}
    for column, value, half in zip(problem.columns, values.tolist(), half_width.tolist(), strict=True):
        if column.name in known or column.is_nuisance:
            continue
        size = float(np.sqrt(np.mean(column.values[mask] ** 2)))
        limit = abs(column.nominal) or force / size
        if half > max(limit, abs(value)):
            detail = {"half_width": half, "limit": limit, "unit": column.unit}
            lost[column.name] = Unidentifiable(Cause.UNCERTAIN, column.effect, detail)
    return lost


def _hardly_accelerating(
    problem: Problem, residual: float, ratio: float, known: Mapping[str, Unidentifiable]
) -> dict[str, Unidentifiable]:
    """Return the inertia where the torque of the acceleration is less than `ratio` times the residual, rms."""
    for column in problem.columns:
        if not column.is_inertia or column.name in known:
            continue
        torque = abs(column.nominal) * float(np.std(column.values[problem.mask]))
        if torque < ratio * residual:
            detail = {"torque": torque, "residual": residual, "unit": problem.unit}
            return {column.name: Unidentifiable(Cause.NO_ACCELERATION, detail=detail)}
    return {}

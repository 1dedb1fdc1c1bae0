"""Solving the inverse-dynamics regression: estimates, honest standard errors, and what cannot be identified."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.effects.base import Effect
from pmsm_ctrl.evidence.noise import NoiseModel, degrees_of_freedom, fit_noise
from pmsm_ctrl.identify.problem import Column, Problem

__all__ = ["Fit", "excitation", "solve"]

Array = NDArray[np.float64]

# A column of which less than this share is independent of the others cannot be told from them: measured speeds
# and accelerations are not exact to much better than 1 %.
INDEPENDENT_SHARE = 0.01
# An instrument this much smaller than the column it stands for says that the column is noise.
WEAK = 1e-3


@dataclass(frozen=True, eq=False)
class Fit:
    """Least squares of a problem.

    Attributes
    ----------
    values, stderr : dict of column name to float
        Identifiable columns only.
    unidentifiable : dict of column name to str
        Why the others got no number.
    coefficients : array, shape (columns,)
        Of all columns, those without a number of their own included.
    predicted, residual : array, shape (m,)
        On the whole thinned grid, masked samples included; residual = target - predicted.
    condition : float
        Condition number of the columns scaled to unit length.
    dof : float
        Effective degrees of freedom of the residual, its correlation allowed for.
    spread : float
        Variance of the noise, in the target's unit squared.
    weights : array, shape (columns, samples of the mask)
        The estimates are these times the target.
    """

    values: Mapping[str, float]
    stderr: Mapping[str, float]
    unidentifiable: Mapping[str, str]
    coefficients: Array
    covariance: Array
    predicted: Array
    residual: Array
    condition: float
    dof: float
    noise: NoiseModel
    spread: float
    weights: Array

    def interval(self, name: str, coverage: float = 0.95) -> tuple[float, float]:
        """Return the two-sided interval of one value by Student's t."""
        half = t_quantile(coverage, self.dof) * self.stderr[name]
        return self.values[name] - half, self.values[name] + half


def t_quantile(coverage: float, dof: float) -> float:
    """Half-width of a two-sided interval in standard errors."""
    from scipy.special import ndtri, stdtrit

    upper = 0.5 + coverage / 2.0
    return float(stdtrit(dof, upper)) if np.isfinite(dof) else float(ndtri(upper))


def solve(
    problem: Problem,
    effects: Mapping[str, Effect] | None = None,
    instruments: Array | None = None,
    ratio: float | None = 1.0,
) -> Fit:
    """Solve by least squares, or by instrumental variables, with standard errors that allow for correlated residuals.

    Parameters
    ----------
    problem : Problem
    effects : mapping of id to Effect, optional
        Lets the reasons for "not identifiable" quote what each effect needs.
    instruments : array, shape (m, columns), optional
        The problem's columns as they would be without the log's noise. Every column of the problem is then replaced
        by what the instruments explain of it (two-stage least squares: ``(Z'X)^-1 Z'y``).
    ratio : float or None
        The inertia gets no number when its torque is less than this multiple of the residual: without instruments,
        so little acceleration may be the loops' answer to noise, and the inertia found from it falls short. None: no
        such limit.

    Notes
    -----
    Columns that no data can tell apart stay in the fit as a group, so that the others are not biased by their
    absence; only their own values are withheld.
    """
    mask = problem.mask
    x, y = problem.matrix(), problem.target
    instruments = problem.instruments() if instruments is None else instruments
    scale = np.sqrt(np.mean(x[mask] ** 2, axis=0))
    scale[scale == 0.0] = 1.0
    explained = x[mask] if instruments is None else _projected(x[mask], instruments[mask])
    u, s, vt = np.linalg.svd(explained / scale, full_matrices=False)
    kept = s > 1e-9 * s[0] if s.size else np.zeros(0, dtype=bool)
    inverse = vt[kept].T / s[kept]  # (columns, rank): scaled pseudo-inverse is inverse @ u'
    beta = inverse @ (u[:, kept].T @ y[mask])
    predicted = (x / scale) @ beta
    residual = y - predicted
    basis = np.zeros((len(y), int(kept.sum())))
    basis[mask] = u[:, kept]
    noise = fit_noise(residual, mask, basis=basis)
    meat = basis.T @ noise.toeplitz(basis)  # U'RU, exact across gaps
    free = max(float(mask.sum()) - float(np.trace(meat)), 1.0)  # tr(M R)
    spread = float(residual[mask] @ residual[mask]) / free
    covariance = spread * inverse @ meat @ inverse.T / np.outer(scale, scale)
    stderr = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    dof = degrees_of_freedom(noise, free, int(mask.sum()))
    beta = beta / scale
    reasons = excitation(problem, effects or {}, None if instruments is None else explained)
    sums = _sums(problem.columns, explained, beta, covariance, reasons)
    reasons |= _lost(problem, beta, stderr * t_quantile(0.95, dof), reasons)
    if ratio is not None:
        reasons |= _shaken(problem, float(np.sqrt(np.mean(residual[mask] ** 2))), ratio, reasons)
    good = [k for k, name in enumerate(problem.names) if name not in reasons]
    return Fit(
        values={problem.names[k]: float(beta[k]) for k in good},
        stderr={problem.names[k]: float(stderr[k]) for k in good},
        unidentifiable={name: f"{why}{sums.get(name, '')}" for name, why in reasons.items()},
        coefficients=beta,
        covariance=covariance,
        predicted=predicted,
        residual=residual,
        condition=float(s[0] / s[-1]) if s.size and s[-1] > 0 else float("inf"),
        dof=dof,
        noise=noise,
        spread=spread,
        weights=inverse @ u[:, kept].T / scale[:, None],
    )


def _projected(x: Array, z: Array) -> Array:
    """Return what instruments z, shape (n, k), explain of the columns x, shape (n, m).

    A column of which its own instrument moves less than `WEAK` is noise, and explained by nothing.
    """
    size = np.sqrt(np.mean(z**2, axis=0))
    enough = size > WEAK * np.sqrt(np.mean(x**2, axis=0))
    alive = z[:, enough] / size[enough]
    u, s, _ = np.linalg.svd(alive, full_matrices=False)
    basis = u[:, s > 1e-6 * s[0]] if s.size else u
    return np.where(enough, basis @ (basis.T @ x), 0.0)


def excitation(problem: Problem, effects: Mapping[str, Effect], explained: Array | None = None) -> dict[str, str]:
    """Return the columns that the motion does not excite, or not apart from others, and why.

    `explained`, shape (n, columns), stands for the problem's own columns on the samples of its mask where given.
    """
    x = problem.matrix()[problem.mask] if explained is None else explained
    size = np.sqrt(np.mean(x**2, axis=0))
    reasons: dict[str, str] = {}
    alive = []
    for k, column in enumerate(problem.columns):
        if size[k] == 0.0:
            reasons[column.name] = "its term is zero all along" + _needs(column, effects)
        else:
            alive.append(k)
    scaled = x[:, alive] / size[alive]
    for position, k in enumerate(alive):
        others = np.delete(scaled, position, axis=1)
        if others.shape[1] == 0:
            continue
        weights = np.linalg.lstsq(others, scaled[:, position], rcond=1e-9)[0]
        share = float(np.sqrt(np.mean((scaled[:, position] - others @ weights) ** 2)))
        if share >= INDEPENDENT_SHARE:
            continue
        partners = [problem.columns[j].name for j in np.delete(alive, position)[np.abs(weights) > 0.05]]
        column = problem.columns[k]
        reasons[column.name] = f"this motion cannot tell it from {', '.join(partners)}" + _needs(column, effects)
    return reasons


def _lost(problem: Problem, values: Array, half_width: Array, known: Mapping[str, str]) -> dict[str, str]:
    """Columns known less well than before: intervals beyond the design's value, or, where that is zero, beyond the
    value that would explain the whole torque by itself."""
    mask = problem.mask
    force = float(np.sqrt(np.mean(problem.target[mask] ** 2)))
    reasons = {}
    for column, value, half in zip(problem.columns, values.tolist(), half_width.tolist(), strict=True):
        if column.name in known:
            continue
        size = float(np.sqrt(np.mean(column.values[mask] ** 2)))
        limit = abs(column.nominal) or force / size
        if half > max(limit, abs(value)):
            reasons[column.name] = (
                f"its torque drowns in the residual: known to +- {half:.2g} {column.unit} only, "
                f"where about {limit:.2g} {column.unit} is expected at most"
            )
    return reasons


def _shaken(problem: Problem, residual: float, ratio: float, known: Mapping[str, str]) -> dict[str, str]:
    """Return the inertia where the axis hardly accelerates, and why it gets no number."""
    for column in problem.columns:
        if column.symbol != "J" or column.name in known:
            continue
        torque = abs(column.nominal) * float(np.std(column.values[problem.mask]))
        if torque < ratio * residual:
            return {
                column.name: f"the torque of its acceleration, {torque:.2g} {problem.unit} rms, drowns in the residual "
                f"of {residual:.2g} {problem.unit}: what accelerates there may be noise; it needs acceleration"
            }
    return {}


def _sums(
    columns: tuple[Column, ...], x: Array, beta: Array, covariance: Array, reasons: Mapping[str, str]
) -> dict[str, str]:
    """Return what is known of parameters that cannot be told apart: their weighted sum, where that is one number."""
    size = np.sqrt(np.mean(x**2, axis=0))
    left = [k for k, column in enumerate(columns) if column.name in reasons and size[k] > 0.0]
    texts: dict[str, str] = {}
    while left:
        first = left[0]
        cosine = x.T @ x[:, first] / (len(x) * np.where(size > 0.0, size, 1.0) * size[first])
        group = [k for k in left if abs(cosine[k]) > 1.0 - INDEPENDENT_SHARE**2]
        left = [k for k in left if k not in group]
        if len(group) < 2:
            continue
        weights = np.zeros(len(columns))
        weights[group] = np.sign(cosine[group]) * size[group] / size[first]
        value, stderr = float(weights @ beta), float(np.sqrt(abs(weights @ covariance @ weights)))
        if stderr > abs(value):
            continue
        terms = [f"{'-' if w < 0 else '+'} {_factor(abs(w))}{columns[k].name}" for k, w in enumerate(weights) if w]
        text = f"; known is {' '.join(terms).removeprefix('+ ')} = {value:.4g} +- {stderr:.2g} {columns[first].unit}"
        texts |= {columns[k].name: text for k in group}
    return texts


def _factor(value: float) -> str:
    return "" if f"{value:.3g}" == "1" else f"{value:.3g} "


def _needs(column: Column, effects: Mapping[str, Effect]) -> str:
    if not column.effect:
        return "; it needs acceleration"
    effect = effects.get(column.effect)
    return f"; it needs {effect.needs}" if effect is not None else ""

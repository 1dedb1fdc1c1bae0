"""Bounds as constraints of a fit: the optimum inside them, not the free optimum clipped to them.

The active set is found on the triangular factor of a fit that exists already. No tall column is touched for it, and
nothing is done where the free optimum keeps the bounds.

Source: P. B. Stark, R. L. Parker, Computational Statistics 10 (1995) 129, bounded-variable least squares.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.regression.model import Model, Solved, known, solve_on_factors

__all__ = ["bounded", "column_bounds", "holding"]

Array = NDArray[np.float64]

# Passes of a fit inside bounds that hang on what it finds, and the share of a bound to which they settle.
PASSES, SETTLED = 60, 1e-9


def column_bounds(model: Model, values: Array) -> list[tuple[float, float]]:
    """Return where the parameter of every column may lie; everywhere where it is no effect's."""
    found = known(model, values)
    out: list[tuple[float, float]] = []
    for group in model.groups:
        effect = group.effect
        bounds = {} if effect is None else effect.structure.bounds(effect, found, group.shape)
        out += [bounds.get(symbol, (-np.inf, np.inf)) for symbol in group.symbols]
    return out


def bounded(free: Solved, columns: Iterable[int] | None = None) -> Solved:
    """Return the optimum inside the bounds of the effects' parameters; the fit itself where it keeps them.

    Parameters
    ----------
    free : Solved
        Without bounds.
    columns : iterable of int, optional
        Those whose bounds count; all when left out.
    """
    from scipy.optimize import lsq_linear

    found = free
    counted = np.isin(np.arange(len(free.values)), range(len(free.values)) if columns is None else list(columns))
    for _ in range(PASSES):  # some bounds hang on what is found
        low, high = np.array(column_bounds(free.model, found.values)).reshape(-1, 2).T
        low, high = np.where(counted, low, -np.inf), np.where(counted, high, np.inf)
        if np.all((low - _slack(low) <= found.values) & (found.values <= high + _slack(high))):
            break
        size = np.linalg.norm(free.triangle, axis=0)
        size[size == 0.0] = 1.0
        lowest = low * size
        highest = np.maximum(high * size, np.nextafter(lowest, np.inf))  # what a parameter may be can be one number
        inside = lsq_linear(free.triangle / size, free.along, (lowest, highest), method="bvls")
        edges = {-1: low, 1: high}
        held = {k: float(edges[side][k]) for k, side in enumerate(inside.active_mask.tolist()) if side}
        if not held:  # columns hang together: the free optimum is one of many, and another one keeps the bounds
            nearest = np.clip(found.values, low, high)
            held = {k: float(nearest[k]) for k in np.flatnonzero(nearest != found.values).tolist()}
        found = holding(free, held)
    return found


def _slack(bounds: Array) -> Array:
    return np.where(np.isfinite(bounds), SETTLED * np.abs(bounds), 0.0)


def holding(free: Solved, held: Mapping[int, float]) -> Solved:
    """Return the fit with some parameters held at given values.

    Parameters
    ----------
    free : Solved
    held : dict of column to float
    """
    rest = [free.rest_of(row) for row in range(len(free.bases))]
    predicted = free.triangle @ free.values
    for row, (basis, part) in enumerate(zip(free.bases, free.parts, strict=True)):
        rest[row] = rest[row] + predicted[part] @ basis
    return solve_on_factors(free.model, free.triangle, free.along, free.bases, rest, held)

"""A parameter over time: a constant, a trend or a step, with scatter between records beside the errors within them.

The error that a record states is that of its own noise. From day to day friction differs by more, so that every fit
has a random part between records, whose variance is found by restricted maximum likelihood. Intervals are Student's,
with the variance factor of Knapp and Hartung (Stat. Med. 22 (2003) 2693); they are exact where all records are equally
precise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "FALSE_DISCOVERIES", "FEWEST_RECORDS", "Changing", "Regression", "Step", "between_records", "changing", "q_values",
    "regression", "step",
]  # fmt: skip

Array = NDArray[np.float64]

# Expected share of false ones among all that are named. Source of the procedure: Y. Benjamini, Y. Hochberg,
# J. R. Stat. Soc. B 57 (1995) 289.
FALSE_DISCOVERIES = 0.05

# Records from which a trend or a change is judged: two parameters leave two degrees of freedom.
FEWEST_RECORDS = 4

# Quantile 0.95 of the likelihood ratio of the place of a change, -2 ln(1 - sqrt(0.95)).
# Source: B. E. Hansen, Econometrica 68 (2000) 575, table I.
LOCATION = 7.352

GRID = 60  # values of the variance that are tried


@dataclass(frozen=True, eq=False)
class Regression:
    """A straight line through a parameter.

    Attributes
    ----------
    slope, stderr : float
        Per unit of the abscissa.
    level, level_stderr : float
        At the abscissa `at`.
    at : float
    dof : int
    p_value : float
        Of a slope of zero, two-sided.
    between : float
        Standard deviation between records.
    left : float
        Weighted sum of squares that it leaves.
    """

    slope: float
    stderr: float
    level: float
    level_stderr: float
    at: float
    dof: int
    p_value: float
    between: float
    left: float

    def interval(self, coverage: float = 0.95) -> tuple[float, float]:
        """Return the two-sided interval of the slope.

        Parameters
        ----------
        coverage : float
        """
        from scipy.special import stdtrit

        half = float(stdtrit(self.dof, 0.5 + 0.5 * coverage)) * self.stderr
        return self.slope - half, self.slope + half


@dataclass(frozen=True, eq=False)
class Step:
    """A change from one level to another between two records.

    Attributes
    ----------
    index : int
        The first record of the new level.
    first, last : int
        First and last record that may be the first of the new level, at 95 %.
    size, stderr : float
    dof : int
    p_value : float
        Of no change, allowing for the choice of the place (Bonferroni).
    left : float
        Weighted sum of squares that it leaves.
    """

    index: int
    first: int
    last: int
    size: float
    stderr: float
    dof: int
    p_value: float
    left: float


@dataclass(frozen=True, eq=False)
class Changing:
    """How a parameter changes over its records.

    Attributes
    ----------
    p_value : float
        Of no change.
    step : Step or None
    trend : Regression or None
        The one of the two that explains more.
    """

    p_value: float
    step: Step | None
    trend: Regression | None


def changing(t: Array, y: Array, stderr: Array) -> Changing | None:
    """Judge a parameter over its records: a trend or a step, whichever explains more at its number of parameters.

    Parameters
    ----------
    t, y, stderr : array, shape (n,)
        Abscissa, value, and standard error of each record, in the order of time.

    Returns
    -------
    Changing or None
        None for fewer than `FEWEST_RECORDS` records, or all at one abscissa.
    """
    trend, jump = regression(t, y, stderr), step(y, stderr)
    if trend is None or jump is None:
        return None
    # one p-value each, of the same hypothesis: the smaller one belongs to the shape that explains more
    p = min(1.0, 2.0 * min(trend.p_value, jump.p_value))
    return Changing(p, jump, None) if jump.p_value < trend.p_value else Changing(p, None, trend)


def q_values(p_values: Sequence[float]) -> Array:
    """Return the q-values of Benjamini and Hochberg: the share of false ones among all that are at least as sure.

    Parameters
    ----------
    p_values : sequence of float, length n

    Returns
    -------
    array, shape (n,)
    """
    if not len(p_values):
        return np.empty(0)
    from scipy.stats import false_discovery_control

    return np.asarray(false_discovery_control(np.array(p_values), method="bh"), dtype=np.float64)


def between_records(x: Array, y: Array, stderr: Array) -> float:
    """Return the variance between records by restricted maximum likelihood.

    Parameters
    ----------
    x : array, shape (n, p)
        Columns of the mean.
    y, stderr : array, shape (n,)

    Returns
    -------
    float
        In the square of the unit of `y`.
    """
    spread = float(np.var(y)) + float(np.mean(stderr**2))
    trial = np.concatenate(([0.0], spread * np.geomspace(1e-6, 30.0, GRID)))
    w = 1.0 / (stderr**2 + trial[:, None])
    gram = np.einsum("gn,np,nq->gpq", w, x, x)
    found = np.linalg.solve(gram, np.einsum("gn,np,n->gp", w, x, y)[..., None])[..., 0]
    left = np.einsum("gn,gn->g", w, (y - found @ x.T) ** 2)
    likelihood = np.log(w).sum(axis=1) - np.linalg.slogdet(gram)[1] - left
    return float(trial[int(np.argmax(likelihood))])


def _usable(stderr: Array, y: Array) -> Array:
    """Return errors that are positive: where none is known, those of the other records."""
    known = np.isfinite(stderr) & (stderr > 0.0)
    usual = float(np.median(stderr[known])) if known.any() else 0.0
    return np.maximum(np.where(known, stderr, usual), 1e-9 * (float(np.abs(y).max()) or 1.0))


def regression(t: Array, y: Array, stderr: Array, at: float | None = None) -> Regression | None:
    """Fit a line with a random part between records.

    Parameters
    ----------
    t, y, stderr : array, shape (n,)
        Abscissa, value, and standard error of each record.
    at : float, optional
        Where the level is stated; the last abscissa if left out.

    Returns
    -------
    Regression or None
        None for fewer than `FEWEST_RECORDS` records, or all at one abscissa.
    """
    if len(y) < FEWEST_RECORDS or np.ptp(t) <= 0.0:
        return None
    from scipy.special import stdtr

    at = float(np.max(t)) if at is None else at
    scale, size = float(np.ptp(t)), float(np.abs(y).max()) or 1.0
    x = np.column_stack((np.ones_like(t), (t - at) / scale))
    y, errors = y / size, _usable(stderr, y) / size
    between = between_records(x, y, errors)
    w = 1.0 / (errors**2 + between)
    inverse = np.linalg.inv(x.T @ (w[:, None] * x))
    found = inverse @ (x.T @ (w * y))
    left = float(w @ (y - x @ found) ** 2)
    dof = len(y) - 2
    own = np.sqrt(np.diag(inverse) * left / dof)
    p = 2.0 * float(stdtr(dof, -abs(found[1]) / own[1])) if own[1] > 0.0 else 0.0
    return Regression(
        found[1] * size / scale, own[1] * size / scale, found[0] * size, own[0] * size, at, dof, p,
        float(np.sqrt(between)) * size, left,
    )  # fmt: skip


def step(y: Array, stderr: Array) -> Step | None:
    """Find the most likely change of level.

    Parameters
    ----------
    y, stderr : array, shape (n,)
        In the order of time.

    Returns
    -------
    Step or None
        None for fewer than `FEWEST_RECORDS` records.
    """
    n = len(y)
    if n < FEWEST_RECORDS:
        return None
    from scipy.special import stdtr

    size = float(np.abs(y).max()) or 1.0
    y, errors = y / size, _usable(stderr, y) / size
    # the scatter left by the likeliest step: that around one mean would take the step itself for scatter
    k = 1 + int(np.argmin(_left(y, 1.0 / errors**2)))
    columns = np.column_stack((np.ones(n), np.arange(n) >= k)).astype(float)
    w = 1.0 / (errors**2 + between_records(columns, y, errors))
    left = _left(y, w)
    best = int(np.argmin(left))
    k, dof = best + 1, n - 2
    factor = left[best] / dof
    inside = np.flatnonzero(n * (left - left[best]) <= LOCATION * left[best])
    change = float(np.average(y[k:], weights=w[k:]) - np.average(y[:k], weights=w[:k]))
    own = float(np.sqrt(factor * (1.0 / w[:k].sum() + 1.0 / w[k:].sum())))
    p = 2.0 * float(stdtr(dof, -abs(change) / own)) if own > 0.0 else 0.0
    return Step(
        k, int(inside[0]) + 1, int(inside[-1]) + 1, change * size, own * size, dof, min(1.0, p * (n - 1)), left[best]
    )


def _left(y: Array, w: Array) -> Array:
    """Weighted sums of squares around the means before and from record k, k = 1 to n - 1."""
    centred = y - np.average(y, weights=w)  # for the rounding of the differences below
    total = np.array([np.cumsum(w), np.cumsum(w * centred), np.cumsum(w * centred**2)])
    before, after = total[:, :-1], total[:, -1:] - total[:, :-1]
    left = total[2, -1] - before[1] ** 2 / before[0] - after[1] ** 2 / after[0]
    return np.asarray(np.maximum(left, 1e-12 * total[2, -1]), dtype=np.float64)

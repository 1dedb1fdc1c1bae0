"""How much a candidate explains, how sure that is, and whether it would hold on data that were left out."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.diagnose.candidates import Candidate
from pmsm_ctrl.evidence.tests import f_tail, rank_test
from pmsm_ctrl.evidence.whitening import Whitener, make_whitener
from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.regression.columns import Group
from pmsm_ctrl.regression.model import Model, Solved, spread

__all__ = [
    "Evidence",
    "Trial",
    "blocked_gain",
    "least_shown",
    "plain_evidence",
    "saturated_whitener",
    "try_candidate",
    "try_group",
]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Trial:
    """A candidate at its best shape, added to the model.

    Attributes
    ----------
    gain : float
        Fall of the whitened sum of squares.
    score : float
        The same less what its parameters cost (Schwarz).
    p_value : float
        Of the group F-test, the searched shapes paid for; not yet corrected for the number of candidates.
    values, stderr : array, shape (k,)
    slow : bool
        Whether the estimate's own weights judged it, not the prewhitened rows.
    direction : array, shape (rows,)
        Whitened columns times values, orthogonal to the model: what it explains and nothing else does.
    """

    candidate: Candidate
    group: Group
    gain: float
    score: float
    p_value: float
    values: Array
    stderr: Array
    direction: Array
    wrong_sign: bool = False
    singular: bool = False
    slow: bool = False
    plain_gain: float = 0.0
    plain_direction: Array = field(default_factory=lambda: np.zeros(0))

    @property
    def at_bound(self) -> bool:
        """Whether a nonlinear parameter ran into its bound: the shape wants to be another one."""
        effect = self.candidate.effect
        return effect.structure.at_bound(effect, self.group.shape)


@dataclass(frozen=True)
class Evidence:
    """The gates one accepted or refused candidate went through."""

    gain: float
    p_value: float
    p_holm: float
    blocks: int
    block_gain: float
    block_stderr: float
    p_rank: float
    material: float


def saturated_whitener(record: Record, model: Model, extra: Iterable[Array]) -> tuple[Whitener, Whitener]:
    """Fit the noise to what even a model with every candidate in it leaves over.

    Returns the prewhitener, and the same noise without its correlation: point estimates use that one, because
    whitening shifts the weight to high frequencies, where differentiation and timing errors live.
    """
    parts = [model.matrix, *extra, _smooth(record)]
    residual = np.zeros(record.target.shape)
    lost = 0
    for row in range(len(record.channels)):
        w = (record.weight[row] * record.mask)[:, None]
        a = np.concatenate([part[row] for part in parts if np.any(part[row])], axis=-1) * w
        norm = np.linalg.norm(a, axis=0)
        a = a[:, norm > 0.0]
        a /= norm[norm > 0.0]
        gram = a.T @ a
        values, vectors = np.linalg.eigh(gram)
        kept = values > 1e-9 * values[-1]
        # a short log has no room for all of them: what the columns have in common comes first
        room = max(10, int(_effective(w[:, 0]) / 8.0))
        kept[: max(0, len(kept) - room)] = False
        basis = a @ (vectors[:, kept] / np.sqrt(values[kept]))
        target = record.target[row] * w[:, 0]
        residual[row] = target - basis @ (basis.T @ target)
        residual[row] -= basis @ (basis.T @ residual[row])
        residual[row] = np.divide(residual[row], w[:, 0], out=np.zeros(len(target)), where=w[:, 0] > 0)
        lost = max(lost, int(kept.sum()))
    noise = residual, record.weight, record.mask, record.rate, lost
    return make_whitener(*noise), make_whitener(*noise, 0)


def _effective(weight: Array) -> float:
    """Number of samples of full weight that carry the same information."""
    top = float(weight.max())
    return float(np.sum(weight**2)) / top**2 if top > 0.0 else 0.0


def _smooth(record: Record, count: int = 10) -> Array:
    """Hat functions of speed and of time, in the torque balance: what no effect of the catalogue may explain."""
    omega, t = record.at_grid(record.signals["omega"]), record.t
    out = []
    for x in (omega, t):
        used = x[record.mask]
        knots = np.unique(np.quantile(used, np.linspace(0.0, 1.0, count)))
        for k in range(len(knots)):
            hat = np.zeros(len(knots))
            hat[k] = 1.0
            column = np.zeros(record.target.shape)
            column[0] = np.interp(x, knots, hat)
            out.append(column)
    return np.stack(out, axis=-1)


def try_candidate(
    record: Record, solved: Solved, whitener: Whitener, candidate: Candidate, shapes: Iterable[Group] | None = None
) -> Trial | None:
    """Return the candidate at the best of its shapes, or None when it has no column on this log."""
    best: Trial | None = None
    for group in shapes if shapes is not None else candidate.groups(record):
        trial = try_group(solved, whitener, candidate, group)
        if best is None or (not trial.wrong_sign, trial.score) > (not best.wrong_sign, best.score):
            best = trial
    return best


def try_group(solved: Solved, whitener: Whitener, candidate: Candidate, group: Group) -> Trial:
    """Test one group of columns against the model."""
    n = len(solved.rest)
    u, inverse, scale = beyond(solved, whitener, group)
    k = u.shape[1]
    if k == 0:
        nothing = np.zeros(len(scale))
        return Trial(candidate, group, 0.0, 0.0, 1.0, nothing, np.full(len(scale), np.inf), np.zeros(n), singular=True)
    along = u.T @ solved.rest
    values = inverse @ along / scale
    stderr = np.sqrt(np.sum(inverse**2, axis=1)) / scale
    gain = float(along @ along)
    free = candidate.free
    score = gain - (k + free) * np.log(max(n, 2))
    wrong = _wrong_sign(group, values, solved)
    p = min(1.0, f_tail(gain / k, k, max(solved.rows - solved.q.shape[1] - k, 1)) * max(candidate.searched, 1))
    return Trial(candidate, group, gain, score, p, values, stderr, u @ along, wrong)


def beyond(solved: Solved, whitener: Whitener, group: Group) -> tuple[Array, Array, Array]:
    """Orthonormal basis of what a group has beyond the model; the way back to its values, and their scale."""
    rows = whitener(group.values)
    size = np.linalg.norm(rows, axis=0)
    z = np.vstack([rows, np.zeros((len(solved.rest) - solved.rows, rows.shape[1]))])
    left = z - solved.q @ (solved.q.T @ z)
    left -= solved.q @ (solved.q.T @ left)
    scale = np.where(size > 0.0, size, 1.0)
    u, s, vt = np.linalg.svd(left / scale, full_matrices=False)
    kept = s > 1e-2  # less than 1 % of its own left: the model has it already
    return u[:, kept], vt[kept].T / s[kept], scale


def least_shown(solved: Solved, whitener: Whitener, group: Group, level: float, along: Array | None = None) -> Array:
    """Return the amounts from which a test that knows shape and noise finds a group in half of all logs.

    Parameters
    ----------
    level : float
        Significance that is asked of the test.
    along : array, shape (k,), optional
        Proportion of the parameters; each alone when left out.

    Returns
    -------
    array, shape (k,), or (1,) with `along`
        In the units of the parameters, or of `along`; infinite where the model has the columns already.
        Source: Cramer and Rao's bound in the power of the chi-square test, S. M. Kay, Fundamentals of Statistical
        Signal Processing II, Prentice Hall 1998, sec. 6.5.
    """
    from scipy.optimize import brentq
    from scipy.stats import chi2, ncx2

    u, inverse, scale = beyond(solved, whitener, group)
    k = u.shape[1]
    parts = np.eye(len(scale)) if along is None else np.asarray(along, dtype=float)[:, None]
    if k == 0:
        return np.full(parts.shape[1], np.inf)
    # u' z: what is left of the columns beside the model, in standard deviations of the noise
    seen = np.linalg.norm(np.linalg.pinv(inverse) @ (scale[:, None] * parts), axis=0)
    threshold = chi2.isf(level, k)
    half = brentq(lambda x: ncx2.sf(threshold, k, x) - 0.5, 1e-6, 10.0 * threshold)
    return np.sqrt(half) / np.maximum(seen, 1e-300)


def plain_evidence(
    plain: Solved, weights: Whitener, whitener: Whitener, candidate: Candidate, group: Group
) -> tuple[float, float]:
    """Return gain and p-value of the estimate by weighted least squares, its covariance that of correlated noise.

    Less powerful than the prewhitened test where a column is right at every frequency; where its fast part is not,
    as that of a differentiated current, the prewhitened estimate is drawn to zero and this one is not.
    """
    u, _, _ = beyond(plain, weights, group)
    k = u.shape[1]
    if k == 0:
        return 0.0, 1.0
    along = u.T @ plain.rest
    gain = float(along @ np.linalg.solve(spread(u, weights, whitener), along))
    p = f_tail(gain / k, k, max(plain.rows - plain.q.shape[1] - k, 1)) * max(candidate.searched, 1)
    return gain, min(1.0, p)


def _wrong_sign(group: Group, values: Array, solved: Solved) -> bool:
    """Whether a linear parameter lies where physics does not allow it."""
    assert group.effect is not None
    bounds = group.effect.structure.bounds(group.effect, solved.known)
    return any(not bounds[s][0] <= v <= bounds[s][1] for s, v in zip(group.symbols, values, strict=True))


def equal_blocks(weight: Array, t: Array, count: int) -> list[tuple[float, float]]:
    """Cut time into contiguous blocks that each hold the same share of `weight`."""
    order = np.argsort(t, kind="stable")
    total = np.cumsum(weight[order])
    if total[-1] <= 0.0:
        return []
    cuts = np.interp(np.linspace(0.0, 1.0, count + 1)[1:-1] * total[-1], total, t[order])
    edges = np.concatenate([[t.min() - 1.0], cuts, [t.max() + 1.0]])
    return list(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True))


def blocked_gain(
    record: Record,
    solved: Solved,
    whitener: Whitener,
    group: Group,
    direction: Array,
    memory: float,
    count: int = 16,
) -> tuple[float, float, int, float]:
    """Return the mean gain of held-out blocks, its standard error, their number, and Wilcoxon's p-value.

    Source of the rank test: F. Wilcoxon, Biometrics Bulletin 1 (1945) 80. It judges effects that show in a few
    short stretches, whose gains differ by orders of magnitude.

    Contiguous blocks that hold equal shares of what the candidate could explain; around each, samples within
    the gap (1 s, or less where the noise forgets sooner) are used neither to fit nor to judge.
    """
    t = record.t[whitener.index]
    rows = whitener(solved.model.matrix)
    z = whitener(group.values)
    y = whitener(record.target)
    gap = min(1.0, max(3.0 * memory, 4.0 / record.prepared.cutoff))
    known = np.isfinite(solved.model.sigma)
    prior = np.diag(1.0 / solved.model.sigma[known]) @ np.eye(len(solved.model.sigma))[known]
    target = solved.model.nominal[known] / solved.model.sigma[known]
    info = direction[: solved.rows] ** 2
    gains = []
    for start, stop in equal_blocks(info, t, count):
        test = (t >= start) & (t < stop)
        train = (t < start - gap) | (t >= stop + gap)
        if test.sum() < 3 or train.sum() < 50:
            continue
        small = _errors(rows, y, train, test, prior, target)
        big = _errors(np.column_stack([rows, z]), y, train, test, np.pad(prior, ((0, 0), (0, z.shape[1]))), target)
        gains.append(small - big)
    if len(gains) < 3:
        return 0.0, float("inf"), len(gains), 1.0
    values = np.array(gains)
    spread = float(values.std(ddof=1) / np.sqrt(len(values)))
    return float(values.mean()), spread, len(values), rank_test(values)


def _errors(
    a: Array, y: Array, train: NDArray[np.bool_], test: NDArray[np.bool_], prior: Array, target: Array
) -> float:
    """Sum of squares on the test rows of a model fitted to the training rows."""
    x = np.vstack([a[train], prior])
    b = np.concatenate([y[train], target])
    scale = np.linalg.norm(x, axis=0)
    scale[scale == 0.0] = 1.0
    x = x / scale
    gram = x.T @ x
    ridge = 1e-10 * np.trace(gram) / len(gram)
    beta = np.linalg.solve(gram + ridge * np.eye(len(gram)), x.T @ b) / scale
    r = y[test] - a[test] @ beta
    return float(r @ r)

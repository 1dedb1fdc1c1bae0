"""What a curve explains of a residual: by a prewhitened F-test, and on blocks of time that were left out.

A residual is correlated, and tests that take its samples for independent find a dependence in nearly every log. The
noise is therefore modelled from what even the curves of all coordinates together leave over, each stretch of time at
its own level, and everything is whitened with that; and a curve has to hold where it was not fitted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.evidence.noise import burg, memory_of, schwarz, stretches
from pmsm_ctrl.evidence.tests import f_tail, rank_test

__all__ = ["Bench", "Noise", "Outcome", "bench", "noise_of"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Index = list[int]

BLOCKS = 16
LONGEST_GAP = 1.0  # s left out on either side of a block that is judged
MOST_ORDER = 16
# Least share of a column that the base must leave for it to be something new.
INDEPENDENT = 0.02
LEVEL_TIME = 0.5  # s over which the level of the noise is taken


@dataclass(frozen=True, eq=False)
class Noise:
    """Noise of a residual on the samples that count.

    Attributes
    ----------
    rms : float
        In the residual's unit: what no curve explains, as if nothing had been fitted away.
    left : array, shape (m,)
        What all columns together leave over; zero where a sample does not count.
    weight : array, shape (m,)
        Relative inverse level, at most 2; zero where a sample does not count.
    models, variances : of autoregressive orders 0, 1, ...; the last one is used
    memory : float
        Time after which it has forgotten all but 5 % of itself, s.
    lost : int
        Columns that were fitted away.
    """

    rms: float
    left: Array
    weight: Array
    models: tuple[Array, ...]
    variances: Array
    pieces: tuple[slice, ...]
    memory: float
    lost: int

    def whiten(self, columns: Array) -> Array:
        """Return rows of unit variance without correlation from columns of shape (m, k); shape (used, k)."""
        order = len(self.models) - 1
        weighted = columns * self.weight[:, None]
        out = []
        coefficients = np.concatenate([[1.0], self.models[order]])
        for piece in self.pieces:
            part = weighted[piece]
            done = coefficients[0] * part
            for lag in range(1, min(order, len(part) - 1) + 1):
                done[lag:] += coefficients[lag] * part[:-lag]
            done /= np.sqrt(self.variances[order])
            for k in range(min(order, len(part))):  # the first samples know fewer before them
                before = part[:k][::-1]
                done[k] = (part[k] + self.models[k] @ before) / np.sqrt(self.variances[k])
            out.append(done)
        return np.concatenate(out)


def noise_of(residual: Array, columns: Sequence[Array], mask: Mask, rate: float) -> Noise:
    """Model the noise by what all columns together leave over.

    Parameters
    ----------
    residual : array, shape (m,)
    columns : arrays of shape (m, k)
    rate : float
        Of the thinned grid, Hz.
    """
    weight = mask.astype(np.float64)
    everything = np.hstack(columns)
    for _ in range(2):
        left, lost = _left(residual * weight, everything * weight[:, None], mask)
        level = _level(np.divide(left, weight, out=np.zeros_like(left), where=weight > 0.0), mask, rate)
        weight = np.where(mask, 1.0 / level, 0.0)
        weight *= np.sqrt(mask.sum() / np.sum(weight**2))
        weight = np.minimum(weight, 2.0)
    left, lost = _left(residual * weight, everything * weight[:, None], mask)
    pieces = stretches(mask)
    n = int(mask.sum())
    inflate = n / max(n - lost, n // 4)
    limit = max(0, min(MOST_ORDER, n // 20, max(p.stop - p.start for p in pieces) // 3))
    models, variances = burg([left[piece] for piece in pieces], limit)
    variances = np.maximum(variances * inflate, 1e-300)
    best = schwarz(variances, n)
    plain = np.divide(left, weight, out=np.zeros_like(left), where=weight > 0.0) * np.sqrt(inflate)
    return Noise(
        rms=float(np.sqrt(np.mean(plain[mask] ** 2))),
        left=plain,
        weight=weight,
        models=tuple(models[: best + 1]),
        variances=variances[: best + 1],
        pieces=tuple(pieces),
        memory=memory_of(models[best], rate),
        lost=lost,
    )


def _left(target: Array, columns: Array, mask: Mask) -> tuple[Array, int]:
    """What the columns leave of the target, and how many directions were fitted away."""
    size = np.linalg.norm(columns, axis=0)
    a = columns[:, size > 0.0] / size[size > 0.0]
    values, vectors = np.linalg.eigh(a.T @ a)
    kept = values > 1e-8 * values[-1]
    room = max(8, int(mask.sum()) // 8)  # a short log has no room for all: what the columns share comes first
    kept[: max(0, len(kept) - room)] = False
    basis = a @ (vectors[:, kept] / np.sqrt(values[kept]))
    left = target - basis @ (basis.T @ target)
    return left - basis @ (basis.T @ left), int(kept.sum())


def _level(left: Array, mask: Mask, rate: float) -> Array:
    """Level of the noise around each sample, at least half the usual one."""
    from scipy.ndimage import uniform_filter1d

    width = 2 * round(0.5 * LEVEL_TIME * rate) + 1
    power = uniform_filter1d(np.where(mask, left**2, 0.0), width, mode="nearest")
    share = uniform_filter1d(mask.astype(np.float64), width, mode="nearest")
    level = np.sqrt(np.maximum(np.divide(power, share, out=np.zeros_like(power), where=share > 0.0), 0.0))
    usual = float(np.median(level[mask]))
    return np.maximum(level, max(0.5 * usual, 1e-300))


@dataclass(frozen=True)
class Outcome:
    """What columns explain beyond a base.

    Attributes
    ----------
    p_value : float
        Of the F-test on whitened rows.
    share : float
        Of the residual's mean square, on blocks left out, that base and columns explain more than the base.
    gain, stderr : float
        Mean gain of a left-out block, whitened, and its standard error.
    p_rank : float
        Wilcoxon's p-value of the same gains. Source: F. Wilcoxon, Biometrics Bulletin 1 (1945) 80.
    size : float
        Rms of what the columns alone explain, on the tenth of the samples where that is largest.
    """

    p_value: float
    share: float
    gain: float
    stderr: float
    p_rank: float
    blocks: int
    size: float


@dataclass(frozen=True, eq=False)
class Bench:
    """A residual and all columns that may explain it, as measured and whitened, on the samples that count.

    Attributes
    ----------
    t : array, shape (used,)
    plain, white : array, shape (used, 1 + k)
        The residual, then the columns.
    plain_gram, white_gram : array, shape (1 + k, 1 + k)
    gap : float
        Time left out on either side of a block that is judged, s.
    free : int
        Degrees of freedom of the noise.
    """

    t: Array
    plain: Array
    white: Array
    plain_gram: Array
    white_gram: Array
    gap: float
    free: int

    def judge(self, base: Index, own: Index) -> Outcome | None:
        """Judge what the columns `own` explain beyond `base`, both by number; None where they are nothing new.

        `base` may be empty: then the residual's own mean square is what there is to explain.
        """
        beta, k, gain = _beyond(self.white_gram, base, own)
        if k == 0:
            return None
        # the noise has unit variance, known from so many samples
        p = f_tail(gain / k, k, max(self.free - len(base), 1))
        along = self.white[:, [*own, *base]] @ beta
        edges = _equal_blocks(along**2, self.t)
        gains, _ = _left_out(self.t, self.white, self.white_gram, base, own, edges, self.gap)
        if len(gains) < 4:
            return None
        plain, total = _left_out(self.t, self.plain, self.plain_gram, base, own, edges, self.gap)
        spread = float(gains.std(ddof=1) / np.sqrt(len(gains)))
        share = float(np.sum(plain)) / max(total, 1e-300)
        size = self._size(base, own)
        return Outcome(p, share, float(gains.mean()), spread, rank_test(gains), len(gains), size)

    def significance(self, base: Index, own: Index) -> float:
        """The F-test's p-value alone, which costs little."""
        _, k, gain = _beyond(self.white_gram, base, own)
        return f_tail(gain / k, k, max(self.free - len(base), 1)) if k else 1.0

    def _size(self, base: Index, own: Index) -> float:
        beta, _, _ = _beyond(self.plain_gram, base, own)
        fitted = np.abs(self.plain[:, [*own, *base]] @ beta)
        count = max(10, len(fitted) // 10)
        return float(np.sqrt(np.mean(np.partition(fitted, -count)[-count:] ** 2))) if len(fitted) > count else 0.0


def bench(noise: Noise, t: Array, residual: Array, mask: Mask, columns: Array, cutoff: float) -> Bench:
    """Lay out a residual of shape (m,) and columns of shape (m, k) for judging."""
    both = np.column_stack([residual, columns])
    both[:, 1:] /= np.maximum(np.sqrt(np.mean(both[mask, 1:] ** 2, axis=0)), 1e-300)
    plain, white = both[mask], noise.whiten(both)
    gap = min(LONGEST_GAP, max(3.0 * noise.memory, 4.0 / cutoff))
    free = int(mask.sum()) - noise.lost
    return Bench(t[mask], plain, white, plain.T @ plain, white.T @ white, gap, free)


def _beyond(gram: Array, base: Index, own: Index) -> tuple[Array, int, float]:
    """Return the weights of own and base columns that explain what the base does not, their rank and the gain."""
    g = gram[np.ix_(own, own)]
    cross, right = gram[np.ix_(base, own)], gram[own, 0]
    onto = _inverse(gram[np.ix_(base, base)]) @ np.column_stack([cross, gram[base, 0]])
    g, right = g - cross.T @ onto[:, :-1], right - cross.T @ onto[:, -1]
    size = np.sqrt(np.maximum(np.diag(gram)[own], 1e-300))
    values, vectors = np.linalg.eigh(g / np.outer(size, size))
    kept = values > INDEPENDENT**2
    along = vectors[:, kept].T @ (right / size)
    gain = float(np.sum(along**2 / values[kept]))
    weights = (vectors[:, kept] / values[kept]) @ along / size
    return np.concatenate([weights, -onto[:, :-1] @ weights]), int(kept.sum()), gain


def _inverse(gram: Array) -> Array:
    """Inverse on the directions that there are."""
    if len(gram) == 0:
        return gram
    size = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    values, vectors = np.linalg.eigh(gram / np.outer(size, size))
    kept = values > 1e-9 * values[-1]
    return (vectors[:, kept] / values[kept]) @ vectors[:, kept].T / np.outer(size, size)


def _equal_blocks(weight: Array, t: Array) -> list[tuple[float, float]]:
    """Cut time into contiguous blocks that each hold the same share of what there is to explain."""
    total = np.cumsum(weight)
    cuts = np.interp(np.linspace(0.0, 1.0, BLOCKS + 1)[1:-1] * total[-1], total, t)
    edges = np.concatenate([[t[0] - 1.0], cuts, [t[-1] + 1.0]])
    return list(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True))


def _left_out(
    t: Array, rows: Array, gram: Array, base: Index, own: Index, edges: list[tuple[float, float]], gap: float
) -> tuple[Array, float]:
    """Gain of every block, fitted without it and its surroundings, and the sum of squares of all of them."""
    b, columns = len(base), [0, *base, *own]
    part = np.ascontiguousarray(rows[:, columns])
    full = gram[np.ix_(columns, columns)]
    gains, total = [], 0.0
    for start, stop in edges:
        near = slice(*np.searchsorted(t, [start - gap, stop + gap]))
        test = slice(*np.searchsorted(t, [start, stop]))
        if test.stop - test.start < 3 or len(t) - (near.stop - near.start) < 5 * len(columns):
            continue
        g = full - part[near].T @ part[near]
        y, x = part[test, 0], part[test, 1:]
        small = y - x[:, :b] @ _solved(g[1 : b + 1, 1 : b + 1], g[1 : b + 1, 0]) if b else y
        big = y - x @ _solved(g[1:, 1:], g[1:, 0])
        gains.append(float(small @ small - big @ big))
        total += max(float(y @ y), float(small @ small))
    return np.array(gains), total


def _solved(gram: Array, right: Array) -> Array:
    ridge = 1e-6 * np.trace(gram) / len(gram)
    return np.linalg.solve(gram + ridge * np.eye(len(gram)), right)

"""Stretches of time in which a residual departs and returns, and times at which it steps and stays.

A stretch is judged by the mean of the residual in it, of constant sign or along the direction of motion. Its null
distribution is the scatter of such means in the rest of the residual, which is valid for noise of any correlation.
Student's distribution allows for their number, and Bonferroni's correction for the number of places. The mean must also
be several times every other one: a missing effect shows in many places, a push in one.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.evidence.linalg import GRAM_RANK_TOLERANCE, gram_of, orthonormal

__all__ = ["Burst", "Search", "Shift", "basis_of", "bursts", "explained_by", "shift"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MAD = 1.4826  # standard deviation of normal noise over the median of its magnitude
FEWEST = 12  # means of one length, side by side, that make a null
# Largest share of the samples in a stretch; growth of the scatter of means, over that of white noise, as their length
# doubles.
LONGEST, GROWTH = 0.35, 1.3
STRIDE = 8  # places in the length of a stretch
ROUNDING = 1e-12  # share of a running sum below which a difference is rounding
USED = 0.5  # share of a stretch's samples that must count
PLACES = 60  # times at which a step is looked for
MARGIN = 0.05  # share of the samples that lie before and after an event
NEAR = 21  # times around the best of them
DRIFTS = (0.03, 0.06, 0.12, 0.25, 0.5)  # time constants of a drift, as shares of the log


@dataclass(frozen=True)
class Search:
    """What counts as an event.

    Attributes
    ----------
    significance : float
        Family-wise significance of the search.
    durations : tuple of float
        Lengths of a stretch that are tried, s.
    shortest : float
        Shortest stretch after its ends were refined, s.
    stands_out : float
        Smallest ratio of the mean of a stretch to any other mean of the same length.
    own, own_step : float
        Smallest share of the shape of a stretch, and of a step, that is independent of what the motion explains.
    nearly_all : float
        Share of what the motion does not explain from which on a step counts although less of it is independent: short
        logs of many motions leave 1.4 to 12 % of a step, which explains 83 % and more; a false one explains up to 41 %.
    drift : float
        Smallest ratio of what a step explains to what the best drift explains.
    even : float
        Largest share of a step that has the same sign in both directions of motion: friction changes its sign.
    size : float
        Smallest torque of an event, as a share of the rms of the balance.
    most : int
        Largest number of stretches.
    """

    significance: float = 1e-3
    durations: tuple[float, ...] = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0)
    shortest: float = 0.2
    stands_out: float = 3.0
    own: float = 0.3
    own_step: float = 0.1
    nearly_all: float = 0.75
    drift: float = 1.05
    even: float = 0.5
    size: float = 0.02
    most: int = 3


@dataclass(frozen=True)
class Burst:
    """A stretch, samples ``start <= k < stop``, with the size of the residual in it, in its unit.

    `along` says whether its sign is that of the motion: something that brakes. `score` is its size in standard errors.
    """

    start: int
    stop: int
    size: float
    along: bool
    score: float


@dataclass(frozen=True)
class Shift:
    """A sample from which on the residual differs by `size` along the motion, and by `offset` whatever the motion."""

    start: int
    size: float
    offset: float
    score: float


def basis_of(motion: Array, weight: Array) -> Array:
    """Return an orthonormal basis, shape (m, rank), of what the motion can explain, weighted.

    Parameters
    ----------
    motion : array, shape (m, k)
    weight : array, shape (m,)
    """
    # of so many columns a triangular factor takes long; a part at a time, as each copy of a long log's is large
    basis = motion @ orthonormal(gram_of([motion.T], weight))
    basis *= weight[:, None]
    return basis


def bursts(residual: Array, weight: Array, direction: Array, basis: Array, search: tuple[Search, float]) -> list[Burst]:
    """Return the stretches in which the residual departs, the clearest first.

    Parameters
    ----------
    residual, weight : array, shape (m,)
        The weight is the inverse of the noise's level; zero where a sample does not count.
    direction : array, shape (m,)
        Of motion.
    basis : array, shape (m, rank)
        What the motion alone can explain: `basis_of`, by the weight.
    search : (Search, float)
        What counts, and the sampling rate, Hz.
    """
    rules, rate = search
    found: list[Burst] = []
    used = weight.copy()
    for _ in range(rules.most):
        target = _beyond(basis, residual * used)
        judged = [
            _judged(one, target, used, direction, basis, rules)
            for one in _candidates(target / np.where(used > 0.0, used, np.inf), used, direction, rules, rate)
        ]
        passed = [pair for pair in judged if pair is not None]
        if not passed:
            break
        rough = max(passed, key=lambda pair: pair[0])[1]
        shapes = [replace(rough, along=along) for along in (False, True)]
        settled = [_settled(one, target, used, direction, basis) for one in shapes]
        again = _judged(max(settled, key=lambda pair: pair[0])[1], target, used, direction, basis, rules)
        if again is None or again[1].stop - again[1].start < rules.shortest * rate:
            break
        burst = again[1]
        found.append(burst)
        length = burst.stop - burst.start
        used = used.copy()
        used[max(0, burst.start - length // 4) : burst.stop + length // 4] = 0.0
        basis = basis_of(basis, (used > 0.0).astype(np.float64))
    return found


def _candidates(rest: Array, weight: Array, direction: Array, rules: Search, rate: float) -> Iterator[Burst]:
    """Yield the stretch of the greatest mean for every length and shape, its ends moved to where it explains most."""
    count = np.concatenate([[0.0], np.cumsum(weight > 0.0)])
    for along in (False, True):
        sums, powers = _sums(rest, weight, direction if along else np.ones(len(rest)))
        for seconds in rules.durations:
            n = round(seconds * rate)
            if n < 4 or n > LONGEST * count[-1]:
                continue
            starts = np.arange(0, len(rest) - n + 1, max(1, n // STRIDE))
            starts = starts[count[starts + n] - count[starts] >= USED * n]
            power = powers[starts + n] - powers[starts]
            if not np.any(power > 0.0):
                continue
            means = np.abs(sums[starts + n] - sums[starts]) / np.sqrt(np.where(power > 0.0, power, np.inf))
            start = int(starts[np.argmax(means)])
            yield _refined(rest, weight, direction, Burst(start, start + n, 0.0, along, 0.0))


def _judged(
    one: Burst, target: Array, weight: Array, direction: Array, basis: Array, rules: Search
) -> tuple[float, Burst] | None:
    """Return what a stretch explains, and the stretch with its size; None where it does not count as an event.

    The null distribution is that of the residual with the stretch in the model. Otherwise a stretch that holds a fifth
    of the log would widen it.
    """
    from scipy.stats import t as student

    places = np.arange(len(weight))
    inside = (places >= one.start) & (places < one.stop)
    shape = (direction if one.along else np.ones(len(weight))) * weight
    n, count = one.stop - one.start, int(np.count_nonzero(weight))
    counted = np.flatnonzero(weight)
    around = min(np.count_nonzero(counted < one.start), np.count_nonzero(counted >= one.stop))
    if around < max(n // 4, MARGIN * count):  # it departs and returns
        return None
    if np.count_nonzero(shape[inside]) < USED * n or n > LONGEST * count:
        return None
    explained, values, own, left = _gain((inside * shape)[:, None], target, basis)
    if own < rules.own or explained <= 0.0:
        return None
    outside = ~inside
    short = min(n, max(4, count // (2 * FEWEST)))  # enough means for a null
    others = np.abs(_means(left * outside, shape * outside, short))
    if len(others) < FEWEST:
        return None
    scale = max(1.0, MAD * float(np.median(others))) * GROWTH ** math.log2(n / short)
    score = math.sqrt(explained) / scale
    tries = 4 * len(rules.durations) * STRIDE * count / n
    level = float(student.isf(rules.significance / tries, max(len(others) / STRIDE, FEWEST) - 1))
    if score < max(level, rules.stands_out * float(others.max()) / scale):
        return None
    return explained, replace(one, size=float(values[0]), score=score)


def _settled(one: Burst, target: Array, weight: Array, direction: Array, basis: Array) -> tuple[float, Burst]:
    """Move the ends of a stretch until it explains most, exactly; also across a reversal, where a brake turns over."""

    def gain(start: int, stop: int) -> tuple[float, float]:
        shape = np.zeros(len(weight))
        shape[start:stop] = (direction[start:stop] if one.along else 1.0) * weight[start:stop]
        explained, values, _, _ = _gain(shape[:, None], target, basis)
        return explained, float(values[0])

    start, stop, best = one.start, one.stop, gain(one.start, one.stop)
    step = (stop - start) // 2
    while step >= max(1, (one.stop - one.start) // 32):
        moves = [(start - step, stop), (start + step, stop), (start, stop - step), (start, stop + step)]
        moves = [(a, b) for a, b in moves if 0 <= a < b <= len(weight) and b - a >= 2 * step]
        tried = [(gain(*move), move) for move in moves]
        found, move = max(tried, key=lambda pair: pair[0][0], default=(best, (start, stop)))
        if found[0] > best[0]:
            best, (start, stop) = found, move
        else:
            step //= 2
    return best[0], replace(one, start=start, stop=stop, size=best[1])


def _means(white: Array, shape: Array, n: int) -> Array:
    """Return means of a whitened residual along a shape, over all stretches of `n` samples, in standard errors."""
    sums = np.concatenate([[0.0], np.cumsum(white * shape)])
    powers = np.concatenate([[0.0], np.cumsum(shape**2)])
    counts = np.concatenate([[0.0], np.cumsum(shape != 0.0)])
    starts = np.arange(0, len(white) - n + 1, max(1, n // STRIDE))
    starts = starts[counts[starts + n] - counts[starts] >= USED * n]
    found, power = sums[starts + n] - sums[starts], powers[starts + n] - powers[starts]
    # stretches of next to no weight, of which the running sums keep no digits, tell nothing
    told = power > ROUNDING * powers[-1]
    size = np.sqrt(power, where=told, out=np.ones_like(power))
    return np.asarray(np.divide(found, size, out=np.zeros_like(found), where=told))


def _sums(rest: Array, weight: Array, shape: Array) -> tuple[Array, Array]:
    """Return running sums of residual times shape, and of the shape's square, weighted, from zero on."""
    square = weight**2
    return (
        np.concatenate([[0.0], np.cumsum(square * shape * rest)]),
        np.concatenate([[0.0], np.cumsum(square * shape**2)]),
    )


def _refined(rest: Array, weight: Array, direction: Array, rough: Burst) -> Burst:
    """Move start and stop to where the stretch explains most."""
    sums, powers = _sums(rest, weight, direction if rough.along else np.ones(len(rest)))
    n = rough.stop - rough.start
    step = max(1, n // 16)
    first = np.arange(max(0, rough.start - n), rough.start + n // 2, step)
    last = np.arange(rough.stop - n // 2 + step, min(len(rest), rough.stop + n) + 1, step)
    total = sums[last][None] - sums[first][:, None]
    power = powers[last][None] - powers[first][:, None]
    gain = np.divide(total**2, power, out=np.zeros_like(total), where=power > 0.0)
    i, k = np.unravel_index(int(np.argmax(gain)), gain.shape)
    size = float(total[i, k] / power[i, k])
    return Burst(int(first[i]), int(last[k]), size, rough.along, rough.score)


def _beyond(basis: Array, values: Array) -> Array:
    """Return what is left of values, shape (m,) or (m, k), beside an orthonormal basis, shape (m, rank)."""
    left: Array = values - basis @ (basis.T @ values)
    return left


def shift(residual: Array, weight: Array, direction: Array, basis: Array, search: tuple[Search, float]) -> Shift | None:
    """Return the time at which the residual steps along the motion and stays; None where it does not.

    A step must explain more than any drift: a line, and exponentials of all time constants.

    Parameters
    ----------
    residual, weight, direction, basis, search
        As for `bursts`.
    """
    from scipy.stats import f as fisher

    rules = search[0]
    used = np.flatnonzero(weight > 0.0)
    if len(used) < 4 * FEWEST:
        return None
    target = _beyond(basis, residual * weight)
    inner = used[round(MARGIN * len(used)) : -round(MARGIN * len(used))]
    places = np.unique(inner[np.linspace(0, len(inner) - 1, PLACES).astype(np.int64)])
    best = int(np.argmax(_gains_after(places, weight, direction, target, basis)))
    near = np.linspace(places[max(best - 1, 0)], places[min(best + 1, len(places) - 1)], NEAR).astype(np.int64)
    place = int(near[np.argmax(_gains_after(near, weight, direction, target, basis))])
    explained, values, own, left = _gain(_after(place, direction) * weight[:, None], target, basis)
    time = np.arange(len(residual)) / len(residual)
    courses = np.array([time, *(np.exp(-time / tau) for tau in DRIFTS)]) * weight
    along, even = (_products(c, target, basis) for c in (courses * direction, courses))
    drift = float(np.max(_pair_gains(along, even, np.sum(courses**2 * direction, axis=1))))
    scale, count = _scatter(left, weight * direction, used)
    level = 2.0 * float(fisher.isf(rules.significance / PLACES, 2, count))
    if explained < level * scale**2 or explained < rules.drift * drift:
        return None
    if own < rules.own_step and explained < rules.nearly_all * float(target @ target):
        return None
    if abs(values[1]) > rules.even * abs(values[0]):
        return None
    return Shift(place, float(values[0]), float(values[1]), float(np.sqrt(explained)) / scale)


# Products of columns with themselves, with a target and with a basis, shapes (p,), (p,) and (p, rank).
_Products = tuple[Array, Array, Array]


def _products(columns: Array, target: Array, basis: Array) -> _Products:
    return np.sum(columns**2, axis=1), columns @ target, columns @ basis


def _gains_after(places: NDArray[np.int64], weight: Array, direction: Array, target: Array, basis: Array) -> Array:
    """Return what steps explain that begin at these places, in order: by sums over the samples between them."""

    pieces = list(zip(places, [*places[1:], len(weight)], strict=True))

    def after(one: Array, other: Array) -> Array:
        products = np.array([one[a:b] @ other[a:b] for a, b in pieces])
        return np.asarray(np.cumsum(products[::-1], axis=0)[::-1])

    shapes = weight * direction, weight
    along, even = ((after(one, one), after(one, target), after(one, basis)) for one in shapes)
    return _pair_gains(along, even, after(*shapes))


def _pair_gains(first: _Products, second: _Products, mixed: Array) -> Array:
    """Return what pairs of columns explain beyond the basis, shape (p,); `mixed` holds the products of either two."""
    gram = np.empty((len(mixed), 2, 2))
    for i, one in enumerate((first, second)):
        for j, other in enumerate((first, second)):
            whole = one[0] if i == j else mixed
            gram[:, i, j] = whole - np.sum(one[2] * other[2], axis=1)
    size = np.sqrt(np.maximum(np.stack([first[0], second[0]], axis=1), 1e-300))
    along = np.stack([first[1], second[1]], axis=1) / size
    values, vectors = np.linalg.eigh(gram / (size[:, :, None] * size[:, None, :]))
    inverse = np.where(values > GRAM_RANK_TOLERANCE, 1.0 / np.maximum(values, GRAM_RANK_TOLERANCE), 0.0)
    gains: Array = np.sum(np.einsum("pij,pi->pj", vectors, along) ** 2 * inverse, axis=1)
    return gains


def explained_by(found: Burst | Shift, residual: Array, weight: Array, direction: Array, basis: Array) -> float:
    """Return the fall of the weighted sum of squares by an event, beyond what the motion explains.

    Parameters
    ----------
    found : Burst or Shift
    residual, weight, direction, basis
        As for `bursts`.
    """
    columns: Array = _after(found.start, direction)
    if isinstance(found, Burst):
        inside = (np.arange(len(direction)) >= found.start) & (np.arange(len(direction)) < found.stop)
        columns = np.where(inside, direction if found.along else 1.0, 0.0)[:, None].astype(np.float64)
    return _gain(columns * weight[:, None], _beyond(basis, residual * weight), basis)[0]


def _after(place: int, direction: Array) -> Array:
    on = (np.arange(len(direction)) >= place).astype(np.float64)
    return np.column_stack([on * direction, on])


def _gain(columns: Array, target: Array, basis: Array) -> tuple[float, Array, float, Array]:
    """Return what columns explain beyond a basis, their values, the first one's own share, and what is left."""
    free = _beyond(basis, columns)
    if free.shape[1] == 1:
        values: Array = (free[:, 0] @ target / max(float(free[:, 0] @ free[:, 0]), 1e-300))[None]
    else:
        values = np.asarray(np.linalg.lstsq(free, target, rcond=GRAM_RANK_TOLERANCE)[0], dtype=np.float64)
    fitted = free @ values
    total = float(columns[:, 0] @ columns[:, 0])
    own = float(free[:, 0] @ free[:, 0]) / total if total > 0.0 else 0.0
    return float(fitted @ fitted), values, own, target - fitted


def _scatter(white: Array, shape: Array, places: NDArray[np.int64]) -> tuple[float, int]:
    """Return the level of slow noise, over that of white, and how many means of a part of the samples tell it."""
    n = max(4, len(places) // (2 * FEWEST))
    pieces = [places[k : k + n] for k in range(0, len(places) - n + 1, n)]
    means = [float(white[p] @ shape[p]) / max(float(np.linalg.norm(shape[p])), 1e-300) for p in pieces]
    return max(1.0, float(np.sqrt(np.mean(np.square(means))))), len(means)

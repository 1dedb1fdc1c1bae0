"""Orders of a turn in a residual: its spectrum over the angle, not over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.evidence.linalg import factored
from pmsm_ctrl.evidence.waves import PASSED
from pmsm_ctrl.regression.conditioning import Prepared
from pmsm_ctrl.residuals import policy

__all__ = ["order_spectrum", "strongest_orders", "waves"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


def waves(theta: Array, orders: Sequence[int]) -> Array:
    """Return cosine and sine of every order at angles of shape (n,), rad: shape (n, 2 len(orders))."""
    return np.column_stack([f(k * theta) for k in orders for f in (np.cos, np.sin)])


@dataclass(frozen=True, eq=False)
class _Waves:
    """The waves of all orders on the samples that count, slow ones first: all of a spectrum but the residual.

    Attributes
    ----------
    slow : int array, shape (n,)
        The samples, in the order of their speed.
    cosine, sine, w, d : array, shape (n,)
        Of the angle; square of the weight; direction.
    counts : int array, shape (highest,)
        Samples slow enough for each order.
    seen : bool array, shape (highest,)
        Orders of which enough is seen.
    both : bool
        Whether waves that change their sign with the direction count.
    solved : list
        Filled with what is the same for every residual.
    """

    slow: NDArray[np.int64]
    cosine: Array
    sine: Array
    w: Array
    d: Array
    counts: NDArray[np.int64]
    seen: Mask
    both: bool
    solved: list[tuple[Array, Mask]] = field(default_factory=list)

    def spectrum(self, residual: Array) -> tuple[Array, Array]:
        """Return amplitude and score of every order in a residual of shape (m,); see `order_spectrum`."""
        from pmsm_ctrl.kernels.orders import wave_sums

        highest = len(self.counts)
        amplitude, score = np.full(highest, np.nan), np.zeros(highest)
        if not np.any(self.seen):
            return amplitude, score
        w, d, r = self.w, self.d, residual[self.slow]
        products = np.column_stack([w, w * d, w * d * d, w * r, w * r * d])
        once, twice = np.empty((highest, 2, 5)), np.empty((highest, 2, 3))
        wave_sums(self.cosine, self.sine, products, self.counts, once, twice)
        places, count = np.flatnonzero(self.seen), self.counts[self.seen]
        none = np.cumsum(products, axis=0)[count - 1]
        power = np.cumsum(w * r * r)[count - 1]
        gram, right = _normal_equations(none, once[self.seen], twice[self.seen])
        # where the direction hangs on the angle, the wave that is the same either way is left
        ways = ((1, [0, 2, 3]), (2, [0, 1, 2, 3, 4, 5]))[: 1 + self.both]
        if not self.solved:
            self.solved.extend(_told_apart(gram[:, used][:, :, used]) for _, used in ways)
        for (base, used), (sound, well) in zip(ways, self.solved, strict=True):
            sizes, scores = _solved(sound, right[:, used], power, count, base)
            amplitude[places[well]], score[places[well]] = sizes[well], scores[well]
        return amplitude, score


def order_spectrum(
    prepared: Prepared,
    residual: Array,
    mask: Mask,
    weight: Array,
    highest: int = policy.HIGHEST_ORDER,
    friction: bool = True,
) -> tuple[Array, Array]:
    """Return amplitude and score of the mechanical orders 1 to `highest`, shape (highest,) each.

    Every order has a wave that is the same either way and, where the axis moves both ways and `friction` is allowed,
    one that changes its sign with the direction. The amplitude is that of the larger, NaN where no turn is slow enough
    to pass the filter; the score is the gain of the weighted sum of squares over the residual's per sample. Residual,
    mask and weight (relative inverse noise level) have shape (m,).
    """
    return _waves_of(prepared, mask, weight, highest, friction).spectrum(residual)


def _waves_of(
    prepared: Prepared, mask: Mask, weight: Array, highest: int = policy.HIGHEST_ORDER, friction: bool = True
) -> _Waves:
    signed = prepared.signals["omega"][prepared.keep]
    theta, omega, direction = prepared.signals["theta"][prepared.keep], np.abs(signed), np.sign(signed)
    both = friction and bool(policy.ONE_WAY < np.mean(direction[mask] > 0.0) < 1.0 - policy.ONE_WAY)
    # in order of speed, those slow enough for an order come first
    slow = np.flatnonzero(mask)[np.argsort(omega[mask], kind="stable")]
    omega, angle = omega[slow], theta[slow]
    orders = np.arange(1, highest + 1)
    counts = np.searchsorted(omega, 2.0 * np.pi * prepared.cutoff * PASSED / orders)
    travelled = np.cumsum(omega / prepared.thinned_rate)
    seen = counts >= max(policy.FEWEST, 1)
    seen[seen] = orders[seen] * travelled[counts[seen] - 1] >= 4.0 * np.pi
    seen &= (counts == len(angle)) | (orders * _visited(angle, counts) >= policy.PERIODS * (2.0 * np.pi))
    return _Waves(slow, np.cos(angle), np.sin(angle), weight[slow] ** 2, direction[slow], counts, seen, both)


def _visited(theta: Array, counts: NDArray[np.int64]) -> Array:
    """Return how much of a turn was seen slowly enough for each order, rad, shape (highest,).

    Around the reversals of a part of a turn the axis is slow enough for a high order, at the same few angles each time:
    there a part of one period is any smooth function. `theta` has shape (n,), of the slowest sample first; of an order
    the first `counts` are slow enough. A turn is divided into quarters of a period of the highest order of an octave.
    """
    highest = len(counts)
    out, end = np.zeros(highest), highest
    while end > 0:
        start, parts = end // 2, 4 * end
        first = np.unique(np.floor(theta * (parts / (2.0 * np.pi))) % parts, return_index=True)[1]
        visited = np.searchsorted(np.sort(first), counts[start:end])
        out[start:end] = visited * (2.0 * np.pi / parts)
        end = start
    return out


def _normal_equations(none: Array, once: Array, twice: Array) -> tuple[Array, Array]:
    """Return the normal equations of every order, shapes (k, 6, 6) and (k, 6).

    The columns are a constant, the direction d, the cosine and the sine that are the same either way, and both times d.
    Given are weighted sums of 1, d, d^2, r and r d: alone, shape (k, 5), and times cosine and sine of the order, shape
    (k, 2, 5), and of twice the order, shape (k, 2, 3), since the product of two waves has that order.
    """
    gram, right = np.zeros((len(none), 6, 6)), np.zeros((len(none), 6))
    for i in range(2):  # the power of d that comes with a column
        right[:, i] = none[:, 3 + i]
        right[:, 2 + 2 * i : 4 + 2 * i] = once[:, :, 3 + i]
        for j in range(2):
            waves_i, waves_j, power = slice(2 + 2 * i, 4 + 2 * i), slice(2 + 2 * j, 4 + 2 * j), i + j
            gram[:, i, j] = none[:, power]
            gram[:, i, waves_j] = once[:, :, power]
            gram[:, waves_j, i] = once[:, :, power]
            cosine, sine = twice[:, 0, power], twice[:, 1, power]
            even = none[:, power]
            block = [[even + cosine, sine], [sine, even - cosine]]
            gram[:, waves_i, waves_j] = 0.5 * np.moveaxis(np.array(block), -1, 0)
    return gram, right


def _told_apart(gram: Array) -> tuple[Array, Mask]:
    """Return normal equations that can be solved, and of which orders they are: where the waves can be told apart."""
    values = np.abs(np.linalg.eigvalsh(gram))
    well = values.max(axis=1) <= 1e3 * values.min(axis=1)
    return np.where(well[:, None, None], gram, np.eye(gram.shape[-1])), well


def _solved(
    sound: Array, right: Array, power: Array, count: NDArray[np.int64], base: int
) -> tuple[Array, Array]:  # fmt: skip
    """Amplitude and score of every order beyond the first `base` columns."""
    x = np.linalg.solve(sound, right[..., None])[..., 0]
    without = np.linalg.solve(sound[:, :base, :base], right[:, :base, None])[..., 0]
    explained = np.sum(right * x, axis=1)
    gain = explained - np.sum(right[:, :base] * without, axis=1)
    left = (power - explained) / (count - sound.shape[-1])
    amplitude = np.hypot(x[:, base::2], x[:, base + 1 :: 2]).max(axis=1)
    return amplitude, gain / np.maximum(left, 1e-300)


def strongest_orders(
    prepared: Prepared, residual: Array, mask: Mask, weight: Array, count: int
) -> tuple[Array, list[int], int]:
    """Return the spectrum, the orders that stand out, best first and `count` at most, and how many could be judged.

    One order at a time is taken out of the residual before the next is looked for: it leaks into its neighbours. The
    spectrum has shape (2, highest): amplitude of every order, and the one that noise alone exceeds in one order of a
    hundred spectra.
    """
    all_waves = _waves_of(prepared, mask, weight)
    first, score = all_waves.spectrum(residual)
    seen = int(np.sum(score > 0.0))
    if seen == 0:
        return np.stack([first, first]), [], 0
    # The largest of so many chi-squares with two degrees of freedom, in units of their median 2 ln 2: a residual that
    # hangs together from sample to sample has larger ones throughout.
    by_chance = 2.0 * np.log(seen / 0.01) * max(1.0, float(np.median(score[score > 0.0])) / (2.0 * np.log(2.0)))
    level = np.divide(first * np.sqrt(by_chance), np.sqrt(score), out=np.full_like(first, np.nan), where=score > 0.0)
    best, orders = float(score.max()), [int(np.argmax(score)) + 1]
    theta, direction = prepared.signals["theta"][prepared.keep], np.sign(prepared.signals["omega"][prepared.keep])
    w = (weight * mask)[:, None]
    while len(orders) < count:
        shape = waves(theta, orders)
        columns = np.hstack([shape, shape * direction[:, None], np.ones((len(theta), 1)), direction[:, None]])
        beta = factored(columns * w).solve(residual * w[:, 0])
        _, score = all_waves.spectrum(residual - columns @ beta)
        score[np.array(orders) - 1] = 0.0
        if score.max() < max(policy.ORDER_SCORE, policy.ORDER_SHARE * best):
            break
        orders.append(int(np.argmax(score)) + 1)
    return np.stack([first, level]), orders, seen

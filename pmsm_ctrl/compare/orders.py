"""Orders of a turn in a residual: its spectrum over the angle, not over time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.compare import policy
from pmsm_ctrl.regression.conditioning import Prepared

__all__ = ["order_spectrum", "strongest_orders", "waves"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


def waves(theta: Array, orders: Sequence[int]) -> Array:
    """Return cosine and sine of every order at angles of shape (n,), rad: shape (n, 2 len(orders))."""
    return np.column_stack([f(k * theta) for k in orders for f in (np.cos, np.sin)])


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
    signed = prepared.signals["omega"][prepared.keep]
    theta, omega, direction = prepared.signals["theta"][prepared.keep], np.abs(signed), np.sign(signed)
    both = friction and bool(policy.ONE_WAY < np.mean(direction[mask] > 0.0) < 1.0 - policy.ONE_WAY)
    amplitude, score = np.full(highest, np.nan), np.zeros(highest)
    step = np.exp(1j * theta)
    turning = np.ones_like(step)
    limit = 2.0 * np.pi * prepared.cutoff * policy.PASSED
    travel = omega / prepared.thinned_rate
    seen_orders, sums = [], []
    for k in range(1, highest + 1):
        turning = turning * step
        seen = mask & (k * omega < limit)
        if int(seen.sum()) < policy.FEWEST or k * float(travel[seen].sum()) < 4.0 * np.pi:
            continue
        seen_orders.append(k - 1)
        sums.append(_sums(turning[seen], weight[seen], residual[seen], direction[seen]))
    if not sums:
        return amplitude, score
    places = np.array(seen_orders)
    gram, right, power, count = (np.array(parts) for parts in zip(*sums, strict=True))
    # where the direction hangs on the angle, the wave that is the same either way is left
    for base, used in ((1, [0, 2, 3]), (2, [0, 1, 2, 3, 4, 5]))[: 1 + both]:
        sizes, scores, well = _solved(gram[:, used][:, :, used], right[:, used], power, count, base)
        amplitude[places[well]], score[places[well]] = sizes[well], scores[well]
    return amplitude, score


def _sums(turning: NDArray[np.complex128], w: Array, r: Array, d: Array) -> tuple[Array, Array, float, int]:
    """Normal equations of one order: constant, direction, the wave that is the same either way, the one that turns."""
    wave = [turning.real, turning.imag]
    a = np.column_stack([np.ones(len(r)), d, *wave, *(x * d for x in wave)]) * w[:, None]
    b = w * r
    return a.T @ a, a.T @ b, float(b @ b), len(r)


def _solved(gram: Array, right: Array, power: Array, count: Array, base: int) -> tuple[Array, Array, Mask]:
    """Amplitude and score of every order beyond the first `base` columns, and where its waves can be told apart."""
    well = np.linalg.cond(gram) <= 1e3
    sound = np.where(well[:, None, None], gram, np.eye(gram.shape[-1]))
    x = np.linalg.solve(sound, right[..., None])[..., 0]
    without = np.linalg.solve(sound[:, :base, :base], right[:, :base, None])[..., 0]
    explained = np.sum(right * x, axis=1)
    gain = explained - np.sum(right[:, :base] * without, axis=1)
    left = (power - explained) / (count - gram.shape[-1])
    amplitude = np.hypot(x[:, base::2], x[:, base + 1 :: 2]).max(axis=1)
    return amplitude, gain / np.maximum(left, 1e-300), well


def strongest_orders(
    prepared: Prepared, residual: Array, mask: Mask, weight: Array, count: int
) -> tuple[Array, list[int], int]:
    """Return the spectrum, the orders that stand out, best first and `count` at most, and how many could be judged.

    One order at a time is taken out of the residual before the next is looked for: it leaks into its neighbours. The
    spectrum has shape (2, highest): amplitude of every order, and the one that noise alone exceeds in one order of a
    hundred spectra.
    """
    first, score = order_spectrum(prepared, residual, mask, weight)
    seen = int(np.sum(score > 0.0))
    if seen == 0:
        return np.stack([first, first]), [], 0
    by_chance = 2.0 * np.log(seen / 0.01)  # of so many chi-squares with two degrees of freedom
    level = np.divide(first * np.sqrt(by_chance), np.sqrt(score), out=np.full_like(first, np.nan), where=score > 0.0)
    best, orders = float(score.max()), [int(np.argmax(score)) + 1]
    theta, direction = prepared.signals["theta"][prepared.keep], np.sign(prepared.signals["omega"][prepared.keep])
    w = (weight * mask)[:, None]
    while len(orders) < count:
        shape = waves(theta, orders)
        columns = np.hstack([shape, shape * direction[:, None], np.ones((len(theta), 1)), direction[:, None]])
        beta = np.linalg.lstsq(columns * w, residual * w[:, 0], rcond=1e-6)[0]
        _, score = order_spectrum(prepared, residual - columns @ beta, mask, weight)
        score[np.array(orders) - 1] = 0.0
        if score.max() < max(policy.ORDER_SCORE, policy.ORDER_SHARE * best):
            break
        orders.append(int(np.argmax(score)) + 1)
    return np.stack([first, level]), orders, seen

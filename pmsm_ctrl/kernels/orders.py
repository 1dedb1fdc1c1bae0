"""Sums over the waves of many orders of a turn, in one pass over the samples an order."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.kernels import kernel

__all__ = ["apart_sums", "faded_sums", "wave_sums"]

Array = NDArray[np.float64]


@kernel
def wave_sums(
    cosine: Array, sine: Array, products: Array, counts: NDArray[np.int64], once: Array, twice: Array
) -> None:
    """Sum products times the wave of every order, and of twice the order.

    Parameters
    ----------
    cosine, sine : array, shape (n,)
        Of the angle.
    products : array, shape (n, 5)
    counts : int array, shape (orders,)
        Samples that an order takes, the first ones; never more than the order before it.
    once : array, shape (orders, 2, 5)
        Filled: sums with the cosine and the sine of the order.
    twice : array, shape (orders, 2, 3)
        Filled: the same of twice the order, with the first three products.
    """
    c, s = np.ones(cosine.size), np.zeros(cosine.size)
    for k in range(counts.size):
        a0 = a1 = a2 = a3 = a4 = b0 = b1 = b2 = b3 = b4 = 0.0
        d0 = d1 = d2 = e0 = e1 = e2 = 0.0
        for i in range(counts[k]):
            x = c[i] * cosine[i] - s[i] * sine[i]
            y = c[i] * sine[i] + s[i] * cosine[i]
            c[i], s[i] = x, y
            p0, p1, p2, p3, p4 = products[i, 0], products[i, 1], products[i, 2], products[i, 3], products[i, 4]
            a0 += x * p0
            a1 += x * p1
            a2 += x * p2
            a3 += x * p3
            a4 += x * p4
            b0 += y * p0
            b1 += y * p1
            b2 += y * p2
            b3 += y * p3
            b4 += y * p4
            u, v = x * x - y * y, 2.0 * x * y
            d0 += u * p0
            d1 += u * p1
            d2 += u * p2
            e0 += v * p0
            e1 += v * p1
            e2 += v * p2
        once[k, 0, 0], once[k, 0, 1], once[k, 0, 2], once[k, 0, 3], once[k, 0, 4] = a0, a1, a2, a3, a4
        once[k, 1, 0], once[k, 1, 1], once[k, 1, 2], once[k, 1, 3], once[k, 1, 4] = b0, b1, b2, b3, b4
        twice[k, 0, 0], twice[k, 0, 1], twice[k, 0, 2] = d0, d1, d2
        twice[k, 1, 0], twice[k, 1, 1], twice[k, 1, 2] = e0, e1, e2


@kernel
def apart_sums(
    theta: Array, values: Array, edges: NDArray[np.int64], enough: float, sums: Array, span: Array
) -> None:  # fmt: skip
    """Sum values times the conjugate wave of every order, bin by bin, over odd and over even pieces of time apart.

    Parameters
    ----------
    theta : array, shape (n,)
        Angle, rad.
    values : array, shape (2, n)
        What is demodulated, in odd pieces and in even ones; 0 in the others.
    edges : int array, shape (orders, bins + 1)
        Samples at which the bins of an order begin, and its last end, which never comes after that of the order before.
    enough : float
        Angle, rad, beyond which no span is measured.
    sums : array, shape (orders, bins, 2, 2)
        Filled: odd and even pieces, real and imaginary part.
    span : array, shape (orders,)
        Filled: the greatest angle of an order's samples less the smallest, or `enough` or more of it.
    """
    turn_c, turn_s = np.cos(theta), np.sin(theta)
    c, s = np.ones(theta.size), np.zeros(theta.size)
    bins = edges.shape[1] - 1
    for k in range(edges.shape[0]):
        for i in range(edges[k, bins]):
            x = c[i] * turn_c[i] - s[i] * turn_s[i]
            s[i] = c[i] * turn_s[i] + s[i] * turn_c[i]
            c[i] = x
        for b in range(bins):
            first, stop = edges[k, b], edges[k, b + 1]
            for piece in range(2):
                some = values[piece, first:stop]
                sums[k, b, piece, 0] = np.dot(some, c[first:stop])
                sums[k, b, piece, 1] = -np.dot(some, s[first:stop])
        low, high = np.inf, -np.inf
        for i in range(edges[k, 0], edges[k, bins]):
            low, high = min(low, theta[i]), max(high, theta[i])
            if high - low >= enough:
                break
        span[k] = high - low


@kernel
def faded_sums(
    cosine: Array, sine: Array, faded: Array, power: float, signals: Array, rights: Array, grams: Array,
    travelled: Array,
) -> None:  # fmt: skip
    """Sum the wave of every order, faded with the speed, times a residual and times itself.

    Parameters
    ----------
    cosine, sine : array, shape (n,)
        Of the angle.
    faded : array, shape (n,)
        Order 1 is divided by one plus this, order k by one plus k to the `power` times this.
    power : float
    signals : array, shape (3, n)
        Weight of the wave, weighted residual, speed.
    rights : array, shape (orders, 2)
        Filled: sums of the residual with cosine and sine.
    grams : array, shape (orders, 2, 2)
        Filled: sums of the products of cosine and sine.
    travelled : array, shape (orders,)
        Filled: sums of the speed, faded.
    """
    c, s = np.ones(cosine.size), np.zeros(cosine.size)
    for k in range(travelled.size):
        scale = float(k + 1) ** power
        right_c = right_s = cc = cs = ss = path = 0.0
        for i in range(cosine.size):
            x = c[i] * cosine[i] - s[i] * sine[i]
            y = c[i] * sine[i] + s[i] * cosine[i]
            c[i], s[i] = x, y
            passed = 1.0 / (1.0 + scale * faded[i])
            path += passed * signals[2, i]
            x *= signals[0, i] * passed
            y *= signals[0, i] * passed
            right_c += x * signals[1, i]
            right_s += y * signals[1, i]
            cc += x * x
            cs += x * y
            ss += y * y
        rights[k, 0], rights[k, 1], travelled[k] = right_c, right_s, path
        grams[k, 0, 0], grams[k, 0, 1], grams[k, 1, 0], grams[k, 1, 1] = cc, cs, cs, ss

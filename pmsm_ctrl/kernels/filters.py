"""Compiled filters: zero-phase low-pass with thinning, and whitening by short filters.

A recursive filter waits for its own last output, so that one column alone leaves most of the processor idle. Columns
side by side in memory are filtered in the same instructions.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.kernels import inlined, kernel, uncontracted

__all__ = [
    "LANES",
    "central_differences",
    "coloured_back",
    "followed",
    "moved",
    "reflections",
    "thinned_zero_phase",
    "whitened",
    "zero_phase",
]

Array = NDArray[np.float64]

LANES = 16  # columns side by side: two cache lines
AT_ONCE = 1024  # samples that stay in the cache while every lag is added
FEW = 3  # columns; fewer are filtered one by one, with the filter's state in registers
VECTOR, TILE = 8, 64  # columns of a whole vector register; samples that are transposed in the cache


@uncontracted
def _recursive(rows: Array, sections: Array, settled: Array, backward: bool) -> None:
    """Run second-order sections over rows of shape (n, lanes), in place, from rest at the first value.

    Direct form II transposed: bit for bit what scipy's ``sosfilt`` does.
    """
    n, lanes = rows.shape
    count = sections.shape[0]
    state = np.empty((count, 2, lanes))
    first = n - 1 if backward else 0
    for s in range(count):
        for c in range(lanes):
            state[s, 0, c] = settled[s, 0] * rows[first, c]
            state[s, 1, c] = settled[s, 1] * rows[first, c]
    for k in range(n):
        i = n - 1 - k if backward else k
        for s in range(count):
            b0, b1, b2 = sections[s, 0], sections[s, 1], sections[s, 2]
            a1, a2 = sections[s, 4], sections[s, 5]
            for c in range(lanes):
                x = rows[i, c]
                y = b0 * x + state[s, 0, c]
                state[s, 0, c] = b1 * x - a1 * y + state[s, 1, c]
                state[s, 1, c] = b2 * x - a2 * y
                rows[i, c] = y


@uncontracted
def _four_sections(rows: Array, sections: Array, settled: Array, backward: bool) -> None:
    """Do what `_recursive` does for one column and at most four sections, whose state stays in registers."""
    a = np.zeros((4, 6))
    rest = np.zeros((4, 2))
    for s in range(4):  # element by element: numba compiles the message of a wrong shape with every whole row
        a[s, 0] = 1.0  # a section that passes everything
        if s < sections.shape[0]:
            for j in range(6):
                a[s, j] = sections[s, j]
            rest[s, 0], rest[s, 1] = settled[s, 0], settled[s, 1]
    n = rows.shape[0]
    x = rows[n - 1 if backward else 0, 0]
    p0, p1, p2, p3 = rest[0, 0] * x, rest[1, 0] * x, rest[2, 0] * x, rest[3, 0] * x
    q0, q1, q2, q3 = rest[0, 1] * x, rest[1, 1] * x, rest[2, 1] * x, rest[3, 1] * x
    for k in range(n):
        i = n - 1 - k if backward else k
        x = rows[i, 0]
        y = a[0, 0] * x + p0
        p0 = a[0, 1] * x - a[0, 4] * y + q0
        q0 = a[0, 2] * x - a[0, 5] * y
        x = a[1, 0] * y + p1
        p1 = a[1, 1] * y - a[1, 4] * x + q1
        q1 = a[1, 2] * y - a[1, 5] * x
        y = a[2, 0] * x + p2
        p2 = a[2, 1] * x - a[2, 4] * y + q2
        q2 = a[2, 2] * x - a[2, 5] * y
        x = a[3, 0] * y + p3
        p3 = a[3, 1] * y - a[3, 4] * x + q3
        q3 = a[3, 2] * y - a[3, 5] * x
        rows[i, 0] = x


@uncontracted
def _two_sections(rows: Array, sections: Array, settled: Array, backward: bool) -> None:
    """Do what `_recursive` does for one column and two sections: their coefficients stay in registers as well."""
    b0, b1, b2, a1, a2 = sections[0, 0], sections[0, 1], sections[0, 2], sections[0, 4], sections[0, 5]
    d0, d1, d2, c1, c2 = sections[1, 0], sections[1, 1], sections[1, 2], sections[1, 4], sections[1, 5]
    n = rows.shape[0]
    x = rows[n - 1 if backward else 0, 0]
    p0, q0, p1, q1 = settled[0, 0] * x, settled[0, 1] * x, settled[1, 0] * x, settled[1, 1] * x
    for k in range(n):
        i = n - 1 - k if backward else k
        x = rows[i, 0]
        y = b0 * x + p0
        p0 = b1 * x - a1 * y + q0
        q0 = b2 * x - a2 * y
        x = d0 * y + p1
        p1 = d1 * y - c1 * x + q1
        q1 = d2 * y - c2 * x
        rows[i, 0] = x


@uncontracted
def zero_phase(values: Array, sections: Array, settled: Array, pad: int, step: int, out: Array) -> None:
    """Filter forward and backward, both ends mirrored in their last value, and keep every `step`-th sample.

    Parameters
    ----------
    values : array, shape (k, n)
    sections : array, shape (sections, 6)
        Second-order sections.
    settled : array, shape (sections, 2)
        Their state after a constant one.
    pad : int
        Samples by which both ends are continued, below n.
    step : int
    out : array, shape (k, ceil(n / step))
        Filled.
    """
    columns, n = values.shape
    few = columns < FEW and len(sections) <= 4
    most = 1 if few else LANES
    for start in range(0, columns, most):
        count = min(most, columns - start)
        # empty lanes cost less than lanes that fill no whole vector
        lanes = 1 if few else (count + VECTOR - 1) // VECTOR * VECTOR
        rows = np.zeros((n + 2 * pad, lanes))
        for first in range(0, n, TILE):
            for c in range(count):
                for i in range(first, min(first + TILE, n)):
                    rows[pad + i, c] = values[start + c, i]
        for i in range(pad):
            for c in range(lanes):
                rows[i, c] = 2.0 * rows[pad, c] - rows[2 * pad - i, c]
                rows[pad + n + i, c] = 2.0 * rows[pad + n - 1, c] - rows[pad + n - 2 - i, c]
        for backward in (False, True):  # a variable: numba compiles a function anew for every constant
            part = rows[pad:] if backward else rows
            if few and len(sections) == 2:
                _two_sections(part, sections, settled, backward)
            elif few:
                _four_sections(part, sections, settled, backward)
            else:
                _recursive(part, sections, settled, backward)
        for first in range(0, out.shape[1], TILE):
            for c in range(count):
                for j in range(first, min(first + TILE, out.shape[1])):
                    out[start + c, j] = rows[pad + j * step, c]


@inlined
def _mirrored(values: Array, i: int) -> float:
    """One sample of a signal whose ends are continued by mirroring in their last value."""
    last = values.size - 1
    if i < 0:
        return float(2.0 * values[0] - values[-i])
    if i > last:
        return float(2.0 * values[last] - values[2 * last - i])
    return float(values[i])


@inlined
def _turned(state: Array, turns: Array, k: int, re: float, im: float) -> None:
    """Let a mode decay, and add to it."""
    x, y = state[2 * k], state[2 * k + 1]
    state[2 * k] = turns[2 * k] * x - turns[2 * k + 1] * y + re
    state[2 * k + 1] = turns[2 * k + 1] * x + turns[2 * k] * y + im


@kernel
def _settle_and_pass(values: Array, first: int, last: int, turns: Array, weights: Array, state: Array) -> None:
    """Let the modes take up samples one by one, from the first to before the last, forward or backward in time."""
    by = 1 if last > first else -1
    for i in range(first, last, by):
        x = _mirrored(values, i)
        for k in range(turns.size // 2):
            _turned(state, turns, k, weights[2 * k] * x, weights[2 * k + 1] * x)


@kernel
def thinned_zero_phase(
    values: Array, pad: int, step: int, poles: Array, leaps: Array, settled: Array, sums: Array, between: Array,
    ahead: Array, last: Array, own: float, shared: Array, out: Array,
) -> None:  # fmt: skip
    """Filter forward and backward, and work out nothing but every `step`-th sample; both ends as in `zero_phase`.

    What both passes do together is a sum of modes that decay forward in time and of such that decay backward. Blocks
    hold B of the samples that are kept. Over a block every mode decays once, and a weighted sum of its samples is added
    to it; what the samples of a block do to each other is another one. A mode is two numbers, real and imaginary part;
    there are L of them.

    Parameters
    ----------
    values : array, shape (n,)
    pad : int
        Samples by which both ends are continued, at least as many as a block has, and below n.
    step : int
    poles, leaps : array, shape (L,)
        Decay of the modes within a sample, and within a block.
    settled : array, shape (L,)
        The modes of one pass after a constant one.
    sums : array, shape (B step, 2 L + B)
        What a block of samples adds to the modes that decay forward, to those that decay backward, and to the values of
        the block that are kept.
    between : array, shape (2 L, B)
        The modes that decay forward, before a block, and those that decay backward, after it, in these values.
    ahead : array, shape (L,)
        What one sample adds to the modes that decay backward.
    last : array, shape (L,)
        The modes of the forward pass in its output.
    own : float
        A sample in it.
    shared : array, shape (L, L)
        What the modes of the backward pass have of those of the forward pass.
    out : array, shape (ceil(n / step),)
        Filled.
    """
    n, count, size = values.size, out.size, poles.size
    leap, kept = sums.shape[0], sums.shape[1] - 2 * size
    blocks = (count + kept - 1) // kept
    whole = min(n // leap, blocks)
    total, around = np.empty((blocks, sums.shape[1])), np.empty((blocks, 2 * size))
    np.dot(values[: whole * leap].reshape(whole, leap), sums, total[:whole])
    block = np.empty((1, leap))
    for b in range(whole, blocks):  # it reaches beyond the end
        for i in range(leap):
            block[0, i] = _mirrored(values, b * leap + i)
        np.dot(block, sums, total[b : b + 1])
    one = np.zeros(size)
    one[::2] = 1.0
    begin = -pad  # and no 0 below, for which it would be compiled once more
    state, behind = settled * _mirrored(values, begin), np.empty(size)
    _settle_and_pass(values, begin, begin + pad, poles, one, state)
    for b in range(blocks):
        for k in range(size):
            around[b, k] = state[k]
        for k in range(size // 2):
            _turned(state, leaps, k, total[b, 2 * k], total[b, 2 * k + 1])
    end = n + pad - 1
    _settle_and_pass(values, blocks * leap, end, poles, one, state)
    passed = own * _mirrored(values, end)
    for k in range(size):
        passed += last[k] * state[k]
    _settle_and_pass(values, end, end + 1, poles, one, state)
    for k in range(size):  # the backward pass starts settled at the last output of the forward one
        behind[k] = settled[k] * passed
        for j in range(size):
            behind[k] -= shared[k, j] * state[j]
    _settle_and_pass(values, end, blocks * leap - 1, poles, ahead, behind)
    for b in range(blocks - 1, -1, -1):
        for k in range(size):
            around[b, size + k] = behind[k]
        for k in range(size // 2):
            _turned(behind, leaps, k, total[b, size + 2 * k], total[b, size + 2 * k + 1])
    passing = np.dot(around, between)
    for b in range(blocks):
        for j in range(min(kept, count - b * kept)):
            out[b * kept + j] = total[b, 2 * size + j] + passing[b, j]


@uncontracted
def central_differences(values: Array, weights: Array, period: float, out: Array) -> None:
    """Differentiate samples of shape (n,) by weights of pairs around each, and by the next ones at either end.

    Parameters
    ----------
    values : array, shape (n,)
    weights : array, shape (reach,)
        Of ``values[i + j] - values[i - j]`` for j = 1 to reach, which is below n / 2.
    period : float
    out : array, shape (n,)
        Filled.
    """
    reach, count, last = weights.size, values.size - 2 * weights.size, values.size - 1
    out[0], out[last] = (values[1] - values[0]) / period, (values[last] - values[last - 1]) / period
    for i in range(1, reach):
        out[i] = (values[i + 1] - values[i - 1]) / (2.0 * period)
        out[last - i] = (values[last - i + 1] - values[last - i - 1]) / (2.0 * period)
    inner = out[reach : reach + count]
    if reach == 4:  # of all columns: in one pass, and the same bits
        w0, w1, w2, w3 = weights[0], weights[1], weights[2], weights[3]
        for i in range(count):
            total = w0 * (values[i + 5] - values[i + 3])
            total += w1 * (values[i + 6] - values[i + 2])
            total += w2 * (values[i + 7] - values[i + 1])
            total += w3 * (values[i + 8] - values[i])
            inner[i] = total / period
        return
    inner[:] = 0.0
    for j in range(reach):
        weight, later, earlier = weights[j], values[reach + j + 1 :], values[reach - j - 1 :]
        for i in range(count):
            inner[i] += weight * (later[i] - earlier[i])
    for i in range(count):
        inner[i] /= period


@kernel
def moved(values: Array, by: float, out: Array) -> None:
    """Evaluate the cubic spline through samples of a uniform grid at times that all lie as far from the samples.

    Its third derivative has no jump at the second and the last but one sample ("not a knot").
    Source: C. de Boor, A Practical Guide to Splines, Springer 2001, ch. IV.

    Parameters
    ----------
    values : array, shape (n,)
        n is at least 4.
    by : float
        How much later, in samples; both ends are continued.
    out : array, shape (n,)
        Filled.
    """
    n = values.size
    slope, share = np.empty(n), np.empty(n)
    slope[0], share[0] = 0.5 * (values[2] + 4.0 * values[1] - 5.0 * values[0]), 2.0
    for i in range(1, n - 1):
        share[i] = 1.0 / (4.0 - share[i - 1])
        slope[i] = (3.0 * (values[i + 1] - values[i - 1]) - slope[i - 1]) * share[i]
    last = 0.5 * (5.0 * values[n - 1] - 4.0 * values[n - 2] - values[n - 3])
    slope[n - 1] = (last - 2.0 * slope[n - 2]) / (1.0 - 2.0 * share[n - 2])
    for i in range(n - 2, -1, -1):
        slope[i] -= share[i] * slope[i + 1]
    whole = int(np.floor(by))
    x = by - whole
    for i in range(n):
        k = i + whole
        if k < 0 or k >= n - 1:
            out[i] = values[0 if k < 0 else n - 1]
            continue
        rise = values[k + 1] - values[k]
        bent, curved = slope[k] + slope[k + 1] - 2.0 * rise, 3.0 * rise - 2.0 * slope[k] - slope[k + 1]
        out[i] = values[k] + x * (slope[k] + x * (curved + x * bent))


@kernel
def whitened(values: Array, position: NDArray[np.int64], filters: Array, out: Array) -> None:
    """Apply to every sample the filter of as many predecessors as it has in its stretch.

    Parameters
    ----------
    values : array, shape (k, n)
    position : int array, shape (n,)
        Number of samples before each one in its own stretch.
    filters : array, shape (order + 1, order + 1)
        Row o holds the coefficients of lags 0 to o.
    out : array, shape (k, n)
        Overwritten.
    """
    order = filters.shape[0] - 1
    columns, n = values.shape
    for c in range(columns):
        for start in range(0, n, AT_ONCE):
            stop = min(start + AT_ONCE, n)
            for i in range(start, stop):
                out[c, i] = filters[order, 0] * values[c, i]
            for lag in range(1, order + 1):
                weight, first = filters[order, lag], max(start, lag)
                later, earlier = out[c, first:stop], values[c, first - lag :]
                for i in range(later.size):
                    later[i] += weight * earlier[i]
        for i in range(n):
            known = position[i]
            if known < order:
                total = 0.0
                for lag in range(known + 1):
                    total += filters[known, lag] * values[c, i - lag]
                out[c, i] = total


@kernel
def coloured_back(values: Array, position: NDArray[np.int64], filters: Array, out: Array) -> None:
    """Solve with the transposed matrix of `whitened`: ``W' out = values``; arguments as there."""
    order = filters.shape[0] - 1
    columns, n = values.shape
    for c in range(columns):
        for i in range(n):
            out[c, i] = values[c, i]
        for i in range(n - 1, -1, -1):
            known = min(position[i], order)
            x = out[c, i] / filters[known, 0]
            out[c, i] = x
            for lag in range(1, known + 1):
                out[c, i - lag] -= filters[known, lag] * x


@kernel
def followed(values: Array, half: float, out: Array) -> None:
    """Follow values of shape (n,), from zero, only where they leave a play of `half` around the last one."""
    last = 0.0
    for i in range(values.size):
        last = min(max(last, values[i] - half), values[i] + half)
        out[i] = last


@kernel
def reflections(values: Array, lengths: NDArray[np.int64], out: Array) -> None:
    """Find the reflection coefficients of an autoregressive process by Burg's method.

    Parameters
    ----------
    values : array, shape (n,)
        Separate stretches of the process, one after the other.
    lengths : int array
        Of the stretches.
    out : array, shape (order,)
        Filled; zero where the prediction errors vanish.
    """
    forward, backward = values.copy(), values.copy()
    for stage in range(1, out.size + 1):
        power = along = 0.0
        start = 0
        for length in lengths:
            for i in range(start + stage, start + length):
                power += forward[i] * forward[i] + backward[i - 1] * backward[i - 1]
                along += forward[i] * backward[i - 1]
            start += length
        k = -2.0 * along / power if power > 0.0 else 0.0
        out[stage - 1] = k
        start = 0
        for length in lengths:
            for i in range(start + length - 1, start + stage - 1, -1):
                f, b = forward[i], backward[i - 1]
                forward[i] = f + k * b
                backward[i] = b + k * f
            start += length

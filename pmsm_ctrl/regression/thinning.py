"""The zero-phase low-pass of every column of a regression, worked out at the samples that are kept alone; and back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from pmsm_ctrl.regression.filters import ORDER, RIPPLE, low_pass, mirrored

__all__ = ["interpolated", "thinned"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

SIDE_LOBES = 8.0  # Kaiser's parameter: 80 dB
# Samples of the thinned grid on either side from which one is interpolated, and those between which it is done at once.
SINC, PART = 24, 4096
AT_ONCE = 8  # samples that are kept of a block, at most: more are more products, fewer more steps of the modes


@dataclass(frozen=True, eq=False)
class _Modes:
    """The filter, run forward and backward, as modes that decay; see `thinned_zero_phase`."""

    poles: Array
    leaps: Array
    settled: Array
    sums: Array
    between: Array
    ahead: Array
    last: Array
    own: float
    shared: Array


def thinned(signals: Sequence[Array] | Array, rate: float, cutoff: float, step: int) -> Array:
    """Filter signals steeply, as `low_pass` does, and keep every so many samples: the same but for rounding.

    Parameters
    ----------
    signals : arrays of shape (n,), or array, shape (k, n)
    rate : float
        Of the samples, Hz.
    cutoff : float
        Hz.
    step : int
        Every so many samples one is kept.

    Returns
    -------
    array, shape (k, ceil(n / step))
    """
    from pmsm_ctrl.kernels.filters import thinned_zero_phase

    n = signals[0].shape[-1]
    pad = mirrored(n, rate, cutoff)
    out = np.empty((len(signals), -(-n // step)))
    if step == 1 or pad < step:
        for values, row in zip(signals, out, strict=True):
            row[:] = low_pass(values, rate, cutoff, steep=True, step=step)
        return out
    m = _modes(rate, cutoff, step, min(AT_ONCE, pad // step))
    for values, row in zip(signals, out, strict=True):
        if not (values.dtype == np.float64 and values.flags.c_contiguous and values.flags.writeable):
            # a writeable array, as the channels of a log are not: numba compiles the filter for each kind
            values = np.require(values, np.float64, ["C", "W"])
        thinned_zero_phase(
            values, pad, step, m.poles, m.leaps, m.settled, m.sums, m.between,
            m.ahead, m.last, m.own, m.shared, row,
        )  # fmt: skip
    return out


def interpolated(values: Array, step: int) -> Array:
    """Return a signal of a thinned grid on one that is so many times as fine; both ends are continued.

    The band reaches up to nine tenths of what the grid resolves, where a spline would lose half of a slope.

    Parameters
    ----------
    values : array, shape (m,)
    step : int

    Returns
    -------
    array, shape (m * step,)
        The given array where `step` is 1.
    """
    if step == 1:
        return values
    weights, padded = _between(step), np.pad(values, SINC, mode="edge")
    out = np.empty((len(values), step))
    for start in range(0, len(values), PART):
        part = out[start : start + PART]
        around = sliding_window_view(padded[start : start + len(part) + 2 * SINC], 2 * SINC + 1)
        np.matmul(np.ascontiguousarray(around), weights, out=part)
    return out.ravel()


@lru_cache(maxsize=8)
def _between(step: int) -> Array:
    """Weights of the samples around each for the values from it up to the next one, shape (2 SINC + 1, step)."""
    from scipy.signal import firwin

    taps = step * firwin(2 * SINC * step + 1, 1.0 / step, window=("kaiser", SIDE_LOBES))
    return np.ascontiguousarray(np.pad(taps, (0, step - 1)).reshape(-1, step)[::-1])


@lru_cache(maxsize=16)
def _modes(rate: float, cutoff: float, step: int, kept: int) -> _Modes:
    """Expand the two passes in partial fractions, for blocks that hold so many of the samples that are kept.

    One pass has the states ``s[n + 1] = p s[n] + x[n]`` and the output ``w[n] = c s[n] + d x[n]``. The states of the
    backward pass are ``r[n] = q[n] + P s[n + 1]``, where q hangs on later samples alone: ``P = p P p + c`` and
    ``q[n - 1] = p q[n] + (p P + d) x[n]``. Both passes together answer a single sample alike before and after it.
    """
    from scipy.signal import cheby1

    zeros, p, d = cheby1(ORDER, RIPPLE, cutoff, fs=rate, output="zpk")
    c = np.array([d * np.prod(one - zeros) / np.prod(one - np.delete(p, k)) for k, one in enumerate(p)])
    shared = c / (1.0 - np.multiply.outer(p, p))
    ahead = p * shared.sum(axis=1) + d
    causal = (c @ shared) * p + d * c
    above = np.flatnonzero(p.imag > 0.0)  # of each pair one
    below = np.array([int(np.argmin(np.abs(p - p[k].conj()))) for k in above])
    leap, at = kept * step, step * np.arange(kept)
    q, early = p[above], np.arange(leap)[:, None]
    answer = 2.0 * np.real(q ** np.maximum(early - 1, 0) @ (c * ahead)[above])
    answer[0] = float(np.real(c @ shared.sum(axis=1))) + d * d
    sums = np.hstack([_parts(q ** (leap - 1 - early)), _parts(q**early * ahead[above]), answer[np.abs(early - at)]])
    before, after = causal[above] * q ** at[:, None], c[above] * q ** (leap - 1 - at[:, None])
    # of a pair's states a + jb and a - jb the sum of both is a real one, and so is what either adds to it
    one, other = shared[np.ix_(above, above)], shared[np.ix_(above, below)]
    mixed = np.stack([_parts((one + other).T), _parts(1j * (one - other).T)], axis=1).reshape(2 * len(q), -1).T
    return _Modes(
        _parts(q), _parts(q**leap), _parts(1.0 / (1.0 - q)), np.ascontiguousarray(sums),
        np.vstack([_in_value(before).T, _in_value(after).T]), _parts(ahead[above]), _in_value(c[above]), float(d),
        np.ascontiguousarray(mixed),
    )  # fmt: skip


def _parts(values: Complex) -> Array:
    """Real and imaginary parts side by side, along the last axis."""
    return np.stack([values.real, values.imag], axis=-1).reshape(*values.shape[:-1], -1)


def _in_value(weights: Complex) -> Array:
    """What the real and imaginary parts of the modes of a pair count in the sum of both."""
    return _parts(2.0 * weights.conj())

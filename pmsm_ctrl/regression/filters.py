"""Zero-phase low-pass filters and numerical derivatives of uniformly sampled signals."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.errors import RequestError

__all__ = ["ORDER", "RIPPLE", "SIDE_BY_SIDE", "derivative", "low_pass", "low_pass_each", "mirrored", "shifted"]

Array = NDArray[np.float64]

# Central differences over 3 and 9 points (exact to degree 2 and 8): weights of x[k+j] - x[k-j].
# B. Fornberg, Mathematics of Computation 51 (1988) 699.
_STENCILS: dict[str, tuple[float, ...]] = {
    "central": (1 / 2,),
    "nine_point": (4 / 5, -1 / 5, 4 / 105, -1 / 280),
}


def derivative(values: Array, period: float, method: str = "nine_point") -> Array:
    """Differentiate samples of a uniform grid, shape (n,), their period in s.

    The last few samples at either end are of second order only.

    Raises
    ------
    RequestError
        For an unknown method.
    """
    if method not in _STENCILS:
        raise RequestError(f"derivative '{method}': known are nine_point, central")
    weights = _STENCILS[method]
    n = len(values)
    if n <= 2 * len(weights):
        return np.gradient(values, period)
    from pmsm_ctrl.kernels.filters import central_differences

    out = np.empty(n)
    central_differences(np.require(values, np.float64, ["C", "W"]), np.array(weights), period, out)
    return out


def shifted(values: Array, period: float, by: float) -> Array:
    """Return samples of a uniform grid at times that lie `by` later, by a cubic spline; the ends are continued.

    Parameters
    ----------
    values : array, shape (n,)
    period : float
        s.
    by : float
        s.

    Returns
    -------
    array, shape (n,)
    """
    from pmsm_ctrl.kernels.filters import moved

    out = np.empty(len(values))
    moved(np.require(values, np.float64, ["C", "W"]), by / period, out)
    return out


ORDER, RIPPLE = 8, 0.05  # of the Chebyshev filter; dB
SIDE_BY_SIDE = 1_000_000  # samples of all signals that are filtered at once, at most


def mirrored(n: int, rate: float, cutoff: float) -> int:
    """Return by how many samples both ends of n are continued.

    Parameters
    ----------
    n : int
    rate, cutoff : float
        Hz.
    """
    return min(n - 1, round(3.0 * rate / cutoff))


def low_pass(values: Array, rate: float, cutoff: float, steep: bool = False, step: int = 1) -> Array:
    """Filter forward and backward along the last axis, so that nothing shifts in time.

    Butterworth of fourth order, or where `steep` the Chebyshev filter of eighth order with 0.05 dB ripple
    that is customary before thinning; run twice, both attenuate twice. Both ends are continued by mirroring in their
    last value, and the filter starts settled: scipy's ``sosfiltfilt``, bit for bit.

    Parameters
    ----------
    values : array, shape (..., n)
    rate : float
        Of the samples, Hz.
    cutoff : float
        Hz.
    steep : bool
        Chebyshev in place of Butterworth.
    step : int
        Every so many samples one is kept.

    Returns
    -------
    array, shape (..., ceil(n / step))
    """
    from pmsm_ctrl.kernels.filters import zero_phase

    sections, settled = _sections(rate, cutoff, steep)
    n = values.shape[-1]
    # a writeable array, as the channels of a log are not: numba compiles the filter for each kind
    flat = np.require(values, np.float64, ["C", "W"]).reshape(-1, n)
    out = np.empty((*values.shape[:-1], -(-n // step)))
    zero_phase(flat, sections, settled, mirrored(n, rate, cutoff), step, out.reshape(-1, out.shape[-1]))
    return out


def low_pass_each(signals: Sequence[Array], rate: float, cutoff: float) -> list[Array]:
    """Return several signals of one length after `low_pass`: side by side, which is faster, where they are not long.

    Parameters
    ----------
    signals : sequence of array, shape (n,)
    rate, cutoff : float
        Hz.
    """
    if sum(len(one) for one in signals) > SIDE_BY_SIDE:
        return [low_pass(one, rate, cutoff) for one in signals]
    return list(low_pass(np.stack(signals), rate, cutoff)) if len(signals) else []


@lru_cache(maxsize=32)
def _sections(rate: float, cutoff: float, steep: bool) -> tuple[Array, Array]:
    """Second-order sections of a low-pass, and their state after a constant one, shape (sections, 2)."""
    from scipy.signal import butter, cheby1, sosfilt_zi

    design = cheby1(ORDER, RIPPLE, cutoff, fs=rate, output="sos") if steep else butter(4, cutoff, fs=rate, output="sos")
    return np.array(design), np.array(sosfilt_zi(design))

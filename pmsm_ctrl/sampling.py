"""First-order filters as a drive samples them: exact for a value that is held over a period."""

from __future__ import annotations

import math

__all__ = ["filter_delay", "smoothing", "speed_lag", "time_constant"]


def smoothing(period: float, time_constant: float) -> float:
    """Gain a of the exact first-order filter x += a (u - x) per period; 1 where there is no filter.

    Parameters
    ----------
    period, time_constant : float
        s.

    Returns
    -------
    float
    """
    return 1.0 if time_constant == 0.0 else -math.expm1(-period / time_constant)


def filter_delay(period: float, time_constant: float) -> float:
    """Delay of that filter at low frequency, s: T (1 - a) / a, somewhat less than its time constant.

    Parameters
    ----------
    period, time_constant : float
        s.

    Returns
    -------
    float
    """
    a = smoothing(period, time_constant)
    return period * (1.0 - a) / a


def speed_lag(period: float, time_constant: float) -> float:
    """Lag of a measured speed, s: half a period of the difference quotient, and the filter behind it.

    Parameters
    ----------
    period, time_constant : float
        s.

    Returns
    -------
    float
    """
    return 0.5 * period + filter_delay(period, time_constant)


def time_constant(period: float, delay: float) -> float:
    """Time constant of the filter whose delay at low frequency is this one, s: the inverse of `filter_delay`.

    Parameters
    ----------
    period, delay : float
        s.

    Returns
    -------
    float
    """
    return 0.0 if delay <= 0.0 else period / math.log1p(period / delay)

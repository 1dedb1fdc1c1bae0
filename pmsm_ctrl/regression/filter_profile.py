"""The filter of a drive signal that reaches into the band, where the moments of its response do not describe it.

A slow log has few samples in a time constant of such a filter. The model is then fitted behind filters of several time
constants, and behind delays, which a filter must not be taken for.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pmsm_ctrl.regression.drive_timing import DriveTiming

__all__ = ["LOWERED", "by_profile"]

# Time constants, and delays beyond what sampling can do, in periods of the log. Every fit finds a delay of up to one.
LAGS, LATES = (0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 2.5, 3.0), (1.5, 2.5, 3.5, 4.5)
# What a filter has to lower the error to: a mean over a period, and noise that the controller responds to, lower it
# less.
LOWERED = 0.9


def by_profile(known: DriveTiming, period: float, error: Callable[[DriveTiming], float]) -> DriveTiming:
    """Return the filter with which a model has the least error; the known timing where that is no better noticeably.

    Parameters
    ----------
    known : DriveTiming
        What was found by the moments.
    period : float
        Of the log, s.
    error : function
        Of a timing: the rms error of the model that is fitted behind it; infinite where there is none.
    """
    lags = [period * each for each in LAGS]
    errors = [error(DriveTiming(0.0, lag)) for lag in lags]
    best = int(np.argmin(errors))
    if best == len(lags) - 1 or not errors[best] < LOWERED * error(known):
        return known
    if min(error(DriveTiming(period * each, 0.0)) for each in LATES) < errors[best]:
        return known
    found, least = lags[best], errors[best]
    if best > 0:
        near = slice(best - 1, best + 2)
        a, b, _ = np.polyfit(lags[near], np.square(errors[near]), 2)
        between = float(np.clip(-0.5 * b / a, lags[best - 1], lags[best + 1])) if a > 0.0 else found
        if error(DriveTiming(0.0, between)) < least:
            found = between
    return DriveTiming(0.0, found)

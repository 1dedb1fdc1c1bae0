"""How the drive signal was sampled, beside the position: late by some time, and behind a filter.

A signal T(t) that passes a linear filter of mean delay m and variance v of its impulse response is, slow against that,
``T - m dT/dt + (m^2 + v) / 2 d^2T/dt^2``. Variances add: a sample that is late has none, a mean over a period P has
``P^2 / 12``, a first-order filter of time constant lag has ``lag^2``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.design_parts import LogMap
from pmsm_ctrl.log import Log

__all__ = ["CURRENT_LOOP", "UNDELAYED", "DriveTiming", "filter_behind", "possible_sampling", "stated_timing"]

Array = NDArray[np.float64]

# What is sampled with the current, and so as late as that.
DRIVE = ("torque", "i_q", "i_d")
# Standard errors by which the spread must miss that of a filter for the rest to be called a delay.
SURE = 3.0
# Part of a period of the log by which a sampling that the design states may be off: the clocks of two boards.
TOLD = 0.05
# Period of the speed loop of a drive of which nothing is known, and what a current loop lags its command at most, s:
# one of 160 Hz and more.
UNKNOWN_LOOP, CURRENT_LOOP = 1e-3, 1e-3


@dataclass(frozen=True)
class DriveTiming:
    """How the drive signal was sampled.

    Attributes
    ----------
    late : float
        Time after the position at which it was sampled, s.
    lag : float
        Time constant of the first-order filter that it passed, s.
    """

    late: float = 0.0
    lag: float = 0.0

    @property
    def delay(self) -> float:
        """Mean delay, s."""
        return self.late + self.lag

    @property
    def spread(self) -> float:
        """Half the variance of the impulse response, s^2."""
        return 0.5 * self.lag**2

    def undone(self, log: Log) -> Log:
        """Return the log with the drive signal as it was at the time of the position, before the filter.

        Parameters
        ----------
        log : Log
        """
        if self == UNDELAYED:
            return log
        from scipy.interpolate import CubicSpline

        t = log.t
        ahead = np.clip(t + self.late, t[0], t[-1])
        channels = dict(log.channels)
        for name in DRIVE:
            if name in channels:
                spline = CubicSpline(t, channels[name])
                channels[name] = spline(ahead) + self.lag * spline(ahead, 1)
        return replace(log, channels=channels)


UNDELAYED = DriveTiming()


def stated_timing(stated: LogMap, period: float) -> DriveTiming:
    """Return how the drive signal was sampled, as the log's table in the design says.

    Parameters
    ----------
    stated : LogMap
    period : float
        Of the log, s: a mean over it is late by half of it, and has the variance of a filter of ``period / sqrt(12)``.
    """
    width = period / math.sqrt(12.0) if stated.sampling == "mean" else 0.0
    lag = math.hypot(stated.filter, width)
    centre = 0.5 * period if stated.sampling == "mean" else 0.0
    return DriveTiming(stated.late + centre + stated.filter - lag, lag)


def possible_sampling(design: Design, period: float) -> tuple[float, float]:
    """Return how late and how early, s, a drive signal may be sampled beside the position.

    By a period of the log, or of the speed loop, whose steps are always sampled at the same place; and earlier by what
    a current loop lags, since the signal may be its command.

    Parameters
    ----------
    design : Design
    period : float
        Of the log, s.
    """
    if design.log.sampling_told:
        return TOLD * period, TOLD * period
    late = max(period, design.drive.speed_period if design.motor.electrical else UNKNOWN_LOOP)
    return late, late + CURRENT_LOOP


def filter_behind(delay: float, spread: tuple[float, float], sampling: float) -> DriveTiming | None:
    """Return the filter that explains a delay beyond what sampling can do; None where it must be a delay.

    Parameters
    ----------
    delay : float
        Mean delay, s.
    spread : (float, float)
        Half the variance of the impulse response, s^2, and its standard error.
    sampling : float
        How late a sample may be, s.

    Returns
    -------
    DriveTiming or None
    """
    least = delay - sampling
    value, stderr = float(spread[0]), float(spread[1])
    if least <= 0.0 or value + SURE * stderr < 0.5 * least**2:
        return None
    lag = min(max(math.sqrt(2.0 * max(value, 0.0)), least), delay)
    return DriveTiming(float(delay) - lag, lag)

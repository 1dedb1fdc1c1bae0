"""Errors of speed and acceleration by the steps of an angle, sample by sample.

The error of a rounded angle is a wave with one period a step. At high speed its frequency lies above the band, and
little of it remains. At low speed, around every reversal, all of it passes the filter and is differentiated twice. If
this noise were taken to be the same everywhere, it would look like a friction that changes, a gap or a spring.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.importers.timebase import growing_steps
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.conditioning import PREFILTER, Prepared
from pmsm_ctrl.regression.filters import ORDER, RIPPLE, SIDE_BY_SIDE, derivative, low_pass_each

__all__ = ["StepErrors", "angle_step", "angle_steps", "errors_by_steps", "rough_acceleration"]

Array = NDArray[np.float64]

LONG_ENOUGH = 200_000  # samples that tell the step of an angle
ROUNDING = 1e-9  # share of the range below which a step is the rounding of a number
NEGLIGIBLE = 1e-3  # share of the acceleration's scatter
# Steps of an angle are multiples of the smallest: of those of up to so many times that, at most a share may be off by
# more than a share of it. The advance of a shaft that never stops is no step.
MULTIPLES, OFF, MOST_OFF = 10.0, 0.1, 0.1
ZEROS = 8  # places of the encoder's zero between two steps over which its error is averaged


def angle_step(log: Log) -> float:
    """Return the step of the angle, rad (m): of a coarse encoder, and next to nothing of any other; 0 without one.

    Parameters
    ----------
    log : Log
    """
    if "theta" not in log:
        return 0.0
    theta = log["theta"][:LONG_ENOUGH]
    steps, least = np.diff(np.unique(theta)), ROUNDING * float(np.ptp(theta))
    steps = steps[steps > least]
    if _multiples(steps):
        return float(np.min(steps, initial=np.inf)) if len(steps) else 0.0
    sizes = np.diff(np.unique(steps))  # by how much the advances differ
    sizes = sizes[sizes > least]
    return float(np.min(sizes)) if len(sizes) and _multiples(sizes) else least


def angle_steps(log: Log) -> tuple[float, float]:
    """Return the smallest and the largest step of the angle, rad (m): they differ where it has few digits.

    Parameters
    ----------
    log : Log
    """
    smallest = angle_step(log)
    return smallest, max(smallest, growing_steps(log["theta"]) if "theta" in log else 0.0)


def _multiples(values: Array) -> bool:
    """Return whether values are multiples of the smallest, as far as those of a few times that tell."""
    unit = float(np.min(values, initial=np.inf))
    counts = values[values < MULTIPLES * unit] / unit
    return len(counts) == 0 or float(np.mean(np.abs(counts - np.round(counts)) > OFF)) <= MOST_OFF


def rough_acceleration(step: float, rate: float, cutoff: float) -> float:
    """Return the noise of the filtered acceleration by the steps of an angle, rms, where they pass fast.

    Their error is white, of variance ``step^2 / 12``; differentiated twice its density grows with the fourth power of
    the frequency, and the balance's filter passes a little above its cutoff. Sources: B. Widrow, I. Kollar,
    Quantization Noise, Cambridge 2008, ch. 1; for the filter `filters.low_pass`.

    Parameters
    ----------
    step : float
        Of the angle, rad (m).
    rate : float
        At which it was logged, Hz.
    cutoff : float
        Hz.
    """
    density = step**2 / 12.0 * 2.0 / rate
    x = np.linspace(0.0, 2.0, 401)  # frequency over the cutoff
    passed = 1.0 / (1.0 + (10.0 ** (0.1 * RIPPLE) - 1.0) * np.polynomial.chebyshev.Chebyshev.basis(ORDER)(x) ** 2)
    return math.sqrt(density * (2.0 * math.pi) ** 4 * cutoff**5 * float(np.trapezoid(x**4 * passed**2, x)))


@dataclass(frozen=True, eq=False)
class StepErrors:
    """Errors by the steps of an angle, rms.

    Attributes
    ----------
    speed : array, shape (n,)
        rad/s (m/s).
    acceleration : array, shape (n,)
        Of the acceleration before the balance's filter, rad/s^2 (m/s^2).
    filtered : array, shape (m,)
        Of the filtered and thinned acceleration.
    """

    speed: Array
    acceleration: Array
    filtered: Array


def errors_by_steps(prepared: Prepared, step: float, largest: float = 0.0) -> StepErrors | None:
    """Return the errors by the steps of an angle; None where they are negligible beside the motion.

    The smoothed motion is rounded again by encoders with different zeros. Where the zero lies is chance; how fast the
    steps pass is not. Source: B. Widrow, I. Kollar, Quantization Noise, Cambridge 2008, ch. 1.

    Parameters
    ----------
    prepared : Prepared
    step : float
        Of the angle, rad (m); the smallest of one that was written with few digits.
    largest : float
        The largest of such a one, rad (m).
    """
    period, wide = 1.0 / prepared.rate, PREFILTER * prepared.cutoff
    wave = max(step, largest) / math.pi * (2.0 * math.pi * wide) ** 2  # of the angle at the edge of the band
    if wave < NEGLIGIBLE * float(np.std(prepared.alpha)):
        return None
    sizes = _by_size(prepared.signals["theta"], step, largest)
    count = prepared.signals["theta"] / sizes
    speed, acceleration, filtered = np.zeros(len(count)), np.zeros(len(count)), np.zeros(len(prepared.keep))
    at_once = ZEROS if ZEROS * len(count) <= SIDE_BY_SIDE else 1  # those of a long log are large
    for first in range(0, ZEROS, at_once):
        places = (count + (k + 0.5) / ZEROS for k in range(first, first + at_once))
        errors = [sizes * (np.round(place) - place) for place in places]
        for error in low_pass_each(errors, prepared.rate, wide) if wide < 0.45 * prepared.rate else errors:
            slope = derivative(error, period)
            bend = derivative(slope, period)
            speed += slope**2
            acceleration += bend**2
            filtered += prepared.column(bend) ** 2
    return StepErrors(*(np.sqrt(total / ZEROS) for total in (speed, acceleration, filtered)))


def _by_size(theta: Array, smallest: float, largest: float) -> Array:
    """Return the step at each angle, shape (n,): of few digits, a tenth of the size has a tenth of the step."""
    decade = np.floor(np.log10(np.maximum(np.abs(theta), 1e-300)))
    return np.asarray(np.maximum(smallest, largest * 10.0 ** (decade - decade.max())))

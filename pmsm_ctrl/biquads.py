"""Filters of second order at most: in s, and as a drive samples them, by Tustin's rule prewarped at their frequency.

This is the one place of their equations. The simulated controller, the loop transfer functions and the code export
read the coefficients from here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

__all__ = ["Biquad", "lead", "low_pass", "notch"]

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class Biquad:
    """(n_2 s^2 + n_1 s + n_0) / (d_2 s^2 + d_1 s + d_0) and its sampled form.

    Attributes
    ----------
    numerator, denominator : tuple of float
        In s (rad/s), highest power first; filters of first order have 0 there.
    frequency : float
        At which the sampled filter has exactly the response of the continuous one, Hz.
    """

    numerator: Triple
    denominator: Triple
    frequency: float

    def at(self, s: Any) -> Any:
        """Return the continuous response.

        Parameters
        ----------
        s : complex or array
            rad/s.
        """
        (n_2, n_1, n_0), (d_2, d_1, d_0) = self.numerator, self.denominator
        return ((n_2 * s + n_1) * s + n_0) / ((d_2 * s + d_1) * s + d_0)

    def sampled(self, period: float) -> tuple[float, float, float, float, float]:
        """Return b_0, b_1, b_2, a_1, a_2 of (b_0 + b_1 z^-1 + b_2 z^-2) / (1 + a_1 z^-1 + a_2 z^-2).

        Tustin's rule s = c (z - 1) / (z + 1) with c = w / tan(w T / 2), which keeps the response at w.

        Parameters
        ----------
        period : float
            s.

        Raises
        ------
        ValueError
            When the frequency is not below half the sampling rate.
        """
        w = 2.0 * math.pi * self.frequency
        if not 0.0 < w * period < math.pi:
            raise ValueError(f"{self.frequency:g} Hz is not below half the sampling rate, {0.5 / period:g} Hz")
        c = w / math.tan(0.5 * w * period)
        if self.denominator[0] == 0.0:
            (_, n_1, n_0), (_, d_1, d_0) = self.numerator, self.denominator
            a_0 = d_1 * c + d_0
            return (n_1 * c + n_0) / a_0, (n_0 - n_1 * c) / a_0, 0.0, (d_0 - d_1 * c) / a_0, 0.0
        (b_0, b_1, b_2), (a_0, a_1, a_2) = (
            (p_2 * c * c + p_1 * c + p_0, 2.0 * (p_0 - p_2 * c * c), p_2 * c * c - p_1 * c + p_0)
            for p_2, p_1, p_0 in (self.numerator, self.denominator)
        )
        return b_0 / a_0, b_1 / a_0, b_2 / a_0, a_1 / a_0, a_2 / a_0

    def delay(self, period: float) -> float:
        """Return the delay of the sampled form at low frequency, s; negative for a lead.

        Parameters
        ----------
        period : float
            s.
        """
        b_0, b_1, b_2, a_1, a_2 = self.sampled(period)
        return period * ((b_1 + 2.0 * b_2) / (b_0 + b_1 + b_2) - (a_1 + 2.0 * a_2) / (1.0 + a_1 + a_2))

    def sampled_at(self, z: Any, period: float) -> Any:
        """Return the response of the sampled form.

        Parameters
        ----------
        z : complex or array
        period : float
            s.
        """
        b_0, b_1, b_2, a_1, a_2 = self.sampled(period)
        return ((b_0 * z + b_1) * z + b_2) / ((z + a_1) * z + a_2)


def notch(frequency: float, width: float, depth: float = math.inf) -> Biquad:
    """Return a notch: (s^2 + 2 pi width g s + w^2) / (s^2 + 2 pi width s + w^2) with g = 10^(-depth/20).

    Parameters
    ----------
    frequency : float
        Hz.
    width : float
        Between the two frequencies at which a complete notch attenuates by 3 dB, Hz.
    depth : float
        Attenuation at the frequency, dB; inf for a complete notch.
    """
    w, damping = 2.0 * math.pi * frequency, 2.0 * math.pi * width
    return Biquad((1.0, damping * 10.0 ** (-depth / 20.0), w * w), (1.0, damping, w * w), frequency)


def low_pass(frequency: float, order: int = 2, damping: float = math.sqrt(0.5)) -> Biquad:
    """Return a low-pass: w / (s + w), or w^2 / (s^2 + 2 D w s + w^2).

    Parameters
    ----------
    frequency : float
        Corner frequency, of second order the natural frequency, Hz.
    order : {1, 2}
    damping : float
        D, of second order; sqrt(1/2) is Butterworth's.
    """
    w = 2.0 * math.pi * frequency
    if order == 1:
        return Biquad((0.0, 0.0, w), (0.0, 1.0, w), frequency)
    return Biquad((0.0, 0.0, w * w), (1.0, 2.0 * damping * w, w * w), frequency)


def lead(frequency: float, phase: float) -> Biquad:
    """Return a lead element (1 + s/w_1) / (1 + s/w_2) with w_1 w_2 = w^2; its gain rises from 1 to w_2/w_1.

    Parameters
    ----------
    frequency : float
        Of the largest lead, Hz.
    phase : float
        That lead, deg: arcsin((w_2 - w_1) / (w_2 + w_1)).
    """
    w, share = 2.0 * math.pi * frequency, math.sin(math.radians(phase))
    ratio = (1.0 + share) / (1.0 - share)
    low, high = w / math.sqrt(ratio), w * math.sqrt(ratio)
    return Biquad((0.0, ratio, ratio * low), (0.0, 1.0, high), frequency)

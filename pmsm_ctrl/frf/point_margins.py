"""Margins of a loop from the measured points around its crossovers, with bands from the points' own errors.

The response over that of the fitted axis varies little with frequency, also where the axis is not all that there is.
It is interpolated by local lines over the logarithm of the frequency, whose errors follow from those of the points.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.frf.policy import FAR, FEWEST_POINTS, UNSURE, WIDEST
from pmsm_ctrl.frf.result import Response

__all__ = ["point_margins"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

Margin = tuple[float, float, float]  # value, standard error, and where it is, in ln f

REACH = math.log(2.0) / 3.0  # half-width of the kernel, in ln f: a third octave on either side
NEPER = 20.0 / math.log(10.0)  # dB
AT = {"phase_margin_crossover": "phase_margin"}  # a place -> the margin that is there
GAP = 0.05  # in ln f, between two frequencies


def point_margins(
    measured: Response, fitted: Complex, frequency: Array, loop: Complex, late: float = 0.0
) -> Mapping[str, tuple[float, float]]:
    """Return phase margin (deg) and where it is (Hz), gain margin (dB), crossover (Hz) and peak of the sensitivity.

    Each has its standard error.

    Those that lie outside of the measured range are left out: one that the fitted axis has elsewhere counts only where
    the points are worse.

    Parameters
    ----------
    measured : Response
        Of the axis.
    fitted : complex array, shape (n,)
        That of a fitted axis at the same frequencies, the delay of the log included.
    frequency : array, shape (m,)
        Hz, rising, close.
    loop : complex array, shape (m,)
        Open loop around the fitted axis, without the delay of the log.
    late : float
        Standard error of this delay, s.
    """
    x, at = np.log(measured.frequency), np.log(frequency)
    if len(x) < FEWEST_POINTS:
        return {}
    y = np.log(measured.value / fitted)
    error = 0.5 * (measured.stderr / np.abs(measured.value)) ** 2
    weights, usable = _lines(x, at, error)
    variance = weights**2 @ error
    usable &= (np.abs(loop) > 0.0) & (
        variance < UNSURE**2
    )  # also where the points are too close together to hold a line
    whole = at
    at, weights, variance, L = at[usable], weights[usable], variance[usable], loop[usable]
    if len(at) < 3:
        return {}
    away = weights @ y
    if np.max(np.abs(away)) > FAR:
        return {}
    L = L * np.exp(away)
    found, own = _margins(at, L, np.sqrt(variance), late), _margins(whole, loop, np.zeros(len(whole)), 0.0)
    seen = (at[0], at[-1])
    return {
        name: one[:2]
        for name, one in found.items()
        for judge in (AT.get(name, name),)
        if _decides(judge, found[judge], own.get(judge), seen)
    }


def _decides(name: str, found: Margin, own: Margin | None, seen: tuple[float, float]) -> bool:
    """Whether a margin of the points is that of the loop, and not the worst of those within their range alone."""
    if own is None or abs(found[2] - own[2]) < REACH:
        return True
    if name == "crossover":
        return bool(seen[0] <= own[2] <= seen[1])
    worse = abs(found[0]) - abs(own[0])
    return worse > 0.0 if name == "sensitivity_peak" else worse < 0.0


def _lines(x: Array, at: Array, variance: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Return the weights of the points in a local line at each place, shape (m, n), and where there are enough."""
    away = x - at[:, None]
    distance = np.abs(away)
    least = np.sort(distance, axis=1)[:, FEWEST_POINTS - 1]
    half = np.maximum(REACH, 1.01 * least)[:, None]
    weight = np.maximum(1.0 - (distance / half) ** 3, 0.0) ** 3 / variance
    zero, one, two = (np.sum(weight * away**k, axis=1)[:, None] for k in range(3))
    spread = zero * two - one**2
    apart = spread > 1e-6 * zero * two
    usable = (least < WIDEST) & (at >= x[0]) & (at <= x[-1]) & apart[:, 0]
    return weight * (two - away * one) / np.where(apart, spread, 1.0), usable


def _margins(at: Array, L: Complex, sigma: Array, late: float) -> dict[str, Margin]:
    """Return the margins of a loop at `at` (ln f) whose logarithm has errors `sigma` in either part."""
    size, phase = np.log(np.abs(L)), np.unwrap(np.angle(L))
    steep, turn = np.gradient(size, at), np.gradient(phase, at)
    omega = 2.0 * math.pi * np.exp(at)
    angle = np.sqrt(sigma**2 + (omega * late) ** 2)  # error of the phase
    found: dict[str, Margin] = {}
    crossed = _crossings(at, size)
    if crossed.size:
        margin = (np.interp(crossed, at, phase) + 2.0 * math.pi) % (2.0 * math.pi) - math.pi
        k = int(np.argmin(np.abs(margin)))
        s, p, g, t = (float(np.interp(crossed[k], at, one)) for one in (sigma, angle, steep, turn))
        place = float(crossed[k])
        found["phase_margin"] = (math.degrees(margin[k]), math.degrees(math.hypot(p, s * t / g)), place)
        found["phase_margin_crossover"] = (math.exp(place), math.exp(place) * s / abs(g), place)
        first = float(crossed[0])
        s, g = (float(np.interp(first, at, one)) for one in (sigma, steep))
        found["crossover"] = (math.exp(first), math.exp(first) * s / abs(g), first)
    behind = [(_crossings(at, phase - turns), turns) for turns in _odd_turns(phase)]
    places = np.concatenate([one for one, _ in behind]) if behind else np.empty(0)
    gains = -np.interp(places, at, size)
    if np.any(gains > 0.0):
        k = int(np.argmin(np.where(gains > 0.0, gains, math.inf)))
        s, p, g, t = (float(np.interp(places[k], at, one)) for one in (sigma, angle, steep, turn))
        found["gain_margin_db"] = (NEPER * float(gains[k]), NEPER * math.hypot(s, p * g / t), float(places[k]))
    S = 1.0 / (1.0 + L)
    k = int(np.argmax(np.abs(S)))
    if 0 < k < len(S) - 1:
        error = float(np.abs(S[k]) * np.abs(S[k] * L[k]) * angle[k])
        found["sensitivity_peak"] = (float(np.abs(S[k])), error, float(at[k]))
    return found


def _odd_turns(phase: Array) -> list[float]:
    """Return the odd multiples of pi within the range of a phase."""
    low, high = (math.ceil(float(one) / math.pi) for one in (phase.min(), phase.max()))
    return [k * math.pi for k in range(low, high + 1) if k % 2]


def _crossings(at: Array, values: Array) -> Array:
    """Return where values change their sign, interpolated; not across a gap."""
    k = np.flatnonzero((np.diff(np.sign(values)) != 0.0) & (np.diff(at) < GAP))
    return np.asarray(at[k] - values[k] * (at[k + 1] - at[k]) / (values[k + 1] - values[k]))

"""Errors that friction causes in a motion, from a log with the true motion."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.errors import LogError
from pmsm_ctrl.log import Log
from pmsm_ctrl.units import axis_unit

__all__ = [
    "CHANGE", "FINEST", "UNITS", "Metrics", "limit_cycle", "measure", "measure_contour", "turning_samples", "units_of",
]  # fmt: skip

Array = NDArray[np.float64]

REVERSAL_WINDOW = 0.1  # s around a change of the reference speed's sign
SETTLE = 0.8  # s of rest in which the axis still settles
SHORTEST = 0.5  # s of rest in which a limit cycle can be detected
SINE = 2.0**0.5  # amplitude of a sine over its rms value
CYCLE_SWINGS = 4  # swings, in either direction, that make a limit cycle
FINEST = 1e-9  # rad (m): no encoder resolves it, and an ideal one shows the rounding of the simulation
FINER = 2.0**0.5  # step of the size of swings that are counted
ALIKE = 2.0  # ratio of the swings of one limit cycle, and of the pauses between them
MOST = 0.75  # share of the swings that are alike in a limit cycle

UNITS = {
    "rms": "rad", "peak": "rad", "reversal_peak": "rad", "stuck": "1", "cycle_amplitude": "rad",
    "cycle_frequency": "Hz", "effort": "A", "noise": "A",
}  # fmt: skip
CHANGE = ("rms", "peak", "reversal_peak", "effort", "noise")  # those with a meaning as a share of that without


def units_of(motion: str) -> dict[str, str]:
    """Return the units of the metrics on this kind of axis.

    Parameters
    ----------
    motion : {"rotary", "linear"}
    """
    return {name: axis_unit(unit, motion) for name, unit in UNITS.items()}


@dataclass(frozen=True)
class Metrics:
    """Errors and side effects of one run.

    Attributes
    ----------
    rms, peak : float
        Position error, rad (m).
    reversal_peak : float
        Largest error within 0.1 s after a change of direction, rad (m).
    stuck : float
        Share of the commanded motion during which the axis stands.
    cycle_amplitude, cycle_frequency : float
        Limit cycle while the reference rests, rad (m) and Hz; 0 when there is none.
    effort : float
        RMS of the current reference, A.
    noise : float
        RMS of its change from sample to sample over sqrt(2), without reversals, A.
    """

    rms: float
    peak: float
    reversal_peak: float
    stuck: float
    cycle_amplitude: float
    cycle_frequency: float
    effort: float
    noise: float


def measure(log: Log, skip: float = 0.0, dither: float = 0.0) -> Metrics:
    """Return the metrics of a run under position control.

    Parameters
    ----------
    log : Log
    skip : float
        Left out at the start, s.
    dither : float
        Amplitude below which the motion at rest is no limit cycle, rad (m).

    Returns
    -------
    Metrics

    Raises
    ------
    LogError
        When the log lacks the true motion or the position reference.
    """
    _require(log)
    used = log.t >= log.t[0] + skip
    error = (log["theta_ref"] - log["theta_true"])[used]
    reference, turned = log["omega_ref"][used], turning_samples(log["omega_ref"][used])
    return _metrics(log, used, error, (reference, turned), dither)


def measure_contour(x: Log, y: Log, radius: float, dither: float = 0.0) -> Metrics:
    """Return the metrics of a circle that starts at (radius, 0), from the logs of its two axes.

    Errors are the distance from the circle, in the unit of the axes; the reversal peak follows a reversal of either
    axis (quadrant glitch). Of the other metrics the worse axis counts.

    Parameters
    ----------
    x, y : Log
    radius : float
        In the unit of the axes.
    dither : float
        As in `measure`.

    Returns
    -------
    Metrics

    Raises
    ------
    LogError
        When a log lacks the true motion or the position reference.
    """
    for log in (x, y):
        _require(log)
    every = np.ones(len(x), dtype=bool)
    error = np.hypot(x["theta_true"] + radius, y["theta_true"]) - radius
    turned = np.unique(np.concatenate([turning_samples(log["omega_ref"]) for log in (x, y)]))
    axes = [_metrics(log, every, error, (log["omega_ref"], turned), dither) for log in (x, y)]
    return Metrics(**{name: max(getattr(axis, name) for axis in axes) for name in UNITS})


def _require(log: Log) -> None:
    for name in ("theta_ref", "theta_true", "omega_true", "omega_ref", "i_q_ref"):
        if name not in log:
            raise LogError(f"metrics of a compensation need '{name}' (present: {', '.join(log)})")
    if 4 * CYCLE_SWINGS * log.period > SHORTEST:
        raise LogError(
            f"samples every {log.period:.3g} s: a limit cycle cannot be seen in a rest of {SHORTEST:g} s; at least "
            f"{4 * CYCLE_SWINGS / SHORTEST:g} Hz were expected"
        )


def _metrics(
    log: Log, used: NDArray[np.bool_], error: Array, motion: tuple[Array, NDArray[np.intp]], dither: float
) -> Metrics:  # fmt: skip
    """Return the metrics of an error, of the reference speed and of the samples at which it turns."""
    reference, turned = motion
    omega, current, period = log["omega_true"][used], log["i_q_ref"][used], log.period
    commanded = reference != 0.0
    window = np.zeros(error.size, dtype=bool)
    for k in turned:
        window[k : k + round(REVERSAL_WINDOW / period)] = True
    quiet = np.ones(error.size - 1, dtype=bool)
    quiet[np.minimum(turned, error.size - 2)] = False
    quiet[np.maximum(turned - 1, 0)] = False
    disturbed = _jumps(log["T_load"][used]) if "T_load" in log else np.zeros(error.size, dtype=bool)
    amplitude, frequency = limit_cycle(log["theta_true"][used], commanded | disturbed, period, dither)
    return Metrics(
        rms=float(np.sqrt(np.mean(error**2))),
        peak=float(np.max(np.abs(error))),
        reversal_peak=float(np.max(np.abs(error[window]))) if window.any() else 0.0,
        stuck=float(np.mean(omega[commanded] == 0.0)) if commanded.any() else 0.0,
        cycle_amplitude=amplitude,
        cycle_frequency=frequency,
        effort=float(np.sqrt(np.mean(current**2))),
        noise=float(np.sqrt(np.mean(np.diff(current)[quiet] ** 2) / 2.0)) if quiet.any() else 0.0,
    )


def _jumps(load: Array) -> NDArray[np.bool_]:
    """Return where a load leaves a constant value: a rest ends there, and begins anew."""
    changes = np.diff(load, prepend=load[0]) != 0.0
    return np.asarray(changes & ~np.concatenate([[False], changes[:-1]]))


def turning_samples(reference: Array) -> NDArray[np.intp]:
    """Return the samples at which a reference speed starts in a direction other than its last one.

    Parameters
    ----------
    reference : array, shape (n,)

    Returns
    -------
    int array
    """
    moving = np.flatnonzero(reference)
    signs = np.sign(reference[moving])
    change = np.flatnonzero(np.diff(signs) != 0) + 1
    return np.concatenate([moving[:1], moving[change]])


def limit_cycle(
    theta: Array, commanded: NDArray[np.bool_], period: float, dither: float = 0.0
) -> tuple[float, float]:  # fmt: skip
    """Return amplitude and frequency (Hz) of the largest limit cycle while the reference rests; zeros without one.

    It lasts to the end of the rest: it is searched in all of the rest (slow hunting), in its last half and in its
    last quarter (a fast cycle after a last slip). A resting axis also drifts, by the integral of the speed controller,
    and a cycle may ride on it: swings are counted between turning points, which a drift does not move. Noise shakes an
    axis on an elastic contact: the longer one looks, the larger its largest swing. So a motion is dither as well where
    a sine of the same rms value is.

    Parameters
    ----------
    theta : array, shape (n,)
        Position; the amplitude is in its unit.
    commanded : bool array, shape (n,)
        Where the reference moves.
    period : float
        Of the samples, s.
    dither : float
        Amplitude of a sine below which a motion is no limit cycle, in the unit of the position; at least `FINEST`.

    Returns
    -------
    (float, float)
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[True], commanded, [True]]).astype(np.int8)))
    worst = (0.0, 0.0)
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        length = stop - start - round(SETTLE / period)
        if length < round(SHORTEST / period):
            continue
        for share in (1, 2, 4):
            amplitude, swings = _cycle(theta[stop - length // share : stop], max(dither, FINEST))
            if amplitude > worst[0]:
                worst = amplitude, float((swings.size - 1) / (2.0 * (swings[-1] - swings[0]) * period))
    return worst


def _cycle(theta: Array, dither: float) -> tuple[float, NDArray[np.intp]]:
    """Return the largest amplitude of which `CYCLE_SWINGS` swings last to the end, and the samples of its swings.

    The swings of a limit cycle are alike. Smaller ones ride on it (noise), and are left out by raising the size of a
    swing until too few are left; larger ones are drift, and few.
    """
    turns, size = np.arange(theta.size), 2.0 * dither
    best: tuple[float, NDArray[np.intp]] = (0.0, np.zeros(0, dtype=np.intp))
    while (turns := turns[_turning_points(theta[turns], size)]).size > CYCLE_SWINGS:
        swing = np.abs(np.diff(theta[turns]))
        smallest = float(swing.min())
        alike, size = swing <= ALIKE * smallest, FINER * smallest
        if np.count_nonzero(alike) < max(CYCLE_SWINGS, MOST * swing.size):
            continue
        crossed, middle = _crossings(theta, turns)
        ends = np.append(crossed[alike], theta.size)
        lasts = ends[-1] - ends[-2] <= ALIKE * np.diff(ends[:-1]).max()
        inside = np.arange(turns[0], turns[-1] + 1)
        around = theta[inside] - np.interp(inside, crossed, middle)  # without the drift
        if lasts and SINE * float(np.std(around)) >= dither:
            best = 0.5 * float(np.median(swing[alike])), crossed
    return best


def _crossings(theta: Array, turns: NDArray[np.intp]) -> tuple[NDArray[np.intp], Array]:
    """Return the samples at which an angle is half way between two turning points, and the angle there."""
    middle = 0.5 * (theta[turns[1:]] + theta[turns[:-1]])
    crossed = [
        k + np.argmax((theta[k : stop + 1] > at) != (theta[k] > at))
        for (k, stop), at in zip(pairwise(turns.tolist()), middle.tolist(), strict=True)
    ]
    return np.asarray(crossed, dtype=np.intp), middle


def _turning_points(theta: Array, size: float) -> list[int]:
    """Return the samples at which an angle turns between swings of at least a size, the ends of the outer ones too."""
    low = high = 0
    found: list[int] = []
    values, rising, falling = theta.tolist(), True, True
    for k, value in enumerate(values):
        if value > values[high]:
            high = k
        elif value < values[low]:
            low = k
        if rising and values[high] - value >= size:
            found.append(high)
            rising, falling, low = False, True, k
        elif falling and value - values[low] >= size:
            found.append(low)
            rising, falling, high = True, False, k
    return [*found, high if rising else low] if found else found

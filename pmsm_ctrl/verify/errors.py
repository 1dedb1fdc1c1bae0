"""Tracking errors of a log, as the drive measured them, and those that the simulated drive promises."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.compensate.metrics import REVERSAL_WINDOW, SETTLE, SHORTEST, limit_cycle, turning_samples
from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import PmsmCtrlError
from pmsm_ctrl.log import Log
from pmsm_ctrl.verify import policy

__all__ = ["Tracking", "promised", "same_motion", "tracking"]

Array = NDArray[np.float64]

AROUND = 0.05  # s on either side of a reversal that the mean error is kept of
REST = 1e-6  # share of the largest reference speed up to which the reference rests


@dataclass(frozen=True, eq=False)
class Tracking:
    """Errors of one record.

    Attributes
    ----------
    rms, peak, reversal_peak : float
        Of the position error, rad (m); of a log under speed control of the speed error, rad/s (m/s). The peak at
        reversals is the median over the reversals, which one disturbance does not move.
    cycle_amplitude, cycle_frequency : float
        Limit cycle at rest, rad (m) and Hz; 0 where there is none, NaN where the reference does not rest long enough.
    unit : str
    t, error : array, shape (m,)
        Mean error around a reversal in the direction of the motion that begins, and its time from the reversal, s.
    """

    rms: float
    peak: float
    reversal_peak: float
    cycle_amplitude: float
    cycle_frequency: float
    unit: str
    t: Array
    error: Array


def tracking(log: Log, count: float) -> Tracking:
    """Return the tracking errors of a log.

    Parameters
    ----------
    log : Log
        With a reference of position or speed, and what follows it.
    count : float
        Angle of an encoder count, rad (m): less is no limit cycle.
    """
    name = "theta" if {"theta", "theta_ref"} <= set(log) else "omega"
    error = log[f"{name}_ref"] - log[name]
    speed, period = log["omega_ref"], log.period
    moving = np.abs(speed) > REST * float(np.max(np.abs(speed)))
    turns = turning_samples(np.where(moving, speed, 0.0))
    window = max(1, round(REVERSAL_WINDOW / period))
    peaks = [float(np.max(np.abs(error[k : k + window]))) for k in turns.tolist()]
    amplitude, frequency = np.nan, np.nan
    if "theta" in log and _rests(moving, period):
        amplitude, frequency = limit_cycle(log["theta"], moving, period, dither=count)
    t, mean = _around(error, speed, turns, period)
    return Tracking(
        float(np.sqrt(np.mean(error**2))), float(np.max(np.abs(error))), float(np.median(peaks)) if peaks else np.nan,
        amplitude, frequency, log.unit(name), t, mean,
    )  # fmt: skip


def _rests(moving: NDArray[np.bool_], period: float) -> bool:
    """Whether the reference rests long enough for a limit cycle to show."""
    edges = np.flatnonzero(np.diff(np.concatenate([[True], moving, [True]]).astype(np.int8)))
    return bool(np.any(np.diff(edges)[::2] * period >= SETTLE + SHORTEST)) if len(edges) else False


def _around(error: Array, speed: Array, turns: NDArray[np.intp], period: float) -> tuple[Array, Array]:
    half = round(AROUND / period)
    inside = [k for k in turns.tolist() if half <= k < len(error) - half]
    if not inside or half == 0:
        return np.zeros(0), np.zeros(0)
    pieces = [np.sign(speed[k]) * error[k - half : k + half] for k in inside]
    return period * np.arange(-half, half, dtype=np.float64), np.asarray(np.mean(pieces, axis=0))


def same_motion(before: Log, after: Log) -> bool:
    """Whether two logs hold the same reference motion: rms and peak of the speed and the number of reversals agree."""

    def told(log: Log) -> tuple[float, float, int]:
        speed = log["omega_ref"]
        return float(np.sqrt(np.mean(speed**2))), float(np.max(np.abs(speed))), len(turning_samples(speed))

    (rms, peak, turns), (other_rms, other_peak, other_turns) = told(before), told(after)
    allowed = policy.OTHER_MOTION
    return (
        abs(other_rms - rms) <= allowed * rms and abs(other_peak - peak) <= allowed * peak
        and abs(other_turns - turns) <= max(1.0, allowed * turns)
    )  # fmt: skip


def promised(design: Design, log: Log, gain: float, seed: int = 0) -> Mapping[str, float]:
    """Return the changes of the errors that the simulated drive shows on the log's own reference.

    Parameters
    ----------
    design : Design
        With its compensation.
    log : Log
        Before the download.
    gain : float
    seed : int
        Of the simulated noise, the same in both runs.

    Returns
    -------
    dict of str to float
        rms, peak and reversal_peak, -0.8 for -80 %; empty where the drive cannot be simulated on this log.
    """
    from pmsm_ctrl.identify.replay import build_replay, replayable
    from pmsm_ctrl.simulate import simulate

    off = design.replace(compensation={"gain": 0.0})
    if not replayable(off, log):
        return {}
    try:
        motion = build_replay(off, log).scenario
        on = design.replace(compensation={"gain": gain})
        before, after = (tracking(simulate(one, motion, seed=seed), design.encoder_step) for one in (off, on))
    except PmsmCtrlError:  # a drive that cannot be simulated promises nothing
        return {}
    return changes(before, after)


def changes(before: Tracking, after: Tracking) -> dict[str, float]:
    """Return the change of each error, -0.8 for -80 %; NaN where there was none before."""
    pairs = {name: (getattr(before, name), getattr(after, name)) for name in ("rms", "peak", "reversal_peak")}
    return {name: b / a - 1.0 if a > 0.0 else np.nan for name, (a, b) in pairs.items()}

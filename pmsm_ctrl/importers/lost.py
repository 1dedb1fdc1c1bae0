"""Physically impossible samples: positions that jump, speeds that spike, channels that freeze."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from pmsm_ctrl.design import Design
from pmsm_ctrl.importers import notices as say
from pmsm_ctrl.importers.table import Array
from pmsm_ctrl.importers.timebase import SAMPLE, quantum
from pmsm_ctrl.log import Log
from pmsm_ctrl.section import Notice

__all__ = ["frozen", "jumps", "lost_samples", "spikes"]

NEIGHBOURS = 3  # neighbouring steps on either side
SPIKE = 3  # longest spike, samples
FROZEN = 20  # samples; a shorter standstill is normal


def lost_samples(log: Log, design: Design | None = None) -> list[Notice]:
    """Return the physically impossible samples of a log, each kind with its first time."""
    return [*_jumped(log, design), *_spiked(log), *_frozen_channels(log)]


def _thinned(values: Array) -> Array:
    return values[:: max(1, values.size // SAMPLE)]


def jumps(t: Array, theta: Array) -> tuple[Array, Array]:
    """Return (indices before each jump, its height) of a position, less the motion itself.

    A step counts when it is three times larger than every one of its neighbours and eight steps of the
    quantisation beyond that: the inertia of a shaft allows neither. Steps near a gap in time do not count.
    """
    step = np.diff(theta)
    usual = float(np.percentile(np.abs(_thinned(step)), 90))
    grain = quantum(theta)
    grain = 8.0 * grain if math.isfinite(grain) else 0.0
    candidates = np.flatnonzero(np.abs(step) > 3.0 * usual + grain)
    if candidates.size == 0 or candidates.size > 0.2 * step.size:
        return np.empty(0, dtype=np.int64), np.empty(0)
    longest = 1.5 * float(np.median(np.diff(t[:SAMPLE])))
    at, height = [], []
    for k in candidates:
        first = max(0, k - NEIGHBOURS)
        around, stamps = step[first : k + NEIGHBOURS + 1], t[first : k + NEIGHBOURS + 2]
        others = np.delete(around, min(int(k), NEIGHBOURS))
        apart = others.size and abs(step[k]) > 3.0 * np.max(np.abs(others)) + grain
        if apart and float(np.max(np.diff(stamps))) < longest:
            at.append(k)
            height.append(step[k] - float(np.median(others)))
    return np.array(at, dtype=np.int64), np.array(height)


def _jumped(log: Log, design: Design | None) -> list[Notice]:
    out = []
    for name in ("theta", "theta_load"):
        if name not in log:
            continue
        at, height = jumps(log.t, log[name])
        if at.size == 0:
            continue
        size = float(np.median(np.abs(height)))
        facts = {"channel": name, "unit": log.unit(name), "count": at.size, "at": float(log.t[at[0] + 1])}
        alike = at.size > 1 and float(np.ptp(np.abs(height))) < 0.2 * size
        if alike and float(np.ptp(log[name])) < 1.2 * size:
            out.append(say.ANGLE_WRAPS(**facts, size=size, turn=_turn(size, design)))
        else:
            out.append(say.POSITION_JUMPS(**facts, size=float(height[0])))
    return out


def _turn(size: float, design: Design | None) -> str:
    p = design.motor.p if design is not None and design.motion == "rotary" else None
    if p is not None and p > 1 and abs(size * p / (2.0 * math.pi) - 1.0) < 0.1:
        return f" (one turn divided by the pole pairs, p = {p})"
    return ""


def spikes(values: Array) -> Array:
    """Return where a signal leaves its level by more than a quarter of its span for a few samples, and returns."""
    low, high = np.percentile(_thinned(values), [0.5, 99.5])
    span = float(high - low)
    step = np.diff(values)
    large = np.flatnonzero(np.abs(step) > 0.25 * span) if span > 0.0 else np.empty(0, dtype=np.int64)
    if large.size == 0 or large.size > 0.01 * step.size:
        return np.empty(0, dtype=np.int64)
    found = []
    for a, b in pairwise(large):
        calm = np.abs(np.concatenate((step[max(0, a - NEIGHBOURS) : a], step[b + 1 : b + 1 + NEIGHBOURS])))
        back = abs(values[b + 1] - values[a]) < 0.1 * abs(step[a])
        if b - a <= SPIKE and back and calm.size and float(np.max(calm)) < 0.05 * abs(step[a]):
            found.append(a + 1)
    return np.array(found, dtype=np.int64)


def _spiked(log: Log) -> list[Notice]:
    # a current may spike; the inertia prevents it for the speed
    if "omega" not in log:
        return []
    at = spikes(log["omega"])
    if at.size == 0:
        return []
    value, time = float(log["omega"][at[0]]), float(log.t[at[0]])
    return [say.SPEED_SPIKES(value=value, unit=log.unit("omega"), at=time, count=at.size)]


def frozen(values: Array, other: Array) -> tuple[int, int]:
    """Return (start, samples) of the longest stretch in which a changing channel is constant while another is not.

    A changing channel differs from the sample before in nine of ten samples. (0, 0) where there is no such stretch.
    """
    still = np.diff(values) == 0.0
    if not 0.0 < float(still.mean()) < 0.1:
        return 0, 0
    edges = np.flatnonzero(np.diff(np.concatenate(([False], still, [False])).astype(np.int8)))
    starts, stops = edges[::2], edges[1::2]
    longest = int(np.argmax(stops - starts))
    start, stop = int(starts[longest]), int(stops[longest])
    if stop - start < FROZEN or float(np.mean(np.diff(other[start : stop + 1]) == 0.0)) > 0.5:
        return 0, 0
    return start, stop - start


def _frozen_channels(log: Log) -> list[Notice]:
    out = []
    for name in ("i_q", "torque"):
        if name not in log or "omega" not in log:
            continue
        start, samples = frozen(log[name], log["omega"])
        # a channel at its limit is saturated, which is reported elsewhere
        if samples and abs(log[name][start]) < 0.999 * float(np.max(np.abs(log[name]))):
            at, stop = float(log.t[start]), float(log.t[start + samples])
            value = float(log[name][start])
            out.append(say.FROZEN_CHANNEL(channel=name, value=value, unit=log.unit(name), duration=stop - at, at=at))
    return out

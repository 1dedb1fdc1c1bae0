"""Physically impossible samples: positions that jump, speeds that spike, channels that freeze or are held."""

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

__all__ = ["freezes", "jumps", "lost_samples", "period_of_steps", "spikes"]

NEIGHBOURS = 3  # neighbouring steps on either side
SPIKE = 3  # longest spike, samples
FROZEN = 20  # samples; a shorter standstill is normal
HELD = 2.5e-3  # s; the slowest speed loops hold a torque command for 2 ms
MOVING = 0.02  # of the mean speed of a log; an axis that is slower rests, or creeps
# channels that are looked at, each with the motion that shows whether the log itself is as slow
_BESIDE = {"theta": ("omega",), "omega": ("theta",)} | dict.fromkeys(("i_q", "torque", "u_q"), ("theta", "omega"))


def lost_samples(log: Log, design: Design | None = None) -> list[Notice]:
    """Return the physically impossible samples of a log, each kind with its first time."""
    return [*_jumped(log, design), *_spiked(log), *_frozen_channels(log), *_held_channels(log)]


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


def freezes(values: Array, other: Array) -> list[tuple[int, int]]:
    """Return (start, steps) of every stretch in which a noisy channel keeps one value while another changes.

    A noisy channel differs from the sample before in nine of ten samples elsewhere, however long the stretches are. One
    that is held, as if recorded at a lower rate, changes only between its stretches.
    """
    still = np.diff(values) == 0.0
    edges = np.flatnonzero(np.diff(np.concatenate(([False], still, [False])).astype(np.int8)))
    starts, stops = edges[::2], edges[1::2]
    long = stops - starts >= FROZEN
    runs = list(zip(starts[long].tolist(), stops[long].tolist(), strict=True))
    elsewhere = still.size - sum(b - a for a, b in runs)
    short = int(np.sum((stops - starts)[~long]))
    if not runs or elsewhere < FROZEN * len(runs) or not short < 0.1 * elsewhere:
        return []
    return [(a, b - a) for a, b in runs if float(np.mean(np.diff(other[a : b + 1]) == 0.0)) <= 0.5]


def _frozen_channels(log: Log) -> list[Notice]:
    out = []
    for name in ("i_q", "torque"):
        if name not in log or "omega" not in log:
            continue
        values, omega = log[name], log["omega"]
        found = [(a, n) for a, n in freezes(values, omega) if _driven(values, omega, a, n)]
        if not found:
            continue
        first = found[0][0]
        lengths = [float(log.t[a + n] - log.t[a]) for a, n in found]
        facts = {"value": float(values[first]), "unit": log.unit(name), "duration": lengths[0]}
        facts |= {"count": len(found), "total": sum(lengths), "at": float(log.t[first])}
        more = f"; {len(found)} times, {sum(lengths):.4g} s in all" if len(found) > 1 else ""
        out.append(say.FROZEN_CHANNEL(channel=name, more=more, **facts))
    return out


def _driven(values: Array, speed: Array, start: int, steps: int) -> bool:
    """Whether an axis moves in a stretch, with a drive that is switched on and not at its limit."""
    value, part = float(values[start]), slice(start, start + steps + 1)
    noise = 3.0 * float(np.std(np.diff(speed[part])))
    if float(np.mean(np.abs(speed[part]))) < max(MOVING * float(np.mean(np.abs(speed))), noise):
        return False
    # a channel at its limit is saturated, which is reported elsewhere
    if abs(value) >= 0.999 * float(np.max(np.abs(values))):
        return False
    # before it is enabled and after it is disabled a drive makes no current, and an axis that coasts moves
    return value != 0.0 or 0 < start < values.size - 1 - steps


def period_of_steps(values: Array) -> int:
    """Return the number of samples for which a channel is held; 0 where it is not, or not always as long.

    Parameters
    ----------
    values : array, shape (n,)
    """
    places = np.flatnonzero(np.diff(values) != 0.0)
    if places.size < 50 or places.size > 0.5 * len(values):
        return 0
    period = int(np.median(np.diff(places)))
    return period if float(np.mean(np.diff(places) % period == 0)) > 0.9 else 0


def _held_channels(log: Log) -> list[Notice]:
    """Channels that change only at every so many samples, while the motion changes at each."""
    out = []
    for name, others in _BESIDE.items():
        other = next((log[one] for one in others if one in log), None)
        if name not in log or other is None or float(np.mean(np.diff(other) == 0.0)) > 0.5:
            continue
        period = period_of_steps(log[name])
        if period > 2 and period * log.period > HELD:
            out.append(say.HELD_CHANNEL(channel=name, periods=period, held_ms=1e3 * period * log.period))
    return out

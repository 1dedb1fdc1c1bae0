"""What the recorder did to single channels: wraps, jumps, lost samples, held and clipped channels, copies."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import LogError
from pmsm_ctrl.importers.lost import jumps, period_of_steps
from pmsm_ctrl.importers.notices import ANGLE_UNWRAPPED, HELD_CHANNEL, SPEED_UNRELATED
from pmsm_ctrl.importers.plausibility import speed_doubts
from pmsm_ctrl.importers.timebase import quantum
from pmsm_ctrl.importers.wraps import unwrapped, wrap_period
from pmsm_ctrl.log import Log
from pmsm_ctrl.plausibility import notices as say
from pmsm_ctrl.plausibility.clipping import unclipped
from pmsm_ctrl.plausibility.policy import POLICY
from pmsm_ctrl.plausibility.result import Plausibility
from pmsm_ctrl.section import Notice

__all__ = ["recorded"]

Array = NDArray[np.float64]

TURN = 2.0 * math.pi
PAUSE = 0.5  # s; a gap of this length in time stands for a piece that is missing


def recorded(design: Design, log: Log) -> Plausibility:
    """Return what was done to single channels, and the log without it.

    Raises
    ------
    LogError
        When the current or the torque is constant.
    """
    _require_torque(log)
    log, unrolled = _even(log)
    log, wraps = _unwrapped(design, log)
    log, cuts = _joined(log)
    log, clipped, left_out = unclipped(design, log)
    few = all(notice.detail["percent"] < POLICY.few_clipped for notice in clipped)
    lost = _lost(log)
    rare = all(notice.detail["percent"] < 100.0 * POLICY.few_lost for notice in lost)
    log, held = _in_the_middle(log, _held(log))
    doubts = (*held, *_speed(design, log), *cuts, *(clipped if few else ()), *(lost if rare else ()))
    # what is missing all over a log cannot be left out, and every derivative is wrong
    broken = (*_copies(log), *(() if rare else lost), *(() if few else clipped))
    return Plausibility(log, broken, doubts, left_out, (*unrolled, *wraps))


def _require_torque(log: Log) -> None:
    name = next((name for name in ("torque", "i_q") if name in log), None)
    motion = next((name for name in ("theta", "omega") if name in log), None)
    if name is None or motion is None or np.ptp(log[name]) > 0.0 or np.ptp(log[motion]) == 0.0 or log[name][0] == 0.0:
        return
    label = f"{log.provenance.file}: " if log.provenance.file else ""
    value = f"{float(log[name][0]):.6g} {log.unit(name)}"
    raise LogError(
        f"{label}{name} is constant ({value}) throughout the log: nothing can be said of a motion that no torque "
        "drives; another column was expected"
    )


def _even(log: Log) -> tuple[Log, tuple[Notice, ...]]:
    """Replace stamps that are off by more than half a period, where a clock took the samples at equal steps."""
    t = log.t
    n = len(t)
    mean = float(t[-1] - t[0]) / (n - 1)
    line = t[0] + mean * np.arange(n)
    off = t - line
    if float(np.max(np.abs(off))) < 0.5 * mean or "theta" not in log:
        return log, ()
    index = np.arange(n)
    slope, start = np.polyfit(index, off, 1)
    line = line + start + slope * index
    theta = np.unwrap(log["theta"]) if log.motion == "rotary" else log["theta"]
    stamped = np.interp(line, t, theta)
    rough = [float(np.sum(np.diff(values, 3) ** 2)) for values in (theta, stamped)]
    drift = float(np.max(np.abs(t - line))) / mean
    if drift > POLICY.jitter or rough[0] > POLICY.smoother * rough[1]:
        return log, ()
    return log.with_channels(t=line), (say.EVEN_STAMPS(periods=drift, rate=1.0 / (mean + slope)),)


def _unwrapped(design: Design, log: Log) -> tuple[Log, tuple[Notice, ...]]:
    """Undo wraps at another period than a turn; those at a turn are undone elsewhere, without a word."""
    changed, found = {}, []
    for name in ("theta", "theta_ref", "theta_load"):
        period = wrap_period(log[name], design.motor.p) if name in log else 0.0
        if period > 0.0:
            changed[name] = unwrapped(log[name], period)
            if abs(period / TURN - 1.0) > 1e-6 or log.motion == "linear":
                count = int(np.count_nonzero(np.abs(np.diff(log[name])) > 0.7 * period))
                found.append(ANGLE_UNWRAPPED(channel=name, period=period, unit=log.unit(name), count=count))
    return (log.with_channels(**changed) if changed else log), tuple(found)


def _joined(log: Log) -> tuple[Log, tuple[Notice, ...]]:
    """Close jumps of the angle by whole turns, and put a pause where a piece is missing."""
    if "theta" not in log:
        return log, ()
    theta = log["theta"]
    at, height = jumps(log.t, theta)
    usual = float(np.percentile(np.abs(np.diff(theta)), 90))
    large = np.abs(height) > POLICY.cut * usual
    at, height = at[large], height[large]
    if not 0 < at.size <= POLICY.most_cuts:
        return log, ()
    t, theta, found = log.t.copy(), theta.copy(), []
    for k, size in zip(at.tolist(), height.tolist(), strict=True):
        turns = round(size / TURN) * TURN if log.motion == "rotary" else size
        theta[k + 1 :] -= turns
        if abs(size - turns) > 0.5 * usual:
            t[k + 1 :] += PAUSE
        found.append(say.CUT_IN_TIME(channel="theta", size=size, unit=log.unit("theta"), at=float(log.t[k + 1])))
    return log.with_channels(t=t, theta=theta), tuple(found)


def _lost(log: Log) -> tuple[Notice, ...]:
    """Samples that are missing without a gap: the angle advances by two usual steps at once amid even ones.

    A motion that accelerates has other steps further off. Jitter of the sampling makes steps of every length: those of
    one and a half and of half a usual step are then more than those of two, and take their place in the count.
    """
    if "theta" not in log or len(log) < 1000:
        return ()
    step, dt = np.diff(log["theta"]), np.diff(log.t)
    here, before, after = step[2:-2], step[1:-3], step[3:-1]
    usual, further = 0.5 * (before + after), 0.5 * (step[:-4] + step[4:])
    grain = quantum(log["theta"])
    grain = grain if math.isfinite(grain) else 0.0
    calm = np.maximum(np.abs(before - after), np.abs(further - usual)) < 0.1 * np.abs(usual) + 2.0 * grain
    fast = np.abs(usual) > max(POLICY.counts * grain, 0.2 * float(np.percentile(np.abs(step), 99)))
    even = np.abs(dt[2:-2] - log.period) < 0.2 * log.period
    judged = calm & fast & even
    if int(judged.sum()) < 200:
        return ()
    ratio = here[judged] / usual[judged]
    missing = np.abs(ratio - 2.0) < 0.25
    uneven = np.abs(np.abs(ratio - 1.0) - 0.5) < 0.25
    share = float(missing.mean() - uneven.mean())
    return (say.LOST_SAMPLES(percent=100.0 * share),) if share > POLICY.lost_samples else ()


def _speed(design: Design, log: Log) -> Iterator[Notice]:
    """Yield that a speed is another one than that of the position; the position is what the fits read."""
    for doubt in speed_doubts(log, design):
        if doubt.code != SPEED_UNRELATED.code:  # a rough or filtered one is that as well
            yield doubt


def _in_the_middle(log: Log, held: tuple[Notice, ...]) -> tuple[Log, tuple[Notice, ...]]:
    """Take a held channel, and all that the drive logs with it, in the middle of the time that it is held.

    A hold of n samples is late by (n - 1)/2 of them in the mean.
    """
    if not held:
        return log, ()
    n = max(notice.detail["periods"] for notice in held)
    drive = [name for name in ("torque", "i_q", "i_d", "u_q", "u_d") if name in log]
    drive = [name for name in drive if period_of_steps(log[name]) == n]
    late = 0.5 * (n - 1) * log.period
    return log.with_channels(**{name: np.interp(log.t + late, log.t, log[name]) for name in drive}), held


def _held(log: Log) -> tuple[Notice, ...]:
    """Channels that change only at every so many samples, while the motion changes at each."""
    motion = next((log[name] for name in ("theta", "omega") if name in log), None)
    if motion is None or float(np.mean(np.diff(motion) == 0.0)) > 0.5:
        return ()
    out = []
    for name in ("i_q", "torque", "u_q"):
        if name not in log:
            continue
        period = period_of_steps(log[name])
        if period * log.period > POLICY.held and period > POLICY.held_periods:
            out.append(HELD_CHANNEL(channel=name, periods=period, held_ms=1e3 * period * log.period))
    return tuple(out)


def _copies(log: Log) -> tuple[Notice, ...]:
    """A measured channel that is its reference, digit for digit, is none."""
    out = []
    for name, reference in (("omega", "omega_ref"), ("theta", "theta_ref")):
        if name not in log or reference not in log or np.ptp(log[name]) == 0.0:
            continue
        changing = np.diff(log[reference]) != 0.0
        if int(changing.sum()) > 100 and bool(np.all(log[name] == log[reference])):
            out.append(say.REFERENCE_AS_MEASURED(channel=name, reference=reference))
    return tuple(out)

"""Where in a log an effect shows: one way or at one speed only, or in passing, other causes explain as much."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.diagnose.fit import Fitted
from pmsm_ctrl.diagnose.policy import Policy
from pmsm_ctrl.diagnose.refusal import Reason, Refusal
from pmsm_ctrl.regression.one_way import share_gone_back

__all__ = ["where_seen"]

Array = NDArray[np.float64]

SLOWEST = 1e-3  # share of the top speed: all below it is one speed
STEPS = 10  # speeds per decade that are looked at
WIDTH = 1.25  # ratio on either side that is one speed
MEMORY = 0.5  # of a filter, over its cutoff: half a period


def where_seen(before: Fitted, after: Fitted, policy: Policy) -> Refusal | None:
    """Return that the place where the last effect explains something tells it from no other cause.

    Parameters
    ----------
    before, after : Fitted
        Without and with the effect, otherwise alike.
    policy : Policy
    """
    last, record = after.accepted[-1], after.record
    structure = last.effect.structure
    if structure.has_memory and not structure.delays and record.turning >= policy.above_floor:
        return Refusal(Reason.TURNS_TOO_OFTEN, {"percent": 100.0 * record.turning})
    if last.effect.both_ways and (refusal := _one_way(after, policy)) is not None:
        return refusal
    if before.residual[0].shape != after.residual[0].shape:
        return None
    if last.effect.rounds:
        return _in_passing(_fall(before, after), after, last.shape[last.effect.bends_over], policy)
    if last.effect.order and last.effect.repeated and not record.linear:
        return _at_one_speed(_fall(before, after), after, policy)
    return None


def _fall(before: Fitted, after: Fitted) -> Array:
    """Return the fall of the squared residual of the torque by the effect, shape (used samples,)."""
    used = after.record.mask > 0
    weight = after.record.weight[0][used]
    old, new = ((fit.residual[0][used] * weight) ** 2 for fit in (before, after))
    return np.asarray(old - new)


def _one_way(after: Fitted, policy: Policy) -> Refusal | None:
    """Return that the axis runs one way, where a load is a friction, and where a bristle bends at starts alone.

    What little it goes back it goes at its stops, and how far a bristle is bent at rest nobody knows. Friction drives
    no axis: where something does, it is a load.
    """
    if after.record.driven and not after.accepted[-1].effect.structure.has_memory:
        return None
    back = share_gone_back(after.record)
    return Refusal(Reason.ONE_WAY, {"percent": 100.0 * back}) if back < policy.own_share else None


def _at_one_speed(fall: Array, after: Fitted, policy: Policy) -> Refusal | None:
    """Return that nearly all of what an order of a turn explains is at one speed, where others fit as well.

    At one speed an order is a wave over time: a limit cycle, a process force or an alias of the drive's ripple. In n
    turns there are n waves between two whole orders that the log can tell apart, so that any wave is a whole order by
    a chance of 1 / n. Nobody knows what is a whole order of a linear axis, which has none of this.
    """
    record = after.record
    speed = np.abs(record.at_grid(record.signals["omega"]))[record.mask > 0]
    order = np.argsort(speed)
    speed, told = speed[order], np.concatenate([[0.0], np.cumsum(fall[order])])
    top = float(speed[-1])
    if not top > 0.0 or not told[-1] > 0.0:
        return None
    speeds = top * np.geomspace(SLOWEST, 1.0, round(STEPS * math.log10(1.0 / SLOWEST)) + 1)
    low, high = (np.searchsorted(speed, speeds * ratio) for ratio in (1.0 / WIDTH, WIDTH))
    shares = (told[high] - told[low]) / told[-1]
    k = int(np.argmax(shares))
    turns = float(speed[low[k] : high[k]].sum()) / record.rate / (2.0 * math.pi)
    if shares[k] < 1.0 - policy.refused_share or turns * policy.refused_share >= 1.0:
        return None
    return Refusal(Reason.ONE_SPEED, {"speed": float(speeds[k]), "turns": turns})


def _in_passing(fall: Array, after: Fitted, speed: float, policy: Policy) -> Refusal | None:
    """Return that a friction shows much where the axis passes the speed over which it rises within the filter's memory.

    A stop or a reversal inside that memory, a bristle and a late torque round the step of dry friction off as well.
    """
    record = after.record
    quick = np.abs(record.at_grid(record.signals["alpha"]))[record.mask > 0] * (MEMORY / record.cutoff) >= speed
    share, whole = float(fall[quick].sum()), float(fall.sum())
    if not whole > 0.0 or share <= policy.refused_share * whole:
        return None
    return Refusal(Reason.IN_PASSING, {"percent": 100.0 * min(share / whole, 1.0)})

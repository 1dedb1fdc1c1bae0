"""An order of a turn that shows at one speed only: a wave over time shows the same there."""

from __future__ import annotations

import math

import numpy as np

from pmsm_ctrl.diagnose.fit import Fitted
from pmsm_ctrl.diagnose.policy import Policy
from pmsm_ctrl.diagnose.refusal import Reason, Refusal
from pmsm_ctrl.effects.base import Effect

__all__ = ["at_one_speed"]

SLOWEST = 1e-3  # share of the top speed: all below it is one speed
STEPS = 10  # speeds per decade that are looked at
WIDTH = 1.25  # ratio on either side that is one speed


def at_one_speed(before: Fitted, after: Fitted, effect: Effect, policy: Policy) -> Refusal | None:
    """Return that nearly all of what an order of a turn explains is at one speed, where others fit as well.

    At one speed an order is a wave over time: a limit cycle, a process force or an alias of the drive's ripple. In n
    turns there are n waves between two whole orders that the log can tell apart, so that any wave is a whole order by
    a chance of 1 / n. Nobody knows what is a whole order of a linear axis, which has none of this.

    Parameters
    ----------
    before, after : Fitted
        Without and with the effect, otherwise alike.
    effect : Effect
    policy : Policy
    """
    record = after.record
    if not (effect.order and effect.repeated) or record.linear or before.residual[0].shape != after.residual[0].shape:
        return None
    used = record.mask > 0
    weight = record.weight[0][used]
    fall = (before.residual[0][used] * weight) ** 2 - (after.residual[0][used] * weight) ** 2
    speed = np.abs(record.at_grid(record.signals["omega"]))[used]
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

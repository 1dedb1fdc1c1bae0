"""A wave of a turn above the band of a fit: it is as large there as in the band, and an error of the model is not.

The waves of a turn that a fit sees are those of slow motion. Faster ones are in the log as well: the measured torque
less that of the inertia holds them, with more noise, at frequencies that took no part in the fit.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.diagnose import criteria
from pmsm_ctrl.diagnose.fit import Fitted
from pmsm_ctrl.diagnose.measures import order_of
from pmsm_ctrl.diagnose.policy import POLICY, Policy
from pmsm_ctrl.diagnose.refusal import Refusal
from pmsm_ctrl.regression.fast_orders import CLIPPED, PIECE, RESOLVED, second_difference
from pmsm_ctrl.regression.filters import low_pass

__all__ = ["unlike_above"]

Array = NDArray[np.float64]

# Frequencies of the wave that are looked at, in bandwidths of the fit, and the highest that is not filtered away.
LOWEST, HIGHEST, PASSED = 1.5, 4.0, 8.0
# Share of the log's rate below which a filter has a use.
FILTERED = 0.4
FEWEST = 8  # pieces of time, over which the scatter is taken


def unlike_above(after: Fitted, policy: Policy = POLICY) -> Refusal | None:
    """Return that the wave accepted last is surely of another size above the band.

    Parameters
    ----------
    after : Fitted
        Everything fitted with it.
    policy : Policy
    """
    found = _amount(after)
    return None if found is None else criteria.same_above(*found, policy)


def _amount(after: Fitted) -> tuple[float, float] | None:
    """Return the size of the last effect above the band over that in it, and its standard error.

    None for all but waves of a turn in a torque, and where the motion is too slow or too short to tell.
    """
    one, record, number = after.accepted[-1], after.record, len(after.accepted) - 1
    order, position = order_of(one, record.design.motor.p or 0), after.position(number)
    if not order or one.effect.enters != "torque" or record.linear or record.age is not None or position is None:
        return None
    rate, cutoff = record.prepared.rate, record.cutoff
    values = after.estimate.values[after.model.columns_of(position)]
    parts = one.effect.structure.columns(record, one.effect, one.shape)
    wave = sum(value * part["torque"] for value, part in zip(values.tolist(), parts, strict=True))
    J = float(after.estimate.values[after.model.names.index("J")])
    theta = record.signals["theta"]
    torque = record.signals["torque_meas"] - J * second_difference(theta, rate)

    def fast(signal: Array) -> Array:
        above = low_pass(signal, rate, PASSED * cutoff) if PASSED * cutoff < FILTERED * rate else signal
        return np.asarray(above - low_pass(signal, rate, cutoff))

    speed = np.abs(np.gradient(low_pass(theta, rate, min(cutoff, 0.2 * rate)), 1.0 / rate))
    frequency = order * speed / (2.0 * np.pi)
    used = record.prepared.moving & (frequency > LOWEST * cutoff) & (frequency < min(HIGHEST * cutoff, RESOLVED * rate))
    place = np.floor((record.prepared.t[used] - record.prepared.t[0]) / PIECE).astype(np.int64)
    if np.count_nonzero(np.bincount(place)) < FEWEST:
        return None
    seen, expected = fast(torque)[used], fast(np.asarray(wave))[used]
    limit = CLIPPED * float(np.median(np.abs(seen)))
    products, squares = (
        np.bincount(place, expected * one) for one in (np.clip(seen, -limit, limit), expected)
    )  # fmt: skip
    size = float(products.sum() / squares.sum())
    return size, float(np.sqrt(np.sum((products - size * squares) ** 2)) / squares.sum())

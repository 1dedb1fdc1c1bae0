"""A wave of a turn above the band of a fit: it is as large there as in the band, and an error of the model is not.

The waves of a turn that a fit sees are those of slow motion. Faster ones are in the log as well: the measured torque
less that of the inertia holds them, with more noise, at frequencies that took no part in the fit.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.diagnose.case import Case
from pmsm_ctrl.diagnose.fit import Fitted
from pmsm_ctrl.diagnose.measures import order_of
from pmsm_ctrl.diagnose.refusal import Refusal
from pmsm_ctrl.diagnose.same_size import same_above
from pmsm_ctrl.effects.evaluate import column
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.drive_timing import LATENESS
from pmsm_ctrl.regression.fast_orders import CLIPPED, PIECE, RESOLVED, as_logged
from pmsm_ctrl.regression.filters import low_pass

__all__ = ["unlike_above"]

Array = NDArray[np.float64]

# Frequencies of the wave that are looked at, in bandwidths of the fit, and the highest that is not filtered away.
LOWEST, HIGHEST, PASSED = 1.5, 4.0, 8.0
# Share of the log's rate below which a filter has a use.
FILTERED = 0.4
FEWEST = 8  # pieces of time, over which the scatter is taken


def unlike_above(case: Case, after: Fitted) -> Refusal | None:
    """Return that the wave accepted last is surely of another size above the band.

    Parameters
    ----------
    case : Case
    after : Fitted
        Everything fitted with it.
    """
    log = case.believed.log if case.believed is not None else None
    found = _amount(log, after) if log is not None and after.accepted else None
    return None if found is None else same_above(*found, case.policy)


def _amount(log: Log, after: Fitted) -> tuple[float, float] | None:
    """Return the size of the last effect above the band over that in it, and its standard error.

    None for all but waves over the angle alone, and where the motion is too slow or too short to tell.
    """
    one, record, number = after.accepted[-1], after.record, len(after.accepted) - 1
    order, position = order_of(one, record.design.motor.p or 0), after.position(number)
    if not order or one.effect.signals != ("theta",) or one.effect.enters != "torque" or position is None:
        return None
    names = after.model.names
    late = float(after.estimate.values[names.index(LATENESS)]) if LATENESS in names else 0.0
    timing = replace(record.timing, late=record.timing.late + late)
    whole, cutoff, own = as_logged(record.design, timing.undone(log)), record.cutoff, record.prepared
    if whole is None:
        return None
    t, rate = whole.t, whole.rate
    group, columns = after.model.groups[position], after.model.columns_of(position)
    values = dict(zip(group.symbols, after.estimate.values[columns].tolist(), strict=True))
    angle = np.interp(t, own.t, record.signals["theta"])  # where the records have one zero
    wave = column(one.effect, {"theta": angle}, dict(one.shape) | values)
    torque = whole.without_inertia(float(after.estimate.values[names.index("J")]))
    moving = whole.good & (np.interp(t, own.t, own.moving.astype(np.float64)) > 0.5)

    def fast(signal: Array) -> Array:
        above = low_pass(signal, rate, PASSED * cutoff) if PASSED * cutoff < FILTERED * rate else signal
        return np.asarray(above - low_pass(signal, rate, cutoff))

    frequency = order * whole.speed(cutoff) / (2.0 * np.pi)
    used = moving & (frequency > LOWEST * cutoff) & (frequency < min(HIGHEST * cutoff, RESOLVED * rate))
    place = np.floor((t[used] - t[0]) / PIECE).astype(np.int64)
    if np.count_nonzero(np.bincount(place)) < FEWEST:
        return None
    seen, expected = fast(torque)[used], fast(wave)[used]
    limit = CLIPPED * float(np.median(np.abs(seen)))
    products, squares = (
        np.bincount(place, expected * one) for one in (np.clip(seen, -limit, limit), expected)
    )  # fmt: skip
    size = float(products.sum() / squares.sum())
    return size, float(np.sqrt(np.sum((products - size * squares) ** 2)) / squares.sum())

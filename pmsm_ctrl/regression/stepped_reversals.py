"""Friction that steps between two samples of the torque: where the motion is prescribed, the torque has the step.

An axis that a current turns is slowed down and sped up by its friction: the acceleration has the step, and every
reversal is followed with it. On a stand whose motion is prescribed, or in a torque that was worked out from a motion,
the acceleration is smooth and the torque steps. Sampled at instants such a step lies at a sample, and not at its
moment: the balance is wrong there by the whole friction over a part of a period, which no later filter takes away, and
which a friction that bends, or falls with speed, resembles.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.regression.balances import STANDSTILL, Record
from pmsm_ctrl.regression.base_fit import Estimated, base_fit
from pmsm_ctrl.regression.conditioning import Processing
from pmsm_ctrl.regression.made import Made
from pmsm_ctrl.regression.reversals import as_sampled

__all__ = ["stepped_at_reversals"]

Array = NDArray[np.float64]

# Moments that are looked at, in periods of the log after the change of sign: so many, ever closer to the best of them.
MOMENTS, STEPS = 9, (0.25, 0.0625, 0.015625)
LOUD = 1.5  # times the noise of the fit, that all samples alike must leave for the moments to be looked at
LOWERED = 0.36  # share of the power beyond that noise that followed reversals leave, which stepped ones may leave


def stepped_at_reversals(design: Design, made: Made, record: Record, fit: Estimated) -> tuple[Record, Estimated]:
    """Return the record with friction that steps at a sample, and its fit, where that lowers the error of all samples.

    Parameters
    ----------
    design : Design
    made : Made
    record : Record
    fit : Estimated
        Of the base model to that record.
    """
    left = (record.target[0] - fit.estimate.predicted()[0])[record.mask]
    if record.age is not None or record.dry <= 0.0 or _rms(left) < LOUD * float(fit.weights.sigma[0]):
        return record, fit
    direction, omega, noise = record.signals["direction"], record.signals["omega"], float(fit.weights.sigma[0])
    followed = _error(record, direction, record.rate_of(direction))
    finer = round(made.log.rate / record.prepared.rate)
    tried, moment = {}, 0.0
    for step in STEPS:
        for one in (moment + step * (np.arange(MOMENTS) - MOMENTS // 2)).tolist():
            tried[one] = _error(record, as_sampled(direction, omega, one, finer))
        moment = min(tried, key=tried.__getitem__)
    if tried[moment] ** 2 - noise**2 > LOWERED * (followed**2 - noise**2):
        return record, fit
    same = Processing(standstill=STANDSTILL, cutoff=record.cutoff)
    again = made.record(design, same, None, replace(record.timing, stepped=moment))
    return again, base_fit(design, again)


def _error(record: Record, *friction: Array) -> float:
    """Return what inertia, viscous friction, a constant and these columns leave of the torque, rms of all samples."""
    s = record.signals
    columns = record.prepared.columns([s["alpha"], s["omega"], np.ones_like(s["omega"]), *friction])
    used, target = columns[:, record.mask].T, record.target[0][record.mask]
    size = np.linalg.norm(used, axis=0)
    size[size == 0.0] = 1.0
    return _rms(target - (used / size) @ np.linalg.lstsq(used / size, target, rcond=None)[0])


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))

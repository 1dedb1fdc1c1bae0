"""Friction that steps between two samples of the torque: where the motion is prescribed, the torque has the step.

An axis that a current turns is slowed down and sped up by its friction: the acceleration has the step, and every
reversal is followed with it. On a stand whose motion is prescribed, or in a torque that was worked out from a motion,
the acceleration is smooth and the torque steps. Sampled at instants such a step lies at a sample, and not at its
moment: the balance is wrong there by the whole friction over a part of a period, which no later filter takes away, and
which a friction that bends, or falls with speed, resembles.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.regression.balances import STANDSTILL, Record
from pmsm_ctrl.regression.base_fit import Estimated, base_fit
from pmsm_ctrl.regression.conditioning import Processing, default_cutoff
from pmsm_ctrl.regression.made import Made
from pmsm_ctrl.regression.reversals import REACHES, as_sampled, bend

__all__ = ["stepped_at_reversals"]

Array = NDArray[np.float64]

# Moments that are looked at, in periods of the log after the change of sign: so many, ever closer to the best of them.
MOMENTS, STEPS = 9, (0.25, 0.0625, 0.015625)
COARSE = 0.5  # sample of the thinned log, by which later moments are tried first
BENT = 0.7  # of what friction that bends before it slides leaves at best, a step that is late may leave: half the power
LATEST = 0.02  # s; a torque that is later is found before anything is fitted
LOUD = 1.5  # times the noise of the fit, that all samples alike must leave for the moments to be looked at; and times
# what a late friction leaves, that a torque late as a whole may leave
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
    error = _Errors(record)
    followed, finer = error.of(direction, record.rate_of(direction)), round(made.log.rate / record.prepared.rate)
    seen = partial(as_sampled, direction, omega, finer=finer, moved=record.timing.late * made.log.rate)
    # half the band tells a bristle behind a coarse encoder from a late step no more
    usual = record.cutoff >= default_cutoff(record.prepared.rate)
    in_time = usual and not record.timing.lag and not record.delayed
    coarse = np.arange(0.0, LATEST * made.log.rate, COARSE * finer) if in_time else np.zeros(1)
    tried = {one: error.of(seen(one)) for one in coarse.tolist()}
    for step in STEPS:
        best = min(tried, key=tried.__getitem__)
        around = best + step * (np.arange(MOMENTS) - MOMENTS // 2)
        tried |= {one: error.of(seen(one)) for one in around.tolist()}
    moment = min(tried, key=tried.__getitem__)
    if tried[moment] ** 2 - noise**2 > LOWERED * (followed**2 - noise**2):
        return record, fit
    if whole := round(moment):
        bent = min(error.of(bend(record.signals["theta"], share)) for share in REACHES.tolist())
        if tried[moment] > min(LOUD * noise, BENT * bent):
            return record, fit
    same = Processing(standstill=STANDSTILL, cutoff=record.cutoff)
    late = record.timing.late + whole / made.log.rate
    again = made.record(design, same, None, replace(record.timing, late=late, stepped=moment - whole))
    if whole:  # a torque that is late is so with what the inertia takes of it; a bristle alone is the friction
        s = again.signals
        as_one = as_sampled(s["direction"], s["omega"], moment - whole, finer, late * made.log.rate)
        if _Errors(again).of(as_one) > LOUD * tried[moment]:
            return record, fit
    return again, base_fit(design, again)


class _Errors:
    """What inertia, viscous friction, a constant and a friction leave of the torque, rms of all samples."""

    def __init__(self, record: Record) -> None:
        s = record.signals
        self._record = record
        self._motion, _ = np.linalg.qr(self._columns(s["alpha"], s["omega"], np.ones_like(s["omega"])))
        self._left = self._beside(record.target[0][record.mask])

    def of(self, *friction: Array) -> float:
        """Return it for these columns of the friction."""
        columns = self._beside(self._columns(*friction))
        return _rms(self._left - columns @ np.linalg.lstsq(columns, self._left, rcond=None)[0])

    def _columns(self, *values: Array) -> Array:
        columns = self._record.prepared.columns(list(values))[:, self._record.mask].T
        size = np.linalg.norm(columns, axis=0)
        return np.asarray(columns / np.where(size > 0.0, size, 1.0))

    def _beside(self, values: Array) -> Array:
        return np.asarray(values - self._motion @ (self._motion.T @ values))


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))

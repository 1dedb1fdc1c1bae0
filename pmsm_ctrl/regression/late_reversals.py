"""Reversals that are followed with the drive signal as it was at the time of the position."""

from __future__ import annotations

from dataclasses import replace

from pmsm_ctrl.design import Design
from pmsm_ctrl.regression.balances import STANDSTILL, Record
from pmsm_ctrl.regression.base_fit import Estimated, base_fit, error_left
from pmsm_ctrl.regression.conditioning import Processing
from pmsm_ctrl.regression.drive_timing import LATENESS, SURE
from pmsm_ctrl.regression.made import Made
from pmsm_ctrl.regression.model import FIXED

__all__ = ["in_time_at_reversals"]

# s: a reversal that is off by less falsifies the friction, low-passed at 40 Hz, by less than 2 % of F_c
LATE = 1e-4


def in_time_at_reversals(design: Design, made: Made, record: Record, fit: Estimated) -> tuple[Record, Estimated]:
    """Return the record with reversals at the moment that a drive signal in time gives, and its fit.

    Where that lowers the error: a spring that the model lacks looks like a delay as well. The column of a delay
    describes what it does to the balance, and not that the friction seems to change its sign at another moment, where
    the torque that turns the axis is a mean of 4 ms.

    Parameters
    ----------
    design : Design
    made : Made
    record : Record
    fit : Estimated
        Of the base model to that record.
    """
    if record.age is not None or record.sampling_stated or record.dry <= 0.0:
        return record, fit
    late = fit.level(LATENESS)
    if not max(LATE, SURE * fit.value(LATENESS)[1]) < late <= record.sampling * (1.0 + FIXED):
        return record, fit
    if late >= record.sampling and _later(design, record):
        return record, fit
    same = Processing(standstill=STANDSTILL, cutoff=record.cutoff)
    again = made.record(design, same, None, replace(record.timing, reversals=late))
    found = base_fit(design, again)
    return (again, found) if error_left(again, found) < error_left(record, fit) else (record, fit)


def _later(design: Design, record: Record) -> bool:
    """Whether the drive signal is surely later than sampling can make it: that is undone, or a delay."""
    value, stderr = base_fit(design, record, settled=False).value(LATENESS)
    return value > record.sampling + SURE * stderr

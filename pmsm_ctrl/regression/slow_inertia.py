"""Inertia and dry friction by the slow part of the acceleration, where the fast part is noise."""

from __future__ import annotations

import math

import numpy as np

from pmsm_ctrl.design import Design
from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.regression.filters import low_pass

__all__ = ["slow_friction", "slow_inertia"]

SLOW = 0.25  # of the band: noise of a twice differentiated angle has a thousandth of its power there
SURE = 3.0  # standard errors beyond the tolerance by which a log contradicts the design


def slow_inertia(design: Design, record: Record, tolerance: float) -> tuple[float, float]:
    """Return the inertia of the design and its tolerance, or, where they contradict it, that of the log and its error.

    Noise of the acceleration makes an inertia by least squares too small. The slow part of the acceleration is an
    instrument that has hardly any of it.

    Parameters
    ----------
    design : Design
    record : Record
    tolerance : float
        Of the design's inertia, kg m^2 (kg).
    """
    (value, stderr), _ = _by_slow_part(record)
    contradicted = value > 0.0 and abs(value - design.J) - tolerance > SURE * stderr
    return (value, stderr) if contradicted else (design.J, tolerance)


def slow_friction(record: Record) -> tuple[float, float]:
    """Return the dry friction and its standard error, whatever the inertia is and however noisy the acceleration.

    Parameters
    ----------
    record : Record
    """
    return _by_slow_part(record)[1]


def _by_slow_part(record: Record) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return inertia and dry friction, with standard errors; infinite where the motion does not tell them."""
    key = ("slow inertia",)
    if key not in record.kept:
        record.kept[key] = np.array(_solved(record))
    values: list[list[float]] = record.kept[key].tolist()
    return (values[0][0], values[0][1]), (values[1][0], values[1][1])


def _solved(record: Record) -> tuple[tuple[float, float], tuple[float, float]]:
    used, weight = record.mask, record.weight[0]
    alpha, band = record.acceleration(), SLOW * record.cutoff
    direction, omega = (record.shaped(record.signals[name]) for name in ("direction", "omega"))
    columns = np.column_stack([alpha, direction, omega, np.ones(len(alpha))])[used] * weight[used, None]
    instruments = columns.copy()
    instruments[:, 0] = low_pass(alpha, record.rate, band, steep=True)[used] * weight[used]
    target = record.target[0][used] * weight[used]
    products = instruments.T @ columns
    if np.linalg.cond(products / np.outer(*(np.linalg.norm(x, axis=0) for x in (instruments, columns)))) > 1e6:
        return (math.nan, math.inf), (math.nan, math.inf)
    inverse = np.linalg.inv(products)
    values = inverse @ (instruments.T @ target)
    left = low_pass(target - columns @ values, record.rate, band, steep=True)
    alike = record.rate / (2.0 * band)  # samples that have one noise of that band
    covariance = inverse @ (instruments.T @ instruments) @ inverse.T * float(np.mean(left**2)) * alike
    errors = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return (float(values[0]), float(errors[0])), (float(values[1]), float(errors[1]))

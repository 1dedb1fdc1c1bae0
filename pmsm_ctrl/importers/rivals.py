"""Columns of one quantity: which of them is measured, and which is the reference that it follows.

A reference is smoother, holds no noise, and leads: what is measured follows it, and a measured speed does not lead the
derivative of the position. A filtered copy is smoother as well, but follows what it is a copy of: of such two the raw
one is taken, with a doubt.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pmsm_ctrl.importers.delays import lag
from pmsm_ctrl.importers.relations import roughness
from pmsm_ctrl.importers.table import Array

__all__ = ["LEADS", "Choice", "alike", "measured_one"]

ROUGHER = 2.0  # times as rough: noise tells the two apart
FOLLOWS = 0.5  # samples by which one follows the other; a drive logs its channels within one sample
ALIKE = 0.99  # correlation, one shifted onto the other, of two columns of one quantity
LEADS = 1.0  # samples before the derivative of the position, which differences of the position do not reach


@dataclass(frozen=True)
class Choice:
    """Which of two columns is measured.

    Attributes
    ----------
    measured : int
        0 or 1.
    reason : str
        What makes the other one the reference; empty where nothing tells them apart.
    """

    measured: int
    reason: str


def measured_one(columns: Sequence[Array], rate: Array | None = None) -> Choice:
    """Return which of two columns of one quantity is measured.

    Parameters
    ----------
    columns : sequence of array, shape (n,)
        Two.
    rate : array, shape (n,), optional
        The derivative of the position, where the two are speeds.
    """
    if rate is not None:
        found = [lag(rate, column) for column in columns]
        leads = [at is not None and at[0] < -LEADS for at in found]
        if leads[0] != leads[1]:
            return Choice(int(leads[0]), "it leads the position, which no measured speed does")
    rough = [roughness(column) for column in columns]
    rougher = int(rough[1] > rough[0])
    noisy = rough[rougher] >= ROUGHER * rough[1 - rougher]
    behind = lag(columns[0], columns[1])
    follows = behind is not None and abs(behind[0]) > FOLLOWS
    follower = int(behind is not None and behind[0] > 0.0)
    if noisy and (not follows or follower == rougher):
        return Choice(rougher, "smoother and earlier" if follows else "smoother")
    if follows and not noisy:
        return Choice(follower, "earlier")
    return Choice(rougher, "")


def alike(first: Array, second: Array) -> bool:
    """Return whether two columns are one quantity in one unit, be it measured, filtered or commanded.

    Parameters
    ----------
    first, second : array, shape (n,)
    """
    behind = lag(first, second)
    size = float(np.std(first)), float(np.std(second))
    return behind is not None and behind[1] > ALIKE and abs(size[1] - size[0]) < 0.1 * size[0]

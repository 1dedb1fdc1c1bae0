"""Many loads looked at beside a rigid axis, roughly and at once: which of them are worth a fit.

A load that is held, let go or struck follows from the motion in time. Its column is made of a coarser motion, in single
precision, and remembered: what it explains of another residual is one product.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.effects.structures.interface import Balances

__all__ = ["LoadTable", "RigidAxis", "made_table", "peaks", "rigid_axis"]

Array = NDArray[np.float64]
# Returns the torques of some loads over their inertia, from angle, speed and period of the motion, shape (k, n).
Followed = Callable[[slice, Array, Array, float], Array]

BEST = 4  # of a table
# Longest step at which the motion is taken, s; loads that are followed at once.
STEP, AT_ONCE = 1e-3, 16


@dataclass(frozen=True, eq=False)
class RigidAxis:
    """A rigid axis fitted to the torque, by weighted least squares.

    Attributes
    ----------
    columns : array, shape (4, m)
        Acceleration, direction, speed and one, filtered and thinned.
    weight : array, shape (m,)
    inertia, dry : float
        Inertia and dry friction, both positive.
    """

    columns: Array
    weight: Array
    inertia: float
    dry: float

    @property
    def deceleration(self) -> float:
        """What its dry friction decelerates it by, rad/s^2 (m/s^2)."""
        return self.dry / self.inertia


def rigid_axis(balances: Balances) -> RigidAxis | None:
    """Return the rigid axis of a log; None where it has no dry friction.

    Parameters
    ----------
    balances : Balances
    """
    s, weight = balances.signals, balances.weight[0] * balances.mask
    columns = np.stack([balances.shaped(s[name]) for name in ("alpha", "direction", "omega")])
    columns = np.vstack([columns, np.ones_like(columns[:1])])
    torque = weight * balances.shaped(s["torque"])
    inertia, dry = np.linalg.lstsq((weight * columns).T, torque, rcond=None)[0][:2].tolist()
    return RigidAxis(columns, weight, inertia, dry) if inertia > 0.0 and dry > 0.0 else None


@dataclass(frozen=True, eq=False)
class LoadTable:
    """Loads that rub, as columns beside a rigid axis; they follow from the motion alone.

    Attributes
    ----------
    loads : array, shape (k, any)
        What they are.
    weight : array, shape (m,)
    columns : array, shape (k, m)
        Weighted.
    basis : array, shape (m, 4)
        Orthonormal, of the rigid axis, weighted.
    shared : array, shape (k, 4)
        Products of the columns with the basis.
    size : array, shape (k,)
        Squares of what the columns have beside the basis.
    most : array, shape (k,)
        The largest inertia of each load.
    """

    loads: Array
    weight: Array
    columns: NDArray[np.float32]
    basis: Array
    shared: Array
    size: Array
    most: Array

    def gains(self, residual: Array) -> Array:
        """Return by how much each load lowers the weighted sum of squares of a residual, shape (k,)."""
        weighted = self.weight * residual
        products = [self.columns[some] @ weighted for some in _parts(len(self.size))]
        along = np.concatenate(products) - self.shared @ (self.basis.T @ weighted)
        load = np.clip(along / np.maximum(self.size, 1e-300), 0.0, self.most)
        return np.asarray(load * (2.0 * along - load * self.size))


def made_table(balances: Balances, axis: RigidAxis, loads: Array, most: Array, followed: Followed) -> LoadTable:
    """Return the table of loads that rub.

    Parameters
    ----------
    balances : Balances
    axis : RigidAxis
    loads : array, shape (k, any)
        What they are; last their deceleration by friction, rad/s^2 (m/s^2).
    most : array, shape (k,)
        Largest inertia of each, kg m^2 (kg).
    followed : callable
        Returns the torques over the inertia of some of the loads, of angle, speed and period of a motion.
    """
    count, weight, plain = len(loads), axis.weight, axis.columns
    basis = np.linalg.qr((weight * plain).T)[0]
    columns = np.empty((count, plain.shape[1]), dtype=np.float32)
    shared, size = np.zeros((count, len(plain))), np.zeros(count)
    s = balances.signals
    every = max(1, int(STEP / balances.period + 1e-9))
    theta, omega = s["theta"][::every].copy(), s["omega"][::every].copy()
    nearest = np.minimum((np.arange(len(s["theta"])) + every // 2) // every, len(theta) - 1)
    for some in _parts(count):
        torques = followed(some, theta, omega, every * balances.period)
        shaped = np.stack([balances.shaped(row if every == 1 else row[nearest]) for row in torques])
        own = (weight * (shaped - plain[0] - loads[some, -1:] * plain[1])).astype(np.float32)
        columns[some], shared[some] = own, own @ basis
        size[some] = np.sum((own - shared[some] @ basis.T) ** 2, axis=1)
    return LoadTable(loads, weight, columns, basis, shared, size, most)


def peaks(table: Array) -> NDArray[np.intp]:
    """Return the places, along the flat table, of the best that are better than all around them, the best first.

    Parameters
    ----------
    table : array, shape (rows, columns)
    """
    beside, (rows, width) = np.pad(table, 1), table.shape
    places = [(i, j) for i in range(3) for j in range(3) if (i, j) != (1, 1)]
    around = np.max([beside[i : i + rows, j : j + width] for i, j in places], axis=0)
    found = np.flatnonzero(table > around)
    return np.asarray(found[np.argsort(-table.ravel()[found])][:BEST])


def _parts(count: int) -> Iterator[slice]:
    """Yield slices of so many loads, a few at a time: of a long log they are large."""
    return (slice(start, min(start + AT_ONCE, count)) for start in range(0, count, AT_ONCE))

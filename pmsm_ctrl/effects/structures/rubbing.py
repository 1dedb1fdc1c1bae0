"""A load on a spring that has dry friction of its own: it is held, let go, swings and is held again.

The spring's torque over the load's inertia follows from the motion of the shaft in time (`kernels.springs`), and the
column is linear in the inertia: with ``f = F_load / J_load`` the torque of the axis is
``J alpha + F_c direction + J_load (T_s / J_load - alpha - f direction)``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.effects.structures.interface import Balances, LogView
from pmsm_ctrl.effects.structures.transmission import DAMPING, FREQUENCY, RUBBING

__all__ = ["bristle_column", "own_deceleration", "rubbing_column", "rubbing_shapes"]

Array = NDArray[np.float64]

NAMES = (FREQUENCY, DAMPING, RUBBING)
# What is searched: so many frequencies up to the band, and decelerations in ratios to that of the whole axis by its
# friction; the best few of a table are refined. A spring loses a few per cent of its energy in a swing.
FREQUENCIES, RATIOS, BEST = 18, np.geomspace(0.2, 5.0, 9), 4
DAMPED = 0.03
SEEN = ("seen", RUBBING)  # under which the searched loads are remembered: they follow from the motion alone
# Longest step at which the motion is taken for the search, s; the share of a swing's radian that a step of the load
# covers, and most of these a sample; loads that are followed at once.
STEP, PART_OF_RADIAN, MOST, AT_ONCE = 1e-3, 0.1, 64, 16


def rubbing_column(balances: Balances, shape: Mapping[str, float]) -> Array:
    """Return what a load that rubs adds to the torque of a rigid axis, per unit of its inertia, shape (n,).

    Parameters
    ----------
    balances : Balances
    shape : mapping
        With the load's own frequency, its damping and its deceleration.
    """
    s = balances.signals
    spring = np.array([[shape[name] for name in NAMES]])
    followed = _followed(s["theta"], s["omega"], balances.period, spring)[0]
    return np.asarray(followed - s["alpha"] - shape[RUBBING] * s["direction"])


def bristle_column(balances: Balances, reach: float) -> Array:
    """Return what a load without a mass adds, per unit of the torque's rms, shape (n,): a spring that slides.

    Parameters
    ----------
    balances : Balances
    reach : float
        By how much the spring bends before it slides, rad (m).
    """
    from pmsm_ctrl.kernels.springs import slider

    s = balances.signals
    bent = np.empty(len(s["theta"]))
    slider(np.ascontiguousarray(s["theta"]), reach, bent)
    return np.asarray(float(np.std(s["torque"])) * (bent / reach - s["direction"]))


@dataclass(frozen=True, eq=False)
class _Table:
    """Loads that rub, as columns beside a rigid axis; they follow from the motion alone.

    Attributes
    ----------
    springs : array, shape (k, 3)
        Frequency, damping and deceleration.
    columns : array, shape (k, m)
        Weighted.
    basis : array, shape (m, 4)
        Orthonormal, of the rigid axis, weighted.
    shared : array, shape (k, 4)
        Products of the columns with the basis.
    size : array, shape (k,)
        Squares of what the columns have beside the basis.
    """

    springs: Array
    columns: NDArray[np.float32]
    basis: Array
    shared: Array
    size: Array

    def gains(self, residual: Array) -> Array:
        """Return by how much each load lowers the sum of squares of a weighted residual, shape (k,)."""
        products = [self.columns[some] @ residual for some in _parts(len(self.springs))]
        along = np.concatenate(products) - self.shared @ (self.basis.T @ residual)
        return np.asarray(np.where(along > 0.0, along**2 / np.maximum(self.size, 1e-300), 0.0))


def rubbing_shapes(log: LogView, lowest: float) -> tuple[list[dict[str, float]], int]:
    """Return the loads that rub and lower the torque's sum of squares most, and how many were looked at.

    Parameters
    ----------
    log : LogView
    lowest : float
        Frequency, rad/s.
    """
    balances = log.balances
    if lowest >= 2.0 * np.pi * balances.cutoff:
        return [], 0
    weight = balances.weight[0] * balances.mask
    if SEEN not in balances.kept:
        made = _table(balances, weight, lowest)
        if made is None:
            return [], 0
        balances.kept[SEEN] = made
    table: _Table = balances.kept[SEEN]
    best = table.springs[_peaks(table.gains(weight * log.residual).reshape(FREQUENCIES, len(RATIOS)))]
    return [dict(zip(NAMES, spring, strict=True)) for spring in best.tolist()], len(table.springs)


def _table(balances: Balances, weight: Array, lowest: float) -> _Table | None:
    """Return the loads that are searched; None where the axis has no dry friction."""
    plain = _rigid(balances)
    rigid = weight * np.vstack([plain[:3], np.ones_like(plain[:1])])
    own = _deceleration(rigid, weight * plain[3])
    if own is None:
        return None
    springs = np.array([
        (w, DAMPED, f)
        for w in np.geomspace(lowest, 2.0 * np.pi * balances.cutoff, FREQUENCIES).tolist()
        for f in (own * RATIOS).tolist()
    ])  # fmt: skip
    basis, columns = np.linalg.qr(rigid.T)[0], _spring_torques(balances, springs)
    shared, size = np.zeros((len(springs), len(rigid))), np.zeros(len(springs))
    for some in _parts(len(springs)):
        own = weight * (columns[some] - plain[0] - springs[some, 2:] * plain[1])
        columns[some], shared[some] = own, own @ basis
        size[some] = np.sum((own - shared[some] @ basis.T) ** 2, axis=1)
    return _Table(springs, columns, basis, shared, size)


def own_deceleration(balances: Balances) -> float | None:
    """Return what a rigid axis is decelerated by, by its dry friction, rad/s^2 (m/s^2); None where it has none.

    Parameters
    ----------
    balances : Balances
    """
    weight, plain = balances.weight[0] * balances.mask, _rigid(balances)
    return _deceleration(weight * np.vstack([plain[:3], np.ones_like(plain[:1])]), weight * plain[3])


def _rigid(balances: Balances) -> Array:
    """Return the columns of a rigid axis and its torque, filtered and thinned, shape (4, m)."""
    s = balances.signals
    return np.stack([balances.shaped(s[name]) for name in ("alpha", "direction", "omega", "torque")])


def _deceleration(rigid: Array, torque: Array) -> float | None:
    inertia, dry = np.linalg.lstsq(rigid.T, torque, rcond=None)[0][:2].tolist()
    return float(dry / inertia) if inertia > 0.0 and dry > 0.0 else None


def _spring_torques(balances: Balances, springs: Array) -> NDArray[np.float32]:
    """Return the torques of springs over the inertia of their loads, filtered and thinned, shape (k, m)."""
    s, out = balances.signals, []
    every = max(1, int(STEP / balances.period + 1e-9))
    theta, omega = s["theta"][::every], s["omega"][::every]
    nearest = np.minimum((np.arange(len(s["theta"])) + every // 2) // every, len(theta) - 1)
    for start in range(0, len(springs), AT_ONCE):
        followed = _followed(theta, omega, every * balances.period, springs[start : start + AT_ONCE])
        out += [balances.shaped(row if every == 1 else row[nearest]).astype(np.float32) for row in followed]
    return np.stack(out)


def _parts(count: int) -> Iterator[slice]:
    """Yield slices of so many loads, a few at a time: of a long log they are large."""
    return (slice(start, start + AT_ONCE) for start in range(0, count, AT_ONCE))


def _peaks(table: Array) -> NDArray[np.intp]:
    """Return the places, along the flat table, of the best that are better than all around them, the best first."""
    beside, (rows, width) = np.pad(table, 1), table.shape
    places = [(i, j) for i in range(3) for j in range(3) if (i, j) != (1, 1)]
    around = np.max([beside[i : i + rows, j : j + width] for i, j in places], axis=0)
    peaks = np.flatnonzero(table > around)
    return np.asarray(peaks[np.argsort(-table.ravel()[peaks])][:BEST])


def _followed(theta: Array, omega: Array, period: float, springs: Array) -> Array:
    """Return the torques of springs over the inertia of their loads, shape (k, n)."""
    from pmsm_ctrl.kernels.springs import rubbing_loads

    out = np.empty((len(springs), len(theta)))
    steps = min(MOST, max(1, int(np.ceil(period * float(springs[:, 0].max()) / PART_OF_RADIAN))))
    rubbing_loads(np.ascontiguousarray(theta), np.ascontiguousarray(omega), period, steps, springs, out)
    return out

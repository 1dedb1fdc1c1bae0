"""Records whose angles were counted from different zeros, brought to one: waves of a turn tell how far they are apart.

An encoder without an index, or a drive that sets its position to zero at power-up, gives every record its own zero, and
so does the integral of a speed that has no angle beside it.
What depends on the angle (cogging, unbalance, ripple) has then another phase in each. The waves that stand out from the
residual of the base model are matched, those that keep their phase within each record: a wave that the loops answer, or
an error of the encoder, turns with the speed and tells nothing of a zero.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.evidence.tests import holm
from pmsm_ctrl.evidence.whitening import Whitener
from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.regression.records import members

__all__ = ["turned_by", "with_common_zero"]

Array = NDArray[np.float64]

HIGHEST, KEPT = 96, 6  # orders of a turn that are looked for, and the largest that are matched
PERIODS = 3.0  # of an order that a record must hold
SURE = 0.01  # significance, of a wave and of a zero that differs, over all that is looked for
# Share of what a wave explains in a half of a record that it has to explain as the other half has it, and of what it
# explains with a phase of its own in each record that one zero has to.
AGREE = 0.7
LEAST = 0.05  # share of what the base model leaves over that a wave has to explain
STEPS = 64  # of the angle in a period of the highest order
AT_ONCE = 16  # orders whose columns are filtered together


@dataclass(frozen=True, eq=False)
class _Waves:
    """What each record tells of the waves of some orders, cosine and sine of each in turn.

    Attributes
    ----------
    orders : array, shape (n,)
    information : array, shape (records, 2 n, 2 n)
    along : array, shape (records, 2 n)
    """

    orders: Array
    information: Array
    along: Array

    def turned(self, record: int, angle: float) -> tuple[Array, Array]:
        """Return information and product of one record with this angle, rad, added to its own."""
        c, s = np.cos(self.orders * angle), np.sin(self.orders * angle)
        back = np.zeros((2 * len(c),) * 2)
        even = 2 * np.arange(len(c))
        # cos(n (x + a)) = c cos - s sin, sin(n (x + a)) = s cos + c sin
        back[even, even], back[even, even + 1] = c, -s
        back[even + 1, even], back[even + 1, even + 1] = s, c
        return back @ self.information[record] @ back.T, back @ self.along[record]


def with_common_zero(record: Record, residual: Array, whitener: Whitener) -> Record:
    """Return the record with the angles of its records counted from one zero, where the waves of a turn tell it.

    Parameters
    ----------
    record : Record
    residual : array, shape (m,)
        Of the torque balance.
    whitener : Whitener
    """
    if len(record.records) < 2 or record.linear:
        return record
    waves = _waves(record, residual, whitener)
    if waves is None:
        return record
    shifts = _matched(waves)
    return turned_by(record, tuple(shifts)) if any(shift for shift, _ in shifts) else record


def turned_by(record: Record, shifts: tuple[tuple[float, float], ...]) -> Record:
    """Return the record with an angle added to that of each of its records.

    Parameters
    ----------
    record : Record
    shifts : tuple of (float, float)
        What is added, and its standard error, rad.
    """
    theta = record.signals["theta"].copy()
    for k, one in enumerate(record.records):
        first = int(np.searchsorted(record.prepared.t, one.start - 0.5 * record.period))
        theta[first:] += shifts[k][0] - (shifts[k - 1][0] if k else 0.0)
    prepared = replace(record.prepared, signals={**record.prepared.signals, "theta": theta})
    signals = {**record.signals, "theta": theta}
    return replace(record, prepared=prepared, signals=signals, shifts=shifts, memo={}, kept={})


def _waves(record: Record, residual: Array, whitener: Whitener) -> _Waves | None:
    """Return the waves that stand out, each record with a phase of its own; None where none does."""
    theta = record.signals["theta"]
    inside = members(record)[:, whitener.used]
    travel = [float(np.sum(np.abs(np.diff(record.at_grid(theta)[here & record.mask])))) for here in members(record)]
    rest = whitener.part(0, residual)
    orders = np.arange(1, HIGHEST + 1)
    columns = []
    for start in range(0, HIGHEST, AT_ONCE):
        some = orders[start : start + AT_ONCE, None] * theta
        both = np.stack([np.cos(some), np.sin(some)], axis=1).reshape(-1, len(theta))
        columns.append(whitener.part(0, record.prepared.columns(both)))
    rows = np.concatenate(columns)
    p_values, steady = [], []
    for k, order in enumerate(orders.tolist()):
        gain, apart, told, left_over, count = 0.0, 0.0, 0.0, 0.0, 0
        for here, way in zip(inside, travel, strict=True):
            if way * order < PERIODS * 2.0 * np.pi:
                continue
            own, left = rows[2 * k : 2 * k + 2, here], rest[here]
            half = len(left) // 2
            halves = [
                (own[:, part] @ own[:, part].T, own[:, part] @ left[part]) for part in (slice(half), slice(half, None))
            ]
            gain += _explained(own @ own.T, own @ left)
            apart += sum(_explained(*one) for one in halves)
            told += _foretold(*halves) + _foretold(*halves[::-1])
            left_over += float(left @ left)
            count += 2
        p_values.append(_tail(gain, count))
        steady.append(told > AGREE * (apart - 2 * count) and gain - count > LEAST * left_over)
    sure = np.flatnonzero((np.array(holm(p_values)) < SURE) & steady)
    if len(sure) == 0:
        return None
    best = sure[np.argsort(np.array(p_values)[sure], kind="stable")][:KEPT]
    best.sort()
    chosen = np.ravel([[2 * k, 2 * k + 1] for k in best.tolist()])
    own = rows[chosen]
    information = np.array([own[:, here] @ own[:, here].T for here in inside])
    along = np.array([own[:, here] @ rest[here] for here in inside])
    return _Waves(orders[best].astype(np.float64), information, along)


def _tail(gain: float, count: int) -> float:
    from scipy.special import chdtrc

    return float(chdtrc(count, gain)) if count else 1.0


def _matched(waves: _Waves) -> list[tuple[float, float]]:
    """Return the angle to add to each record, and its standard error: record by record, beside those matched before."""
    from scipy.special import chdtri

    count = len(waves.along)
    strength = [_explained(waves.information[k], waves.along[k]) for k in range(count)]
    first = int(np.argmax(strength))
    shifts = [(0.0, 0.0)] * count
    information, along = waves.information[first].copy(), waves.along[first].copy()
    period = 2.0 * np.pi / float(np.gcd.reduce(waves.orders.astype(np.int64)))
    highest = float(waves.orders.max())
    steps = max(STEPS, round(STEPS * highest * period / (2.0 * np.pi)))
    grid = period * (np.arange(steps) - steps // 2) / steps
    asked = float(chdtri(1, SURE / (count * 2.0 * highest)))
    for k in np.argsort(strength)[::-1].tolist():
        if k == first:
            continue
        found = np.array([_gain(waves, k, angle, (information, along)) for angle in grid.tolist()])
        angle, curvature = _peak(grid, found)
        best, alone = _gain(waves, k, angle, (information, along)), _explained(information, along)
        matched = best - alone >= AGREE * (strength[k] - len(along))
        if matched and best - _gain(waves, k, 0.0, (information, along)) > asked:
            shifts[k] = (angle, float(np.sqrt(2.0 / max(curvature, 1e-300))))
        own, pull = waves.turned(k, shifts[k][0])
        information, along = information + own, along + pull
    return shifts


def _gain(waves: _Waves, record: int, angle: float, others: tuple[Array, Array]) -> float:
    """Return what waves common to the others and to this record, turned by an angle, explain."""
    own, pull = waves.turned(record, angle)
    return _explained(others[0] + own, others[1] + pull)


def _peak(grid: Array, found: Array) -> tuple[float, float]:
    """Return the place of the highest value on a periodic grid, and the curvature there."""
    k, step = int(np.argmax(found)), float(grid[1] - grid[0])
    left, middle, right = found[k - 1], found[k], found[(k + 1) % len(found)]
    bent = float(left - 2.0 * middle + right)
    off = 0.5 * float(left - right) / bent if bent < 0.0 else 0.0
    return float(grid[k] + off * step), -bent / step**2


def _foretold(by: tuple[Array, Array], of: tuple[Array, Array]) -> float:
    """Return what a wave as one half of a record has it explains of the other half, in units of the noise."""
    wave = np.linalg.lstsq(*by, rcond=1e-9)[0]
    return float(wave @ (2.0 * of[1] - of[0] @ wave))


def _explained(information: Array, along: Array) -> float:
    """Return what waves explain, in units of the noise."""
    return float(along @ np.linalg.lstsq(information, along, rcond=1e-9)[0])

"""Records whose positions were counted from different zeros, brought to one by what repeats with the position.

An encoder without an index, or a drive that sets its position to zero at power-up, gives every record its own zero, and
so does the integral of a speed that has no angle beside it.
What depends on the position (cogging, unbalance, ripple, a detent force) has then another phase in each. The waves that
stand out from the residual of the base model are matched.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.regression.position_waves import (
    PERIODS,
    Basis,
    Source,
    along_a_line,
    behind_a_gear,
    explained_by,
    of_a_turn,
    products,
    refined,
    standing_out,
    tail,
)
from pmsm_ctrl.regression.records import members

__all__ = ["from_one_zero", "turned_by", "with_common_zero", "with_zero_of", "zero_of_known"]

Array = NDArray[np.float64]

SURE = 0.01  # significance of a zero that differs, over all that is looked for
AGREE = 0.7  # share of what a wave explains with a phase of its own in each record that one zero has to explain
STEPS = 64  # of the position in the shortest period
# Longest periods after which those along a line are taken to repeat together, at most, and how nearly, in periods.
MOST_TIMES, WHOLE = 12, 0.1
ROUNDS = 2  # in which waves are looked for


@dataclass(frozen=True, eq=False)
class _Waves:
    """What each record tells of some waves, cosine and sine of each in turn.

    Attributes
    ----------
    numbers : array, shape (n,)
        Radians of each wave in a radian of the axis (a metre).
    common : float
        Way after which all repeat, rad (m).
    information : array, shape (records, 2 n, 2 n)
    along : array, shape (records, 2 n)
    places : sequence of (float, float)
        Lowest and highest position along a line. A zero is known to a multiple of the common way: records that have no
        place in common are brought to one, where a period that is a little off does no harm.
    """

    numbers: Array
    common: float
    information: Array
    along: Array
    places: Sequence[tuple[float, float]]

    @property
    def different(self) -> float:
        """Positions on the common way that the shortest wave tells apart."""
        return self.common * float(self.numbers.max()) / np.pi

    @property
    def grid(self) -> Array:
        """Positions that are tried, rad (m), shape (steps,)."""
        steps = round(0.5 * STEPS * self.different)
        return self.common * (np.arange(steps) - steps // 2) / steps

    def turned(self, record: int, angle: float) -> tuple[Array, Array]:
        """Return information and product of one record with this angle, rad (m), added to its own."""
        c, s = np.cos(self.numbers * angle), np.sin(self.numbers * angle)
        back = np.zeros((2 * len(c),) * 2)
        even = 2 * np.arange(len(c))
        # cos(n (x + a)) = c cos - s sin, sin(n (x + a)) = s cos + c sin
        back[even, even], back[even, even + 1] = c, -s
        back[even + 1, even], back[even + 1, even + 1] = s, c
        return back @ self.information[record] @ back.T, back @ self.along[record]


def with_common_zero(source: Source) -> Record:
    """Return the record with the positions of its records counted from one zero, where waves along them tell it.

    Parameters
    ----------
    source : Source
    """
    record = source.record
    if len(record.records) < 2:
        return record
    shifts = _shifts([replace(source, parts=members(record))])
    return turned_by(record, shifts) if any(shift for shift, _ in shifts) else record


def with_zero_of(other: Source, like: Source) -> Record:
    """Return another record with its position counted from the zero of a first one, where waves along both tell it.

    Parameters
    ----------
    other, like : Source
    """
    shifts = _shifts([like, other], first=0)[1:]
    return turned_by(other.record, shifts) if any(shift for shift, _ in shifts) else other.record


def _shifts(sources: Sequence[Source], first: int | None = None) -> tuple[tuple[float, float], ...]:
    """Return what has to be added to the position of every part of these, and its standard error, rad (m).

    Waves of a turn tell a zero to within a turn, those of a load behind a gear tell how many turns there are.
    """
    if not all("theta" in one.record.signals for one in sources):
        return ()
    if sources[0].record.linear:
        return _shifts_by(sources, along_a_line, first)
    within = _shifts_by(sources, None, first)
    turns = _shifts_by(sources, behind_a_gear, first)
    if not any(shift for shift, _ in turns):
        return within
    if not any(shift for shift, _ in within):
        return turns
    turn = 2.0 * np.pi
    far = [turn * round((whole - part) / turn) for (whole, _), (part, _) in zip(turns, within, strict=True)]
    return tuple((part + more, stderr) for (part, stderr), more in zip(within, far, strict=True))


def _shifts_by(
    sources: Sequence[Source], waves: Callable[[Sequence[Source]], tuple[Basis, int]] | None, first: int | None
) -> tuple[tuple[float, float], ...]:
    """Return the same by some waves over the position, whose periods are found as well; by those of a turn if None."""
    found = None
    for _ in range(ROUNDS):  # a wave hides beside a larger one
        left = sources if found is None else [one.beside_waves(found, kept=False) for one in sources]
        more = standing_out(left, *(of_a_turn() if waves is None else waves(left)))
        if more is None:
            break
        found = more if found is None else found.with_more(more)
    if found is None:
        return ()
    quiet = [one.beside_waves(found) for one in sources]
    if waves is not None:
        alike, apart = (refined(quiet, found, common=common) for common in (True, False))
        different = 2 * len(found.numbers) * (sum(len(one.parts) for one in sources) - 1)
        if tail(apart[1] - alike[1], different) > SURE:
            return ()  # one zero, with periods a little longer or shorter
        found = apart[0]
    information, along = products(quiet, found)
    free = waves is not None
    places = [one.ends(here) if free else (0.0, 0.0) for one in sources for here in one.parts]
    return tuple(_matched(_Waves(found.numbers, _common(found.numbers), information, along, places), first))


def _common(numbers: Array) -> float:
    """Return the way after which waves repeat together, rad (m); as nearly as their periods are known.

    Parameters
    ----------
    numbers : array, shape (n,)
    """
    if np.all(numbers == np.rint(numbers)):  # orders of a turn
        return 2.0 * np.pi / max(float(np.gcd.reduce(np.rint(numbers).astype(np.int64))), 1.0)
    longest = 2.0 * np.pi / float(numbers.min())
    for times in range(1, MOST_TIMES + 1):
        turns = numbers * (times * longest / (2.0 * np.pi))
        if np.all(np.abs(turns - np.rint(turns)) < WHOLE):
            return times * longest
    return MOST_TIMES * longest


def zero_of_known(source: Source, known: Mapping[float, tuple[float, float]]) -> tuple[float, float] | None:
    """Return what has to be added to a position for known waves to be those of the log; None where nothing has to.

    Parameters
    ----------
    source : Source
        What is left over beside a model without these waves.
    known : dict of float to (float, float)
        Radians of each wave in a radian of the axis (a metre), to its cosine and sine part, N m (N).

    Returns
    -------
    (float, float) or None
        What has to be added, and its standard error, rad (m).
    """
    from scipy.special import chdtri

    numbers = np.array(sorted(known))
    ((rows, left, way),) = source.pieces(Basis(numbers, np.zeros(len(numbers), dtype=bool)))
    if way * numbers[0] < PERIODS * 2.0 * np.pi:
        return None
    common = _common(numbers)
    waves = _Waves(numbers, common, (rows @ rows.T)[None], (rows @ left)[None], [(0.0, 0.0)])
    size = np.ravel([known[number] for number in numbers.tolist()])

    def gain(angle: float) -> float:
        own, pull = waves.turned(0, angle)
        return float(2.0 * size @ pull - size @ own @ size)

    asked, grid = float(chdtri(1, SURE / waves.different)), waves.grid
    found = np.array([gain(angle) for angle in grid.tolist()])
    angle, curvature = _peak(grid, found, asked)
    best = gain(angle)
    if best < AGREE * explained_by(waves.information[0], waves.along[0]) or best - gain(0.0) < asked:
        return None
    return angle, float(np.sqrt(2.0 / max(curvature, 1e-300)))


def turned_by(record: Record, shifts: tuple[tuple[float, float], ...]) -> Record:
    """Return the record with an angle added to that of each of its records.

    Parameters
    ----------
    record : Record
    shifts : tuple of (float, float)
        What is added, and its standard error, rad (m).

    Returns
    -------
    Record
    """
    theta = record.signals["theta"] + _steps(record, shifts, record.prepared.t)
    prepared = replace(record.prepared, signals={**record.prepared.signals, "theta": theta})
    signals = {**record.signals, "theta": theta}
    return replace(record, prepared=prepared, signals=signals, shifts=shifts, memo={}, kept={})


def from_one_zero(log: Log, record: Record) -> Log:
    """Return the log that a record was made of, its positions counted as in the record.

    Parameters
    ----------
    log : Log
    record : Record
    """
    if not record.shifts or "theta" not in log:
        return log
    return log.with_channels(theta=log["theta"] + _steps(record, record.shifts, log.t))


def _steps(record: Record, shifts: tuple[tuple[float, float], ...], t: Array) -> Array:
    """Return what has to be added to the position at these times, rad (m), shape (n,)."""
    out = np.full(len(t), shifts[0][0])
    for k, one in enumerate(record.records[1:], start=1):
        out[int(np.searchsorted(t, one.start - 0.5 * record.period)) :] = shifts[k][0]
    return out


def _matched(waves: _Waves, first: int | None) -> list[tuple[float, float]]:
    """Return the angle to add to each record, and its standard error: record by record, beside those matched before.

    Nothing is added to the first one, that which tells most where none is given.
    """
    from scipy.special import chdtri

    count = len(waves.along)
    strength = [explained_by(waves.information[k], waves.along[k]) for k in range(count)]
    first = int(np.argmax(strength)) if first is None else first
    shifts = [(0.0, 0.0)] * count
    information, along = waves.information[first].copy(), waves.along[first].copy()
    asked = float(chdtri(1, SURE / (count * waves.different)))
    for k in np.argsort(strength)[::-1].tolist():
        if k == first:
            continue
        grid = waves.grid + _apart(waves.places[first], waves.places[k])
        found = np.array([_gain(waves, k, angle, (information, along)) for angle in grid.tolist()])
        angle, curvature = _peak(grid, found, asked)
        best, alone = _gain(waves, k, angle, (information, along)), explained_by(information, along)
        matched = best - alone >= AGREE * (strength[k] - len(along))
        if matched and best - _gain(waves, k, 0.0, (information, along)) > asked:
            shifts[k] = (angle, float(np.sqrt(2.0 / max(curvature, 1e-300))))
        own, pull = waves.turned(k, shifts[k][0])
        information, along = information + own, along + pull
    return shifts


def _apart(one: tuple[float, float], other: tuple[float, float]) -> float:
    """Return by how much the middle of one stretch is further than that of another one; 0 where they overlap."""
    if one[0] <= other[1] and other[0] <= one[1]:
        return 0.0
    return 0.5 * (sum(one) - sum(other))


def _gain(waves: _Waves, record: int, angle: float, others: tuple[Array, Array]) -> float:
    """Return what waves common to the others and to this record, turned by an angle, explain."""
    own, pull = waves.turned(record, angle)
    return explained_by(others[0] + own, others[1] + pull)


def _peak(grid: Array, found: Array, within: float) -> tuple[float, float]:
    """Return the place of a highest value on a periodic grid, and the curvature there.

    Of peaks that are as high to within a difference, the one nearest to the middle of the grid.
    """
    peaks = np.flatnonzero(
        (found >= np.roll(found, 1)) & (found >= np.roll(found, -1)) & (found > found.max() - within)
    )
    k, step = int(peaks[np.argmin(np.abs(peaks - len(grid) // 2))]), float(grid[1] - grid[0])
    left, middle, right = found[k - 1], found[k], found[(k + 1) % len(found)]
    bent = float(left - 2.0 * middle + right)
    off = 0.5 * float(left - right) / bent if bent < 0.0 else 0.0
    return float(grid[k] + off * step), -bent / step**2

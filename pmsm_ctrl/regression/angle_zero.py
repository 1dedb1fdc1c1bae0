"""Records whose positions were counted from different zeros, brought to one by what repeats with the position.

An encoder without an index, or a drive that sets its position to zero at power-up, gives every record its own zero, and
so does the integral of a speed that has no angle beside it.
What depends on the position (cogging, unbalance, ripple, a detent force) has then another phase in each. A rotary axis
has waves of a turn, of whole orders; the periods of a linear one are those that stand out over its position.
The waves that stand out from the residual of the base model are matched, those that keep their phase within each
record: a wave that the loops answer, or an error of the encoder, turns with the speed and tells nothing of a zero.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.evidence.tests import holm
from pmsm_ctrl.evidence.waves import highest_over_position, strongest_periods
from pmsm_ctrl.evidence.whitening import Whitener, make_whitener
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.regression.base_fit import Estimated
from pmsm_ctrl.regression.records import members

__all__ = ["Source", "from_one_zero", "turned_by", "with_common_zero", "with_zero_of", "zero_of_known"]

Array = NDArray[np.float64]

HIGHEST, KEPT = 96, 6  # orders of a turn that are looked for, and how many waves are matched at most
PERIODS = 3.0  # of a wave that a record must hold
SURE = 0.01  # significance, of a wave and of a zero that differs, over all that is looked for
# Share of what a wave explains in a half of a record that it has to explain as the other half has it, and of what it
# explains with a phase of its own in each record that one zero has to.
AGREE = 0.7
LEAST = 0.05  # share of what the base model leaves over that a wave has to explain
STEPS = 64  # of the position in the shortest period
AT_ONCE = 16  # waves whose columns are filtered together
# Longest periods after which those along a line are taken to repeat together, at most, and how nearly, in periods.
MOST_TIMES, WHOLE = 12, 0.1
ROUNDS = 2  # in which waves are looked for
FINE = (0.25, 0.05, 0.01)  # of a wave over the whole way: steps in which the periods along a line are refined


@dataclass(frozen=True, eq=False)
class _Basis:
    """Waves over the position.

    Attributes
    ----------
    numbers : array, shape (n,)
        Radians of each wave in a radian of the axis (a metre).
    by_torque : bool array, shape (n,)
        Whether its size is a share of the torque, as that of a ripple is.
    """

    numbers: Array
    by_torque: NDArray[np.bool_]

    @classmethod
    def of_both(cls, numbers: Array) -> _Basis:
        """Return waves of a constant size, and such as are a share of the torque."""
        return cls(np.tile(numbers, 2), np.repeat([False, True], len(numbers)))

    def with_more(self, others: _Basis) -> _Basis:
        """Return these and others, `KEPT` at most."""
        numbers = np.concatenate([self.numbers, others.numbers])[:KEPT]
        return _Basis(numbers, np.concatenate([self.by_torque, others.by_torque])[:KEPT])

    def some(self, chosen: NDArray[np.int64]) -> _Basis:
        """Return some of them."""
        return _Basis(self.numbers[chosen], self.by_torque[chosen])


@dataclass(frozen=True, eq=False)
class Source:
    """A record, and what its base model leaves over of the torque.

    Attributes
    ----------
    record : Record
    residual : array, shape (m,)
    beside : array, shape (k, m)
        The columns of the base model, and a constant: what a wave shares with them tells nothing.
    whitener : Whitener
    parts : bool array, shape (parts, m)
        Samples that have one zero.
    """

    record: Record
    residual: Array
    beside: Array
    whitener: Whitener
    parts: NDArray[np.bool_]

    @classmethod
    def of(cls, record: Record, fit: Estimated) -> Source:
        """Return a record with what its base model leaves over, all samples with one zero.

        Parameters
        ----------
        record : Record
        fit : Estimated
        """
        left = record.target[0] - fit.weighted.predicted()[0]
        base = fit.model.matrix[0].T
        # no design states a constant torque, and each record may have its own
        beside = np.vstack([base[np.any(base != 0.0, axis=1)], np.ones(len(left))])
        return cls(record, left, beside, fit.whitener, np.ones((1, len(left)), dtype=bool))

    def columns(self, basis: _Basis) -> Iterator[Array]:
        """Yield filtered cosines and sines of the waves in turn, a few at a time, shape (2 i, m)."""
        theta, torque = self.record.signals["theta"], self.record.signals["torque"]
        for start in range(0, len(basis.numbers), AT_ONCE):
            part = basis.some(np.arange(start, min(start + AT_ONCE, len(basis.numbers))))
            some = part.numbers[:, None] * theta
            both = np.stack([np.cos(some), np.sin(some)], axis=1)
            both[part.by_torque] *= torque / max(float(np.sqrt(np.mean(torque**2))), 1e-300)
            yield self.record.prepared.columns(both.reshape(-1, len(theta)))

    def pieces(self, basis: _Basis) -> Iterator[tuple[Array, Array, float]]:
        """Yield of each part what the waves, shape (2 n, k), and the residual have beside the base model, and the way.

        Parameters
        ----------
        basis : _Basis
        """
        theta = self.record.at_grid(self.record.signals["theta"])
        rows = np.concatenate([self.whitener.part(0, some) for some in self.columns(basis)])
        left, beside = self.whitener.part(0, self.residual), self.whitener.part(0, self.beside)
        for here in self.parts:
            inside = here[self.whitener.used]
            way = float(np.sum(np.abs(np.diff(theta[here & self.record.mask]))))
            both = _beyond(beside[:, inside], np.vstack([rows[:, inside], left[None, inside]]))
            yield both[:-1], both[-1], way

    def place(self, here: NDArray[np.bool_]) -> float:
        """Return the mean position of a part, rad (m).

        Parameters
        ----------
        here : bool array, shape (m,)
        """
        return float(np.mean(self.record.at_grid(self.record.signals["theta"])[here & self.record.mask]))

    def beside_waves(self, basis: _Basis, kept: bool = True) -> Source:
        """Return the same with the noise that is left beside these waves: with them in it, it hides their phases.

        Parameters
        ----------
        basis : _Basis
        kept : bool
            Whether they stay in the residual.
        """
        record, clean, rank = self.record, self.residual.copy(), 0
        rows = np.concatenate(list(self.columns(basis)))
        for here in self.parts:
            inside = here & record.mask
            weight = record.weight[0] * inside
            own = np.vstack([rows, self.beside])[:, inside]
            value = np.linalg.lstsq((own * weight[inside]).T, (clean * weight)[inside], rcond=1e-9)[0]
            clean[inside] -= value @ own
            rank += len(own)
        one = (clean[None], record.weight[:1], record.mask, record.rate, min(rank, int(record.mask.sum()) // 2))
        return replace(self, residual=self.residual if kept else clean, whitener=make_whitener(*one))


def _beyond(beside: Array, rows: Array) -> Array:
    """Return rows, shape (n, k), without what they share with others, shape (i, k)."""
    shared = np.linalg.lstsq(beside.T, rows.T, rcond=1e-9)[0]
    return np.asarray(rows - shared.T @ beside)


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
    places : array, shape (records,)
        Mean position where the zeros are known only to a multiple of the common way, and one is as good as another:
        records of one axis lie at the same place, and a period that is a little off does no harm there.
    """

    numbers: Array
    common: float
    information: Array
    along: Array
    places: Array

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
    """Return what has to be added to the position of every part of these, and its standard error, rad (m)."""
    if not all("theta" in one.record.signals for one in sources):
        return ()
    linear, found = sources[0].record.linear, None
    for _ in range(ROUNDS):  # a wave hides beside a larger one
        left = sources if found is None else [one.beside_waves(found, kept=False) for one in sources]
        more = _standing_out(left, *(_along_a_line(left) if linear else _of_a_turn()))
        if more is None:
            break
        found = more if found is None else found.with_more(more)
    if found is None:
        return ()
    quiet = [one.beside_waves(found) for one in sources]
    if linear:
        alike, apart = (_refined(quiet, found, common=common) for common in (True, False))
        different = 2 * len(found.numbers) * (sum(len(one.parts) for one in sources) - 1)
        if _tail(apart[1] - alike[1], different) > SURE:
            return ()  # one zero, with periods a little longer or shorter
        found = apart[0]
    information, along = _products(quiet, found)
    places = np.array([one.place(here) if linear else 0.0 for one in sources for here in one.parts])
    return tuple(_matched(_Waves(found.numbers, _common(found.numbers, linear), information, along, places), first))


def _products(sources: Sequence[Source], basis: _Basis) -> tuple[Array, Array]:
    """Return what each part tells of these waves, as `_Waves` has it."""
    pieces = [piece for one in sources for piece in one.pieces(basis)]
    information = np.array([rows @ rows.T for rows, _, _ in pieces])
    return information, np.array([rows @ left for rows, left, _ in pieces])


def _refined(sources: Sequence[Source], basis: _Basis, common: bool) -> tuple[_Basis, float]:
    """Return the waves along a line with the numbers that explain most, with one phase in all parts or one in each.

    Also what they explain, in units of the noise. Each number is moved to the top of a parabola in turn.
    """

    def explained(numbers: Array) -> float:
        information, along = _products(sources, replace(basis, numbers=numbers))
        if common:
            return _explained(information.sum(axis=0), along.sum(axis=0))
        return sum(map(_explained, information, along))

    numbers = basis.numbers.copy()
    positions = [(one.record.at_grid(one.record.signals["theta"]), one.parts) for one in sources]
    extent = max(float(np.ptp(theta[here])) for theta, parts in positions for here in parts)
    best = explained(numbers)
    for reach in FINE:
        step = 2.0 * np.pi * reach / extent
        for k in range(len(numbers)):
            left, right = (explained(numbers + sign * step * (np.arange(len(numbers)) == k)) for sign in (-1.0, 1.0))
            bent = left - 2.0 * best + right
            if bent >= 0.0:
                continue
            moved = numbers.copy()
            moved[k] += step * float(np.clip(0.5 * (left - right) / bent, -1.0, 1.0))
            if (value := explained(moved)) > best:
                numbers, best = moved, value
    return replace(basis, numbers=numbers), best


def _common(numbers: Array, linear: bool) -> float:
    """Return the way after which waves repeat together, rad (m); of a linear axis as nearly as their periods are known.

    Parameters
    ----------
    numbers : array, shape (n,)
    linear : bool
    """
    if not linear:
        return 2.0 * np.pi / float(np.gcd.reduce(np.rint(numbers).astype(np.int64)))
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
    ((rows, left, way),) = source.pieces(_Basis(numbers, np.zeros(len(numbers), dtype=bool)))
    if way * numbers[0] < PERIODS * 2.0 * np.pi:
        return None
    common = _common(numbers, source.record.linear)
    waves = _Waves(numbers, common, (rows @ rows.T)[None], (rows @ left)[None], np.zeros(1))
    size = np.ravel([known[number] for number in numbers.tolist()])

    def gain(angle: float) -> float:
        own, pull = waves.turned(0, angle)
        return float(2.0 * size @ pull - size @ own @ size)

    asked, grid = float(chdtri(1, SURE / waves.different)), waves.grid
    found = np.array([gain(angle) for angle in grid.tolist()])
    angle, curvature = _peak(grid, found, asked)
    best = gain(angle)
    if best < AGREE * _explained(waves.information[0], waves.along[0]) or best - gain(0.0) < asked:
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


def _of_a_turn() -> tuple[_Basis, int]:
    """Return all waves of a turn, and how many there are."""
    return _Basis.of_both(np.arange(1.0, HIGHEST + 1.0)), 2 * HIGHEST


def _along_a_line(sources: Sequence[Source]) -> tuple[_Basis, int]:
    """Return the waves along a linear axis that are the strongest, and of how many possible ones."""
    parts, highest = [], 0.0
    for one in sources:
        record = one.record
        used = record.weight[0] * record.mask > 0.0
        theta, omega = (record.at_grid(record.signals[name]) for name in ("theta", "omega"))
        weighted = one.residual * record.weight[0] ** 2
        parts += [(weighted[here & used], theta[here & used]) for here in one.parts]
        highest = max(highest, highest_over_position(theta[used], omega[used], record.cutoff))
    periods, possible = strongest_periods(parts, highest, KEPT)
    return _Basis(2.0 * np.pi / periods, np.zeros(len(periods), dtype=bool)), possible


def _standing_out(sources: Sequence[Source], basis: _Basis, possible: int) -> _Basis | None:
    """Return the waves that stand out, each part with a phase of its own; None where none does.

    These are the strongest of so many possible ones.
    """
    if possible == 0:
        return None
    pieces = [piece for one in sources for piece in one.pieces(basis)]
    p_values, steady = [], []
    for k, number in enumerate(basis.numbers.tolist()):
        gain, apart, told, left_over, count = 0.0, 0.0, 0.0, 0.0, 0
        for rows, left, way in pieces:
            if way * number < PERIODS * 2.0 * np.pi:
                continue
            own, half = rows[2 * k : 2 * k + 2], len(left) // 2
            halves = [
                (own[:, part] @ own[:, part].T, own[:, part] @ left[part]) for part in (slice(half), slice(half, None))
            ]
            gain += _explained(own @ own.T, own @ left)
            apart += sum(_explained(*one) for one in halves)
            told += _foretold(*halves) + _foretold(*halves[::-1])
            left_over += float(left @ left)
            count += 2
        p_values.append(min(_tail(gain, count) * possible / len(basis.numbers), 1.0))
        steady.append(told > AGREE * (apart - 2 * count) and gain - count > LEAST * left_over)
    sure = np.flatnonzero((np.array(holm(p_values)) < SURE) & steady)
    if len(sure) == 0:
        return None
    best = sure[np.argsort(np.array(p_values)[sure], kind="stable")][:KEPT]
    return basis.some(np.sort(best))


def _tail(gain: float, count: int) -> float:
    from scipy.special import chdtrc

    return float(chdtrc(count, gain)) if count else 1.0


def _matched(waves: _Waves, first: int | None) -> list[tuple[float, float]]:
    """Return the angle to add to each record, and its standard error: record by record, beside those matched before.

    Nothing is added to the first one, that which tells most where none is given.
    """
    from scipy.special import chdtri

    count = len(waves.along)
    strength = [_explained(waves.information[k], waves.along[k]) for k in range(count)]
    first = int(np.argmax(strength)) if first is None else first
    shifts = [(0.0, 0.0)] * count
    information, along = waves.information[first].copy(), waves.along[first].copy()
    asked = float(chdtri(1, SURE / (count * waves.different)))
    for k in np.argsort(strength)[::-1].tolist():
        if k == first:
            continue
        grid = waves.grid + (waves.places[first] - waves.places[k])
        found = np.array([_gain(waves, k, angle, (information, along)) for angle in grid.tolist()])
        angle, curvature = _peak(grid, found, asked)
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


def _foretold(by: tuple[Array, Array], of: tuple[Array, Array]) -> float:
    """Return what a wave as one half of a record has it explains of the other half, in units of the noise."""
    wave = np.linalg.lstsq(*by, rcond=1e-9)[0]
    return float(wave @ (2.0 * of[1] - of[0] @ wave))


def _explained(information: Array, along: Array) -> float:
    """Return what waves explain, in units of the noise."""
    return float(along @ np.linalg.lstsq(information, along, rcond=1e-9)[0])

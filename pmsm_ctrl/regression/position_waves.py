"""Waves over the position that what is left of the torque holds: of whole orders of a turn, or of periods along a line.

Some have a constant size, as a cogging, an unbalance or a detent force; that of others is a share of the torque, as of
a ripple. Those count that keep their phase within each record: a wave that the loops answer, or an error of the
encoder, turns with the speed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.evidence.tests import holm
from pmsm_ctrl.evidence.waves import highest_over_position, strongest_periods
from pmsm_ctrl.evidence.whitening import Whitener, make_whitener
from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.regression.base_fit import Estimated

__all__ = [
    "PERIODS",
    "Basis",
    "Source",
    "along_a_line",
    "behind_a_gear",
    "explained_by",
    "of_a_turn",
    "products",
    "refined",
    "standing_out",
    "tail",
]

Array = NDArray[np.float64]

SLOWEST_TURN = 0.8  # radians of a load behind a gear in a radian of the motor, at most
HIGHEST, KEPT = 96, 6  # orders of a turn that are looked for, and how many waves are kept at most
PERIODS = 3.0  # of a wave that a record must hold
SURE = 0.01  # significance of a wave, over all that is looked for
# Share of what a wave explains in a half of a record that it has to explain as the other half has it.
AGREE = 0.7
LEAST = 0.05  # share of what the base model leaves over that a wave has to explain
AT_ONCE = 16  # waves whose columns are filtered together
FINE = (0.25, 0.05, 0.01)  # of a wave over the whole way: steps in which the periods along a line are refined


@dataclass(frozen=True, eq=False)
class Basis:
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
    def of_both(cls, numbers: Array) -> Basis:
        """Return waves of a constant size, and such as are a share of the torque."""
        return cls(np.tile(numbers, 2), np.repeat([False, True], len(numbers)))

    def with_more(self, others: Basis) -> Basis:
        """Return these and others, `KEPT` at most."""
        numbers = np.concatenate([self.numbers, others.numbers])[:KEPT]
        return Basis(numbers, np.concatenate([self.by_torque, others.by_torque])[:KEPT])

    def some(self, chosen: NDArray[np.int64]) -> Basis:
        """Return some of them."""
        return Basis(self.numbers[chosen], self.by_torque[chosen])


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

    def columns(self, basis: Basis) -> Iterator[Array]:
        """Yield filtered cosines and sines of the waves in turn, a few at a time, shape (2 i, m)."""
        theta, torque = self.record.signals["theta"], self.record.signals["torque"]
        for start in range(0, len(basis.numbers), AT_ONCE):
            part = basis.some(np.arange(start, min(start + AT_ONCE, len(basis.numbers))))
            some = part.numbers[:, None] * theta
            both = np.stack([np.cos(some), np.sin(some)], axis=1)
            both[part.by_torque] *= torque / max(float(np.sqrt(np.mean(torque**2))), 1e-300)
            yield self.record.prepared.columns(both.reshape(-1, len(theta)))

    def pieces(self, basis: Basis) -> Iterator[tuple[Array, Array, float]]:
        """Yield of each part what the waves, shape (2 n, k), and the residual have beside the base model, and the way.

        Parameters
        ----------
        basis : Basis
        """
        theta = self.record.at_grid(self.record.signals["theta"])
        rows = np.concatenate([self.whitener.part(0, some) for some in self.columns(basis)])
        left, beside = self.whitener.part(0, self.residual), self.whitener.part(0, self.beside)
        for here in self.parts:
            inside = here[self.whitener.used]
            way = float(np.sum(np.abs(np.diff(theta[here & self.record.mask]))))
            both = _beyond(beside[:, inside], np.vstack([rows[:, inside], left[None, inside]]))
            yield both[:-1], both[-1], way

    def ends(self, here: NDArray[np.bool_]) -> tuple[float, float]:
        """Return the lowest and the highest position of a part, rad (m).

        Parameters
        ----------
        here : bool array, shape (m,)
        """
        theta = self.record.at_grid(self.record.signals["theta"])[here]  # at rest as well: it may never move
        return float(theta.min()), float(theta.max())

    def beside_waves(self, basis: Basis, kept: bool = True) -> Source:
        """Return the same with the noise that is left beside these waves: with them in it, it hides their phases.

        Parameters
        ----------
        basis : Basis
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


def products(sources: Sequence[Source], basis: Basis) -> tuple[Array, Array]:
    """Return what each part tells of these waves.

    Parameters
    ----------
    sources : sequence of Source
    basis : Basis

    Returns
    -------
    (array, array), shapes (parts, 2 n, 2 n) and (parts, 2 n)
        Products of their cosines and sines with each other, and with what is left.
    """
    pieces = [piece for one in sources for piece in one.pieces(basis)]
    information = np.array([rows @ rows.T for rows, _, _ in pieces])
    return information, np.array([rows @ left for rows, left, _ in pieces])


def refined(sources: Sequence[Source], basis: Basis, common: bool) -> tuple[Basis, float]:
    """Return the waves along a line with the numbers that explain most, and what they explain, in units of the noise.

    Each number is moved to the top of a parabola in turn.

    Parameters
    ----------
    sources : sequence of Source
    basis : Basis
    common : bool
        Whether they have one phase in all parts, or one of their own in each.

    Returns
    -------
    (Basis, float)
    """

    def explained(numbers: Array) -> float:
        information, along = products(sources, replace(basis, numbers=numbers))
        if common:
            return explained_by(information.sum(axis=0), along.sum(axis=0))
        return sum(map(explained_by, information, along))

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


def of_a_turn() -> tuple[Basis, int]:
    """Return all waves of a turn, and how many there are."""
    return Basis.of_both(np.arange(1.0, HIGHEST + 1.0)), 2 * HIGHEST


def behind_a_gear(sources: Sequence[Source]) -> tuple[Basis, int]:
    """Return the strongest waves of more than a turn, and of how many possible ones.

    Parameters
    ----------
    sources : sequence of Source

    Returns
    -------
    (Basis, int)
    """
    return along_a_line(sources, SLOWEST_TURN)


def along_a_line(sources: Sequence[Source], highest: float = np.inf) -> tuple[Basis, int]:
    """Return the waves along an axis that are the strongest, and of how many possible ones.

    Parameters
    ----------
    sources : sequence of Source
    highest : float
        Radians in a radian of the axis (a metre) that a wave may have.

    Returns
    -------
    (Basis, int)
    """
    parts, passed = [], 0.0
    for one in sources:
        record = one.record
        used = record.weight[0] * record.mask > 0.0
        theta, omega = (record.at_grid(record.signals[name]) for name in ("theta", "omega"))
        weighted = one.residual * record.weight[0] ** 2
        parts += [(weighted[here & used], theta[here & used]) for here in one.parts]
        passed = max(passed, highest_over_position(theta[used], omega[used], record.cutoff))
    periods, possible = strongest_periods(parts, min(passed, highest / (2.0 * np.pi)), KEPT)
    return Basis(2.0 * np.pi / periods, np.zeros(len(periods), dtype=bool)), possible


def standing_out(sources: Sequence[Source], basis: Basis, possible: int) -> Basis | None:
    """Return the waves that stand out, each part with a phase of its own; None where none does.

    Parameters
    ----------
    sources : sequence of Source
    basis : Basis
        The strongest of the possible ones.
    possible : int
    """
    if len(basis.numbers) == 0:
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
            gain += explained_by(own @ own.T, own @ left)
            apart += sum(explained_by(*one) for one in halves)
            told += _foretold(*halves) + _foretold(*halves[::-1])
            left_over += float(left @ left)
            count += 2
        p_values.append(min(tail(gain, count) * possible / len(basis.numbers), 1.0))
        steady.append(told > AGREE * (apart - 2 * count) and gain - count > LEAST * left_over)
    sure = np.flatnonzero((np.array(holm(p_values)) < SURE) & steady)
    if len(sure) == 0:
        return None
    best = sure[np.argsort(np.array(p_values)[sure], kind="stable")][:KEPT]
    return basis.some(np.sort(best))


def tail(gain: float, count: int) -> float:
    """Return the upper tail of the chi-square distribution; 1 without a degree of freedom.

    Parameters
    ----------
    gain : float
    count : int
        Degrees of freedom.
    """
    from scipy.special import chdtrc

    return float(chdtrc(count, gain)) if count else 1.0


def _foretold(by: tuple[Array, Array], of: tuple[Array, Array]) -> float:
    """Return what a wave as one half of a record has it explains of the other half, in units of the noise."""
    wave = np.linalg.lstsq(*by, rcond=1e-9)[0]
    return float(wave @ (2.0 * of[1] - of[0] @ wave))


def explained_by(information: Array, along: Array) -> float:
    """Return what waves explain, in units of the noise.

    Parameters
    ----------
    information : array, shape (n, n)
    along : array, shape (n,)
    """
    return float(along @ np.linalg.lstsq(information, along, rcond=1e-9)[0])

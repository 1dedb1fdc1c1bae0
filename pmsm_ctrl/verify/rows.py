"""The rows of two records: what is left of them at a delay and a sign of the speed, and the gains there.

The integral of the error is a sum over the samples of the log, where the controller adds up every cycle. In a log that
is slower than the controller, each sample of a rounded error stands for the cycles between: the sum walks away from the
integral, at random. This error is in a column, not in the current, and makes its coefficient too small; the friction
that the integrator carries is then taken for feedforward, in both records. Rows that are `turned` have the integral
for what is explained and the current for a column: then all error is in what is explained.
Source: W. A. Fuller, Measurement Error Models, 1987, ch. 1.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.evidence.linalg import factored
from pmsm_ctrl.evidence.whitening import ChannelWhitener, channel_whitener
from pmsm_ctrl.verify import policy
from pmsm_ctrl.verify.record import Record, Sign, delayed

__all__ = ["Added", "Pairs", "Place", "Rows", "beyond"]

Array = NDArray[np.float64]
Pairs = Mapping[str, tuple[Array | None, Array | None]]

ROUNDS = 2  # of whitening
TURNED_ROUNDS = 3  # of whitening a walk at random, whose level the first rounds take for a part of the law


@dataclass(frozen=True)
class Place:
    """Where a feedforward is looked for.

    Attributes
    ----------
    delay : float
        s.
    sign : Sign or None
        Of the speed in the drive; None for that of the design.
    free : bool
        Whether the shape of that sign is fitted beside its width.
    """

    delay: float
    sign: Sign | None = None
    free: bool = False


@dataclass(frozen=True, eq=False)
class Added:
    """Gains along one or several currents, with the covariance of their errors.

    Attributes
    ----------
    names : tuple of str
    value : array, shape (m,)
    covariance : array, shape (m, m)
    """

    names: tuple[str, ...]
    value: Array
    covariance: Array

    @property
    def stderr(self) -> Array:
        """Standard errors, shape (m,)."""
        return np.sqrt(np.diag(self.covariance))


def _norms(columns: Array) -> Array:
    return np.asarray(np.maximum(np.linalg.norm(columns, axis=0), 1e-300))


def beyond(columns: Array, target: Array) -> Array:
    """Return what columns do not explain of a target; few columns, so that their products are exact enough."""
    scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    unit = columns / scale
    return np.asarray(target - unit @ (np.linalg.pinv(unit.T @ unit, rcond=1e-10, hermitian=True) @ (unit.T @ target)))


class Rows:
    """The rows of both records, one unused row between them."""

    def __init__(self, before: Record, after: Record, *, separate: bool, turned: bool = False) -> None:
        self.records, self.separate, self.is_turned = (before, after), separate, turned
        n, m = len(before.t), len(after.t)
        self.split, size = n, n + 1 + m
        k = before.columns.shape[1]
        base = np.zeros((size, (2 * k if separate else k) + 2))
        base[:n, :k] = before.columns
        base[n + 1 :, (k if separate else 0) : (2 * k if separate else k)] = after.columns
        base[:n, -2], base[n + 1 :, -1] = 1.0, 1.0
        self.base = base / np.maximum(np.linalg.norm(base, axis=0), 1e-300)
        self.y = self.joined(before.current, after.current)
        self.used = self.joined(before.used.astype(float), after.used.astype(float)) > 0.0
        own = after.integral
        self.integrals = [own, k + own] if separate else [own]
        self.instruments, self.target = self.base, self.y
        if turned:
            self._turn()

    def _turn(self) -> None:
        """Let the current stand for the integral; of separate laws each in its own record."""
        self.target = self.base[:, self.integrals].sum(axis=1)
        self.instruments = self.base.copy()
        here = [self.y] if not self.separate else [self.joined(self.y[: self.split], None),
                                                   self.joined(None, self.y[self.split + 1 :])]  # fmt: skip
        for column, current in zip(self.integrals, here, strict=True):
            self.instruments[:, column] = current / max(float(np.linalg.norm(current)), 1e-300)

    def turned(self) -> Rows:
        """Return the rows with the integral for what is explained."""
        return Rows(*self.records, separate=self.separate, turned=True)

    def joined(self, before: Array | None, after: Array | None) -> Array:
        """Return one column over both records, zero where there is none."""
        out = np.zeros(self.split + 1 + len(self.records[1].t))
        if before is not None:
            out[: self.split] = before
        if after is not None:
            out[self.split + 1 :] = after
        return out

    def signed(self, sign: Sign | None) -> tuple[Record, Record]:
        """Return both records with a sign of the speed."""
        before, after = self.records
        return before.signed(sign), after.signed(sign)

    def currents(self, delay: float, pairs: Pairs) -> Array:
        """Return the compensator's columns at a delay, shape (n, m)."""
        made = [
            self.joined(*(None if one is None else delayed(record, one, delay)
                          for record, one in zip(self.records, pair, strict=True)))
            for pair in pairs.values()
        ]  # fmt: skip
        return np.column_stack(made)

    def totals(self, place: Place) -> Array:
        """Return what acts in both records, and the parts that the second has more: each may be missing."""
        before, after = self.signed(place.sign)
        parts = {name: (None, one) for name, one in after.fed.items()}
        return self.currents(place.delay, {"before": (before.total, after.total), **parts, **self._shape(place)})

    def _shape(self, place: Place) -> Pairs:
        """Return what other widths of the sign differ by.

        It is zero at speeds beyond, so that the gain is judged there.
        """
        own = self.records[1].unsigned
        if not place.free or place.sign is None or own is None:
            return {}
        record, sign = self.records[1].signed(place.sign), place.sign
        others = [Sign(sign.width * factor, curved=True) for factor in policy.SHAPES]
        others = [one for one in others if one != sign and one.width < policy.WIDEST * own.peak]
        return {f"shape {one.width}": (None, self.records[1].signed(one).total - record.total) for one in others}

    @cached_property
    def _differences(self) -> tuple[NDArray[np.bool_], Array, Array]:
        """Pairs of neighbours of the second record; their basis of the law, and what it leaves of the current."""
        here = slice(self.split + 1, None)  # the record before tells nothing of the delay
        pairs = self.used[here][1:] & self.used[here][:-1]
        basis = factored(np.diff(self.base[here], axis=0)[pairs]).basis
        y = np.diff(self.y[here])[pairs]
        return pairs, basis, y - basis @ (basis.T @ y)

    def roughly(self, delays: Sequence[float], sign: Sign | None) -> list[float]:
        """Return what the parts leave of the differences of neighbours, at each delay."""
        pairs, basis, y = self._differences
        record = self.records[1].signed(sign)
        left = []
        for delay in delays:
            c = np.column_stack([np.diff(delayed(record, one, delay))[pairs] for one in record.fed.values()])
            c = c - basis @ (basis.T @ c)
            left.append(float(np.sum(beyond(c, y) ** 2)))
        return left

    def rough_delay(self, sign: Sign | None) -> tuple[float, float]:
        """Return the delay, in whole periods, that explains differences of neighbours best, and what it leaves."""
        period = self.records[1].period
        step = max(1, math.ceil((policy.LATEST - policy.EARLIEST) / period / policy.STEPS))
        lags = np.arange(round(policy.EARLIEST / period), round(policy.LATEST / period) + 1, step)
        left = self.roughly([lag * period for lag in lags.tolist()], sign)
        zero, best = int(np.argmin(np.abs(lags))), int(np.argmin(left))
        # without anything added all delays are alike: none is taken
        best = best if left[best] < policy.CLEARER * left[zero] else zero
        return float(lags[best]) * period, left[best]

    def rows(self, place: Place) -> Array:
        """Return the columns of the law and of the compensator, shape (n, k)."""
        return np.column_stack([self.base, self.totals(place)])

    def residual(self, place: Place) -> Array:
        """Return what these columns leave of the current, A."""
        rows = self.rows(place)
        value = np.linalg.lstsq(rows[self.used], self.y[self.used], rcond=None)[0]
        return np.asarray(np.where(self.used, self.y - rows @ value, 0.0))

    def residual_rms(self, place: Place) -> float:
        """Return the rms of what is left, A."""
        return float(np.sqrt(np.mean(self.residual(place)[self.used] ** 2)))

    def whitener(self, place: Place) -> ChannelWhitener:
        """Return the whitener of the noise that the law leaves."""
        currents, rest = self.totals(place), self.residual(place)
        rows = np.column_stack([self.base, currents])
        whitener = self._of(rest, rows.shape[1])
        for _ in range(TURNED_ROUNDS if self.is_turned else ROUNDS - 1):
            rest = np.where(self.used, self.y - rows @ self._value(whitener, currents), 0.0)
            whitener = self._of(rest, rows.shape[1])
        return whitener

    def _value(self, whitener: ChannelWhitener, currents: Array) -> Array:
        """Return the coefficients of the law and of these currents."""
        rows, instruments = (self.white(whitener, np.column_stack([one, currents]))
                             for one in (self.base, self.instruments))  # fmt: skip
        y = self.white(whitener, self.y)
        if not self.is_turned:
            return np.asarray(np.linalg.lstsq(rows, y, rcond=None)[0])
        scale, held = _norms(rows), _norms(instruments)
        solved = np.linalg.pinv((instruments / held).T @ (rows / scale), rcond=1e-12) @ ((instruments / held).T @ y)
        return np.asarray(solved / scale)

    def _of(self, rest: Array, lost: int) -> ChannelWhitener:
        return channel_whitener(rest, np.ones_like(rest), self.used, 1.0 / self.records[1].period, lost)

    def white(self, whitener: ChannelWhitener, values: Array) -> Array:
        """Whiten a column or columns over all rows."""
        kept = values[self.used]
        return whitener(np.atleast_2d(kept.T)).T if values.ndim == 2 else whitener(kept[None])[0]

    def solved(self, whitener: ChannelWhitener, place: Place, pairs: Pairs) -> Added:
        """Return the gains along these currents, no error smaller than what blocks of the records differ by."""
        names = tuple(pairs)
        currents = self.currents(place.delay, {**pairs, **self._shape(place)})
        rows = self.white(whitener, np.column_stack([self.base, currents]))
        scale = _norms(rows)
        rows, y = rows / scale, self.white(whitener, self.y)
        held = rows
        if self.is_turned:
            held = self.white(whitener, np.column_stack([self.instruments, currents]))
            held = held / _norms(held)
        inverse = np.linalg.pinv(held.T @ rows, rcond=1e-12, hermitian=not self.is_turned)
        value = inverse @ (held.T @ y)
        left = y - rows @ value
        free = max(1, len(y) - rows.shape[1])
        model = (inverse @ (held.T @ held) @ inverse.T if self.is_turned else inverse) * float(left @ left) / free
        blocks = np.array([part.sum(axis=0) for part in np.array_split(held * left[:, None], policy.BLOCKS)])
        robust = inverse @ (blocks.T @ blocks) @ inverse.T * policy.BLOCKS / (policy.BLOCKS - 1.0)
        share = np.sqrt(np.maximum(np.diag(robust) / np.maximum(np.diag(model), 1e-300), 1.0))
        covariance = model * np.outer(share, share) / np.outer(scale, scale)
        own = slice(self.base.shape[1], self.base.shape[1] + len(names))
        found, spread = (value / scale)[own], covariance[own, own].copy()
        dead = scale[own] <= 1e-300  # an effect that this motion does not move
        spread[dead, dead] = math.inf
        return Added(names, found, spread)

    def gains(
        self, whitener: ChannelWhitener, places: Sequence[Place], *, by_part: bool
    ) -> Added:  # fmt: skip
        """Return the gains before the download, and what was added in all or by part, at the first place.

        The other places come in pairs, the ends of an interval of 95 %: what the gains change between them is in their
        errors.
        """
        found, *ends = (self._gains_at(whitener, place, by_part) for place in places)
        covariance = found.covariance
        for low, high in zip(ends[::2], ends[1::2], strict=True):
            away = (high.value - low.value) / 3.92
            covariance = covariance + np.outer(away, away)
        return replace(found, covariance=covariance)

    def _gains_at(self, whitener: ChannelWhitener, place: Place, by_part: bool) -> Added:
        before, after = self.signed(place.sign)
        more = dict(after.fed) if by_part else {"change": after.total}
        pairs: Pairs = {"before": (before.total, after.total), **{name: (None, one) for name, one in more.items()}}
        return self.solved(whitener, place, pairs)

    def walk_of_integral(self, whitener: ChannelWhitener, place: Place) -> float:
        """Return by how much the sum misses the integral per sample, if all that is left is due to that.

        Returns
        -------
        float
            Rms, in the unit of the controller's error.
        """
        value = self._value(whitener, self.totals(place))
        rest, column = self.y - self.rows(place) @ value, self.integrals[-1]
        here = slice(self.split + 1, None)
        # the base is scaled, the record's own column is not
        scale = np.linalg.norm(self.records[1].columns[:, self.records[1].integral])
        scale = scale / max(float(np.linalg.norm(self.base[here, column])), 1e-300)
        steps = np.diff(rest[here])[self.used[here][1:] & self.used[here][:-1]]
        per_sample = abs(value[column]) / max(float(scale), 1e-300) * self.records[1].period
        return float(np.std(steps) / max(per_sample, 1e-300))

    def added(self, whitener: ChannelWhitener, place: Place) -> tuple[Array, Array]:
        """Return the current of the second record beside its controller, and that of it which the compensator makes."""
        rows, value = self.rows(place), self._value(whitener, self.totals(place))
        here = slice(self.split + 1, None)
        k = self.base.shape[1]
        law = self.base[here] @ value[:k]
        return self.y[here] - law, rows[here, k:] @ value[k:]

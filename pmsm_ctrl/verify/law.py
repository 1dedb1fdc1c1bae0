"""The control law found in two logs: gains of the controller, and what was added to its output.

The current reference is a linear combination of what the controller reads: the position error, its integral, the speed
error and the references fed forward. The law holds whatever the axis does, so neither inertia nor friction is needed.
What the second log has beside it, along the compensator's own feedforward, is the gain that was applied.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.evidence.linalg import factored
from pmsm_ctrl.evidence.whitening import ChannelWhitener, channel_whitener
from pmsm_ctrl.verify import policy

__all__ = ["Added", "Law", "Record", "averaged", "cropped", "delayed", "fit_law"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

ROUNDS = 2  # of whitening


@dataclass(frozen=True, eq=False)
class Record:
    """One log, ready to be fitted.

    Attributes
    ----------
    t : array, shape (n,)
        s, from 0.
    current : array, shape (n,)
        Current that the law explains, A.
    columns : array, shape (n, k)
        What the controller reads.
    fed : dict of effect to array, shape (n,)
        Currents of the compensator at a gain of 1, A.
    used : bool array, shape (n,)
    """

    t: Array
    current: Array
    columns: Array
    fed: Mapping[str, Array]
    used: Mask

    @property
    def period(self) -> float:
        """Of the samples, s."""
        return float(self.t[1] - self.t[0])

    @property
    def total(self) -> Array:
        """Current of all parts of the compensator, A."""
        return np.asarray(np.sum(list(self.fed.values()), axis=0))


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


@dataclass(frozen=True, eq=False)
class Law:
    """What was found.

    Attributes
    ----------
    gain : Added
        ``before`` and ``change``: gain in the first log, and what the second has more.
    parts : Added
        Change of the gain by effect.
    delay, delay_low, delay_high : float
        s; NaN where nothing was added.
    explained : float
        Share of the varying current, in means over 10 ms, that the law explains.
    residual : float
        Rms, A.
    retuned : bool
        Whether the gains of the controller differ between the logs.
    t, added, predicted : array, shape (n,)
        Time (s), current of the second log beside its controller, and what the compensator makes of it, A.
    """

    gain: Added
    parts: Added
    delay: float
    delay_low: float
    delay_high: float
    explained: float
    residual: float
    retuned: bool
    t: Array
    added: Array
    predicted: Array


def delayed(record: Record, values: Array, delay: float) -> Array:
    """Return values of a record later by `delay` (s), shape (n,)."""
    return np.interp(record.t - delay, record.t, values)


def fit_law(before: Record, after: Record) -> Law:
    """Fit the law to two records.

    Parameters
    ----------
    before, after : Record

    Returns
    -------
    Law
    """
    fit = _Fit(before, after, separate=False)
    apart = _Fit(before, after, separate=True)
    delay = fit.rough_delay()
    shared, own = fit.residual_rms(delay), apart.residual_rms(delay)
    retuned = shared > policy.RETUNED * own
    fit = apart if retuned else fit
    delay = fit.rough_delay()
    whitener = fit.whitener(delay)
    delay, low, high = fit.delay(whitener, delay)
    both, names = (before.total, after.total), tuple(after.fed)
    gain = fit.gains(whitener, (delay, low, high), {"before": both, "change": (None, after.total)})
    parts = fit.gains(
        whitener, (delay, low, high), {"before": both} | {name: (None, after.fed[name]) for name in names}
    )
    added, predicted = fit.added(whitener, delay)
    rest = fit.residual(delay)
    y = fit.joined(*(one.current - one.current[one.used].mean() for one in (before, after)))
    width = max(1, round(policy.SLOW / after.period))
    size, left = (float(np.sqrt(np.mean(_means(values[fit.used], width) ** 2))) for values in (y, rest))
    rms = float(np.sqrt(np.mean(rest[fit.used] ** 2)))
    return Law(
        gain, _kept(parts, names), delay, low, high, 1.0 - (left / size) ** 2 if size > 0.0 else 0.0, rms, retuned,
        after.t, added, predicted,
    )  # fmt: skip


def _beyond(columns: Array, target: Array) -> Array:
    """Return what columns do not explain of a target; few columns, so that their products are exact enough."""
    scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    unit = columns / scale
    return np.asarray(target - unit @ (np.linalg.pinv(unit.T @ unit, rcond=1e-10, hermitian=True) @ (unit.T @ target)))


def _means(values: Array, width: int) -> Array:
    """Return the means of neighbours, `width` each."""
    whole = len(values) // width * width
    return np.asarray(values[:whole].reshape(-1, width).mean(axis=1))


def _kept(found: Added, names: Sequence[str]) -> Added:
    where = np.array([found.names.index(name) for name in names])
    return Added(tuple(names), found.value[where], found.covariance[np.ix_(where, where)])


class _Fit:
    """The rows of both records, one unused row between them."""

    def __init__(self, before: Record, after: Record, *, separate: bool) -> None:
        self.records = before, after
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

    def joined(self, before: Array | None, after: Array | None) -> Array:
        """Return one column over both records, zero where there is none."""
        out = np.zeros(self.split + 1 + len(self.records[1].t))
        if before is not None:
            out[: self.split] = before
        if after is not None:
            out[self.split + 1 :] = after
        return out

    def currents(self, delay: float, pairs: Mapping[str, tuple[Array | None, Array | None]]) -> Array:
        """Return the compensator's columns at a delay, shape (n, m)."""
        made = [
            self.joined(*(None if one is None else delayed(record, one, delay)
                          for record, one in zip(self.records, pair, strict=True)))
            for pair in pairs.values()
        ]  # fmt: skip
        return np.column_stack(made)

    def totals(self, delay: float) -> Array:
        """Return what acts in both records, and the parts that the second has more: each may be missing."""
        before, after = self.records
        parts = {name: (None, one) for name, one in after.fed.items()}
        return self.currents(delay, {"before": (before.total, after.total), **parts})

    def rough_delay(self) -> float:
        """Return the delay, in whole periods, at which differences of neighbours are explained best."""
        period = self.records[1].period
        step = max(1, math.ceil((policy.LATEST - policy.EARLIEST) / period / policy.STEPS))
        lags = np.arange(round(policy.EARLIEST / period), round(policy.LATEST / period) + 1, step)
        here = slice(self.split + 1, None)  # the record before tells nothing of the delay
        pairs = self.used[here][1:] & self.used[here][:-1]
        basis = factored(np.diff(self.base[here], axis=0)[pairs]).basis
        y = np.diff(self.y[here])[pairs]
        y = y - basis @ (basis.T @ y)
        fed = list(self.records[1].fed.values())
        left = []
        for lag in lags.tolist():
            c = np.column_stack([np.diff(delayed(self.records[1], one, lag * period))[pairs] for one in fed])
            c = c - basis @ (basis.T @ c)
            left.append(float(np.sum(_beyond(c, y) ** 2)))
        zero = int(np.argmin(np.abs(lags)))
        best = int(np.argmin(left))
        # without anything added all delays are alike: none is taken
        return float(lags[best if left[best] < 0.999 * left[zero] else zero]) * period

    def rows(self, delay: float) -> Array:
        return np.column_stack([self.base, self.totals(delay)])

    def residual(self, delay: float) -> Array:
        rows = self.rows(delay)
        value = np.linalg.lstsq(rows[self.used], self.y[self.used], rcond=None)[0]
        return np.asarray(np.where(self.used, self.y - rows @ value, 0.0))

    def residual_rms(self, delay: float) -> float:
        return float(np.sqrt(np.mean(self.residual(delay)[self.used] ** 2)))

    def whitener(self, delay: float) -> ChannelWhitener:
        """Return the whitener of the noise that the law leaves."""
        rows, rest = self.rows(delay), self.residual(delay)
        whitener = self._of(rest, rows.shape[1])
        for _ in range(ROUNDS - 1):
            value = np.linalg.lstsq(self.white(whitener, rows), self.white(whitener, self.y), rcond=None)[0]
            whitener = self._of(np.where(self.used, self.y - rows @ value, 0.0), rows.shape[1])
        return whitener

    def _of(self, rest: Array, lost: int) -> ChannelWhitener:
        return channel_whitener(rest, np.ones_like(rest), self.used, 1.0 / self.records[1].period, lost)

    def white(self, whitener: ChannelWhitener, values: Array) -> Array:
        """Whiten a column or columns over all rows."""
        kept = values[self.used]
        return whitener(np.atleast_2d(kept.T)).T if values.ndim == 2 else whitener(kept[None])[0]

    def solved(
        self, whitener: ChannelWhitener, delay: float, pairs: Mapping[str, tuple[Array | None, Array | None]]
    ) -> Added:
        """Return the gains along these currents, no error smaller than what blocks of the records differ by."""
        names = tuple(pairs)
        rows = self.white(whitener, np.column_stack([self.base, self.currents(delay, pairs)]))
        scale = np.maximum(np.linalg.norm(rows, axis=0), 1e-300)
        rows, y = rows / scale, self.white(whitener, self.y)
        inverse = np.linalg.pinv(rows.T @ rows, rcond=1e-12, hermitian=True)
        value = inverse @ (rows.T @ y)
        left = y - rows @ value
        free = max(1, len(y) - rows.shape[1])
        model = inverse * float(left @ left) / free
        blocks = np.array([part.sum(axis=0) for part in np.array_split(rows * left[:, None], policy.BLOCKS)])
        robust = inverse @ (blocks.T @ blocks) @ inverse * policy.BLOCKS / (policy.BLOCKS - 1.0)
        share = np.sqrt(np.maximum(np.diag(robust) / np.maximum(np.diag(model), 1e-300), 1.0))
        covariance = model * np.outer(share, share) / np.outer(scale, scale)
        own = slice(self.base.shape[1], None)
        found, spread = (value / scale)[own], covariance[own, own].copy()
        dead = scale[own] <= 1e-300  # an effect that this motion does not move
        spread[dead, dead] = math.inf
        return Added(names, found, spread)

    def gains(
        self, whitener: ChannelWhitener, delays: tuple[float, float, float],
        pairs: Mapping[str, tuple[Array | None, Array | None]],
    ) -> Added:  # fmt: skip
        """Return the gains at the delay that was found; what they change within its interval is in their errors."""
        found, *ends = (self.solved(whitener, delay, pairs) for delay in delays)
        away = (ends[1].value - ends[0].value) / 3.92  # the ends are 95 % apart
        return replace(found, covariance=found.covariance + np.outer(away, away))

    def delay(self, whitener: ChannelWhitener, rough: float) -> tuple[float, float, float]:
        """Return the delay and its interval from the profile of the whitened residual."""
        period = self.records[1].period
        base, y = self.white(whitener, self.base), self.white(whitener, self.y)
        basis = factored(base).basis
        y = y - basis @ (basis.T @ y)
        shifts = rough + period * np.linspace(-1.5, 1.5, 31)
        left, robust = [], []
        for shift in shifts.tolist():
            c = self.white(whitener, self.totals(shift))
            c = c - basis @ (basis.T @ c)
            rest = _beyond(c, y)
            left.append(float(rest @ rest))
            robust.append(rest)
        best = int(np.argmin(left))
        # the profile's level from the differences between blocks, as for the gains
        gained = np.array([[float(np.sum(part)) for part in np.array_split(one**2 - robust[best] ** 2, policy.BLOCKS)]
                           for one in robust])  # fmt: skip
        total = gained.sum(axis=1)
        spread = np.sqrt(policy.BLOCKS) * gained.std(axis=1, ddof=1)
        noise = left[best] / max(1, len(y) - base.shape[1])
        inside = total <= np.maximum(3.84 * noise, 2.0 * spread)
        found, own = float(shifts[best]), policy.RESOLVED * period
        return found, min(float(shifts[inside].min()), found - own), max(float(shifts[inside].max()), found + own)

    def added(self, whitener: ChannelWhitener, delay: float) -> tuple[Array, Array]:
        """Return the current of the second record beside its controller, and that of it which the compensator makes."""
        rows = self.rows(delay)
        value = np.linalg.lstsq(self.white(whitener, rows), self.white(whitener, self.y), rcond=None)[0]
        here = slice(self.split + 1, None)
        k = self.base.shape[1]
        law = self.base[here] @ value[:k]
        return self.y[here] - law, rows[here, k:] @ value[k:]


def averaged(record: Record, width: int) -> Record:
    """Return the means of neighbouring samples of a record, `width` each."""

    def means(values: Array) -> Array:
        whole = len(values) // width * width
        return np.asarray(values[:whole].reshape(whole // width, width, *values.shape[1:]).mean(axis=1))

    return Record(
        means(record.t), means(record.current), means(record.columns),
        {name: means(values) for name, values in record.fed.items()}, means(record.used.astype(float)) > 0.999,
    )  # fmt: skip


def cropped(record: Record) -> Record:
    """Return the first `policy.MOST` samples of a record."""
    kept = slice(0, policy.MOST)
    fed = {name: values[kept] for name, values in record.fed.items()}
    return replace(
        record, t=record.t[kept], current=record.current[kept], columns=record.columns[kept], fed=fed,
        used=record.used[kept],
    )  # fmt: skip

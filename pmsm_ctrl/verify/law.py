"""The control law found in two logs: gains of the controller, and what was added to its output.

The current reference is a linear combination of what the controller reads: the position error, its integral, the speed
error and the references fed forward. The law holds whatever the axis does, so neither inertia nor friction is needed.
What the second log has beside it, along the compensator's own feedforward, is the gain that was applied.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.evidence.whitening import ChannelWhitener
from pmsm_ctrl.verify import policy
from pmsm_ctrl.verify.record import Record, Sign
from pmsm_ctrl.verify.rows import Added, Place, Rows
from pmsm_ctrl.verify.search import Profile, freed, profile, rough_place

__all__ = ["Law", "fit_law"]

Array = NDArray[np.float64]


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
        s.
    sign : Sign or None
        Of the speed in the drive, where it is not that of the design and lasts longer than a sample.
    width_low, width_high : float
        Interval of the width of that sign, rad/s (m/s); 0 without one.
    shaped : bool
        Whether that sign is neither of the shapes that are known, so that its shape is fitted.
    unresolved : bool
        Whether the motion is too slow to leave that sign's smoothing, so that it is like a viscous friction.
    explained : float
        Share of the varying current, in means over 10 ms, that the law explains.
    residual : float
        Rms, A.
    retuned : bool
        Whether the gains of the controller differ between the logs.
    rounded : float
        Error of the gain that is due to the cycles of the controller which a slower log lacks, a standard error.
    t, added, predicted : array, shape (n,)
        Time (s), current of the second log beside its controller, and what the compensator makes of it, A.
    """

    gain: Added
    parts: Added
    delay: float
    delay_low: float
    delay_high: float
    sign: Sign | None
    width_low: float
    width_high: float
    shaped: bool
    unresolved: bool
    explained: float
    residual: float
    retuned: bool
    rounded: float
    t: Array
    added: Array
    predicted: Array


def fit_law(before: Record, after: Record, progress: Callable[[float], None] = lambda share: None) -> Law:
    """Fit the law to two records.

    Parameters
    ----------
    before, after : Record
    progress : function, optional
        Called with the share done, 0 to 1.

    Returns
    -------
    Law
    """
    rows = Rows(before, after, separate=False)
    place = rough_place(rows)
    apart = Rows(before, after, separate=True)
    own = min(apart.residual_rms(one) for one in (place, Place(apart.rough_delay(None)[0])))
    retuned = rows.residual_rms(place) > policy.RETUNED * own
    if retuned:
        rows, place = apart, rough_place(apart)
    rows, share = _turned(rows, place)
    whitener, near = _found(rows, place, progress)
    progress(1.0)
    where = _ends(near, after.period)
    gain, parts = (rows.gains(whitener, where, by_part=by_part) for by_part in (False, True))
    if rows.is_turned:
        rounded = float(gain.stderr[1])
    else:
        (gain, rounded), (parts, _) = (_doubted(rows, near.place, one, share) for one in (gain, parts))
    added, predicted = rows.added(whitener, near.place)
    rest = rows.residual(near.place)
    y = rows.joined(*(one.current - one.current[one.used].mean() for one in (before, after)))
    width = max(1, round(policy.SLOW / after.period))
    size, left = (float(np.sqrt(np.mean(_means(values[rows.used], width) ** 2))) for values in (y, rest))
    convention = policy.CONVENTION * after.period / after.mean
    sign, unresolved = _seen(after, near)
    low, high = (one.sign.width if one.sign and sign else 0.0 for one in (near.narrowest, near.widest))
    return Law(
        gain, _kept(parts, tuple(after.fed)), near.place.delay, near.earliest.delay - convention,
        near.latest.delay + convention, sign, low, high, near.place.free, unresolved,
        1.0 - (left / size) ** 2 if size > 0.0 else 0.0, float(np.sqrt(np.mean(rest[rows.used] ** 2))), retuned,
        rounded, after.t, added, predicted,
    )  # fmt: skip


def _turned(rows: Rows, place: Place) -> tuple[Rows, float]:
    """Return rows whose error is in the right place, and how much of what is left is due to rounded samples."""
    if not any(one.slower for one in rows.records):  # the logs hold every term of the controller's sum
        return rows, 0.0
    turned = rows.turned()
    walk, rounding = turned.walk_of_integral(turned.whitener(place), place), rows.records[1].rounding
    if walk <= policy.WALK * rounding and not rows.records[1].measured:
        return turned, 1.0
    return rows, min(1.0, (rounding / walk) ** 2)


def _doubted(rows: Rows, place: Place, found: Added, share: float) -> tuple[Added, float]:
    """Return gains with the error by the cycles that a slower log lacks, and that of the second.

    The gains lie between those with all error in the current and those with all of it in the integral. By the current
    reference, what is found before the download is in doubt as well: what the sum lacks of the integral is found as a
    feedforward of both logs, and the change by as much too small.
    """
    if share == 0.0:
        return found, 0.0
    turned = rows.turned()
    by_part = len(found.names) > 2 or found.names[1] != "change"
    other = turned.gains(turned.whitener(place), [place], by_part=by_part)
    away = share * (other.value - found.value)
    # a measured current has this error at any rate: `verify` knows it
    own = 0.0 if rows.records[1].measured else float(found.value[0]) ** 2
    more = np.outer(away, away) + own * np.eye(len(away))
    return replace(found, covariance=found.covariance + more), float(np.sqrt(more[1, 1]))


def _seen(record: Record, near: Profile) -> tuple[Sign | None, bool]:
    """Return the sign where it is another one than the design's, and whether the motion is too slow for it."""
    own, sign = record.unsigned, near.place.sign
    if sign is None or own is None or not near.other or own.samples_within(sign) < 1.0:
        return None, False
    return sign, sign.width > policy.WIDEST_TOLD * own.peak


def _found(rows: Rows, rough: Place, progress: Callable[[float], None]) -> tuple[ChannelWhitener, Profile]:
    """Return the whitener and the place of what was added."""
    whitener = rows.whitener(rough)
    near = profile(rows, whitener, rough, lambda share: progress(0.1 + 0.4 * share))
    if near.place.sign is None:
        return (whitener, near) if not rows.is_turned or _adds(rows, whitener, near.place) else _stated(rows)
    whitener = rows.whitener(near.place)  # the rough width shifts the noise as well
    near = profile(rows, whitener, near.place, lambda share: progress(0.5 + 0.4 * share))
    if rows.is_turned and not _adds(rows, whitener, near.place):
        return _stated(rows)
    free = freed(rows, whitener, near.place) if near.other else near.place
    if not free.free:
        return whitener, near
    whitener = rows.whitener(free)
    freer = profile(rows, whitener, free)
    return whitener, replace(freer, narrowest=near.narrowest, widest=near.widest)


def _adds(rows: Rows, whitener: ChannelWhitener, place: Place) -> bool:
    """Whether the second record has more of the feedforward there than its error."""
    gain = rows.gains(whitener, [place], by_part=False)
    return bool(abs(gain.value[1]) > 2.0 * gain.stderr[1])


def _stated(rows: Rows) -> tuple[ChannelWhitener, Profile]:
    """Return what a drive that adds nothing is judged at: no place is better than that of the design.

    Where the integral is in error, what the loop does behind a reversal fits a late and smoothed feedforward, in both
    records alike.
    """
    place = Place(0.0)
    return rows.whitener(place), Profile(place, place, place, place, place, other=False)


def _ends(near: Profile, period: float) -> list[Place]:
    """Return the place that was found, and pairs of ends between which the gains may lie."""
    found, own = near.place, policy.RESOLVED * period
    early = replace(found, delay=min(near.earliest.delay, found.delay - own))
    late = replace(found, delay=max(near.latest.delay, found.delay + own))
    # where the shape is free, so is the width
    return [found, early, late, *(() if found.free else (near.narrowest, near.widest))]


def _means(values: Array, width: int) -> Array:
    """Return the means of neighbours, `width` each."""
    whole = len(values) // width * width
    return np.asarray(values[:whole].reshape(-1, width).mean(axis=1))


def _kept(found: Added, names: Sequence[str]) -> Added:
    where = np.array([found.names.index(name) for name in names])
    return Added(tuple(names), found.value[where], found.covariance[np.ix_(where, where)])

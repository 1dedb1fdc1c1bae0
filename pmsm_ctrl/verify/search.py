"""At which delay, and with which sign of the speed, a drive feeds forward.

Drives do not reverse their friction at once: over some speeds around zero they replace the sign by a straight line or
a hyperbolic tangent, and at rest they add nothing. An edge in the wrong place is paid for by the gain, so that both
are found by what they leave of the current.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.evidence.linalg import factored
from pmsm_ctrl.evidence.whitening import ChannelWhitener
from pmsm_ctrl.verify import policy
from pmsm_ctrl.verify.record import Sign
from pmsm_ctrl.verify.rows import Place, Rows, beyond

__all__ = ["Profile", "freed", "profile", "rough_place"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Profile:
    """Where the feedforward is, and how surely.

    Attributes
    ----------
    place : Place
    earliest, latest : Place
        Ends of the delay's interval, 95 %.
    narrowest, widest : Place
        Ends of the interval of the width of the sign, that of the design the narrowest one.
    other : bool
        Whether the sign is another one than that of the design, by more than the noise.
    """

    place: Place
    earliest: Place
    latest: Place
    narrowest: Place
    widest: Place
    other: bool


def rough_place(rows: Rows) -> Place:
    """Return where differences of neighbours are explained best.

    Parameters
    ----------
    rows : Rows
    """
    stated, left = rows.rough_delay(None)
    own = rows.records[1].unsigned
    if own is None or own.peak == 0.0:
        return Place(stated)
    starts = [Sign(share * own.peak) for share in policy.FIRST_WIDTHS]
    tried = [(*rows.rough_delay(sign), sign) for sign in starts]
    rough, least, _ = min(tried, key=lambda one: one[1])
    if not least < policy.CLEARER * left:
        rough = stated
    least, place = min((_refined(rows, rough, own.peak, curved) for curved in (False, True)), key=lambda one: one[0])
    return place if least < policy.CLEARER * left else Place(stated)


def _refined(rows: Rows, rough: float, peak: float, curved: bool) -> tuple[float, Place]:
    """Return what one shape of the sign leaves at its best width and delay, and where that is."""
    period = rows.records[1].period
    widths = np.geomspace(policy.NARROWEST, policy.WIDEST, policy.WIDTHS) * peak
    centre = rough
    for _ in range(policy.MOVES):
        delays = (centre + period * np.arange(-2.0, 3.0)).tolist()
        table = np.array([rows.roughly(delays, Sign(width, curved)) for width in widths.tolist()])
        i, j = np.unravel_index(int(np.argmin(table)), table.shape)
        centre = delays[j]
        if 0 < j < len(delays) - 1:
            break
    return float(table[i, j]), Place(centre, Sign(float(widths[i]), curved))


def _grid(place: Place, period: float, delays: Array, widths: Array) -> list[list[Place]]:
    """Return places about one, a row for each width; a single row where the width is not searched."""
    shifts = (place.delay + period * delays).tolist()
    if place.sign is None or place.free:
        return [[replace(place, delay=shift) for shift in shifts]]
    return [
        [Place(shift, Sign(place.sign.width * factor, place.sign.curved)) for shift in shifts]
        for factor in widths.tolist()
    ]


def _grown(left: _Left, grid: list[list[Place]], progress: Callable[[float], None]) -> dict[Place, Array]:
    """Return what the places of a grid leave: every few of them, those like the best, and all beside these."""
    known: dict[tuple[int, int], Array] = {}
    asked = {(i, j) for i in range(len(grid) // 2 % 2, len(grid), 2) for j in range(0, len(grid[0]), policy.APART)}
    while asked:
        for i, j in sorted(asked):
            known[i, j] = left(grid[i][j])
            progress(len(known) / (len(grid) * len(grid[0])))
        at = list(known)
        like = [at[k] for k in left.like_the_least(np.array(list(known.values())))]
        beside = {(i + down, j + right) for i, j in like for down in (-1, 0, 1) for right in (-1, 0, 1)}
        asked = {(i, j) for i, j in beside if 0 <= i < len(grid) and 0 <= j < len(grid[0])} - known.keys()
    return {grid[i][j]: one for (i, j), one in known.items()}


def profile(
    rows: Rows, whitener: ChannelWhitener, rough: Place, progress: Callable[[float], None] = lambda share: None
) -> Profile:
    """Return the place at which the whitened residual is least, and the intervals of delay and width.

    Parameters
    ----------
    rows : Rows
    whitener : ChannelWhitener
    rough : Place
    progress : function, optional
        Called with the share done, 0 to 1.
    """
    left = _Left(rows, whitener)
    period, apart = rows.records[1].period, 1.1 ** np.arange(-5.0, 6.0)
    found = _grown(left, _grid(rough, period, np.linspace(-1.5, 1.5, 31), apart), lambda share: progress(0.5 * share))
    if rough.sign is not None and not rough.free:
        best = min(found, key=lambda one: float(found[one].sum()))
        near = _grid(best, period, np.linspace(-0.1, 0.1, 5), 1.015 ** np.arange(-4.0, 5.0))
        stated = _grid(Place(rows.rough_delay(None)[0]), period, np.linspace(-1.5, 1.5, 31), apart)
        found |= _grown(left, near, lambda share: progress(0.5 + 0.25 * share))
        found |= _grown(left, stated, lambda share: progress(0.75 + 0.25 * share))
    if rows.is_turned:  # differences of neighbours, rounded as they are, may not tell where to look
        found |= _grown(left, _grid(Place(0.0), period, np.linspace(-1.5, 1.5, 31), apart), lambda share: None)
    places, lost = list(found), list(found.values())
    progress(1.0)
    held = [places[k] for k in left.like_the_least(np.array(lost))]
    return Profile(
        held[0], min(held, key=lambda one: one.delay), max(held, key=lambda one: one.delay), min(held, key=_width),
        max(held, key=_width), all(one.sign is not None for one in held),
    )  # fmt: skip


def freed(rows: Rows, whitener: ChannelWhitener, place: Place) -> Place:
    """Return the place with the shape of its sign fitted, where that leaves less by more than the noise.

    Parameters
    ----------
    rows : Rows
    whitener : ChannelWhitener
    place : Place
    """
    left, free = _Left(rows, whitener), replace(place, free=True)
    return free if left.like_the_least(np.array([left(place), left(free)])) == [1] else place


class _Left:
    """What is left at a place of the whitened current, block by block."""

    def __init__(self, rows: Rows, whitener: ChannelWhitener) -> None:
        base, y = rows.white(whitener, rows.instruments), rows.white(whitener, rows.target)
        self.rows, self.whitener, self.basis = rows, whitener, factored(base).basis
        self.y = y - self.basis @ (self.basis.T @ y)
        self.free = max(1, len(y) - base.shape[1])

    def __call__(self, place: Place) -> Array:
        c = self.rows.white(self.whitener, self.rows.totals(place))
        rest = beyond(c - self.basis @ (self.basis.T @ c), self.y) ** 2
        return np.array([float(np.sum(part)) for part in np.array_split(rest, policy.BLOCKS)])

    def like_the_least(self, blocks: Array) -> list[int]:
        """Return the rows of `blocks` that are no more than the least within the noise, the least first.

        Its level is that of the differences between blocks, as for the gains.
        """
        least = blocks[int(np.argmin(blocks.sum(axis=1)))]
        total, spread = (blocks - least).sum(axis=1), np.sqrt(policy.BLOCKS) * (blocks - least).std(axis=1, ddof=1)
        inside = total <= np.maximum(3.84 * float(least.sum()) / self.free, 2.0 * spread)
        return [k for k in np.argsort(total, kind="stable").tolist() if inside[k]]


def _width(place: Place) -> float:
    return 0.0 if place.sign is None else place.sign.width

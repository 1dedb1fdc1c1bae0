"""Which effects could be missing, with the shapes over which each one is searched."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.effects.base import Effect
from pmsm_ctrl.effects.structures import LogView, Search
from pmsm_ctrl.errors import RequestError, nearest
from pmsm_ctrl.evidence.waves import FINER, PERIODS, highest_over_position, strongest_periods
from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.residuals.orders import order_spectrum

__all__ = ["Candidate", "candidates_for", "offered_effects"]

Array = NDArray[np.float64]

# The low-pass, a Butterworth filter of fourth order run both ways, passes 1 / (1 + (f / cutoff)^8) of a wave.
FADING = 8
MOST_WAVES = 300  # along the way of a linear axis that are looked for where they are slow
TWO_PERIODS = 4.0 * np.pi  # rad of a wave, from which on it is no constant


@dataclass(frozen=True, eq=False)
class Candidate:
    """One effect that might be missing.

    Attributes
    ----------
    effect : Effect
    grid : tuple of shapes (values of the nonlinear parameters)
    searched : int
        Independent shapes tried, paid for in the significance.
    why_not : str
        Why it cannot be tried on this log; the grid is empty then.
    """

    effect: Effect
    grid: tuple[Mapping[str, float], ...]
    searched: int = 1
    why_not: str = ""

    def free(self, shape: Mapping[str, float]) -> list[str]:
        """Return the nonlinear parameters of a shape that the search settles."""
        return [name for name in shape if name in self._varied]

    # Asked of every shape of the grid.
    @cached_property
    def _varied(self) -> frozenset[str]:
        return frozenset(name for name in set().union(*self.grid) if len(varied(self.grid, (name,))))


def varied(grid: Sequence[Mapping[str, float]], shape: Iterable[str]) -> list[str]:
    """Return the names of a shape that have several values in a grid, in which not all shapes have the same names.

    Parameters
    ----------
    grid : sequence of mapping
    shape : iterable of str
        The names.
    """
    return [name for name in shape if len({one[name] for one in grid if name in one}) > 1]


def passing_orders(record: Record, residual: Array, highest: int, length: float = 2.0 * np.pi) -> Array:
    """Return how much each order of a turn stands out of the residual where the filter lets it pass, shape (highest,).

    A high order passes for moments only, around reversals: too few samples for a spectrum of the slow ones, and yet
    a wave that fades with the speed as the filter makes it fade can be most of what is left. Each score is the gain of
    the sum of squares over the residual's per sample; 0 for an order of which less than two periods pass. On a linear
    axis orders are those of any `length`, m.
    """
    used = np.flatnonzero(record.mask)
    turn = 2.0 * np.pi / length
    speed = turn * np.abs(record.at_grid(record.signals["omega"]))[used]
    weight = record.weight[0][used]
    r = residual[used] * weight
    noise = float(np.mean(r**2))
    if noise == 0.0 or "theta" not in record.signals:
        return np.zeros(highest)
    from pmsm_ctrl.kernels.orders import faded_sums

    angle = turn * record.at_grid(record.signals["theta"])[used]
    faded = (speed / (2.0 * np.pi * record.cutoff)) ** FADING
    rights, grams, travelled = np.zeros((highest, 2)), np.zeros((highest, 2, 2)), np.zeros(highest)
    signals = np.stack([weight, r, speed])
    faded_sums(np.cos(angle), np.sin(angle), faded, float(FADING), signals, rights, grams, travelled)
    passing = np.arange(1, highest + 1) * travelled / record.rate >= TWO_PERIODS
    rights[~passing], grams[~passing] = 0.0, 0.0
    gains: Array = np.einsum("ki,kij,kj->k", rights, np.linalg.pinv(grams, hermitian=True), rights)
    return gains / noise


def passing_periods(record: Record, residual: Array, number: int) -> tuple[Array, int]:
    """Return the periods, m, of waves along a linear axis that stand out most where the filter lets them pass.

    And how many waves there can be. Those over the whole log do not show a wave that most of the motion is too fast
    for: see `passing_orders`.
    """
    length = FINER * float(np.ptp(record.signals["theta"]))
    highest = FINER * MOST_WAVES
    score = passing_orders(record, residual, highest, length)
    inner = score[1:-1]
    peaks = 1 + np.flatnonzero((inner >= score[:-2]) & (inner > score[2:]))
    peaks = peaks[peaks + 1 >= FINER * PERIODS]
    best = peaks[np.argsort(score[peaks])[::-1][:number]]
    return np.asarray(length / (1.0 + best[score[best] > 0.0]), dtype=np.float64), MOST_WAVES - PERIODS


def candidates_for(
    record: Record, effects: Mapping[str, Effect], residual: Array, present: Iterable[str]
) -> list[Candidate]:
    """Return every candidate that is not in the model yet. `residual` is that of the torque, shape (m,)."""

    def orders(highest: int) -> Array:
        slow = order_spectrum(record.prepared, residual, record.mask, record.weight[0], highest, friction=False)[1]
        score = np.maximum(slow, passing_orders(record, residual, highest))
        travel = float(np.ptp(record.signals["theta"]))  # not by the view: a circle of references would keep the record
        score[np.arange(1, highest + 1) * travel < TWO_PERIODS] = 0.0  # a part of a turn, however often
        return score

    def periods(number: int) -> tuple[Array, int]:
        used = record.weight[0] * record.mask > 0.0
        theta, omega = (record.at_grid(record.signals[name])[used] for name in ("theta", "omega"))
        values = (residual * record.weight[0] ** 2)[used]
        slow = strongest_periods([(values, theta)], highest_over_position(theta, omega, record.cutoff), number)
        if not record.linear:
            return slow
        fast = passing_periods(record, residual, number)
        return np.concatenate([slow[0], fast[0]]), max(slow[1], fast[1])

    view = LogView(record, residual, orders, periods)
    present = set(present)
    split = any(effects[name].structure.splits_inertia for name in present if name in effects)
    out = []
    for effect in effects.values():
        if effect.id in present and not effect.repeated:
            continue
        if split and effect.structure.splits_inertia:
            continue  # an axis has one: `swap` tries the other in its place
        why = effect.structure.available(record, effect)
        found = Search((), why_not=why) if why else effect.structure.search(effect, view)
        out.append(Candidate(effect, found.shapes, found.tried, found.why_not))
    return out


def offered_effects(effects: Mapping[str, Effect], candidates: Iterable[str] | None) -> dict[str, Effect]:
    """Return the effects with these ids, or all of them.

    Parameters
    ----------
    effects : dict of id to Effect
    candidates : iterable of str, optional

    Returns
    -------
    dict of id to Effect

    Raises
    ------
    RequestError
        For an unknown id.
    """
    if candidates is None:
        return dict(effects)
    out = {}
    for identifier in candidates:
        if identifier not in effects:
            raise RequestError(f"unknown effect '{identifier}'{nearest(identifier, effects)}")
        out[identifier] = effects[identifier]
    return out

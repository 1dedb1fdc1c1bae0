"""What an effect adds to each balance per unit of its linear parameters: its structure's columns, remembered."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.effects.base import Effect
from pmsm_ctrl.effects.structures import UnavailableError
from pmsm_ctrl.regression.balances import MODELLED, Memo, Record

__all__ = ["Group", "UnavailableError", "as_candidate", "candidate_group", "effect_group"]

Array = NDArray[np.float64]

# Bytes of columns that are kept from one fit to the next, roughly.
MOST_KEPT = 100e6


@dataclass(frozen=True, eq=False)
class Group:
    """Columns that stand or fall together.

    Attributes
    ----------
    effect : Effect or None
        None for what every axis has (inertia, winding).
    symbols : names of the linear parameters
    values : array, shape (channels, m, k)
    shape : the nonlinear parameters that the columns were built with
    entry : position in the design's list, or -1
    """

    effect: Effect | None
    symbols: tuple[str, ...]
    values: Array
    shape: Mapping[str, float]
    entry: int = -1


def effect_group(record: Record, effect: Effect, shape: Mapping[str, float], entry: int = -1) -> Group:
    """Return the columns of an effect on a log, its nonlinear parameters given by `shape`.

    Raises
    ------
    UnavailableError
        When the log or the design lacks what the effect needs.
    """
    structure = effect.structure
    why = structure.available(record, effect)
    if why:
        raise UnavailableError(why)
    key = _key(effect, shape)
    memo = _memo(record, effect, key)
    if key not in memo:
        memo[key] = record.stack_all(structure.columns(record, effect, shape), structure.filtered(record))
    return Group(effect, structure.symbols(effect), memo[key], dict(shape), entry)


def _memo(record: Record, effect: Effect, key: tuple[object, ...]) -> Memo:
    """Where the columns of an effect are remembered: from one fit to the next, if they follow from the motion alone."""
    if key in record.kept:
        return record.kept
    modelled = not MODELLED.isdisjoint(effect.structure.reads(effect))
    full = len(record.kept) * record.target.nbytes > MOST_KEPT
    return record.memo if modelled or full else record.kept


def _key(effect: Effect, shape: Mapping[str, float]) -> tuple[object, ...]:
    return (effect.id, id(effect.term), *sorted(shape.items()))


def candidate_group(record: Record, effect: Effect, shape: Mapping[str, float]) -> Group:
    """Return the columns by which an effect that is not in the model yet is judged, and remember no others.

    Raises
    ------
    UnavailableError
        When the log or the design lacks what the effect needs.
    """
    whole = _key(effect, shape)
    key = ("seen", *whole)
    memo = _memo(record, effect, key)
    if key in memo:
        return Group(effect, effect.structure.symbols(effect), memo[key], dict(shape))
    group = effect_group(record, effect, shape)
    seen = as_candidate(record, group)
    if seen is not group:
        memo[key] = seen.values
        _memo(record, effect, whole).pop(whole, None)
    return seen


def as_candidate(record: Record, group: Group) -> Group:
    """Return the columns by which an effect that is not in the model yet is judged: nothing made of noise."""
    if group.effect is None:
        return group
    values = group.effect.structure.judged(record, group.effect, group.values, group.shape)
    return group if values is group.values else replace(group, values=values)

"""Columns of an effect in each balance, per unit of its linear parameters, with a cache."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.effects.base import Effect
from pmsm_ctrl.effects.structures import UnavailableError
from pmsm_ctrl.regression.balances import MODELLED, Memo, Record, Rows

__all__ = [
    "SINGLE",
    "Group",
    "UnavailableError",
    "candidate_groups",
    "effect_group",
    "forget_effects",
    "groups_of_candidates",
    "seen_as_candidate",
]

Array = NDArray[np.float64]

MOST_KEPT = 100e6  # bytes of columns that are kept from one fit to the next, roughly
SINGLE = 150_000  # samples of the thinned grid beyond which candidates are kept in single precision


@dataclass(frozen=True, eq=False)
class Group:
    """Columns that are tested and accepted together.

    Attributes
    ----------
    effect : Effect or None
        None for what every axis has (inertia, winding).
    symbols : names of the linear parameters
    rows : per balance array, shape (k, m), or None
        The columns, in the balances that they enter.
    shape : the nonlinear parameters that the columns were built with
    entry : position in the design's list, or -1
    sampling : whether the columns say how the drive signal was sampled, and not what acts on the axis
    """

    effect: Effect | None
    symbols: tuple[str, ...]
    rows: Rows
    shape: Mapping[str, float]
    entry: int = -1
    sampling: bool = False

    @property
    def misread(self) -> bool:
        """Whether the columns are a measurement error, and do not act on the axis."""
        return self.sampling if self.effect is None else self.effect.falsifies_current

    @property
    def delays(self) -> bool:
        """Whether this is a delay of the drive signal, an effect."""
        return self.effect is not None and self.effect.structure.delays

    @property
    def entering(self) -> Iterator[tuple[int, Array]]:
        """The balances that the columns enter, by number, with the columns, shape (k, m)."""
        return ((row, columns) for row, columns in enumerate(self.rows) if columns is not None)

    @property
    def values(self) -> Array:
        """The columns over the balances up to the last that they enter, shape (channels, m, k)."""
        m = max((columns.shape[1] for _, columns in self.entering), default=0)
        count = max((row + 1 for row, _ in self.entering), default=1)
        out = np.zeros((count, m, len(self.symbols)))
        for row, columns in self.entering:
            out[row] = columns.T
        return out


def effect_group(record: Record, effect: Effect, shape: Mapping[str, float], entry: int = -1) -> Group:
    """Return the columns of an effect on a log, its nonlinear parameters given by `shape`.

    Parameters
    ----------
    record : Record
    effect : Effect
    shape : mapping
    entry : int
        Position in the design's list, or -1.

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
    """Return the cache for an effect's columns; it lives from fit to fit for columns of the measured motion alone."""
    if key in record.kept:
        return record.kept
    modelled = not MODELLED.isdisjoint(effect.structure.reads(effect))
    column = record.target[0].nbytes  # one, in the torque balance alone: most are such
    return record.memo if modelled or len(record.kept) * column > MOST_KEPT else record.kept


def forget_effects(record: Record) -> None:
    """Forget the columns of effects that were remembered; those of the base model stay.

    Parameters
    ----------
    record : Record
    """
    for key in [key for key in record.kept if key[0] in ("seen", "effect")]:
        del record.kept[key]
    record.memo.clear()


def _key(effect: Effect, shape: Mapping[str, float]) -> tuple[object, ...]:
    return ("effect", effect.id, id(effect.term), *sorted(shape.items()))


def candidate_groups(record: Record, effect: Effect, shapes: Sequence[Mapping[str, float]]) -> list[Group]:
    """Return, for every shape, the columns by which an effect that is not in the model yet is judged.

    None where the log or the design lacks what the effect needs.

    Parameters
    ----------
    record : Record
    effect : Effect
    shapes : sequence of mapping
        Nonlinear parameters.
    """
    return groups_of_candidates(record, [(effect, shapes)])[0]


def groups_of_candidates(
    record: Record, wanted: Sequence[tuple[Effect, Sequence[Mapping[str, float]]]], offered: bool = False
) -> list[list[Group]]:
    """Do what `candidate_groups` does for several effects.

    The columns are remembered.

    Parameters
    ----------
    record : Record
    wanted : sequence of (Effect, shapes)
    offered : bool
        Whether the columns are those of the model of all candidates.
    """
    lacking = set()
    for number, (effect, shapes) in enumerate(wanted):
        if effect.structure.available(record, effect):
            lacking.add(number)
            continue
        structure = effect.structure
        kinds = (True, False) if structure.offered_apart else (False,)
        new = [  # of a long log one kind may be remembered for longer than the other
            shape
            for shape in shapes
            if any(key not in memo for memo, key in (_seen(record, effect, shape, kind) for kind in kinds))
        ]
        try:
            for shape, parts in zip(new, structure.columns_each(record, effect, new), strict=True):
                rows = record.stack_all(parts, structure.filtered(record))
                whole = Group(effect, structure.symbols(effect), rows, shape)
                for kind in kinds:
                    memo, key = _seen(record, effect, shape, kind)
                    memo[key] = tuple(map(_small, seen_as_candidate(record, whole, kind).rows))
        except UnavailableError:
            lacking.add(number)
    return [
        [] if number in lacking else [_remembered(record, effect, shape, offered) for shape in shapes]
        for number, (effect, shapes) in enumerate(wanted)
    ]


def _seen(
    record: Record, effect: Effect, shape: Mapping[str, float], offered: bool
) -> tuple[Memo, tuple[object, ...]]:  # fmt: skip
    """Where the columns of a candidate are remembered, and under which name."""
    key = ("seen", offered and effect.structure.offered_apart, *_key(effect, shape))
    return _memo(record, effect, key), key


def _remembered(record: Record, effect: Effect, shape: Mapping[str, float], offered: bool) -> Group:
    memo, key = _seen(record, effect, shape, offered)
    return Group(effect, effect.structure.symbols(effect), memo[key], dict(shape))


def _small(columns: Array | None) -> Array | None:
    """Columns of a long record in single precision: to be searched among, not to be fitted."""
    long = columns is not None and columns.shape[1] > SINGLE
    return columns.astype(np.float32) if columns is not None and long else columns


def seen_as_candidate(record: Record, group: Group, offered: bool = False) -> Group:
    """Return the columns by which an effect that is not in the model yet is judged: nothing made of noise.

    Parameters
    ----------
    record : Record
    group : Group
    offered : bool
        Whether the columns are those of the model of all candidates.
    """
    if group.effect is None or not group.effect.structure.judges(group.effect):
        return group
    values, structure = group.values, group.effect.structure
    of = structure.offered if offered else structure.judged
    seen = of(record, group.effect, values, group.shape)
    if seen is values:
        return group
    rows = (None if columns is None else np.ascontiguousarray(seen[row].T) for row, columns in enumerate(group.rows))
    return replace(group, rows=tuple(rows))

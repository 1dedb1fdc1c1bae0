"""What an effect adds to each balance per unit of its linear parameters: its structure's columns, remembered."""

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
    "seen_as_candidate",
]

Array = NDArray[np.float64]

# Bytes of columns that are kept from one fit to the next, roughly, and of signals that are filtered at once.
MOST_KEPT, AT_ONCE = 100e6, 6e6
SINGLE = 150_000  # samples of the thinned grid beyond which candidates are kept in single precision
FEWEST_AT_ONCE = 4  # shapes: fewer columns are filtered one by one


@dataclass(frozen=True, eq=False)
class Group:
    """Columns that stand or fall together.

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
        """Whether the columns are only measured, and do not act on the axis."""
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
        """The columns over all balances, shape (channels, m, k)."""
        m = max((columns.shape[1] for _, columns in self.entering), default=0)
        out = np.zeros((len(self.rows), m, len(self.symbols)))
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
    """Where the columns of an effect are remembered: from one fit to the next, if they follow from the motion alone."""
    if key in record.kept:
        return record.kept
    modelled = not MODELLED.isdisjoint(effect.structure.reads(effect))
    columns = 2 * record.target[0].nbytes  # two, in the torque balance alone: most are such
    return record.memo if modelled or len(record.kept) * columns > MOST_KEPT else record.kept


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

    They are filtered side by side, and remembered; none where the log or the design lacks what the effect needs.

    Parameters
    ----------
    record : Record
    effect : Effect
    shapes : sequence of mapping
        Nonlinear parameters.
    """
    structure = effect.structure
    if structure.available(record, effect):
        return []
    symbols = structure.symbols(effect)
    keys = [("seen", *_key(effect, shape)) for shape in shapes]
    missing = [k for k, key in enumerate(keys) if key not in _memo(record, effect, key)]
    batch = max(FEWEST_AT_ONCE, int(AT_ONCE / (len(record.prepared.t) * 8 * max(1, len(symbols)))))
    for start in range(0, len(missing), batch):
        some = missing[start : start + batch]
        try:
            parts = [part for k in some for part in structure.columns(record, effect, shapes[k])]
        except UnavailableError:
            return []
        stacked = record.stack_all(parts, structure.filtered(record))
        for position, k in enumerate(some):
            own = slice(position * len(symbols), (position + 1) * len(symbols))
            rows = tuple(None if columns is None else columns[own].copy() for columns in stacked)
            group = seen_as_candidate(record, Group(effect, symbols, rows, shapes[k]))
            _memo(record, effect, keys[k])[keys[k]] = tuple(map(_small, group.rows))
    return [
        Group(effect, symbols, _memo(record, effect, key)[key], dict(shape))
        for key, shape in zip(keys, shapes, strict=True)
    ]


def _small(columns: Array | None) -> Array | None:
    """Columns of a long record in single precision: to be searched among, not to be fitted."""
    long = columns is not None and columns.shape[1] > SINGLE
    return columns.astype(np.float32) if columns is not None and long else columns


def seen_as_candidate(record: Record, group: Group) -> Group:
    """Return the columns by which an effect that is not in the model yet is judged: nothing made of noise.

    Parameters
    ----------
    record : Record
    group : Group
    """
    if group.effect is None:
        return group
    values = group.values
    seen = group.effect.structure.judged(record, group.effect, values, group.shape)
    if seen is values:
        return group
    rows = tuple(None if columns is None else seen[row].T.copy() for row, columns in enumerate(group.rows))
    return replace(group, rows=rows)

"""Channels that a log can do without: a column that was only guessed does not block a file."""

from __future__ import annotations

from collections.abc import Collection, Container, Mapping, Sequence

import numpy as np

from pmsm_ctrl.errors import LogError, MappingError, NextCommand
from pmsm_ctrl.importers.mapping import MEASURED, REQUIRED, Assignment, Source, fits_axis
from pmsm_ctrl.importers.names import counts_of
from pmsm_ctrl.importers.notices import CHANNEL_WITHOUT_NUMBERS, CHANNEL_WITHOUT_TIME
from pmsm_ctrl.importers.table import Array, Column, Table
from pmsm_ctrl.importers.vocabulary import meaning_of
from pmsm_ctrl.log import CHANNELS
from pmsm_ctrl.section import Notice

__all__ = ["unread", "with_time", "without_gaps"]


def _is_spare(source: Source, assignment: Assignment) -> bool:
    """Whether a channel may be left out: nobody has named it, and others are what a log needs.

    Position, speed and drive signal are left out only where a mapping states enough without them.
    """
    mapped = {one.channel for one in assignment.sources if one.how == "mapped"}
    enough = all(mapped.intersection(group) for group in REQUIRED if "t" not in group)
    return source.how == "guessed" and source.channel != "t" and (source.channel not in MEASURED or enough)


def with_time(
    table: Table, assignment: Assignment, timed: Collection[int]
) -> tuple[tuple[Source, ...], tuple[Notice, ...]]:
    """Return the sources whose group has a time, and notices of those that are left out.

    Parameters
    ----------
    table : Table
    assignment : Assignment
    timed : collection of int
        Groups with a time.

    Returns
    -------
    (tuple of Source, tuple of Notice)

    Raises
    ------
    LogError
        For one that was mapped.
    MappingError
        For one that was guessed and cannot be left out.
    """
    kept, notices = [], []
    for source in assignment.sources:
        column = table.columns[source.column]
        if column.group in timed:
            kept.append(source)
            continue
        count = int(table.load([source.column])[0].size)
        if not _is_spare(source, assignment):
            what = f"column '{column.label}' has no time column of its own, and no other one has its {count} samples"
            message = f"{table.file}: {what}; a time of as many was expected"
            if source.how == "mapped":
                raise LogError(f"{message}, or a mapping without {source.channel}")
            raise MappingError(message, next_command=NextCommand.PROPOSE)
        notices.append(CHANNEL_WITHOUT_TIME(channel=source.channel, column=column.label, count=count))
    return tuple(kept), tuple(notices)


def without_gaps(
    table: Table, assignment: Assignment, sources: Sequence[Source], loaded: Mapping[int, Array]
) -> tuple[tuple[Source, ...], tuple[Notice, ...]]:
    """Return the sources to be read, and notices of those that are left out for cells without a number.

    Parameters
    ----------
    table : Table
    assignment : Assignment
    sources : sequence of Source
    loaded : mapping of int to array
        The numbers of their columns.

    Returns
    -------
    (tuple of Source, tuple of Notice)
        One that cannot be left out is kept.
    """
    kept, notices = [], []
    for source in sources:
        bad = ~np.isfinite(loaded[source.column])
        if bad.any() and _is_spare(source, assignment):
            place = table.locate(source.column, int(np.argmax(bad)))
            count = int(np.count_nonzero(bad))
            notices.append(CHANNEL_WITHOUT_NUMBERS(channel=source.channel, count=count, place=place))
        else:
            kept.append(source)
    return tuple(kept), tuple(notices)


def unread(columns: Sequence[Column], motion: str, present: Container[str]) -> tuple[str, ...]:
    """Return a note on every column whose name and unit are those of a measured channel that the log does not have.

    Parameters
    ----------
    columns : sequence of Column
        Those that are no channel.
    motion : {"rotary", "linear"}
    present : container of str
        Channels of the log.
    """
    out = []
    for column in columns:
        meaning = None if column.is_text or not column.unit else meaning_of(column.name)
        channel = meaning.channel if meaning is not None else ""
        if channel in MEASURED and channel not in present and fits_axis(column.unit, channel, motion):
            si = CHANNELS[channel][motion == "linear"]
            spec, said = f"{column.name} [{column.unit}]", "reads it"
            if counts_of(column.unit):
                spec, said = f"FACTOR * {column.name} [{si}]", f"reads it, with the {si} of a count"
            out.append(
                f"{column.label}: may be {channel}, which the log does not have; --map {channel}='{spec}' {said}"
            )
    return tuple(out)

"""From a file's columns to the channels of a log: mapped, canonical, or guessed, and reported.

A design's table, here for the ``speed_test1.txt`` of the LAAS MN4004 bench, whose fourth column is the reference::

    [log.channels]
    t = "Time [s]"
    theta = "Position [rad]"
    omega = "Velocity [rad/s]"
    omega_ref = "Reference Velocity [rad/s]"
    i_q = "Iq [A]"

A column is named by its header, its name without the unit, or its number (``"#3 [rpm]"``); a factor or
a minus may stand before it (``"1.732 * Uq [V]"``, ``"-Iq [A]"``). A drive's own unit
needs a factor: torque in per mille of 2.4 N m is ``torque = "Torque actual value [‰]"`` with
``[log.scale] torque = 0.0024``, or ``"Torque actual value [‰ of 2.4 N m]"``.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import LogError, MappingError, NextCommand, nearest
from pmsm_ctrl.importers.clock import is_clock
from pmsm_ctrl.importers.names import counts_of, guess_channel, has_letter, split_header, unit_of, unit_spelling
from pmsm_ctrl.importers.notices import OTHER_UNIT
from pmsm_ctrl.importers.strange_units import strange_unit
from pmsm_ctrl.importers.table import Column, Table, one_line
from pmsm_ctrl.log import CHANNELS
from pmsm_ctrl.section import Notice
from pmsm_ctrl.units import UNITS, encoder_step

__all__ = [
    "FACTOR",
    "REQUIRED",
    "Assignment",
    "Source",
    "assign",
    "find_column",
    "fits_axis",
    "is_twin",
    "of_this_file",
    "stated_factor",
]

FACTOR = re.compile(
    r"(?:(?P<factor>[-+]?\d++\.?\d*+(?:e[-+]?\d++)?)\s*+\*|(?P<minus>-))\s*+(?P<column>\S.*)", re.IGNORECASE
)
# a log needs at least one channel of each group
REQUIRED = (("t",), ("theta", "omega"), ("i_q", "torque"))
MEASURED = ("theta", "omega", "i_q", "torque")


@dataclass(frozen=True)
class Source:
    """Where one channel comes from: ``SI value = factor * scale * column``.

    Attributes
    ----------
    channel : str
    column : int
    unit : str
        As the file or the mapping states it.
    factor, scale : float
        From that unit to SI; from the [log.scale] table.
    how : str
        "mapped", "canonical" or "guessed".
    assumed_unit : bool
        Whether no unit is stated.
    factor_unknown : bool
        Whether the unit is none of this channel, so that only the scale makes it SI.
    """

    channel: str
    column: int
    unit: str
    factor: float
    scale: float = 1.0
    how: str = "canonical"
    assumed_unit: bool = False
    factor_unknown: bool = False

    @property
    def gain(self) -> float:
        """The factor from the file's number to SI."""
        return self.factor * self.scale

    def doubtful(self, table: Table) -> bool:
        """Whether a unit was assumed for a column that is not named as the channel is."""
        named = table.columns[self.column].name in CHANNELS
        return self.how == "guessed" and self.assumed_unit and self.channel != "t" and not named


@dataclass(frozen=True)
class Assignment:
    """Which column becomes which channel, on which kind of axis, and what was guessed."""

    sources: tuple[Source, ...]
    motion: str
    notes: tuple[str, ...]

    def source(self, channel: str) -> Source | None:
        """Return the source of a channel, or None."""
        return next((source for source in self.sources if source.channel == channel), None)


def assign(table: Table, design: Design | None, mapping: Mapping[str, str] | None) -> Assignment:
    """Assign columns to channels.

    `mapping` has priority over the design's [log] table, and this over canonical names; only without a table are
    the remaining columns guessed from their names.

    Raises
    ------
    LogError
        For a channel or column that does not exist, a unit that is unknown or of the wrong kind, a channel
        that is missing.
    """
    wanted: dict[str, str] = {**(design.log.channels if design is not None else {}), **(mapping or {})}
    for channel in wanted:
        if channel not in CHANNELS:
            near, known = nearest(channel, CHANNELS), ", ".join(CHANNELS)
            place = f"{table.file}: the mapping"
            if design is not None and channel not in (mapping or {}):
                place = f"{design.source or table.file}: [log.channels] of the design"
            raise LogError(f"{place} names unknown channel '{one_line(channel)}'{near} (known: {known})")
    scales = dict(design.log.scale) if design is not None else {}
    stated = {channel: stated_factor(table, spec) for channel, spec in wanted.items()}
    chosen = {channel: (*find_column(table, channel, spec), "mapped") for channel, (_, spec) in stated.items()}
    table_complete = design is not None and bool(design.log.channels)
    counted = design is not None and design.sensor.encoder_counts > 0
    kind = design.motion if design is not None else ""
    for channel, index, how in _unmapped(table, chosen, guess=not table_complete, counted=counted, motion=kind):
        chosen[channel] = (index, "", how)
    motion = _motion(table, design, chosen, scales)
    sources = tuple(
        _source(table, channel, index, unit, how, scales.get(channel), motion, design)
        for channel, (index, unit, how) in chosen.items()
    )
    sources = tuple(replace(s, scale=s.scale * stated[s.channel][0]) if s.channel in stated else s for s in sources)
    _require(table, sources)
    ordered = tuple(sorted(sources, key=lambda source: list(CHANNELS).index(source.channel)))
    return Assignment(ordered, motion, tuple(_notes(table, sources)))


def of_this_file(
    table: Table, design: Design | None, mapping: Mapping[str, str] | None
) -> tuple[Table, Design | None, tuple[Notice, ...]]:
    """Return a canonical file with the part of the design's [log] table that is about it; any other file as it is.

    A design with the table of the drive's own files reads logs that the package wrote as well. What the table states
    of a column that such a log does not have is left out with a note, the scale of that channel included.

    Parameters
    ----------
    table : Table
    design : Design, optional
    mapping : mapping of str to str, optional
        What takes precedence over the design's table.

    Returns
    -------
    (Table, Design or None, tuple of Notice)
        A notice of every unit that the design states otherwise than the file.
    """
    canonical = all(column.name in CHANNELS and column.unit for column in table.columns)
    if design is None or not canonical:
        return table, design, ()
    log = design.log
    asked = {channel: spec for channel, spec in log.channels.items() if channel not in (mapping or {})}
    other = {channel for channel, spec in asked.items() if not is_clock(spec) and not _names(table, channel, spec)}
    if not other:
        return table, design, ()
    timed = any(column.name == "t" for column in table.columns)
    if timed:  # the clock of the other files, which have no time
        other |= {channel for channel, spec in asked.items() if is_clock(spec)}
    entries = ", ".join(f"{channel} = '{one_line(spec)}'" for channel, spec in asked.items() if channel in other)
    note = f"canonical header: not of this file, and not needed, of the design's [log] table: {entries}"
    kept = log.model_copy(
        update={
            "channels": {channel: spec for channel, spec in log.channels.items() if channel not in other},
            "scale": {channel: factor for channel, factor in log.scale.items() if channel not in other},
            "rate": None if timed else log.rate,
        }
    )
    notices = tuple(_other_unit(table, channel, spec) for channel, spec in asked.items() if channel in other)
    return (
        replace(table, notes=(*table.notes, note)),
        design.model_copy(update={"log": kept}),
        tuple(notice for notice in notices if notice is not None),
    )


def _names(table: Table, channel: str, spec: str) -> bool:
    """Whether a mapping names a column of a canonical file.

    The columns of another file may have the same numbers, the name of another channel (a current as "torque"), or
    the same name and another unit: where every unit is SI, the package may have written the file, and is right.
    """
    name, unit = split_header(one_line(stated_factor(table, spec)[1]))
    numbered = name.startswith("#") and name[1:].isdigit()
    own = any(column.name == channel for column in table.columns)
    SI = all(column.unit in CHANNELS[column.name][:2] for column in table.columns)
    for number, column in enumerate(table.columns, start=1):
        agrees = not unit or unit_spelling(unit) == unit_spelling(column.unit)
        if numbered:
            found = name == f"#{number}" and column.name == channel and agrees
        elif column.name == channel:
            found = _is_named(column, name) and (agrees or not SI)
        else:
            found = _is_named(column, name) and agrees and (bool(unit) or not own or _plausible(column, channel))
        if found:
            return True
    return False


def _is_named(column: Column, name: str) -> bool:
    return name.casefold() in (column.name.casefold(), column.header.casefold())


def _other_unit(table: Table, channel: str, spec: str) -> Notice | None:
    """Return the notice of an entry that names the channel's own column with another unit than the file."""
    name, unit = split_header(one_line(stated_factor(table, spec)[1]))
    column = next((column for column in table.columns if column.name == channel and _is_named(column, name)), None)
    if column is None or is_clock(spec):
        return None
    return OTHER_UNIT(channel=channel, file=column.unit, design=unit, mapping=f"{channel}={one_line(spec)}")


def stated_factor(table: Table, spec: str) -> tuple[float, str]:
    """Return the factor of a mapping such as '-speed [rpm]' or '1.732 * Uq [V]', and the mapping without it.

    A column's own name may look like that as well, and comes first.

    Parameters
    ----------
    table : Table
    spec : str

    Returns
    -------
    (float, str)
    """
    text = one_line(spec).strip()
    names = {name for column in table.columns for name in (column.header, column.name)}
    match = FACTOR.fullmatch(text)
    if match is None or {text, split_header(text)[0]} & names:
        return 1.0, spec
    return (-1.0 if match["minus"] else float(match["factor"])), match["column"]


def find_column(table: Table, channel: str, spec: str) -> tuple[int, str]:
    """Return (column index, stated unit) of a mapping such as 'speed [rpm]', 'speed' or '#3 [rpm]'.

    Parameters
    ----------
    table : Table
    channel : str
        For the message.
    spec : str

    Returns
    -------
    (int, str)

    Raises
    ------
    LogError
        When no column or more than one fits.
    """
    spec = one_line(spec)
    name, unit = split_header(spec)
    if name.startswith("#") and name[1:].isdigit():
        index = int(name[1:]) - 1
        if not 0 <= index < len(table.columns):
            raise LogError(f"{table.file}: [log] {channel} = '{spec}': the file has {len(table.columns)} columns")
        return index, unit
    tests: tuple[Callable[[Column], bool], ...] = (
        lambda c: c.header == spec,
        lambda c: c.header == name or c.name == spec,
        lambda c: c.name == name and (not unit or not c.unit or unit_spelling(c.unit) == unit_spelling(unit)),
        lambda c: c.name == name,
        lambda c: c.name.casefold() == name.casefold() or c.header.casefold() == name.casefold(),
    )
    for test in tests:
        found = [i for i, column in enumerate(table.columns) if test(column)]
        if len(found) > 1 and channel != "t":
            places = " or ".join(f"#{i + 1}" for i in found[:4])
            raise LogError(f"{table.file}: column '{name}' appears {len(found)} times; name it by its number: {places}")
        if found:
            return found[0], unit
    known = [column.name for column in table.columns]
    what = f"no column '{name}' for channel '{channel}'{nearest(name, known)}"
    raise LogError(f"{table.file}: {what} (found: {_shown(table.columns)})")


def _shown(columns: tuple[Column, ...]) -> str:
    names = [column.label for column in columns]
    return ", ".join(names[:20]) + (f", ... {len(names)} in all" if len(names) > 20 else "")


def _is_counted(unit: str, channel: str) -> bool:
    """Whether a unit counts the increments of an encoder, and the channel is such a position or speed."""
    return bool(counts_of(unit)) and counts_of(unit) == CHANNELS[channel][0]


def _unmapped(
    table: Table, chosen: Mapping[str, tuple[int, str, str]], guess: bool, counted: bool, motion: str
) -> list[tuple[str, int, str]]:
    """Channels for columns that no mapping names: exact names first, then guesses."""
    used = {index for index, _, _ in chosen.values()}
    free = [(i, c) for i, c in enumerate(table.columns) if i not in used and not c.is_text]
    found: dict[str, tuple[int, str]] = {}
    for i, column in free:
        if column.is_date and "t" not in chosen:
            found["t"] = (i, "guessed" if guess else "canonical")
        if column.name in CHANNELS and column.name not in chosen and column.name not in found:
            found[column.name] = (i, "canonical" if column.unit else "guessed")
    if guess:
        for i, column in free:
            channel = "t" if column.is_time else guess_channel(column.name)
            if channel in MEASURED and channel in found:
                _refuse_twins(table, channel, found[channel][0], i)
            if channel is None or channel in chosen or channel in found:
                continue
            if has_letter(column.name) and not fits_axis(column.unit, channel, motion):
                continue
            if _plausible(column, channel) or (counted and _is_counted(column.unit, channel)):
                found[channel] = (i, "guessed")
        for channel, i in _lettered(free, motion).items():
            if channel not in chosen and channel not in found:
                found[channel] = (i, "guessed")
    return [(channel, i, how) for channel, (i, how) in found.items()]


def is_twin(columns: Sequence[Column], one: int, other: int) -> bool:
    """Return whether two columns of one time base have the same name and the same unit.

    Parameters
    ----------
    columns : sequence of Column
    one, other : int
    """
    first, second = columns[one], columns[other]
    return one != other and (first.name, first.unit, first.group) == (second.name, second.unit, second.group)


def _refuse_twins(table: Table, channel: str, one: int, other: int) -> None:
    """Refuse to guess between two columns of the same name: the numbers may tell which one is measured."""
    if not is_twin(table.columns, one, other):
        return
    name = table.columns[one].label
    message = f"{table.file}: column '{name}' appears more than once for channel '{channel}'; name it by its number: "
    message += f"#{one + 1} or #{other + 1}"
    raise MappingError(message, next_command=NextCommand.PROPOSE)


def _lettered(free: Sequence[tuple[int, Column]], motion: str) -> dict[str, int]:
    """Return the position and the speed that letters name, such as ``x [mm]``: of a known axis, by a unit that fits."""
    letters = dict.fromkeys("xyz", "theta") | dict.fromkeys("vnw", "omega")
    named = [(letters.get(column.name.casefold(), ""), i, column) for i, column in free]
    found = [(channel, i) for channel, i, column in named if channel and column.unit and motion
             and fits_axis(column.unit, channel, motion)]  # fmt: skip
    channels = [channel for channel, _ in found]
    return {channel: i for channel, i in found if channels.count(channel) == 1}


def _plausible(column: Column, channel: str) -> bool:
    """Whether the stated unit fits the channel on some kind of axis; no unit does, an unknown one does not."""
    si = (unit_of(column.unit) or ("", 0.0))[0]
    return not column.unit or si in CHANNELS[channel][:2]


def fits_axis(unit: str, channel: str, motion: str) -> bool:
    """Whether a stated unit is one of a channel of this kind of axis; of any kind where `motion` is empty."""
    kinds = CHANNELS[channel][:2] if not motion else (CHANNELS[channel][motion == "linear"],)
    return not unit or bool(counts_of(unit)) or (unit_of(unit) or ("", 0.0))[0] in kinds


def _motion(
    table: Table,
    design: Design | None,
    chosen: Mapping[str, tuple[int, str, str]],
    scales: Mapping[str, float],
) -> str:
    """The kind of axis: from the design, or else from the units of position and speed."""
    if design is not None:
        return design.motion
    for channel in ("theta", "omega", "theta_ref", "omega_ref"):
        if channel in chosen and channel not in scales:
            index, unit, _ = chosen[channel]
            si = (unit_of(unit or table.columns[index].unit) or ("", 0.0))[0]
            if si in ("m", "m/s"):
                return "linear"
    return "rotary"


def _source(
    table: Table, channel: str, index: int, stated: str, how: str, scale: float | None, motion: str,
    design: Design | None,
) -> Source:  # fmt: skip
    column = table.columns[index]
    target = CHANNELS[channel][1 if motion == "linear" else 0]
    spelled = column.unit if column.is_date else stated or column.unit
    unit = unit_spelling(spelled) if spelled else target
    place = f"{table.file}: column {index + 1} ('{column.label}')"
    known = unit_of(unit)
    if known is None and _is_counted(unit, channel) and design is not None and design.sensor.encoder_counts:
        known = target, encoder_step(design.sensor.encoder_counts, motion)
    if known is None:
        if scale is not None:
            return Source(channel, index, spelled, 1.0, scale, how, factor_unknown=True)
        if way := _way_out(column, spelled, channel):
            raise _refused(f"{place}: unit [{spelled}] for '{channel}': {way}", how)
        accepted = ", ".join(name for name, (si, _) in UNITS.items() if si == target)
        near = nearest(spelled, UNITS)
        what = f"unknown unit [{spelled}] for '{channel}'{near}"
        message = f"{place}: {what} (accepted: {accepted}; or a factor in [log.scale])"
        raise _refused(message, how)
    si, factor = known
    if si != target and scale is None:
        if way := _way_out(column, spelled, channel):
            raise _refused(f"{place}: unit [{spelled}] for '{channel}': {way}", how)
        accepted = ", ".join(name for name, (known_si, _) in UNITS.items() if known_si == target)
        hint = '; for a linear axis the design needs motion = "linear"' if si in ("m", "m/s", "N") else ""
        message = f"{place}: unit [{spelled}] does not fit '{channel}' in {target} "
        message += f"(accepted: {accepted}; or a factor in [log.scale]){hint}"
        raise _refused(message, how)
    return Source(channel, index, unit, factor, 1.0 if scale is None else scale, how, not spelled, si != target)


def _way_out(column: Column, unit: str, channel: str) -> str:
    """Return what a unit lacks that is a share or a count of something else; empty for every other unit."""
    if _is_counted(unit, channel):
        what = "encoder counts, and nothing states how many make a turn (a metre)"
        return f"{what}: encoder_counts in [sensor] of the design, or a factor in [log.scale]"
    sign = unit_spelling(unit)
    if sign in ("%", "‰") and CHANNELS[channel][0] in ("N m", "A"):
        rated = "2.4 N m" if CHANNELS[channel][0] == "N m" else "5 A rms"
        what = f"a share of the rated value: --map {channel}='{column.name} [{sign} of {rated}]', with that of the data"
        return f"{what} sheet; or a factor in [log.scale]"
    return ""


def _refused(message: str, how: str) -> LogError:
    """Return the error of a unit: a mapping that states it is wrong, a column that was guessed may have another one."""
    if how == "mapped":
        return LogError(message, next_command=NextCommand.IMPORT)
    return MappingError(message, next_command=NextCommand.PROPOSE)


def _require(table: Table, sources: tuple[Source, ...]) -> None:
    present = {source.channel for source in sources}
    timed = any(column.is_time for column in table.columns)
    missing = [group for group in REQUIRED if not present.intersection(group) and not (timed and "t" in group)]
    if not missing:
        return
    named = [" or ".join(f"'{name}'" for name in group) for group in missing]
    for group, wanted in zip(missing, named, strict=True):
        _explain_unit(table, group, wanted)
    examples = [f"{group[-1]} = 'column [unit]'" + " or 'every 1 ms'" * ("t" in group) for group in missing]
    message = f"{table.file}: no channel {', and no '.join(named)}; found the columns {_shown(table.columns)} "
    message += f"(name them in [log.channels] or as {', '.join(examples)})"
    raise MappingError(message, next_command=NextCommand.PROPOSE)


def _explain_unit(table: Table, group: tuple[str, ...], wanted: str) -> None:
    """Refuse a column whose name would fit, but whose unit does not, with the way out."""
    for column in table.columns:
        channel = guess_channel(column.name)
        if channel in group and column.unit:
            what = f"column '{column.label}' would be '{channel}', but its unit [{column.unit}] does not fit"
            way = _way_out(column, column.unit, channel) or strange_unit(column)
            way = way or "map it and give its factor in [log.scale]"
            message = f"{table.file}: no channel {wanted}; {what}: {way}"
            raise MappingError(message, next_command=NextCommand.PROPOSE)


def _notes(table: Table, sources: tuple[Source, ...]) -> list[str]:
    notes = []
    for source in sources:
        column = table.columns[source.column]
        shown = column.label
        if source.how != "canonical" or source.assumed_unit or source.gain != 1.0:
            unit = f"[{source.unit}]" + (", unit assumed" if source.assumed_unit else "")
            factor = f", factor {source.gain:.9g}" if source.gain != 1.0 else ""
            notes.append(f"{source.channel} {source.how} from '{shown}' {unit}{factor}")
    used = {source.column for source in sources}
    ignored = [c.label for i, c in enumerate(table.columns) if i not in used and not c.is_time and c.label]
    if ignored:
        more = f", ... {len(ignored)} in all" if len(ignored) > 12 else ""
        notes.append(f"not used: {', '.join(ignored[:12])}{more}")
    return notes

"""The columns of a file whose names say which channel they are, and what has been decided of them so far."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import LogError
from pmsm_ctrl.importers import notices as say
from pmsm_ctrl.importers.mapping import REQUIRED, fits_axis, is_twin
from pmsm_ctrl.importers.names import counts_of, guess_channel, has_letter, unit_of, unit_spelling
from pmsm_ctrl.importers.rivals import alike, measured_one
from pmsm_ctrl.importers.table import Array, Column, Table
from pmsm_ctrl.importers.vocabulary import Meaning, meaning_of, says_measured, says_reference
from pmsm_ctrl.log import CHANNELS
from pmsm_ctrl.section import Notice

__all__ = [
    "AS_STATED",
    "Case",
    "Guess",
    "fits",
    "leave_constants",
    "leave_untimed",
    "say_gaps",
    "settle",
    "take_by_name",
]

LOOKED_AT = 200_000  # samples of each column
MOST = 40  # columns whose physics is looked at
AS_STATED = "as stated"


@dataclass(frozen=True)
class Guess:
    """One channel: its column, how a mapping spells it, and why.

    Attributes
    ----------
    channel : str
    column : int
        -1 for a computed time.
    label : str
        The column as the file names it.
    mapping : str
    reasons : tuple of str
    open_question : str
        What has to be filled in before the mapping can be used; empty where nothing has.
    """

    channel: str
    column: int
    label: str
    mapping: str
    reasons: tuple[str, ...]
    open_question: str = ""


class Case:
    """The columns of a file with what has been decided so far."""

    def __init__(self, table: Table, design: Design | None, stated: Mapping[str, tuple[str, int, str]]) -> None:
        self.table, self.design, self.stated = table, design, stated
        self.columns = table.columns
        self.usable = [i for i, c in enumerate(self.columns) if not c.is_text]
        self.values = _loaded(table, self.usable, {at for _, at, _ in stated.values()})
        self.untimed: set[int] = set()
        self.role: dict[int, str] = {at: channel for channel, (_, at, _) in stated.items()}
        self.why: dict[int, list[str]] = {at: [AS_STATED] for at in self.role}
        self.unit: dict[int, str] = {at: unit or self.columns[at].unit for _, at, unit in stated.values()}
        self.factor: dict[int, float] = {}
        self.open: dict[int, str] = {}
        self.doubts: list[Notice] = []
        self.assumed: list[tuple[str, str]] = []
        self.seen_as: dict[int, str] = {}
        self.rivals: dict[int, list[int]] = {}
        self.clock: Guess | None = None
        self.motion = design.motion if design is not None else "rotary"

    def at(self, channel: str) -> int | None:
        """Return the column that is this channel, None where there is none yet."""
        return next((i for i, role in self.role.items() if role == channel), None)

    def spoiled(self, i: int) -> bool:
        """Whether a column cannot be read: it has cells without a number, or no time."""
        return i in self.untimed or not np.isfinite(self.values[i]).all()

    def commanded(self, i: int) -> bool:
        """Whether the name of a column states a reference, which is never a measured channel."""
        return says_reference(self.columns[i].name)

    def is_measured(self, i: int) -> bool:
        """Whether the name of a column states a measurement."""
        return says_measured(self.columns[i].name)

    def take(self, i: int, channel: str, *reasons: str) -> None:
        """Decide that a column is a channel."""
        self.role[i] = channel
        self.why.setdefault(i, []).extend(reasons)
        self.unit.setdefault(i, self.columns[i].unit)

    def exchange(self, old: int, new: int, *reasons: str) -> None:
        """Decide that a column is the channel that another one was taken for; what was doubted of it goes along."""
        channel = self.role.pop(old)
        self.take(new, channel, *reasons)
        label = self.columns[old].label
        for k, doubt in enumerate(self.doubts):
            if doubt.code == say.UNSURE_NAME.code and doubt.detail["column"] == label:
                self.doubts[k] = say.UNSURE_NAME(**{**doubt.detail, "column": self.columns[new].label})

    def free(self, group: int) -> list[int]:
        """Return the columns of a time base that vary and are no channel yet."""
        return [
            i for i in self.usable
            if i not in self.role and self.columns[i].group == group and i not in self.seen_as
        ][:MOST]  # fmt: skip


def _loaded(table: Table, usable: Sequence[int], stated: Collection[int]) -> dict[int, Array]:
    """Return the numbers of the columns; of one that cannot be read, and that nobody has stated, NaN.

    Raises
    ------
    LogError
        Where none can be read, or one that was stated cannot.
    """
    try:
        return {i: values[:LOOKED_AT] for i, values in zip(usable, table.load(usable), strict=True)}
    except LogError:
        values = {}
        for i in usable:
            try:
                values[i] = table.load([i])[0][:LOOKED_AT]
            except LogError:
                if i in stated:
                    raise
        if not values:
            raise
    missing = np.full(max(one.size for one in values.values()), np.nan)
    return {i: values.get(i, missing) for i in usable}


def leave_untimed(case: Case) -> None:
    """Set columns aside that have no time, where others have one: their number of samples is another."""
    timed = {c.group for i, c in enumerate(case.columns) if c.is_time or guess_channel(c.name) == "t"}
    timed |= {case.columns[at].group for channel, (_, at, _) in case.stated.items() if channel == "t"}
    for i in case.usable:
        if timed and case.columns[i].group not in timed and i not in case.role:
            case.untimed.add(i)
            case.seen_as[i] = f"{case.values[i].size} samples, and no time has as many"


def leave_constants(case: Case) -> None:
    """Set columns aside that hold cells without a number, or one number only."""
    for i, values in case.values.items():
        if not np.isfinite(values).all():
            case.seen_as[i] = "cells that hold no number"
        elif values.size and np.ptp(values) == 0.0:
            case.seen_as[i] = f"constant, {values[0]:.6g}"


def say_gaps(case: Case) -> None:
    """Doubt a column that would be a channel which a log needs, and which is missing for its cells or its length."""
    for group in REQUIRED:
        if any(case.at(channel) is not None for channel in group):
            continue
        for i in (i for i in case.usable if i not in case.role and _named_as(case, i) in group):
            bad = ~np.isfinite(case.values[i])
            named = {"column": case.columns[i].label, "channel": _named_as(case, i)}
            if i in case.untimed:
                case.doubts.append(say.COLUMN_WITHOUT_TIME(count=case.values[i].size, **named))
            elif bad.any() and not bad.all():
                place = case.table.locate(i, int(np.argmax(bad)))
                case.doubts.append(say.COLUMN_WITH_GAPS(count=int(np.count_nonzero(bad)), place=place, **named))


def _named_as(case: Case, i: int) -> str:
    """Return the channel that the name of a column says, empty where it says none or the unit is another's."""
    column = case.columns[i]
    meaning = _meaning(case, i)
    channel = guess_channel(column.name) or (meaning.channel if meaning is not None else "")
    return channel if channel and fits(column, channel) else ""


def fits(column: Column, channel: str) -> bool:
    """Whether a stated unit fits a channel; a share of a rated value fits drive signals."""
    if not column.unit:
        return True
    if unit_spelling(column.unit) in ("%", "‰") and channel in ("torque", "i_q", "i_q_ref", "T_load"):
        return True
    if counts_of(column.unit):
        return counts_of(column.unit) == CHANNELS[channel][0]
    return (unit_of(column.unit) or ("", 0.0))[0] in CHANNELS[channel][:2]


def take_by_name(case: Case) -> None:
    """Take the columns whose names say what they are: exact names first, then words; actual before commanded."""
    exact: list[tuple[int, str]] = []
    words: list[tuple[int, str, str, str]] = []
    bare: set[int] = set()
    for i in case.usable:
        if i in case.role:
            continue
        column = case.columns[i]
        name = "t" if column.is_time or column.is_date else guess_channel(column.name)
        if name is not None and fits(column, name) and not (has_letter(column.name) and _of_another(case, i, name)):
            exact.append((i, name))
        elif (meaning := _meaning(case, i)) is not None and fits(column, meaning.channel):
            bare.update([i] if meaning.bare else [])
            words.append((i, meaning.channel, ", ".join(meaning.words), meaning.unsure))
    named = (*exact, *((i, channel) for i, channel, *_ in words))
    moving = {case.columns[i].group for i, channel in named if channel in ("theta", "omega")}
    exact.sort(
        key=lambda one: (not case.is_measured(one[0]), one[1] == "t" and case.columns[one[0]].group not in moving)
    )
    for i, channel in exact:
        if channel not in case.role.values() and not case.spoiled(i):
            case.take(i, channel, f"named '{case.columns[i].name}'")
    for i, channel, said, unsure in sorted(words, key=lambda one: (bool(one[3]), one[0] in bare)):
        taken = case.at(channel)
        if taken is not None and unsure and i not in case.role and taken in case.rivals and not case.spoiled(i):
            case.rivals[taken].append(i)  # named as vaguely: the motion may tell which of them drives it
        if taken is not None or case.spoiled(i):
            continue
        if channel == "torque" and "command" in unsure and "i_q" in case.role.values():
            case.seen_as[i] = unsure
            continue
        case.take(i, channel, f"its name contains {said}", *([unsure] if unsure else []))
        if unsure:
            case.rivals[i] = []
            case.doubts.append(say.UNSURE_NAME(column=case.columns[i].label, channel=channel, reason=unsure))
    for channel in ("theta", "omega", "i_q", "torque"):
        _settle_twins(case, channel)
    _say_several(case, [*exact, *((i, channel) for i, channel, *_ in words if i in bare)])


def settle(case: Case, channel: str, columns: Sequence[int], rate: Array | None = None) -> int:
    """Return which of several columns of one quantity is measured; the others are its reference, or fit as well.

    Parameters
    ----------
    case : Case
    channel : str
        The measured one, ``theta`` or ``omega``.
    columns : sequence of int
        In any order; names decide before numbers do.
    rate : array, shape (n,), optional
        The derivative of the position, where the columns are speeds.
    """
    named = [i for i in columns if case.is_measured(i)]
    best = (named or list(columns))[0]
    for i in (named or list(columns))[1:]:
        best = (best, i)[measured_one((case.values[best], case.values[i]), rate).measured]
    for i in columns:
        if i == best:
            continue
        choice = measured_one((case.values[i], case.values[best]), rate)
        label, reference = case.columns[best].label, f"{channel}_ref"
        sure = bool(choice.measured and choice.reason)
        if sure and reference in CHANNELS and case.at(reference) is None and (i in named) == (best in named):
            case.why.pop(i, None)
            case.take(i, reference, f"as '{label}', {choice.reason}: the reference")
            continue
        case.seen_as[i] = f"{channel} as well"
        if not sure and (i in named) == (best in named):
            case.doubts.append(
                say.TWO_COLUMNS_FIT(channel=channel, column=_told(case, best, i), other=_told(case, i, best))
            )
    return best


def _settle_twins(case: Case, channel: str) -> None:
    """Decide between columns that have the same name and hold one quantity: the first one may be the reference."""
    taken = case.at(channel)
    if taken is None or taken in {at for _, at, _ in case.stated.values()}:
        return
    twins = [i for i in case.usable if i != taken and i not in case.role and is_twin(case.columns, taken, i)]
    twins = [i for i in twins if not case.spoiled(i) and alike(case.values[taken], case.values[i])]
    if not twins:
        return
    position = case.at("theta")
    rate = np.gradient(case.values[position]) if channel == "omega" and position is not None else None
    best = settle(case, channel, [taken, *twins], rate if position is None or _beside(case, position, taken) else None)
    if best != taken:
        if case.role[taken] == channel:
            del case.role[taken]
        case.take(best, channel, f"named '{case.columns[best].name}'")


def _beside(case: Case, one: int, other: int) -> bool:
    return case.values[one].size == case.values[other].size and not case.spoiled(one)


def _told(case: Case, i: int, other: int) -> str:
    """Return the label of a column, and its number where another one has the same."""
    column = case.columns[i]
    return column.label if column.label != case.columns[other].label else f"#{i + 1} [{column.unit}]"


def _meaning(case: Case, i: int) -> Meaning | None:
    """Return what the words of a name mean; a letter alone needs a unit, and every letter one of this kind of axis."""
    meaning = meaning_of(case.columns[i].name)
    if meaning is None or not meaning.letter:
        return meaning
    linear_x = meaning.channel == "theta" and case.motion == "linear"
    if (meaning.bare and not case.columns[i].unit and not linear_x) or _of_another(case, i, meaning.channel):
        return None
    return meaning


def _of_another(case: Case, i: int, channel: str) -> bool:
    """Whether the unit of a column is that of another kind of axis than the design's."""
    return not fits_axis(case.columns[i].unit, channel, "" if case.design is None else case.motion)


def _say_several(case: Case, exact: list[tuple[int, str]]) -> None:
    """Doubt a channel that several columns are named after, as the joints of a robot are."""
    for channel in ("theta", "omega", "torque", "i_q"):
        taken = case.at(channel)
        others = [i for i, name in exact if name == channel and i != taken]
        if taken is None or not others:
            continue
        case.seen_as.update((i, f"{channel} as well") for i in others if i not in case.role)
        names = {"column": _told(case, taken, others[0]), "other": _told(case, others[0], taken)}
        case.doubts.append(say.SEVERAL_COLUMNS(channel=channel, count=len(others) + 1, **names))

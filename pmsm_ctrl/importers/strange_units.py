"""Columns whose names are understood and whose units are not: what states the unit."""

from __future__ import annotations

from collections.abc import Sequence

from pmsm_ctrl.importers.names import counts_of, guess_channel, unit_of
from pmsm_ctrl.importers.table import Column
from pmsm_ctrl.importers.vocabulary import meaning_of
from pmsm_ctrl.log import CHANNELS

__all__ = ["strange_unit", "strange_units"]

_LIKELY = {"rad": "deg", "rad/s": "rpm", "m": "mm", "m/s": "mm/s"}  # what drives write, of an SI unit


def strange_unit(column: Column, motion: str = "rotary") -> str:
    """Return that the unit of a column is not known, with the option that states one; empty where it is known.

    Parameters
    ----------
    column : Column
    motion : {"rotary", "linear"}
    """
    if not column.unit or column.is_text or column.is_date or unit_of(column.unit) or counts_of(column.unit):
        return ""
    meaning = meaning_of(column.name)
    channel = guess_channel(column.name) or (meaning.channel if meaning is not None else "")
    if not channel or "%" in column.unit or "‰" in column.unit:  # of a rated value that nothing states
        return f'unit "{column.unit}" is not known'
    si = CHANNELS[channel][motion == "linear"]
    spec = f"{channel}='{column.name} [{_LIKELY.get(si, si)}]'"
    return f'unit "{column.unit}" is not known; --map {spec} states one that is'


def strange_units(columns: Sequence[Column], motion: str) -> tuple[str, ...]:
    """Return a note on every column whose name is understood and whose unit is not known.

    Parameters
    ----------
    columns : sequence of Column
        Those that are no channel.
    motion : {"rotary", "linear"}
    """
    told = ((column.label, strange_unit(column, motion)) for column in columns)
    return tuple(f"{label}: {what}" for label, what in told if "--map" in what)

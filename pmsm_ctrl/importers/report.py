"""What was understood of a file, to be checked before the log is used."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import tomli_w

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import LogError
from pmsm_ctrl.importers.delays import Delay, delays
from pmsm_ctrl.importers.mapping import Assignment, Source, find_column
from pmsm_ctrl.importers.notices import UNIT_ASSUMED
from pmsm_ctrl.importers.plausibility import torque_factor, velocity_factor
from pmsm_ctrl.importers.reading import read_all
from pmsm_ctrl.importers.spare import unread
from pmsm_ctrl.importers.strange_units import strange_units
from pmsm_ctrl.importers.table import Table
from pmsm_ctrl.importers.timebase import TimeBase, quantum, saturated_share, time_base
from pmsm_ctrl.log import Log
from pmsm_ctrl.result import Result, jsonable
from pmsm_ctrl.section import Notice

__all__ = ["ChannelReport", "ImportReport", "describe"]


@dataclass(frozen=True)
class ChannelReport:
    """One channel: where it comes from, and what its numbers look like (SI).

    `number` is the place of its column in the file, from 1.
    """

    channel: str
    column: str
    unit: str
    stated_unit: str
    gain: float
    how: str
    assumed_unit: bool
    minimum: float
    maximum: float
    quantum: float
    saturated: float
    number: int = 0


@dataclass(frozen=True, eq=False)
class ImportReport(Result):
    """What was understood of a file.

    Attributes
    ----------
    log : Log
        What `read_log` returns for the same arguments.
    layout : dict
        Encoding, separator, decimal mark, first row of numbers; empty for binary formats.
    channels : tuple of ChannelReport
    base : TimeBase
        Rate, jitter and gaps.
    velocity, torque : (float, float)
        dtheta/dt over omega and its spread; torque over K_t i_q and their correlation. NaN where unknown.
    delays : tuple of Delay
    table : str
        The [log] table, as TOML, that reads this file without a guess.
    unused : tuple of str
        Columns that are no channel.
    accepted : tuple of Notice
        Doubts of the proposed mapping that were accepted with it: they still are reasons to doubt the log.
    remarks : tuple of str
        Those notes of the log that neither the layout nor the channels tell: what was interpolated, dropped, unwrapped.
        Then the columns of which only the unit is not known.
    """

    log: Log
    layout: Mapping[str, str]
    channels: tuple[ChannelReport, ...]
    base: TimeBase
    velocity: tuple[float, float]
    torque: tuple[float, float]
    delays: tuple[Delay, ...]
    table: str
    unused: tuple[str, ...] = field(default=())
    accepted: tuple[Notice, ...] = ()
    remarks: tuple[str, ...] = ()

    @property
    def assumed(self) -> tuple[str, ...]:
        """Channels whose unit was assumed, of columns that are not named as the channels are."""
        found = (notice for notice in self.log.provenance.notices if notice.code == UNIT_ASSUMED.code)
        return tuple(channel for notice in found for channel in notice.detail["channels"])

    @property
    def notices(self) -> tuple[Notice, ...]:
        """Reasons to doubt the log."""
        return tuple(dict.fromkeys((*self.accepted, *self.log.provenance.notices)))

    def to_dict(self) -> dict[str, Any]:
        """Return plain values fit for JSON."""
        return jsonable({
            "schema": "pmsm-ctrl/import/1",
            **self.doubts(),
            "notes": self.log.provenance.notes,
            "file": self.log.provenance.file,
            "sha256": self.log.provenance.sha256,
            "format": self.log.provenance.importer,
            "layout": dict(self.layout),
            "motion": self.log.motion,
            "samples": len(self.log),
            "duration": self.log.duration,
            "time_base": vars(self.base),
            "channels": {c.channel: vars(c) for c in self.channels},
            "unused": self.unused,
            "velocity_factor": {"value": self.velocity[0], "spread": self.velocity[1]},
            "torque_factor": {"value": self.torque[0], "correlation": self.torque[1]},
            "delays": [vars(d) for d in self.delays],
            "log_table": self.table,
        })  # fmt: skip


def describe(
    path: str | os.PathLike[str],
    design: Design | None = None,
    mapping: Mapping[str, str] | None = None,
    *,
    name: str = "",
) -> ImportReport:
    """Read a log and report what was understood of the file.

    Parameters
    ----------
    path, design, mapping
        As `pmsm_ctrl.importers.read_log`.
    name : str
        What messages and the report call the file; the path where it is left out.

    Returns
    -------
    ImportReport

    Raises
    ------
    LogError
        As `pmsm_ctrl.importers.read_log`.
    """
    log, table, assignment = read_all(path, design, mapping, name)
    used = {source.column for source in assignment.sources}
    left = [c for i, c in enumerate(table.columns) if i not in used and not c.is_time]
    notes = (*strange_units(left, log.motion), *unread(left, log.motion, log))
    told = {*assignment.notes, *(note for note in table.notes if note.startswith("read as "))}
    with np.errstate(all="ignore"):
        return ImportReport(
            log=log,
            layout=table.facts,
            channels=tuple(_channel(log, table, source) for source in assignment.sources),
            base=time_base(log.t),
            velocity=velocity_factor(log),
            torque=torque_factor(log, design),
            delays=delays(log),
            table=log_table(table, assignment),
            unused=tuple(column.label for column in left if column.label),
            remarks=(*(note for note in log.provenance.notes if note not in told), *notes),
        )


def _channel(log: Log, table: Table, source: Source) -> ChannelReport:
    column, values = table.columns[source.column], log[source.channel]
    return ChannelReport(
        channel=source.channel,
        column=column.label,
        unit=log.unit(source.channel),
        stated_unit=source.unit,
        gain=source.gain,
        how=source.how,
        assumed_unit=source.assumed_unit,
        minimum=float(values.min()),
        maximum=float(values.max()),
        quantum=quantum(values),
        saturated=saturated_share(values) if source.channel != "t" else 0.0,
        number=source.column + 1,
    )


def log_table(table: Table, assignment: Assignment) -> str:
    """Return the [log] table, as TOML, that reads this file without a guess."""
    content: dict[str, Any] = {}
    words = {"semicolon": ";", "tab": "\t", "comma": ",", "bar": "|", "blanks": " "}
    if table.facts.get("separator") in words:
        content["separator"] = words[table.facts["separator"]]
        content["decimal"] = "," if table.facts["decimal mark"] == "comma" else "."
    content["channels"] = {s.channel: _spelled(table, s) for s in assignment.sources}
    scale = {s.channel: s.scale for s in assignment.sources if s.scale != 1.0 or s.factor_unknown}
    if scale:
        content["scale"] = scale
    return log_toml(content)


def log_toml(content: Mapping[str, Any]) -> str:
    """Return a [log] table as TOML, fit to be shown: a tab as its escape, which a terminal does not swallow.

    Parameters
    ----------
    content : dict
        Settings, and the tables ``channels`` and ``scale``.
    """
    return tomli_w.dumps({"log": content}).replace("\t", "\\t")


def _spelled(table: Table, source: Source) -> str:
    """The shortest mapping to this column: its name, or its number where names are not unique."""
    column = table.columns[source.column]
    if source.channel == "t" and column.header.startswith("every "):
        return column.header
    for text in (f"{column.name} [{source.unit}]", f"{column.header} [{source.unit}]"):
        try:
            if find_column(table, source.channel, text) == (source.column, source.unit):
                return text
        except LogError:
            continue
    return f"#{source.column + 1} [{source.unit}]"

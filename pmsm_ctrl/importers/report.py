"""What was understood of a file, for the engineer to check before she trusts the log."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import tomli_w

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import LogError
from pmsm_ctrl.importers.delays import Delay, delays
from pmsm_ctrl.importers.mapping import Assignment, Source, find_column
from pmsm_ctrl.importers.plausibility import torque_factor, velocity_factor
from pmsm_ctrl.importers.table import Table
from pmsm_ctrl.importers.timebase import TimeBase, quantum, saturated_share, time_base
from pmsm_ctrl.log import Log
from pmsm_ctrl.result import Result, Section, jsonable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["ChannelReport", "ImportReport", "describe"]

DRAWN = 4000  # points per curve; more cannot be seen


@dataclass(frozen=True)
class ChannelReport:
    """One channel: where it comes from, and what its numbers look like (SI)."""

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


@dataclass(frozen=True, eq=False)
class ImportReport(Result):
    """What was understood of a file.

    Attributes
    ----------
    log : Log
        What `read_log` returns for the same arguments.
    layout : dict
        Encoding, separator, decimal mark, first row of numbers; empty for binary formats.
    base : TimeBase
        Rate, jitter and gaps.
    velocity, torque : (float, float)
        dtheta/dt over omega and its spread; torque over K_t i_q and their correlation. NaN where unknown.
    table : str
        The [log] table, as TOML, that reads this file without a guess.
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

    @property
    def warnings(self) -> tuple[str, ...]:
        """Reasons to doubt the log."""
        return self.log.provenance.warnings

    def _facts(self) -> list[tuple[str, str]]:
        log, base = self.log, self.base
        rows = [("file", log.provenance.file), ("format", log.provenance.importer)]
        rows += list(self.layout.items())
        rows += [("axis", log.motion), ("samples", f"{len(log)}"), ("duration", f"{log.duration:.6g} s")]
        if math.isfinite(base.period) and base.period > 1e-300:
            rows.append(("rate", f"{1.0 / base.period:.6g} Hz (median period {1e3 * base.period:.6g} ms)"))
            rows.append(("jitter", f"{1e3 * base.jitter_rms:.3g} ms rms, {1e3 * base.jitter_max:.3g} ms at most"))
            gap = (
                f", the longest {1e3 * base.longest_gap:.4g} ms at t = {base.longest_gap_at:.6g} s" if base.gaps else ""
            )
            rows.append(("gaps", f"{base.gaps}{gap}"))
        if math.isfinite(self.velocity[0]):
            rows.append(("dtheta/dt over omega", f"{self.velocity[0]:.4g} (spread {100 * self.velocity[1]:.2g} %)"))
        if math.isfinite(self.torque[0]):
            rows.append(("torque over K_t i_q", f"{self.torque[0]:.4g} (correlation {self.torque[1]:.3f})"))
        if base.gaps or base.jitter_max > 0.2 * base.period:
            rows.append(("delays", "not estimated: the time stamps are irregular"))
        rows += [(f"delay of {d.later} behind {d.earlier}", f"{1e3 * d.seconds:.3g} ms") for d in self.delays]
        return rows

    def _rows(self) -> list[tuple[str, ...]]:
        def step(c: ChannelReport) -> str:
            return f"{c.quantum:.4g}" if c.quantum > 0.0 else ("constant" if math.isnan(c.quantum) else "none")

        return [
            (
                c.channel,
                c.column,
                f"[{c.stated_unit}]" + (" assumed" if c.assumed_unit else ""),
                f"{c.gain:.9g}",
                c.how,
                f"{c.minimum:.5g} ... {c.maximum:.5g} {c.unit}",
                step(c),
                f"{100 * c.saturated:.2g} %",
            )
            for c in self.channels
        ]

    def summary(self) -> str:
        """Return the report as text, doubts first."""
        lines = [f"import of {self.log.provenance.file}"]
        lines += [f"  warning: {text}" for text in self.warnings] or ["  no reason to doubt the log was found"]
        guessed = [c.channel for c in self.channels if c.how == "guessed" or c.assumed_unit]
        if guessed:
            lines.append(f"  guessed: {', '.join(guessed)}; the table below says so for good")
        lines += [f"  {name}: {value}" for name, value in self._facts()[1:]]
        for channel, column, unit, gain, how, span, step, limit in self._rows():
            factor = f" x {gain}" if gain != "1" else ""
            remarks = {"constant": ", constant", "none": ""}.get(step, f", in steps of {step}")
            remarks += f", at its limit {limit} of the time" if limit != "0 %" else ""
            lines.append(f"  {channel:<11} {how} from '{column}' {unit}{factor}: {span}{remarks}")
        if self.unused:
            lines.append(f"  not used: {', '.join(self.unused[:20])}{', ...' if len(self.unused) > 20 else ''}")
        return "\n".join([*lines, "", self.table.rstrip()])

    def plot(self) -> Figure:
        """Draw every channel over time."""
        from matplotlib.figure import Figure

        names = [name for name in self.log if name != "t"]
        figure = Figure(figsize=(8.0, 1.0 + 1.5 * len(names)), layout="constrained")
        axes = np.atleast_1d(figure.subplots(len(names), 1, sharex=True))
        step = max(1, len(self.log) // DRAWN)
        for axis, name in zip(axes, names, strict=True):
            axis.plot(self.log.t[::step], self.log[name][::step], color="#0072B2", linewidth=0.8)
            axis.set_ylabel(f"{name} [{self.log.unit(name)}]")
            axis.grid(alpha=0.3)
        axes[-1].set_xlabel("t [s]")
        axes[0].set_title("The channels as understood: signs, sizes and units should look familiar")
        return figure

    def to_dict(self) -> dict[str, Any]:
        """Return plain values fit for JSON."""
        return jsonable({
            "schema": "pmsm-ctrl/import/1",
            "warnings": self.warnings,
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

    def section(self) -> Section:
        """Return the section of the report."""
        header = ("channel", "column", "unit", "factor to SI", "how", "range", "step", "at the limit")
        return Section(
            title="The log as it was understood",
            paragraphs=(
                *(f"Warning: {text}" for text in self.warnings),
                *self.log.provenance.notes,
            ),
            tables=((("fact", "value"), tuple(self._facts())), (header, tuple(self._rows()))),
            figures=((self.plot(), "Every channel over time: signs, sizes and units should look familiar."),),
        )


def describe(
    path: str | os.PathLike[str], design: Design | None = None, mapping: Mapping[str, str] | None = None
) -> ImportReport:
    """Read a log and say what was understood of the file.

    Parameters and errors are those of `pmsm_ctrl.importers.read_log`.
    """
    from pmsm_ctrl.importers import read_all

    log, table, assignment = read_all(path, design, mapping)
    used = {source.column for source in assignment.sources}
    unused = [c.label for i, c in enumerate(table.columns) if i not in used and not c.is_time]
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
            unused=tuple(name for name in unused if name),
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
    return tomli_w.dumps({"log": content})


def _spelled(table: Table, source: Source) -> str:
    """The shortest mapping that leads back to this column: its name, or its number where names are not unique."""
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

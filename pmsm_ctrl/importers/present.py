"""The import report in words and pictures."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from pmsm_ctrl.importers.proposal import Proposal
from pmsm_ctrl.importers.recording import NEEDS
from pmsm_ctrl.importers.report import ChannelReport, ImportReport
from pmsm_ctrl.rendering.numbers import number
from pmsm_ctrl.section import Picture, Section, Table, present

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DRAWN = 4000  # points per curve; more are not visible
NO_JITTER = 1e-9  # of the period: rounding of the time stamps
LISTED = 20  # unused columns that are named


@present.register
def _(report: ImportReport) -> Section:
    count = len(report.notices)
    verdict = f"Plausibility checks: {count or 'no'} warning{'' if count == 1 else 's'}."
    if accepted := len(report.accepted):
        share = "" if accepted == count else f" {accepted} of them"
        verdict = f"{verdict[:-1]},{share} accepted with the mapping."
    guessed = [c.channel for c in report.channels if c.how == "guessed" or c.assumed_unit]
    fixed = [f"Guessed: {', '.join(guessed)}. The [log] table at the end fixes the assignment."] if guessed else []
    more = ", ..." if len(report.unused) > LISTED else ""
    unused = [f"Columns not used: {', '.join(report.unused[:LISTED])}{more}."] if report.unused else []
    return Section(
        f"Import of {report.log.provenance.file}",
        (
            verdict,
            *report.notices,
            *fixed,
            Table(("fact", "value"), _facts(report), "The file"),
            _channels(report),
            *unused,
            *([f"Notes: {'; '.join(report.remarks)}."] if report.remarks else []),
            _needs(report),
            Picture(lambda: _figure(report), "Every channel over time: check signs, sizes and units."),
            report.table,
            Section("Notes", report.log.provenance.notes, folded=True),
        ),
    )


def _needs(report: ImportReport) -> Table:
    """Return what later commands need, and what of it this log lacks."""
    rows = tuple(
        (f"{need.command}: {need.why}" if need.why else need.command, _listed(need.channels),
         _listed(need.lacking(report.log)) or "-")
        for need in NEEDS
    )  # fmt: skip
    return Table(("command", "needs", "not in this log"), rows, "What later commands need")


def _listed(channels: tuple[tuple[str, ...], ...]) -> str:
    return ", ".join(" or ".join(some) for some in channels)


@present.register
def _(proposal: Proposal) -> Section:
    count = len(proposal.notices)
    doubts = f"{count or 'no'} doubt{'' if count == 1 else 's'}"
    state = "" if proposal.complete else ", and it is incomplete"
    lacking = (f"Missing: {', '.join(proposal.missing)}.",) if proposal.missing else ()
    rows = tuple((g.channel, g.mapping, "; ".join(g.reasons)) for g in proposal.guesses)
    unused = [f"{label} ({what})" for label, what in proposal.unused[:LISTED]]
    more = ", ..." if len(proposal.unused) > LISTED else ""
    return Section(
        f"Proposed mapping of {proposal.file}",
        (
            f"A proposal from names, units and physics, with {doubts}{state}. Nothing is read before it is confirmed.",
            *proposal.notices,
            *lacking,
            Table(("channel", "column", "why"), rows, "The mapping"),
            *([f"Columns not used: {', '.join(unused)}{more}."] if unused else []),
            proposal.table,
        ),
    )


def _facts(report: ImportReport) -> tuple[tuple[str, str], ...]:
    log, base = report.log, report.base
    rows = [("format", log.provenance.importer), *report.layout.items()]
    rows += [("axis", log.motion), ("samples", f"{len(log)}"), ("duration", f"{log.duration:.6g} s")]
    if math.isfinite(base.period) and base.period > 1e-300:
        rows.append(("rate", f"{1.0 / base.period:.6g} Hz (median period {1e3 * base.period:.6g} ms)"))
        jitter = f"{1e3 * base.jitter_rms:.3g} ms rms, {1e3 * base.jitter_max:.3g} ms at most"
        rows.append(("jitter", jitter if base.jitter_max > NO_JITTER * base.period else "none"))
        longest = f", the longest {1e3 * base.longest_gap:.4g} ms at t = {base.longest_gap_at:.6g} s"
        rows.append(("gaps", f"{base.gaps}{longest if base.gaps else ''}"))
    if math.isfinite(report.velocity[0]):
        rows.append(("dtheta/dt over omega", f"{report.velocity[0]:.4g} (spread {100 * report.velocity[1]:.2g} %)"))
    if math.isfinite(report.torque[0]):
        rows.append(("torque over K_t i_q", f"{report.torque[0]:.4g} (correlation {report.torque[1]:.3f})"))
    if base.irregular and not report.delays:
        rows.append(("delays", "not estimated, or within the jitter: the time stamps are irregular"))
    rows += [(f"delay of {d.later} behind {d.earlier}", f"{1e3 * d.seconds:.3g} ms") for d in report.delays]
    return tuple(rows)


def _channels(report: ImportReport) -> Table:
    """Return one row a channel; columns whose cells are all neutral are left out."""
    head = ("channel", "column", "factor to SI", "found", "range", "step", "at limit")
    rows = [_row(c) for c in report.channels]
    kept = [k for k in range(len(head)) if {row[k] for row in rows} not in ({"1"}, {"-"}, {"mapped"})]
    shown = tuple(tuple(row[k] for k in kept) for row in rows)
    return Table(tuple(head[k] for k in kept), shown, "The channels")


def _row(c: ChannelReport) -> tuple[str, ...]:
    step = "constant" if math.isnan(c.quantum) else number(c.quantum) if c.quantum > 0.0 else "-"
    return (
        c.channel,
        _with_unit(c),
        f"{c.gain:.6g}",
        c.how,
        f"{c.minimum:.5g} ... {c.maximum:.5g} {c.unit}",
        step,
        f"{100 * c.saturated:.2g} %" if c.saturated else "-",
    )


def _with_unit(c: ChannelReport) -> str:
    unit = f"[{c.stated_unit}]"
    label = c.column if c.column.endswith(unit) else f"{c.column} {unit}"
    return f"{label} assumed" if c.assumed_unit else label


def _figure(report: ImportReport) -> Figure:
    """Draw every channel over time."""
    from matplotlib.figure import Figure

    log = report.log
    names = [name for name in log if name != "t"]
    figure = Figure(figsize=(8.0, 1.0 + 1.5 * len(names)), layout="constrained")
    panels = figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
    step = max(1, len(log) // DRAWN)
    for axes, name in zip(panels, names, strict=True):
        axes.plot(log.t[::step], log[name][::step], color="#0072B2", linewidth=0.8)
        axes.set_ylabel(f"{name} [{log.unit(name)}]")
        axes.grid(alpha=0.3)
    panels[-1].set_xlabel("t [s]")
    return figure

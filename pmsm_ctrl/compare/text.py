"""A comparison in words: terminal summary and report section."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pmsm_ctrl.result import Section
from pmsm_ctrl.units import drives

if TYPE_CHECKING:
    from pmsm_ctrl.compare.comparison import ChannelError, Comparison

__all__ = ["report_section", "summary_text"]

HEAD = ("record", "channel", "how", "rms", "noise floor", "unit", "relative", "worst", "mean")


def _cells(name: str, how: str, e: ChannelError, label: str) -> tuple[str, ...]:
    floor = f"{e.floor:.3g}" if np.isfinite(e.floor) else "-"
    figures = (f"{e.rms:.4g}", floor, e.unit, f"{100 * e.relative:.2f} %", f"{e.worst:.3g}", f"{e.mean:+.2g}")
    return (label, name, how, *figures)


def _word(c: Comparison, channel: str) -> str:
    return drives(c.design.motion) if channel == "torque" else channel


def error_rows(c: Comparison) -> list[tuple[str, ...]]:
    """Errors of every channel by every method on both logs."""
    rows: list[tuple[str, ...]] = []
    records = [("log", c.channels, c.simulated)]
    if c.holdout is not None:
        records.append(("held out", c.holdout, c.holdout_simulated or ()))
    for label, errors, simulated in records:
        rows += [_cells(_word(c, name), "prediction", e, label) for name, e in errors.items()]
        for run in simulated:
            rows += [_cells(_word(c, name), run.method, e, label) for name, e in run.errors.items()]
    return rows


def _probability(p: float) -> str:
    return f"{p:.1g}" if p > 1e-12 else "< 1e-12"


def where_rows(c: Comparison, channel: str) -> list[tuple[str, ...]]:
    """What the residual of a channel depends on, one row a coordinate."""
    rows: list[tuple[str, ...]] = []
    for d in c.where[channel].dependences:
        named = f"{100 * d.added:.0f} %" if d.rank else "-"
        place = f"largest {d.largest}" if d.significant else d.why_not
        name = f"position, order {', '.join(map(str, d.orders))}" if d.orders and d.significant else d.coordinate
        rows.append((name, f"{100 * d.share:.0f} %", named, _probability(d.p_value), place))
    return rows


def summary_text(c: Comparison) -> str:
    """Return the result as text, trust first."""
    held = f", held out: {c.holdout_name}" if c.holdout is not None else ""
    lines = [f"comparison of {c.design.name} with {c.log_name}{held}"]
    lines += [f"  warning: {text}" for text in c.warnings] or ["  no reason to doubt the numbers was found"]
    for channel, found in c.where.items():
        lines.append(f"  {_word(c, channel)}: {found.sentence()}")
    lines.append("  errors, measured less predicted:")
    for label, name, how, rms, floor, unit, relative, worst, mean in error_rows(c):
        lines.append(
            f"    {label:<8} {name:<7} rms {rms:>9} {unit:<6} relative {relative:>8}  noise floor {floor:>8}"
            f"  worst {worst:>8}  mean {mean:>8}  {how}"
        )
    lines.append(f"  share of the {_word(c, 'torque')} residual that depends on:")
    for name, share, beyond, p, place in where_rows(c, "torque"):
        extra = f", {beyond} beyond those above" if beyond not in ("-", share) else ""
        lines.append(f"    {name:<28} {share:>5}{extra}  (p {p if p.startswith('<') else '= ' + p}; {place})")
    worst = f"worst stretches of the {_word(c, 'torque')}:"
    lines.append(f"  {worst if c.stretches else 'no stretch of time is worse than the rest'}")
    lines += [f"    {s.sentence()}" for s in c.stretches]
    return "\n".join(lines)


def report_section(c: Comparison) -> Section:
    """Return the section of the report."""
    torque = c.where["torque"]
    paragraphs = [f"Warning: {text}" for text in c.warnings]
    paragraphs += [f"{_word(c, channel)}: {found.sentence()}." for channel, found in c.where.items()]
    paragraphs += [f"Worst stretch {k}: {s.sentence()}." for k, s in enumerate(c.stretches, start=1)]
    figures = [
        (
            c.plot(),
            "Where prediction and measurement part, and where the residual has a shape, an effect is missing"
            + ("; the worst stretches are shaded." if c.stretches else ". No stretch is worse than the rest."),
        ),
        (
            c.plot_where(),
            f"The {_word(c, 'torque')} residual over every coordinate: {torque.sentence()}. A curve that stays on zero "
            "means that the model is right there; shares are those of the residual's mean square on blocks of time "
            "left out.",
        ),
    ]
    if c.stretches:
        figures.append(
            (c.plot_stretches(), "The worst stretches, with the speed below: what the axis was doing there.")
        )
    if c.holdout_traces:
        figures.append((c.plot_holdout(), "The same parameters on the record that was held out."))
    where_head = ("coordinate", "share alone", "share added", "p", "where, or why it does not count")
    tables = [(HEAD[:-1], tuple(row[:-1] for row in error_rows(c))), (where_head, tuple(where_rows(c, "torque")))]
    captions = ("How far the model is off", "What the error depends on")
    return Section("Model against measurement", tuple(paragraphs), tuple(tables), tuple(figures), captions)

"""A run over a fleet, and the report on it, as sections."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from datetime import datetime
from typing import TYPE_CHECKING

import numpy as np

from pmsm_ctrl.evidence.trends import FALSE_DISCOVERIES, FEWEST_RECORDS
from pmsm_ctrl.fleet.answers import AxisAnswer, Change, Finding, FleetReport, Series
from pmsm_ctrl.fleet.policy import OUTLYING
from pmsm_ctrl.fleet.result import FleetResult, Lost
from pmsm_ctrl.rendering.numbers import counted, number, percent, probability, with_error
from pmsm_ctrl.section import Block, Picture, Section, Sparkline, Table, present

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from pmsm_ctrl.fleet.axis import AxisRecord

__all__ = ["axis_sections", "axis_verdict", "linked", "sections", "verdict_of"]

DRAWN = ("F_c", "F_v")  # parameters that the table of axes draws


@present.register
def _(result: FleetResult) -> Section:
    answered = result.logs - len(result.lost)
    verdict = (
        f"{counted(result.logs, 'log')} of {counted(result.axes, 'axis', 'axes')}: {answered} with an answer; "
        f"{result.evaluated} evaluated in {result.seconds:.3g} s, {result.reused} from earlier runs."
    )
    blocks: list[Block] = [verdict, *result.notices]
    if result.verdicts:
        rows = tuple((name.replace("_", " "), str(count)) for name, count in result.verdicts.items())
        blocks.append(Table(("verdict of the diagnosis", "logs"), rows))
    if result.lost:
        blocks.append(_lost_table(result.lost, "Logs without an answer"))
    return Section("Fleet", tuple(blocks))


@present.register
def _(result: FleetReport) -> Section:
    first, *rest = sections(result)
    return Section("Fleet", (*first.blocks, *rest))


def sections(report: FleetReport) -> tuple[Section, ...]:
    """Return the report as the sections of a page; the first one holds the verdict, the notices and all axes.

    Parameters
    ----------
    report : FleetReport

    Returns
    -------
    tuple of Section
    """
    verdict = verdict_of(report)
    axes = Section("Axes", (verdict, *report.notices, _axes_table(report)))
    found = (_missing(report), _changed(report), _unlike(report), _temperature(report), _unexplained(report),
             _worthless(report))  # fmt: skip
    return (axes, *(one for one in found if one is not None))


def verdict_of(report: FleetReport) -> str:
    """Return the answer in one sentence.

    Parameters
    ----------
    report : FleetReport
    """
    consistent = sum(one.consistent for one in report.axes)
    tested = sum(any(len(s.value) >= FEWEST_RECORDS for s in one.series.values()) for one in report.axes)
    changing = f"{len(report.changing)} change over time"
    if not tested:
        changing = f"none has the {FEWEST_RECORDS} records that a test for changes over time takes"
    elif tested < len(report.axes):
        changing += f" of the {tested} with the {FEWEST_RECORDS} records that the test takes"
    return (
        f"{counted(len(report.axes), 'axis', 'axes')}: {counted(len(report.missing), 'lacks', 'lack')} an effect, "
        f"{counted(consistent, 'is', 'are')} consistent with the "
        f"effects of their design, {changing}; at most {percent(FALSE_DISCOVERIES, 0)} of the named axes are expected "
        "to be false."
    )


def _word(axis: AxisAnswer) -> str:
    if axis.missing:
        return "effects missing"
    if axis.consistent:
        return "consistent"
    return "no answer" if not axis.answered else "not decided"


def _axes_table(report: FleetReport) -> Table:
    typed = any(one.type for one in report.axes)
    changed: dict[str, list[Change]] = {}
    for change in report.changes:
        changed.setdefault(change.axis, []).append(change)
    marks = {(c.axis, c.parameter): _day(c.when) for c in report.changes if c.when is not None}
    header = ("axis", *(("type",) if typed else ()), "records", "verdict", "missing effects", "q", "changes")
    rows = tuple(
        (
            one.name, *((one.type,) if typed else ()), str(one.records), _word(one),
            ", ".join(found.effect for found in one.findings), probability(one.q_value) if one.missing else "",
            "; ".join(_briefly(change) for change in changed.get(one.name, ())),
        )
        for one in report.axes
    )  # fmt: skip
    curves = {
        f"{name} [{unit}]": tuple(_spark(one, name, marks.get((one.name, name), np.nan)) for one in report.axes)
        for name in DRAWN
        if (unit := next((one.series[name].unit for one in report.axes if name in one.series), None)) is not None
    }
    return Table(header, rows, "All axes", curves=curves, sortable=True)


def _spark(axis: AxisAnswer, name: str, mark: float) -> Sparkline | None:
    series = axis.series.get(name)
    if series is None:
        return None
    return Sparkline(series.days, series.value, 1.96 * series.stderr, _in_words(series), mark)


def _in_words(series: Series) -> str:
    first, last = (with_error(series.value[k], series.stderr[k]) for k in (0, -1))
    return f"{series.name} over {len(series.value)} records: first {first}, last {last} {series.unit}"


def _briefly(change: Change) -> str:
    if change.step is not None and change.when is not None:
        beside = f", with {', '.join(change.beside)}" if change.beside else ""
        return f"{change.parameter} {_sign(change.step.size)} on {change.when:%Y-%m-%d}{beside}"
    assert change.trend is not None
    return f"{change.parameter} {_sign(7.0 * change.trend.slope)} a week"


def _sign(value: float) -> str:
    return f"{value:+.2g}"


def _missing(report: FleetReport) -> Section | None:
    if not report.missing:
        return None
    rows = tuple(
        (
            one.name, found.effect, ", ".join(found.equivalents), f"{found.records} of {found.of}", _since(found),
            probability(found.p_value), probability(one.q_value),
        )
        for one in report.missing for found in one.findings
    )  # fmt: skip
    said = (
        f"{len(report.missing)} of {counted(len(report.axes), 'axis', 'axes')} "
        f"{'lacks' if len(report.missing) == 1 else 'lack'} an effect. An effect has to show in two records, where "
        "an axis has as many. p allows for all candidates and records of an axis, q for all axes (Benjamini and "
        "Hochberg)."
    )
    header = ("axis", "missing effect", "not distinguishable from", "records", "since", "p", "q")
    return Section("Missing effects", (said, Table(header, rows, "Missing effects", sortable=True)))


def _since(found: Finding) -> str:
    if found.before is None:
        return "the first record"
    return f"{found.since:%Y-%m-%d} (not on {found.before:%Y-%m-%d})"


def _changed(report: FleetReport) -> Section | None:
    if not report.judged:
        return None
    said = (
        f"{len(report.changes)} of {report.judged} parameters change over time, allowing for their number. Friction "
        "scatters between records by more than the error of each, which every interval includes."
    )
    if any(one.beside for one in report.changes):
        said += (
            " A step that appears with a missing effect of the same axis is counted as that effect: the parameter "
            "takes a part of it."
        )
    steps = tuple(_step_row(one) for one in report.changes if one.step is not None)
    trends = tuple(_trend_row(one) for one in report.changes if one.trend is not None)
    blocks: list[Block] = [said]
    header: tuple[str, ...]
    if steps:
        header = ("axis", "parameter", "change", "unit", "date", "between (95 %)", "q", "appears with")
        blocks.append(Table(header, steps, "Steps", sortable=True))
    if trends:
        header = ("axis", "parameter", "a week", "unit", "share a week", "limit", "reached in [days]", "q")
        blocks.append(Table(header, trends, "Trends", sortable=True))
    return Section("Changes over time", tuple(blocks))


def _step_row(change: Change) -> tuple[str, ...]:
    assert change.step is not None
    between = f"{_date(change.earliest)} and {_date(change.latest)}"
    return (change.axis, change.parameter, with_error(change.step.size, change.step.stderr), change.unit,
            _date(change.when), between, probability(change.q_value), ", ".join(change.beside))  # fmt: skip


def _trend_row(change: Change) -> tuple[str, ...]:
    trend = change.trend
    assert trend is not None
    reached = "" if not np.isfinite(change.reached) else with_error(change.reached, change.reached_stderr)
    return (change.axis, change.parameter, with_error(7.0 * trend.slope, 7.0 * trend.stderr), change.unit,
            percent(7.0 * trend.slope / trend.level, 1) if trend.level else "",
            "" if np.isnan(change.limit) else number(change.limit), reached, probability(change.q_value))  # fmt: skip


def _date(when: datetime | None) -> str:
    return "" if when is None else f"{when:%Y-%m-%d}"


def _day(when: datetime) -> float:
    return when.timestamp() / 86400.0


def _unlike(report: FleetReport) -> Section | None:
    if not report.unlike:
        return None
    rows = tuple(
        (one.axis, one.parameter, number(one.value), number(one.median), one.unit, f"{one.score:+.1f}")
        for one in report.unlike[:50]
    )
    said = f"Parameters farther than {OUTLYING:g} robust standard deviations from the median of the axes of their type."
    header = ("axis", "parameter", "median of its records", "of its type", "unit", "distance")
    return Section("Axes unlike the others", (said, Table(header, rows, "Axes unlike the others", sortable=True)))


def _temperature(report: FleetReport) -> Section | None:
    rows = tuple(
        (one.name, with_error(one.per_degree.slope, one.per_degree.stderr), probability(one.per_degree.p_value))
        for one in report.axes if one.per_degree is not None
    )  # fmt: skip
    if not rows:
        return None
    header = ("axis", f"F_c per degree [{_unit(report.axes)}/K]", "p")
    said = "F_c over the mean temperature of each record, a straight line; p of a slope of zero, for one axis."
    return Section("Temperature and friction", (said, Table(header, rows, "Temperature and friction", sortable=True)))


def _unit(axes: Iterable[AxisAnswer]) -> str:
    return next((one.series["F_c"].unit for one in axes if "F_c" in one.series), "")


def _unexplained(report: FleetReport) -> Section | None:
    if not report.unexplained:
        return None
    count = len(report.unexplained)
    said = (
        f"{count} {'log has a residual' if count == 1 else 'logs have a residual'} that no effect of the catalogue "
        "explains. `pmsm-ctrl diagnose LOG --design DESIGN` shows what it depends on."
    )
    return Section("Unexplained logs", (said, _lost_table(report.unexplained, "Unexplained logs")))


def _worthless(report: FleetReport) -> Section | None:
    if not report.worthless:
        return None
    said = f"{len(report.worthless)} logs give no answer."
    return Section("Logs without an answer", (said, _lost_table(report.worthless, "Logs without an answer")))


def linked(section: Section, links: Mapping[str, str]) -> Section:
    """Return a section whose tables of axes link each axis.

    Parameters
    ----------
    section : Section
    links : dict of str to str
        Address by axis.

    Returns
    -------
    Section
    """

    def of(block: Block) -> Block:
        if isinstance(block, Section):
            return linked(block, links)
        return replace(block, links=links) if isinstance(block, Table) and block.header[0] == "axis" else block

    return replace(section, blocks=tuple(of(block) for block in section.blocks))


def axis_verdict(axis: AxisAnswer) -> str:
    """Return the answer for one axis in one sentence.

    Parameters
    ----------
    axis : AxisAnswer
    """
    lacks = ", ".join(one.effect for one in axis.findings)
    return f"{axis.name}: {_word(axis)}{f' ({lacks})' if lacks else ''}; {axis.answered} of {axis.records} logs answer."


def axis_sections(report: FleetReport, axis: AxisAnswer, records: tuple[AxisRecord, ...]) -> tuple[Section, ...]:
    """Return the report of one axis as the sections of a page, from the stored results alone.

    Parameters
    ----------
    report : FleetReport
    axis : AxisAnswer
        One of the report.
    records : tuple of AxisRecord
        Of this axis.

    Returns
    -------
    tuple of Section
    """
    own = replace(
        report, axes=tuple(one for one in report.axes if one.name == axis.name),
        changes=tuple(one for one in report.changes if one.axis == axis.name),
        unlike=tuple(one for one in report.unlike if one.axis == axis.name), worthless=(), unexplained=(), notices=(),
    )  # fmt: skip
    changed = _changed(own) if own.changes else None
    told = (f"{report.judged} parameters of all axes were judged together.", *(changed.blocks[1:] if changed else ()))
    found = (
        _over_time(axis, own.changes), _axis_missing(own),
        None if changed is None else replace(changed, blocks=told), _unlike(own), _temperature(own), _records(records),
        _remarks(records),
    )  # fmt: skip
    return tuple(one for one in found if one is not None)


def _axis_missing(report: FleetReport) -> Section | None:
    """Return the missing effects without the sentence that counts the axes."""
    found = _missing(report)
    return None if found is None else replace(found, blocks=found.blocks[1:])


def _over_time(axis: AxisAnswer, changes: Iterable[Change]) -> Section | None:
    if not axis.series:
        return None
    marks = {one.parameter: _day(one.when) for one in changes if one.when is not None}
    drawn = tuple(axis.series[name] for name in DRAWN if name in axis.series)
    others = [one for name, one in sorted(axis.series.items()) if name not in DRAWN]

    def draw() -> Figure:
        from pmsm_ctrl.fleet.figures import series_figure

        return series_figure(drawn, marks)

    blocks: list[Block] = []
    if drawn:
        blocks.append(Picture(draw, "Friction of each record with its 95 % interval."))
    rows = tuple(
        (one.name, str(len(one.value)), number(float(np.median(one.value))),
         "" if np.isnan(one.nominal) else number(one.nominal), one.unit)
        for one in (*drawn, *others)
    )  # fmt: skip
    curves = tuple(
        Sparkline(one.days, one.value, 1.96 * one.stderr, _in_words(one), marks.get(one.name, np.nan))
        for one in (*drawn, *others)
    )
    header = ("parameter", "records", "median", "design", "unit")
    blocks.append(Table(header, rows, "Parameters over time", curves={"over time": curves}, sortable=True))
    return Section("Parameters over time", tuple(blocks))


def _records(records: tuple[AxisRecord, ...]) -> Section:
    def value(one: AxisRecord, name: str) -> str:
        row = one.parameters.get(name)
        return "" if row is None or row.value is None else with_error(row.value, row.stderr or float("nan"))

    units = {name: row.unit for one in records for name, row in one.parameters.items() if name in DRAWN}
    header = ("time [UTC]", "log", "verdict", "effects", *(f"{name} [{unit}]" for name, unit in units.items()),
              "torque error", "deviations", "because")  # fmt: skip
    rows = tuple(
        (
            f"{one.time:%Y-%m-%d %H:%M}", _short(one.record), one.verdict.replace("_", " "),
            ", ".join(row.name for row in one.effects), *(value(one, name) for name in units),
            "" if one.error is None else percent(one.error), ", ".join(row.name for row in one.deviations),
            one.reason.removeprefix(f"{one.record}: "),
        )
        for one in records
    )  # fmt: skip
    said = "Each log by itself, as stored. pmsm-ctrl study DESIGN --log LOG evaluates one of them in full."
    return Section("Logs", (said, Table(header, rows, "Logs", sortable=True)))


def _remarks(records: tuple[AxisRecord, ...]) -> Section | None:
    """Return the doubts of all logs, each once, with how many logs raise it."""
    said: dict[str, list[str]] = {}
    for one in records:
        for code, text in {row.name: row.text for row in one.doubts}.items():
            said.setdefault(code, []).append(text)
    if not said:
        return None
    rows = tuple((code, f"{len(texts)} of {len(records)}", texts[-1]) for code, texts in sorted(said.items()))
    return Section("Doubts", (Table(("code", "logs", "latest message"), rows, "Doubts", sortable=True),))


def _lost_table(lost: Iterable[Lost], caption: str) -> Table:
    rows = tuple((one.axis, _short(one.record), one.reason.removeprefix(f"{one.record}: ")) for one in lost)
    return Table(("axis", "log", "reason"), rows, caption)


def _short(record: str) -> str:
    """Return the last two parts of a path."""
    return "/".join(record.replace("\\", "/").split("/")[-2:])

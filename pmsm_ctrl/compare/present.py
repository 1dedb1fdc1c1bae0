"""What a comparison has to say, from the result alone."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from pmsm_ctrl.compare.comparison import ChannelError, Comparison, Record
from pmsm_ctrl.compare.notices import OBJECTIONS, STRUCTURE, largest_words, motion_words, structure_words
from pmsm_ctrl.regression.notices import sampling_text
from pmsm_ctrl.regression.present import records_table, torque_error_name
from pmsm_ctrl.rendering.numbers import fit, number, percent, probability, with_prefix
from pmsm_ctrl.result import Verdict
from pmsm_ctrl.section import Picture, Section, Table, present
from pmsm_ctrl.units import axis_unit, drives

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__: list[str] = []


@present.register
def _(result: Comparison) -> Section:
    log, motion = result.log, result.design.motion
    names = {"torque": drives(motion)}
    found = [f"{names.get(name, name)}: {structure_words(s)}." for name, s in log.structure.items()]
    records = [("log", log), *_held_out(result)]
    several = len(log.rows) > 1 or len(result.holdouts) > 1
    table = replace(records_table(result.records, names["torque"], "as predicted"), whole=True)
    by_record = (table,) if several else ()
    return Section(
        f"Comparison of {result.design.name} with {Path(log.name).name}",
        (
            _verdict(result, _capital(found[0])),
            *(notice for notice in result.notices if notice not in result.reasons[:1]),
            *(_capital(sentence) for sentence in found[1:]),
            *filter(None, (_sampled(log, names["torque"]),)),
            *_drift(records, names["torque"]),
            _errors(records, names),
            *by_record,
            *_meanings(records),
            *_whole(records, motion),
            _dependences(result, names["torque"]),
            _stretches(log, axis_unit("rad/s", motion)),
            *_pictures(result),
        ),
        essential=by_record,
    )


def _sampled(log: Record, drive: str) -> str | None:
    """Return how the drive signal was sampled; a doubt where most of the residual's mean square is no noise."""
    return sampling_text(log.timing, drive, log.timing_stderr, log.ratios.get("torque", 1.0) ** 2 > 2.0)


def _drift(records: Iterable[tuple[str, Record]], drive: str) -> Iterator[str]:
    """Yield what the error of a free run over the whole record says, and what it does not say."""
    if any(run.method == "free run" for _, record in records for run in record.simulated):
        yield (
            f"The free run has nothing that holds it to the measured motion: small errors of the {drive} add up, and a "
            "right model drifts away as well, one with friction that falls with speed all the sooner, because alone "
            f"such an axis is unstable. Judge the model by the {drive} error."
        )


def _whole(records: Iterable[tuple[str, Record]], motion: str) -> Iterator[str]:
    """Yield the free run over each whole record in one sentence."""
    for label, run in ((label, run) for label, record in records for run in record.simulated):
        if math.isfinite(run.fit):
            position, speed = (run.errors[name] for name in ("theta", "omega"))
            whole = f"Free run of {run.record or f'the {label}'} over its whole length: "
            yield (
                f"{whole}it drifts away."
                if run.fit < 0.0
                else (
                    f"{whole}"
                    f"position {with_prefix(position.rms, position.unit)} rms (fit: {fit(run.fit)}), speed "
                    f"{with_prefix(speed.rms, speed.unit)} rms (fit: {fit(1.0 - speed.relative)})."
                )
            )


_VERDICTS = {
    Verdict.IMPLAUSIBLE: "Implausible, log and design do not belong together: {reason}.",
    Verdict.INCONCLUSIVE: "Inconclusive: {reason}. {structure}",
}


def _verdict(result: Comparison, structure: str) -> str:
    """The verdict in one sentence; what the residual depends on, where that is it."""
    if result.verdict not in _VERDICTS:
        said = [_capital(one.text) + "." for one in result.reasons[:1] if one.code != STRUCTURE.code]
        curves = not said or any(one.code == STRUCTURE.code for one in result.reasons)
        return " ".join([*said, structure] if curves else said)
    return _VERDICTS[result.verdict].format(reason=result.reasons[0].text, structure=structure)


_HEADER = ("channel", "method", "rms", "noise floor", "unit", "relative", "worst", "mean")


def _errors(records: Iterable[tuple[str, Record]], names: dict[str, str]) -> Table:
    """Every channel by every method; which record, where there is more than one."""
    rows = [row for label, record in records for row in _error_rows(label, record, names)]
    rows.sort(key=lambda row: row[2] != "prediction")  # what a brief table leaves out are simulations
    error = torque_error_name(names["torque"])
    title = f"Errors, measured less predicted; the relative one of the {names['torque']} by prediction is the {error}"
    if len({label for label, *_ in rows}) > 1:
        return Table(("record", *_HEADER), tuple(rows), title)
    return Table(_HEADER, tuple(row[1:] for row in rows), title)


def _meanings(records: Iterable[tuple[str, Record]]) -> Iterator[str]:
    """Yield what each simulation was given, in one sentence."""
    meanings = {run.method: run.meaning for _, record in records for run in record.simulated}
    if meanings:
        yield "Simulated from: " + "; ".join(f"{meaning} ({method})" for method, meaning in meanings.items()) + "."


def _held_out(result: Comparison) -> list[tuple[str, Record]]:
    """The held-out records, by name where there are several."""
    if len(result.holdouts) < 2:
        return [("holdout", other) for other in result.holdouts]
    return [(f"holdout {other.name}", other) for other in result.holdouts]


def _capital(text: str) -> str:
    return text[0].upper() + text[1:] if text[:2] != "u_" else text


def _error_rows(label: str, record: Record, names: dict[str, str]) -> Iterator[tuple[str, ...]]:
    methods = [("", "prediction", record.errors)]
    methods += [(run.record, run.method, run.errors) for run in record.simulated]
    for part, method, errors in methods:
        drifting = any(e.relative > 1.0 for e in errors.values())  # a figure would say how long it has run
        for name, e in errors.items():
            cells = ("drifts away", "", e.unit, *[""] * 3) if drifting and method == "free run" else _error_cells(e)
            yield part or label, names.get(name, name), method, *cells


def _error_cells(e: ChannelError) -> tuple[str, ...]:
    return number(e.rms), number(e.floor, 3), e.unit, percent(e.relative), number(e.worst, 3), f"{e.mean:+.2g}"


def _dependences(result: Comparison, quantity: str) -> Table:
    rows = []
    for d in result.log.structure["torque"].dependences:
        name = f"position, order {', '.join(map(str, d.orders))}" if d.orders and d.significant else d.coordinate
        place = f"largest {largest_words(d)}" if d.objection is None else OBJECTIONS[d.objection]
        beyond = percent(d.added, 0) if d.rank else "-"
        rows.append((name, percent(d.share, 0), beyond, probability(d.p_value), place))
    header = ("coordinate", "share alone", "share added", "p (Holm)", "where, or why it is not counted")
    return Table(header, tuple(rows), f"Dependence of the {quantity} residual, by cross-validation")


def _stretches(log: Record, speed_unit: str) -> Table | str:
    if not log.stretches:
        return "No stretch of time is worse than the rest."
    rows = tuple(
        (f"{s.start:.4g} to {s.stop:.4g}", motion_words(s.motion, speed_unit), number(s.rms, 3)) for s in log.stretches
    )
    unit = log.errors["torque"].unit
    return Table(("time [s]", "motion", f"rms [{unit}]"), rows, "Worst stretches of time")


def _drawn(name: str, record: Record) -> Figure:
    from pmsm_ctrl.compare import figures

    draw: Callable[[Record], Figure] = getattr(figures, name)
    return draw(record)


def _pictures(result: Comparison) -> Iterator[Picture]:
    log = result.log

    yield Picture(
        lambda: _drawn("traces_figure", log),
        "A residual with a pattern is a missing effect"
        + ("; the worst stretches are shaded." if log.stretches else "."),
    )
    yield Picture(
        lambda: _drawn("structure_figure", log),
        "The residual over every coordinate. Where a curve stays at zero the model is right; shares "
        "are shares of the mean square of the residual, by cross-validation.",
    )
    if log.stretches:
        yield Picture(lambda: _drawn("stretches_figure", log), "The worst stretches, with the speed below.")
    for label, other in _held_out(result):
        yield Picture(partial(_drawn, "traces_figure", other), f"The same parameters on the {label} record.")

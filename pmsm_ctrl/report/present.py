"""A study, its history and the entries of the catalogue, in words and pictures."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from pmsm_ctrl.diagnose import Diagnosis, verdict_text
from pmsm_ctrl.effects import Effect
from pmsm_ctrl.rendering.numbers import with_error
from pmsm_ctrl.report.history import Entry
from pmsm_ctrl.report.result import CatalogueEntry, Study
from pmsm_ctrl.result import Estimate
from pmsm_ctrl.section import Block, Picture, Section, Table, present
from pmsm_ctrl.units import axis_unit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["catalogue_section", "history_section", "parts"]

NOTABLE = 3.0  # standard errors between neighbours from which a change is pointed out
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00")

# Context of a part that its own section cannot know.
INTRODUCTIONS = {
    "compare": "The model is the design with the identified inertia and friction; nothing else was fitted."
}
OF_THE_DRIVE = ("compensate", "track", "export")  # what a complete study does with one design
# The subject of the headline comes first, the loops last.
MEASURED_ORDER = ("diagnose", "compare", "identify", "tune")
SIMULATED_ORDER = ("sweep", "paper", "identify", "compare", "tune")
NOT_COMPLETE = "Left out: compensate, track and export; --complete runs them as well."
# LaTeX commands of the equations as plain text.
SPOKEN = {
    r"\mathrm{sgn}": "sgn", r"\mathrm{dz}": "dz", r"\omega": "ω", r"\theta": "θ", r"\varphi": "φ", r"\delta": "δ",
    r"\tau": "τ", r"\mu": "μ", r"\Delta": "Δ", r"\zeta": "ζ", r"\alpha": "α", r"\beta": "β", r"\sin": " sin ",
    r"\cos": " cos ", r"\quad": "  ", r"\to": "->", r"\frac{dθ}{z_s}": "dθ/z_s", r"\sqrt": "sqrt", r"\,": " ",
}  # fmt: skip


def parts(study: Study) -> tuple[Section, ...]:
    """Return the sections of a study's results in reading order, and its history.

    Parameters
    ----------
    study : Study

    Returns
    -------
    tuple of Section
    """
    order = MEASURED_ORDER if "diagnose" in study.results else SIMULATED_ORDER
    shown = []
    for verb in (*(v for v in order if v in study.results), *(v for v in study.results if v not in order)):
        # what is doubtful in the logs stands once, before all parts
        section = study.results[verb].section().without(study.doubts_of_input)
        said = _whose_design(study) if verb in OF_THE_DRIVE else INTRODUCTIONS.get(verb, "")
        introduction = (said,) if said else ()
        first = 1 if isinstance(section.blocks[0], str) else 0  # the verdict, by which a page folds the section
        shown.append(replace(section, blocks=(*section.blocks[:first], *introduction, *section.blocks[first:])))
    return (*shown, history_section(study.history)) if study.history else tuple(shown)


def _whose_design(study: Study) -> str:
    """Say which design is compensated, tracked and exported."""
    effects = ", ".join(dict.fromkeys(entry.id for entry in study.completed.effects)) or "no effects"
    found = study.results.get("diagnose")
    if study.diagnosed is not None:
        return f"The design is the one that the diagnosis completed: {effects}."
    whose = f"The design is the given one with what identify found: {effects}"
    if not isinstance(found, Diagnosis):
        return f"{whose}."
    why = f"its verdict is {verdict_text(found)}" if found.improved else "the given design leaves less of the torque"
    return f"{whose}. That of the diagnosis is not taken: {why}."


@present.register
def _(study: Study) -> Section:
    headline = study.headline
    numbers = Table(("value", "what it is"), headline.numbers)
    blocks: tuple[Block, ...] = (headline.done, headline.verdict, *study.doubts_of_input, numbers, *parts(study))
    where = f"report: {study.path}"
    last = (where,) if study.complete else (NOT_COMPLETE, where)
    return Section(f"Study of {study.design.name}", (*blocks, *last), essential=last)


@present.register
def _(entry: CatalogueEntry) -> Section:
    effect = entry.effect
    facts = (
        ("id", effect.id), ("enters", effect.enters), ("term", _spoken(effect.equation)),
        ("required excitation", effect.needs), ("validated on", effect.validated), ("source", effect.source),
    )  # fmt: skip
    parameters = tuple(
        (
            p.symbol,
            axis_unit(p.unit, entry.motion),
            f"{p.lower:g}",
            f"{p.upper:g}",
            p.description,
            "column" if p.linear else "searched",
        )
        for p in effect.parameters
    )
    alike = Table(("effect", "why"), tuple(effect.look_alikes.items()), "Effects it can be confused with")
    linear = entry.motion == "linear"
    caption = f"What the effect adds, over speed (left) and over {'the position' if linear else 'one turn'} (right)."
    return Section(
        effect.title,
        (
            *entry.notices,
            Table(("property", "value"), facts, "The effect"),
            Table(("symbol", "unit", "from", "to", "what it is", "in the regression"), parameters, "Its parameters"),
            *((alike,) if alike.rows else ()),
            *(() if entry.residual is None else (Picture(lambda: _signature(entry), caption),)),
        ),
    )


def _signature(entry: CatalogueEntry) -> Figure:
    """Draw what the effect adds over speed and over one turn, or over the position."""
    from matplotlib.figure import Figure

    assert entry.residual is not None
    assert entry.omega is not None
    assert entry.theta is not None
    figure = Figure(figsize=(9, 3.4), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    linear = entry.motion == "linear"
    place = (entry.theta, "position [m]") if linear else (np.mod(entry.theta, 2 * np.pi), "angle [rad]")
    over = ((entry.omega, f"speed [{'m/s' if linear else 'rad/s'}]", "#0072B2"), (*place, "#D55E00"))
    for axes, (values, label, colour) in zip(panels, over, strict=True):
        axes.plot(values, entry.residual, ".", markersize=1.5, alpha=0.5, color=colour, rasterized=True)
        axes.set_xlabel(label)
        axes.grid(alpha=0.3)
    panels[0].set_ylabel(f"added {entry.channel} [{entry.unit}]")
    figure.suptitle(f"{entry.effect.title}: added {entry.channel}", fontsize=10)
    return figure


def catalogue_section(effects: Iterable[Effect]) -> Section:
    """Return the catalogue as two tables: id, where it enters, term and parameters; and the excitation each one needs.

    Parameters
    ----------
    effects : iterable of Effect

    Returns
    -------
    Section
    """
    rows = tuple(
        (e.id, e.enters, _spoken(e.equation), ", ".join(f"{p.symbol} [{p.unit}]" for p in e.parameters))
        for e in effects
    )
    terms = Table(("id", "enters", "term", "parameters"), rows)
    needs = Table(("id", "required excitation"), tuple((e.id, e.needs) for e in effects))
    return Section("Effects (friction positive for positive speed)", (terms, needs))


def _spoken(equation: str) -> str:
    """Return a LaTeX equation as plain text."""
    for word, sign in SPOKEN.items():
        equation = equation.replace(word, sign)
    return " ".join(equation.replace("{", "").replace("}", "").replace("\\", "").split())


def history_section(entries: Sequence[Entry]) -> Section:
    """Return what was identified over time: significant changes, a row an entry, and a picture.

    Parameters
    ----------
    entries : sequence of Entry
        Oldest first, at least one.

    Returns
    -------
    Section
    """
    symbols = _symbols(entries)
    units = {symbol: e.parameters[symbol].unit for symbol in symbols for e in entries if symbol in e.parameters}
    header = ("log", "version", *(f"{symbol} [{units[symbol]}]" for symbol in symbols), "relative error")
    rows = tuple(
        (e.log, e.key[2], *(_cell(e.parameters.get(symbol)) for symbol in symbols), f"{100.0 * e.error:.2f} %")
        for e in entries
    )
    changes = _changes(entries, symbols)
    if len(entries) == 1:
        return Section("Parameters over time", ("This is the first entry.", Table(header, rows)))
    said = changes or ("No parameter has changed significantly.",)
    caption = "Bars are two standard errors. A step beyond the bars is a change."
    return Section("Parameters over time", (*said, Table(header, rows), Picture(lambda: _curves(entries), caption)))


def _symbols(entries: Sequence[Entry]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(symbol for entry in entries for symbol in entry.parameters))


def _cell(found: Estimate | None) -> str:
    return "-" if found is None else with_error(found.value, found.stderr)


def _changes(entries: Sequence[Entry], symbols: Sequence[str]) -> tuple[str, ...]:
    """Name the changes between neighbours that their standard errors do not explain."""
    found = []
    for before, after in pairwise(entries):
        for symbol in symbols:
            if symbol not in before.parameters or symbol not in after.parameters:
                continue
            a, b = before.parameters[symbol], after.parameters[symbol]
            spread = math.hypot(a.stderr, b.stderr)
            if spread > 0.0 and abs(b.value - a.value) > NOTABLE * spread:
                share = f"{100.0 * (b.value / a.value - 1.0):+.1f} %, " if a.value else ""
                found.append(
                    f"{symbol} changed from {a.value:.4g} ({before.log}) to {b.value:.4g} {b.unit} ({after.log}): "
                    f"{share}{abs(b.value - a.value) / spread:.1f} standard errors."
                )
    return tuple(found)


def _curves(entries: Sequence[Entry]) -> Figure:
    """Draw each parameter over the records, one panel each."""
    from matplotlib.figure import Figure

    symbols = _symbols(entries)
    figure = Figure(figsize=(7.6, 1.0 + 1.3 * len(symbols)), layout="constrained")
    panels = figure.subplots(len(symbols), 1, sharex=True, squeeze=False)[:, 0]
    for axes, symbol, colour in zip(panels, symbols, COLOURS * len(symbols), strict=False):
        places = [k for k, entry in enumerate(entries) if symbol in entry.parameters]
        shown = [entries[k].parameters[symbol] for k in places]
        bars = [2.0 * e.stderr if math.isfinite(e.stderr) else 0.0 for e in shown]
        axes.errorbar(places, [e.value for e in shown], bars, fmt="o-", color=colour, capsize=4)
        axes.set_ylabel(f"{symbol} [{shown[0].unit}]")
        axes.grid(alpha=0.3)
    panels[-1].set_xticks(
        range(len(entries)), [entry.log for entry in entries], rotation=20, ha="right", parse_math=False
    )
    panels[-1].set_xlabel("record, in the order of the studies")
    return figure

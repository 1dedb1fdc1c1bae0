"""The diagnosis in words: terminal summary and report section."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from pmsm_ctrl.result import Section

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from pmsm_ctrl.diagnose.diagnosis import Diagnosis, DiagnosisStep, Errors, Ranked

__all__ = ["ladder_rows", "report_section", "step_names", "summary_text"]

Table = tuple[tuple[str, ...], tuple[tuple[str, ...], ...]]

VERDICTS = {
    "consistent": "the design explains this log; no effect is missing",
    "effects_missing": "effects are missing",
    "unexplained": "something is left that no effect of the catalogue explains",
    "not_excited": "this log cannot tell",
}


def _percent(errors: Errors) -> str:
    return ", ".join(f"{name} {100 * e['relative']:.2f} %" for name, e in errors.items() if e["relative"] is not None)


def step_names(d: Diagnosis) -> list[str]:
    """Names of the accepted effects, an order told where an effect has one."""
    names = []
    for step in d.steps:
        order = step.parameters.get("order")
        names.append(f"{step.effect} {order.value:g}" if order is not None else step.effect)
    return names


def ladder_rows(d: Diagnosis) -> list[tuple[str, str, str]]:
    """Rows of the ladder: rung, error on the log, error on the held-out record."""
    rows = [("design as given", _percent(d.errors["nominal"]), "")]
    rows.append(
        ("parameters refitted", _percent(d.errors["base"]), _percent(d.steps[0].holdout_before) if d.steps else "")
    )
    for name, step in zip(step_names(d), d.steps, strict=True):
        rows.append((f"+ {name}", _percent(step.error_after), _percent(step.holdout_after)))
    rows.append(("noise floor", _percent(d.errors["noise_floor"]), ""))
    return rows


def _numbers(step: DiagnosisStep, sign: str) -> str:
    """Parameters with their errors and units; what has no unit has none to be said."""
    return ", ".join(
        f"{symbol} = {e.value:.4g}"
        + (f" {sign} {e.stderr:.2g}" if e.stderr == e.stderr else "")
        + (f" {e.unit}" if e.unit != "1" else "")
        for symbol, e in step.parameters.items()
    )


def _amounts(row: Ranked) -> str:
    """From which amounts on the log would show an effect, in words."""
    if any(math.isinf(e.value) for e in row.shown_from.values()):
        return "no amount inside its bounds"
    return ", ".join(
        f"{symbol} {e.value:.2g}" + (f" {e.unit}" if e.unit != "1" else "") for symbol, e in row.shown_from.items()
    )


def _step_text(d: Diagnosis) -> list[str]:
    lines = []
    for step in d.steps:
        lines.append(f"  + {step.effect}: {_numbers(step, '+-')}")
        if step.evidence["blocks"]:
            lines.append(
                f"      p = {step.evidence['p_holm']:.2g} after Holm; left-out blocks gain "
                f"{step.evidence['block_gain']:.3g} +- {step.evidence['block_stderr']:.2g}"
            )
        if step.equivalents:
            lines.append(f"      this log cannot tell it from: {', '.join(step.equivalents)}")
    return lines


def summary_text(d: Diagnosis) -> str:
    """Return verdict, warnings, steps, ladder and ranking as text."""
    lines = [f"diagnosis of {d.design.name} from {d.log_name}: {d.verdict} ({VERDICTS[d.verdict]})"]
    lines += [f"  warning: {text}" for text in d.warnings]
    lines += _step_text(d)
    lines.append("  relative error, each balance:")
    width = max(len(row[0]) for row in ladder_rows(d))
    for name, own, other in ladder_rows(d):
        lines.append(f"    {name:<{width}}  {own}" + (f"   held out: {other}" if other else ""))
    lines.append("  what was considered and not taken:")
    for row in d.ranking:
        if not row.accepted:
            seen = f"; this log would show it from {_amounts(row)}" if row.shown_from else ""
            lines.append(
                f"    {row.effect:<28} {100 * row.explained:5.1f} %  p {row.p_value:8.2g}  {row.why_not}{seen}"
            )
    for dev in d.parameter_deviations:
        mark = "  <-- " + dev.note if dev.flagged else ""
        lines.append(
            f"  {dev.parameter:<8} {dev.estimate:.5g} +- {dev.stderr:.2g} {dev.unit} (design {dev.nominal:.5g}){mark}"
        )
    if d.calibration is not None:
        lines.append(f"  calibration: {d.calibration.sentence()}")
    if d.next_experiment:
        lines.append(f"  next experiment: {d.next_experiment['profile']}: {d.next_experiment['why']}")
    return "\n".join(lines)


def report_section(d: Diagnosis) -> Section:
    """Return the section of the report: what was found, the ladder, maps, worst stretch and contributions."""
    from pathlib import Path

    tried = [r for r in d.ranking if r.accepted or r.shown_from or r.p_value < 1.0]
    names = iter(step_names(d))  # the accepted ones come first, in the order of the steps
    ranking = tuple(
        (
            next(names, r.effect) if r.accepted else r.effect,
            f"{100 * r.explained:.1f} %",
            f"{r.p_value:.2g}",
            "accepted" if r.accepted else r.why_not,
            _amounts(r) if r.shown_from else "-",
        )
        for r in tried
    )
    rest: dict[str, list[str]] = {}
    for r in d.ranking:
        if r not in tried:
            rest.setdefault(r.why_not, []).append(r.effect)
    tables: dict[str, Table] = {}
    if d.steps:
        head: tuple[str, ...] = ("found", "parameters", "p after Holm", "not told from")
        tables["What is missing"] = head, tuple(_found_rows(d))
    head = ("rung", "error on the log", "error on the held-out record")
    tables["How the error falls"] = head, tuple(ladder_rows(d))
    tables["What was tried"] = ("effect", "explains", "p", "taken, or why not", "would show from"), ranking
    if d.parameter_deviations:
        head = ("parameter", "design", "estimate", "unit", "remark")
        tables["The design's own parameters"] = head, tuple(_deviation_rows(d))
    paragraphs = [f"Verdict: {VERDICTS[d.verdict]}.", *(f"Warning: {w}" for w in d.warnings)]
    if d.calibration is not None:
        paragraphs.append(f"Calibration: {d.calibration.sentence()}.")
    if d.next_experiment:
        paragraphs.append(f"Next experiment: {d.next_experiment['profile']}: {d.next_experiment['why']}.")
    if rest:
        parts = "; ".join(f"{', '.join(effects)} ({why})" for why, effects in rest.items())
        paragraphs.append(f"What explains nothing on this log, or cannot be tried on it: {parts}.")
    title = f"Diagnosis from {Path(d.log_name).name}"
    return Section(title, tuple(paragraphs), tuple(tables.values()), tuple(_figures(d)), tuple(tables))


def _found_rows(d: Diagnosis) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = []
    for name, step in zip(step_names(d), d.steps, strict=True):
        numbers = _numbers(step, "±")
        p = step.evidence["p_holm"]
        shown = "< 1e-12" if p < 1e-12 else f"{p:.2g}"
        rows.append((name, numbers, shown, ", ".join(step.equivalents) or "-"))
    return rows


def _deviation_rows(d: Diagnosis) -> list[tuple[str, ...]]:
    return [
        (v.parameter, f"{v.nominal:.5g}", f"{v.estimate:.5g} ± {v.stderr:.2g}", v.unit, v.note if v.flagged else "-")
        for v in d.parameter_deviations
    ]


def _figures(d: Diagnosis) -> list[tuple[Figure, str]]:
    """Every figure with the sentence that says what to see."""
    from pmsm_ctrl.diagnose.figures import (
        contributions_figure,
        leftover_figure,
        maps_figure,
        plane_of,
        rms_within,
        worst_stretch,
        worst_stretch_figure,
    )

    found = ", then ".join(step_names(d)) or "nothing"
    kind = d.record.drive
    before, after, floor = (100 * d.errors[r]["torque"]["relative"] for r in ("base", "final", "noise_floor"))
    fall = f"from {before:.2f} to {after:.2f} % of the {kind}, with a noise floor of {floor:.2f} %"
    ladder = f"Every step down is an effect taken in ({found}): the error falls {fall}."
    if not d.steps:
        ladder = f"No effect was taken in: {after:.2f} % of the {kind} is left, with a noise floor of {floor:.2f} %."
    made = [(d.plot(), ladder)]
    maps = f"Mean residual over speed and {plane_of(d).name}, all in one colour scale; grey: no samples. "
    nothing = "What pattern there is no effect explains." if d.left is not None else "No pattern is left."
    maps += "A pattern is a missing effect; it fades with every effect taken in." if d.steps else nothing
    made.append((maps_figure(d), maps))
    stretch = worst_stretch(d)
    if stretch is not None:
        text = f"The stretch in which the refitted design fails worst ({stretch.doing})."
        if d.steps:
            old, new = (rms_within(fit, stretch) for fit in (d.selection.fits[0], d.selection.fits[-1]))
            unit = d.record.unit("torque")
            text += f" With the effects found the residual there falls from {old:.3g} to {new:.3g} {unit} rms."
        made.append((worst_stretch_figure(d, stretch), text))
    text = (
        "What every part of the final model contributes over speed. Left, means stacked: those above zero less "
        f"those below are the predicted {kind} (line), which has to meet the measured one (dots). Right, the size of "
        "each part, those that average out over a turn included."
    )
    made.append((contributions_figure(d), text))
    if d.left is not None:
        made.append((leftover_figure(d, d.left), f"{d.left.text[0].upper()}{d.left.text[1:]}."))
    return made

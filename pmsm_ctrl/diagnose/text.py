"""The diagnosis in words: terminal summary and report section."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pmsm_ctrl.result import Section

if TYPE_CHECKING:
    from pmsm_ctrl.diagnose.diagnosis import Diagnosis, Errors

__all__ = ["ladder_rows", "report_section", "summary_text"]

VERDICTS = {
    "consistent": "the design explains this log; no effect is missing",
    "effects_missing": "effects are missing",
    "unexplained": "something is left that no effect of the catalogue explains",
    "not_excited": "this log cannot tell",
}


def _percent(errors: Errors) -> str:
    return ", ".join(f"{name} {100 * e['relative']:.2f} %" for name, e in errors.items() if e["relative"] is not None)


def ladder_rows(d: Diagnosis) -> list[tuple[str, str, str]]:
    """Rows of the ladder: rung, error on the log, error on the held-out record."""
    rows = [("design as given", _percent(d.errors["nominal"]), "")]
    rows.append(
        ("parameters refitted", _percent(d.errors["base"]), _percent(d.steps[0].holdout_before) if d.steps else "")
    )
    rows += [(f"+ {step.effect}", _percent(step.error_after), _percent(step.holdout_after)) for step in d.steps]
    rows.append(("noise floor", _percent(d.errors["noise_floor"]), ""))
    return rows


def _step_text(d: Diagnosis) -> list[str]:
    lines = []
    for step in d.steps:
        numbers = ", ".join(
            f"{s} = {e.value:.4g}" + (f" +- {e.stderr:.2g}" if e.stderr == e.stderr else "") + f" {e.unit}"
            for s, e in step.parameters.items()
        )
        lines.append(f"  + {step.effect}: {numbers}")
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
            lines.append(f"    {row.effect:<28} {100 * row.explained:5.1f} %  p {row.p_value:8.2g}  {row.why_not}")
    for dev in d.parameter_deviations:
        mark = "  <-- " + dev.note if dev.flagged else ""
        lines.append(
            f"  {dev.parameter:<8} {dev.estimate:.5g} +- {dev.stderr:.2g} {dev.unit} (design {dev.nominal:.5g}){mark}"
        )
    if d.next_experiment:
        lines.append(f"  next experiment: {d.next_experiment['profile']}: {d.next_experiment['why']}")
    return "\n".join(lines)


def report_section(d: Diagnosis) -> Section:
    """Return the section of the report."""
    ranking = tuple(
        (r.effect, f"{100 * r.explained:.1f} %", f"{r.p_value:.2g}", "accepted" if r.accepted else r.why_not)
        for r in d.ranking
    )
    return Section(
        title=f"Diagnosis from {d.log_name}",
        paragraphs=(f"Verdict: {d.verdict}, {VERDICTS[d.verdict]}.", *(f"Warning: {w}" for w in d.warnings)),
        tables=(
            (("rung", "error on the log", "error on the held-out record"), tuple(ladder_rows(d))),
            (("effect", "explains", "p", "taken, or why not"), ranking),
        ),
        figures=((d.plot(), "The error falls from rung to rung towards the noise floor."),),
    )

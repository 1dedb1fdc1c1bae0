"""What identification, speed sweep and the paper's table have to say, from the results alone."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from pmsm_ctrl.identify.identification import Identification
from pmsm_ctrl.identify.notices import EFFECTIVE_VALUES, OPEN_LOOP
from pmsm_ctrl.identify.paper import PaperRow, PaperTable
from pmsm_ctrl.identify.policy import LARGE_ERROR
from pmsm_ctrl.identify.staircase import SweepResult
from pmsm_ctrl.regression.notices import sampling_text
from pmsm_ctrl.regression.present import records_table, spread_sentence, torque_error_name
from pmsm_ctrl.rendering.numbers import number, percent, with_error
from pmsm_ctrl.result import Estimate
from pmsm_ctrl.section import Block, Picture, Section, Table, present
from pmsm_ctrl.units import drives

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__: list[str] = []

METHODS = {
    "regression": "Inverse-dynamics least squares",
    "iv": "Inverse dynamics by instrumental variables",
    "output_error": "Simulation of the drive with its sampled controller, fitted to the torque",
}


def _lost(result: Identification) -> str:
    """Return which parameters got no number; why stands below."""
    return f" (not {', '.join(result.unidentifiable)})" if result.unidentifiable and result.estimates else ""


@present.register
def _(result: Identification) -> Section:
    quantity = drives(result.design.motion)
    asked = len(result.estimates) + len(result.unidentifiable)
    simulated = any(note.code == OPEN_LOOP.code for note in result.remarks)
    method = "Simulation of the axis, driven by the logged torque" if simulated else METHODS[result.method]
    verdict = (
        f"{method}: {len(result.estimates)} of {asked} parameters identified{_lost(result)}; "
        f"{error_name(result, quantity)} {percent(result.relative_error)}."
    )
    if result.contradictions:
        verdict = f"Implausible, log and design do not belong together: {result.contradictions[0].text}. {verdict}"
    elif result.relative_error > LARGE_ERROR:
        verdict = f"In doubt: {verdict}"
    shown = result.notices[1:] if result.contradictions else result.notices
    blocks: list[Block] = [verdict, *shown, *(f"Note: {note.text}." for note in result.remarks)]
    if result.estimates:
        rows = tuple(
            (name, *_figures(e, result.intervals[name]), "-" if e.nominal is None else number(e.nominal, 5))
            for name, e in result.estimates.items()
        )
        blocks.append(Table((*_HEADER, "design"), rows, "Identified parameters"))
    if result.records:
        blocks.append(records_table(result.records, quantity, "of the design", "identified"))
        if (drift := spread_sentence(result.spreads, quantity)) is not None:
            blocks.append(drift)
    lacking = any(note.code == EFFECTIVE_VALUES.code for note in result.notices)
    if (sampled := sampling_text(result.timing, quantity, result.sampling.stderr, lacking)) is not None:
        blocks.append(sampled)
    lost: tuple[Block, ...] = ()
    if result.unidentifiable:
        reasons = tuple((name, why.text, why.code) for name, why in result.unidentifiable.items())
        lost = (Table(("parameter", "not identifiable, because", "code"), reasons),)
        blocks += lost
    if len(result.over_cutoff) > 1:
        over = tuple((number(hz, 3), with_error(e.value, e.stderr), e.unit) for hz, e in result.over_cutoff.items())
        blocks.append(Table(("cutoff [Hz]", "J", "unit"), over, "Inertia over the cutoff", folded=True))
    if result.bias is not None and result.bias.bias:
        blocks.append(_bias_table(result))
    caption = "The residual below should look like noise; a pattern in it is a missing effect."
    return Section(
        f"Identification of {result.design.name} from {Path(result.log_name).name}",
        (*blocks, Picture(lambda: _drawn("residual_figure", result), caption), _fit_sentence(result, quantity)),
        essential=lost,
    )


def error_name(result: Identification, quantity: str) -> str:
    """Return what the error is called: that of `compare` and `diagnose`, or that of a fit by simulation."""
    return f"error of the simulated {quantity}" if result.method == "output_error" else torque_error_name(quantity)


_HEADER = ("parameter", "value", "standard error", "unit", "95 % interval")


def _figures(estimate: Estimate, interval: tuple[float, float]) -> tuple[str, ...]:
    low, high = interval
    if math.isnan(estimate.stderr):
        shown = "-" if math.isnan(high) else f"{low:.5g} to {high:.5g}"
        return number(estimate.value, 5), "at its bound", estimate.unit, shown
    return number(estimate.value, 5), number(estimate.stderr, 2), estimate.unit, f"{low:.5g} to {high:.5g}"


def _fit_sentence(result: Identification, quantity: str) -> str:
    problem, fit = result.problem, result.fit
    name = error_name(result, quantity)
    inertia = f", the inertia from {problem.inertia_cutoff:.3g} Hz" if problem.inertia_cutoff is not None else ""
    return (
        f"{name[0].upper()}{name[1:]} {percent(result.relative_error)} ({number(result.rms, 3)} {problem.unit} rms): "
        f"{int(problem.mask.sum())} samples at {problem.rate:.4g} Hz, low-pass {problem.cutoff:.3g} Hz{inertia}. "
        f"Condition number {number(fit.condition, 3)}; residual correlation of order {fit.noise.order}, allowed for in "
        f"the standard errors; {fit.dof:.0f} effective degrees of freedom."
    )


def _bias_table(result: Identification) -> Table:
    assert result.bias is not None
    test = result.bias
    header = ("parameter", "least squares - instruments", "standard error", "in standard errors", "verdict")
    rows = tuple(
        (n, f"{d:+.3g}", f"{test.stderr[n]:.2g}", f"{test.shares[n]:+.2f}", "biased" if n in test.biased else "")
        for n, d in test.bias.items()
    )
    return Table(header, rows, "Bias of least squares")


def _drawn(name: str, result: Identification | SweepResult) -> Figure:
    from pmsm_ctrl.identify import figures

    draw: Callable[[Identification | SweepResult], Figure] = getattr(figures, name)
    return draw(result)


@present.register
def _(result: SweepResult) -> Section:
    rows = tuple(
        (name.replace("_", " "), symbol, *_figures(getattr(line, symbol), line.interval(symbol)))
        for name, line in result.lines.items()
        for symbol in ("F_c", "F_v")
    )

    caption = (
        "F_c and F_v describe the friction completely where the points lie on the line and the residual has no pattern."
    )
    return Section(
        f"Speed sweep of {result.design.name}",
        (
            f"Averaged {drives(result.motion)} at {len(result.levels)} settled speeds from {len(result.plateaus)} "
            f"plateaus; the model-to-measurement error of the line is {result.rms_percent:.2f} % rms.",
            *result.notices,
            Table(("fit", *_HEADER), rows, "Friction from the settled speeds"),
            Picture(lambda: _drawn("friction_over_speed", result), caption),
        ),
    )


@present.register
def _(result: PaperTable) -> Section:
    hypothesis = (
        f"A torque constant of {result.K_t_wrong:g} instead of {result.K_t:g} N m/A in the evaluation alone would "
        f"shift both by {100 * (result.K_t_wrong / result.K_t - 1):+.1f} %, close to the paper's -3.0 and -3.3 %. This "
        "is a hypothesis: the paper does not state its torque constant."
    )
    evaluated = (f"here, K_t = {result.K_t:.4g}", f"here, K_t = {result.K_t_wrong:.4g}")
    rows = tuple(
        (r.case, r.symbol, r.unit, f"{r.injected:.4g}", *(_deviating(r, v) for v in (r.paper, r.ours, r.wrong_K_t)))
        for r in result.rows
    )

    return Section(
        "The reference paper's table",
        (
            *result.notices,
            Table(("case", "parameter", "unit", "injected", "paper", *evaluated), rows),
            hypothesis,
            Picture(
                lambda: _drawn("friction_over_speed", result.sweeps[0]),
                "The first case: averaged torque against speed.",
            ),
        ),
    )


def _deviating(row: PaperRow, value: float | None) -> str:
    deviation = row.deviation(value)
    return "-" if value is None or deviation is None else f"{value:.4g} ({deviation:+.2f} %)"

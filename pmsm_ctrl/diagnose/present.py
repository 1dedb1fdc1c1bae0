"""The diagnosis in words, tables and figures, from the result alone."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from pmsm_ctrl.diagnose.addition import Addition
from pmsm_ctrl.diagnose.explorer import traces_of
from pmsm_ctrl.diagnose.notices import calibration_text, errors_caption
from pmsm_ctrl.diagnose.result import Agreement, Diagnosis, DiagnosisStep, Errors, Ranked, Verdict
from pmsm_ctrl.importers.recording import RECORD
from pmsm_ctrl.regression.notices import sampling_text
from pmsm_ctrl.regression.present import records_table, spread_sentence, torque_error_name
from pmsm_ctrl.rendering.numbers import fit, number, percent, probability, with_error, with_prefix
from pmsm_ctrl.result import Estimate
from pmsm_ctrl.section import Block, Picture, Section, Table, present
from pmsm_ctrl.units import drives

__all__ = ["first_pictures", "verdict_text"]

# Times the mean square of the error that refitted parameters leave, from which on the design is not the one that
# explains a log.
OTHER_PARAMETERS = 2.0

VERDICTS = {
    Verdict.CONSISTENT: "no missing effect: the design explains this log",
    Verdict.UNEXPLAINED: "significant structure in the residual that no effect of the catalogue explains",
    Verdict.NOT_EXCITED: "not excited, no answer: this motion does not excite the friction",
    Verdict.IMPLAUSIBLE: "implausible, no answer: log and design do not belong together",
    Verdict.INCONCLUSIVE: "inconclusive: no effect was named, but this log does not show that none is missing",
}


def verdict_text(d: Diagnosis) -> str:
    """Return the verdict in words, such as "1 missing effect: Stribeck friction".

    Parameters
    ----------
    d : Diagnosis
    """
    if d.verdict is Verdict.CONSISTENT and _refitted(d):
        return "no missing effect: with refitted parameters the design explains this log"
    if d.verdict is not Verdict.EFFECTS_MISSING:
        return VERDICTS[d.verdict]
    # only an effect with an order, or on a linear axis with a period, is found more than once
    waves = "periods" if d.design.motion == "linear" else "orders"
    counts = Counter(step.title for step in d.steps)
    titles = ", ".join(title if count == 1 else f"{title} ({count} {waves})" for title, count in counts.items())
    return f"{len(d.steps)} missing effect{'' if len(d.steps) == 1 else 's'}: {titles}"


def _refitted(d: Diagnosis) -> bool:
    """Whether it is not the design as it is given, all of its parameters stated, that explains a log."""
    given, final = (d.errors[which]["torque"]["relative"] for which in ("nominal", "final"))
    stated = all(found.nominal is not None for found in d.base.values())
    return bool(stated and given**2 > OTHER_PARAMETERS * final**2)


def sentence(d: Diagnosis) -> str:
    """Return the verdict and what it rests on, as one sentence.

    Parameters
    ----------
    d : Diagnosis
    """
    verdict = verdict_text(d)
    if d.reasons:
        verdict += f": {d.reasons[0].text}"
    elif d.verdict is Verdict.CONSISTENT:
        error, floor = (percent(d.errors[which]["torque"]["relative"]) for which in ("final", "noise_floor"))
        if lacking := [symbol for symbol, found in d.base.items() if found.nominal is None]:
            verdict += f" with {' and '.join(lacking)}, which it does not state"
        as_given = f", {percent(d.errors['nominal']['torque']['relative'])} as given" if _refitted(d) else ""
        verdict += f" (error {error} of the {drives(d.design.motion)}{as_given}, noise floor {floor})"
    return f"{verdict[0].upper()}{verdict[1:]}."


@present.register
def _(result: Diagnosis) -> Section:
    d = result
    doubts = [notice for notice in d.notices if notice not in d.reasons[:1]]
    blocks: list[Block] = [sentence(d), *doubts, traces_of(d), _errors(d)]
    if d.base:
        without = " without the effects found" if d.steps else ""
        blocks.append(f"Base model{without}: {', '.join(_beside_stated(s, e) for s, e in d.base.items())}.")
    blocks += [f"Note: {note.text}." for note in d.remarks]
    if (sampled := sampling_text(d.timing, drives(d.design.motion), d.timing_stderr)) is not None:
        blocks.append(sampled)
    essential = [_found(d)] if d.steps else []
    if any(v.outside for v in d.parameter_deviations):
        essential.append(_deviations(d, outside=True))
    blocks += essential
    if d.resonance is not None:
        blocks += _resonance(d.resonance)
    if len(d.records) > 1:
        records = records_table(d.records, drives(d.design.motion), "refitted", "final")
        blocks.append(records)
        if not d.steps and any(record.held_out for record in d.records):  # no table of steps holds their errors
            essential.append(records)
        if (drift := spread_sentence(d.spreads, drives(d.design.motion))) is not None:
            blocks.append(drift)
    if d.calibration is not None:
        blocks.append(f"Calibration: {calibration_text(d.calibration)}.")
    if d.next_experiment:
        blocks.append(f"Next experiment: {d.next_experiment['profile'] or 'none'}. {d.next_experiment['why']}.")
        if d.next_experiment["profile"]:
            blocks.append(f"Record {RECORD}.")
    blocks += [*_pictures(d), _candidates(d)]
    if d.parameter_deviations:
        blocks.append(_deviations(d, outside=False))
    return Section(
        f"Diagnosis of {d.design.name} from {Path(d.log_name).name}", tuple(blocks), essential=tuple(essential)
    )


@present.register
def _(result: Addition) -> Section:
    a, drive = result, drives(result.design.motion)
    before, after = (percent(a.errors[which]["torque"]["relative"]) for which in ("base", "final"))
    verdict = f"The log does not support {a.title}: {a.against[0]}." if a.against else f"The log supports {a.title}."
    verdict += f" The {torque_error_name(drive)} is {before} without, {after} with it."
    channels = list(a.errors["base"])
    held = [c for c in channels if c in a.holdout.get("base", {})]
    rows = (("design as given", "nominal"), ("parameters refitted", "base"), (f"+ {a.effect}", "final"))
    errors = Table(
        (
            "model",
            *(_error_name(c, drive) for c in channels),
            *(_error_name(c, drive, True, a.level_refitted) for c in held),
        ),
        tuple(
            (name, *_relative(a.errors[which], channels), *_relative(a.holdout.get(which, {}), held))
            for name, which in rows
        ),
        "Relative rms error of each balance",
    )
    found = Table(
        ("parameter", "value", "unit", "design"),
        tuple(
            (
                symbol,
                with_error(e.value, e.stderr, ends=e.ends),
                e.unit,
                "-" if e.nominal is None else number(e.nominal, 4),
            )
            for symbol, e in {**a.base, **a.parameters}.items()
        ),
        "Parameters, fitted together",
    )
    several: list[Block] = []
    if len(a.records) > 1:
        several = [records_table(a.records, drive, "refitted", "final")]
        several += [drift] if (drift := spread_sentence(a.spreads, drive)) is not None else []
    remarks = (f"Note: {note.text}." for note in a.remarks)
    more = (f"Also: {text}." for text in a.against[1:])
    blocks: tuple[Block, ...] = (verdict, *more, *a.notices, errors, found, *several, *remarks)
    return Section(f"{a.design.name} with {a.effect}, fitted to {Path(a.log_name).name}", blocks, essential=(found,))


def _beside_stated(symbol: str, found: Estimate) -> str:
    stated = "not in the design" if found.nominal is None else f"design: {number(found.nominal, 4)}"
    return f"{symbol} = {with_error(found.value, found.stderr, found.unit)} ({stated})"


def _errors(d: Diagnosis) -> Table:
    """The falling error, model by model."""
    channels, drive = list(d.errors["base"]), drives(d.design.motion)
    other = [c for c in channels if d.steps and c in d.steps[0].holdout_before]
    first = d.steps[0].holdout_before if d.steps else {}
    run = d.free_run
    rows: list[tuple[str, Errors, Errors, Mapping[str, Any]]] = [
        ("design as given", d.errors["nominal"], {}, run.get("nominal", {})),
        ("parameters refitted", d.errors["base"], first, run.get("base", {})),
        *((f"+ {step.name}", step.error_after, step.holdout_after, step.free_run) for step in d.steps),
        ("noise floor", d.errors["noise_floor"], {}, {}),
    ]
    simulated = any(of_run for *_, of_run in rows)
    last = 2 if any(of_run and of_run["fit"] >= 0.0 for *_, of_run in rows) else int(simulated)  # cells of a free run
    return Table(
        (
            "model",
            *(_error_name(c, drive) for c in channels),
            *(_error_name(c, drive, held_out=True, level_refitted=d.level_refitted) for c in other),
            *("free run, position", "fit")[:last],
        ),
        tuple(
            (name, *_relative(own, channels), *_relative(held, other), *_run_cells(of_run)[:last])
            for name, own, held, of_run in rows
        ),
        errors_caption(d.record.cutoff)
        + (f"; free run: simulated from the {drive} alone, whose small errors add up" if simulated else ""),
    )


def _run_cells(run: Mapping[str, Any]) -> tuple[str, str]:
    if not run:
        return "", ""
    # the rms of a run that drifts says how long it has run, and a right effect may make it drift the sooner
    return (fit(run["fit"]), "") if run["fit"] < 0.0 else (with_prefix(run["rms"], run["unit"]), fit(run["fit"]))


def _error_name(channel: str, drive: str, held_out: bool = False, level_refitted: bool = False) -> str:
    return torque_error_name(drive if channel == "torque" else channel, held_out, level_refitted)


def _relative(errors: Errors, channels: list[str]) -> list[str]:
    return [percent(errors[c]["relative"]) if c in errors else "" for c in channels]


def _found(d: Diagnosis) -> Table:
    rows = []
    for step in d.steps:
        e = step.evidence
        gain = with_error(e["block_gain"], e["block_stderr"]) if e["blocks"] else "-"
        rows.append((step.name, _parameters(step), probability(e["p_holm"]), gain, ", ".join(step.equivalents) or "-"))
    head = ("missing effect", "parameters", "p (Holm)", "cross-validation gain", "not distinguishable from")
    return Table(head, tuple(rows), "Missing effects")


def _resonance(both: Agreement) -> Iterator[Block]:
    """Yield whether the frequency response agrees, in words and in numbers."""
    against = f"the frequency response of {Path(both.log_name).name}"
    if not both.effect and not both.frf:
        yield f"No second mass, as in {against}."
        return
    words = {
        True: f"agrees with {against}",
        False: f"does not agree with {against}",
        None: f"stands beside {against} without a verdict: this log is not sure enough",
    }
    yield f"{both.effect or 'A log without a named spring'} {words[both.agrees]}."
    rows = tuple(
        (
            name.replace("_", " "),
            own.unit or "1",
            with_error(own.value, own.stderr),
            with_error(both.frf[name].value, both.frf[name].stderr) if name in both.frf else "none",
            "-" if math.isnan(away := both.apart.get(name, math.nan)) else f"{away:.1f}",
        )
        for name, own in both.diagnosed.items()
    )
    head = ("quantity", "unit", "by this log", "by the frequency response", "joint standard errors apart")
    yield Table(head, rows, "The second mass by log and by frequency response")


def _parameters(step: DiagnosisStep) -> str:
    return ", ".join(f"{s} = {with_error(e.value, e.stderr, e.unit, e.ends)}" for s, e in step.parameters.items())


def _deviations(d: Diagnosis, *, outside: bool) -> Table:
    """The design's own parameters: those outside their tolerance, or all, folded."""
    rows = [
        (v.parameter, number(v.nominal, 5), with_error(v.estimate, v.stderr), v.unit, v.note or "-")
        for v in d.parameter_deviations
        if v.outside or not outside
    ]
    caption = "Parameters outside their tolerance" if outside else "Parameters of the design"
    return Table(("parameter", "design", "estimate", "unit", "remark"), tuple(rows), caption, folded=not outside)


def _candidates(d: Diagnosis) -> Table:
    rows = tuple(
        (r.effect, percent(r.explained, 1), probability(r.p_value), _why_not(r)) for r in d.ranking if not r.accepted
    )
    return Table(("candidate", "explains", "p", "why not"), rows, "Candidates that were not accepted", folded=True)


def _why_not(r: Ranked) -> str:
    if not r.shown_from:
        return r.why_not
    if any(math.isinf(e.value) for e in r.shown_from.values()):
        return f"{r.why_not}; not detectable on this log"
    alone = len(r.shown_from) == 1
    amounts = [("" if alone else f"{s} ") + with_prefix(e.value, e.unit) for s, e in r.shown_from.items()]
    return f"{r.why_not}; detectable here above {', '.join(amounts)}"


def first_pictures(d: Diagnosis) -> tuple[Picture, ...]:
    """Return what a page shows first: the falling error, and the map of the residual before and after.

    Parameters
    ----------
    d : Diagnosis
    """
    from pmsm_ctrl.diagnose import figures

    kind = d.record.drive
    falling = "No effect was accepted; the error that is left is to be compared with the noise floor."
    maps = "A pattern would show a missing effect."
    if d.steps:
        falling = f"The {kind} error falls with every effect that was found"
        falling += ", on records that were held out as well." if d.steps[0].holdout_before else "."
        maps = "The pattern on the left is what the effects explain."
    return (
        Picture(partial(figures.falling_figure, d), falling),
        Picture(partial(figures.ends_figure, d), f"Mean residual over speed and {figures.plane_of(d).name}. {maps}"),
    )


def _pictures(d: Diagnosis) -> Iterator[Picture]:
    """Yield every figure with the sentence that says what to see."""
    from pmsm_ctrl.diagnose import figures

    kind, unit = d.record.drive, d.record.unit("torque")
    before, after, floor = (100 * d.errors[r]["torque"]["relative"] for r in ("base", "final", "noise_floor"))
    falling = f"No effect was accepted: {after:.2f} % of the {kind} is unexplained, the noise floor is {floor:.2f} %."
    maps = "The pattern is not explained by any effect." if d.left is not None else "There is no significant pattern."
    if d.steps:
        names = ", then ".join(step.name for step in d.steps)
        falling = (
            f"Every step is an accepted effect ({names}): the error falls from {before:.2f} to {after:.2f} % of the "
            f"{kind}; the noise floor is {floor:.2f} %."
        )
        maps = "A pattern shows a missing effect; it becomes smaller with every accepted effect."
    yield Picture(partial(figures.error_figure, d), falling)
    text = f"Mean residual over speed and {figures.plane_of(d).name}, in one colour scale; grey: no samples. {maps}"
    yield Picture(partial(figures.maps_figure, d), text)
    stretch = figures.worst_stretch(d)
    if stretch is not None:
        text = f"The stretch in which the refitted design fails worst ({figures.doing(d, stretch)})."
        if d.steps:
            old, new = (figures.rms_within(fit, stretch) for fit in (d.selection.fits[0], d.selection.fit))
            text += f" With the accepted effects the residual there falls from {old:.3g} to {new:.3g} {unit} rms."
        yield Picture(partial(figures.worst_stretch_figure, d, stretch), text)
    yield Picture(
        partial(figures.contributions_figure, d),
        "What every part of the final model contributes over speed. Left, means stacked: their sum is the predicted "
        f"{kind} (line), to be compared with the measured one (dots). Right, the rms of each part.",
    )
    if d.structure is not None:
        text = d.structure.notice.text
        yield Picture(partial(figures.structure_figure, d, d.structure), f"{text[0].upper()}{text[1:]}.")

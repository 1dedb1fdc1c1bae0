"""A study of the compensation as blocks: safe gains, doubts, changes, what happens at rest."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import asdict
from functools import partial
from typing import TYPE_CHECKING

from pmsm_ctrl.compensate.choice import assumptions, recommended_blocks
from pmsm_ctrl.compensate.metrics import units_of
from pmsm_ctrl.compensate.motions import CIRCLE, WARM_UP
from pmsm_ctrl.compensate.notices import named, safe_gain, sentence
from pmsm_ctrl.compensate.result import CompensationStudy, Variant
from pmsm_ctrl.compensate.window import LESS, ROUNDING, WORSE
from pmsm_ctrl.rendering.numbers import percent
from pmsm_ctrl.section import Picture, Section, Table, present
from pmsm_ctrl.units import axis_unit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from pmsm_ctrl.compensate.examples import Example

__all__ = ["first_pictures"]

# Column, metric and motion of the changes shown.
SHOWN = (
    ("reversals", "rms", "reversal"), ("peak", "reversal_peak", "reversal"), ("triangle", "rms", "triangle"),
    ("creep", "rms", "creep"), ("circle", "rms", CIRCLE), ("quadrant", "reversal_peak", CIRCLE),
    ("warm-up", "rms", WARM_UP),
)  # fmt: skip
METHOD = (
    "The baseline already has feedforward of inertia and delay, so that the changes are due to friction alone. "
    "A gain is safe when neither it nor any smaller gain causes a limit cycle at rest or an RMS error more than "
    f"{100.0 * (WORSE - 1.0):.0f} % above that without compensation, errors below one encoder count taken as one "
    "count: an error that grows but stays below a count is safe, and no improvement. The encoder resolves the "
    "error of a motion whose largest value, without compensation, is above one count and whose RMS value is "
    f"above {ROUNDING:.2f} counts, that of the rounding to counts; only such motions can show an improvement. "
    "Limit cycles are also looked for after a disturbance that can start one. For a safe gain each is tried "
    "with the right parameters and with parameters 20 % wrong, on the plant and, if it has no presliding, on "
    "the plant with presliding (a bristle of 0.5 mrad, 10 um for a linear axis), which is assumed: it decides "
    "what is safe. Of safe gains the one is recommended that leaves the least RMS error on the design's own "
    "plant; there the parameters are wrong by two standard errors of the design, by 6 % at least and 20 % at "
    "most, and by 20 % where it states none. A motion at rest of less than one encoder count is no limit cycle. "
    "The error of the circle is its contour error. During the warm-up Coulomb and viscous friction fall by 40 "
    "%. The axis without friction shows the error that noise and the loops cause."
)
BY = {Variant.ALL: "reference", Variant.OBSERVER: "observer"}
WORTH = "worth its model here"
BRACKETS = "in brackets: without compensation below what the encoder resolves"


@present.register
def _(result: CompensationStudy) -> Section:
    return Section(
        f"Friction compensation of {result.design.name}",
        (_verdict(result), *result.notices, *recommended_blocks(result), *first_pictures(result), _gains(result),
         _windows(result), _changes(result), *_observer(result), *_rest(result),
         *_acceptance(result),
         METHOD, _sweep(result), _runs(result)),
    )  # fmt: skip


def first_pictures(result: CompensationStudy) -> tuple[Picture, ...]:
    """Return what a page shows first: a reversal and the quadrants of a circle, with and without compensation.

    Parameters
    ----------
    result : CompensationStudy
    """
    angle = axis_unit("rad", result.design.motion)

    def drawn(example: Example) -> Figure:
        from pmsm_ctrl.compensate import figures

        return (figures.reversal if example.angle is None else figures.circle)(example, angle)

    words = ("Position error at a reversal, caused by friction, without and with compensation.",
             "Error of a circle: each axis turns, and friction shows, at the ends of a diameter.")  # fmt: skip
    return tuple(Picture(partial(drawn, e), words[e.angle is not None]) for e in result.examples)


def _gains(result: CompensationStudy) -> Picture:
    def drawn() -> Figure:
        from pmsm_ctrl.compensate.figures import gain_sweep

        return gain_sweep(result)

    words = "Where the lower curve is above zero, the axis oscillates at rest."
    if any(w.resolved and bool((w.rms[w.gains <= w.safe] > WORSE).any()) for w in result.windows.values()):
        words += " An error above 100 % at a safe gain is below one encoder count."
    return Picture(drawn, words)


def _verdict(result: CompensationStudy) -> str:
    speeds = [w for w in result.windows.values() if w.source != "observer"]
    text = ", ".join(f"{safe_gain(w)} with {w.source}-speed" for w in speeds) + " feedforward"
    if "observer" in result.windows:
        text += f", {safe_gain(result.windows['observer'])} with the disturbance observer"
    if result.verdicts:
        met = sum(verdict.passed for verdict in result.verdicts)
        text += f"; acceptance: {met}/{len(result.verdicts)} limits met"
    best = result.recommendation
    chosen = "no compensation"
    if best is not None:
        chosen = f"{named(best.compensation.source)}, gain {percent(best.gain, 0)}, {assumptions(result)}"
    return f"Recommended: {chosen}. Highest safe gain: {text}."


def _windows(result: CompensationStudy) -> Table:
    rows = tuple(
        (w.source if w.source == "observer" else f"{w.source} speed", safe_gain(w),
         percent(w.best, 0) if w.best > 0.0 else "none",
         w.limited_by or "end of the sweep", "none" if w.hint is None else f"from {percent(w.hint, 0)}")
        for w in result.windows.values()
    )  # fmt: skip
    header = ("feedforward with", "highest safe gain", "best gain", "limited by", "limit cycle, describing function")
    return Table(header, rows, "Safe gains, by simulation")


def _off(factor: float) -> str:
    return "" if factor == 1.0 else f", parameters {100 * (factor - 1):+.0f} %"


def _changes(result: CompensationStudy) -> Table:
    pairs = dict.fromkeys((row.variant, row.factor) for row in result.table if row.variant != Variant.NONE)
    rows = tuple(
        (f"{variant}{_off(factor)}", *(_change(result, variant, metric, factor, motion) for _, metric, motion in SHOWN))
        for variant, factor in pairs
    )
    caption = (
        "Change of the RMS position error against no compensation, at a gain of 100 % unless as recommended; peak, "
        "quadrant: largest error after a reversal"
    )
    if not all(result.resolved_motions(motion) for *_, motion in SHOWN):
        caption += f"; {BRACKETS}"
    return Table(("compensated", *(title for title, *_ in SHOWN)), rows, caption)


def _change(result: CompensationStudy, variant: str, metric: str, factor: float, motion: str) -> str:
    """Return the worst change; in brackets where the encoder resolves no error of these motions."""
    said = f"{100 * result.change(variant, metric, factor, motion):+.0f} %"
    return said if result.resolved_motions(motion) else f"({said})"


def _observer(result: CompensationStudy) -> tuple[str | Table, ...]:
    """Friction feedforward beside the disturbance observer: error left, what they cost, and which is worth it."""
    found = result.observer
    if found is None:
        return ("A disturbance observer was not tried: the loops leave no margin for one.",)
    rows = []
    for variant in (Variant.ALL, Variant.OBSERVER):
        rms, peak, noise = (
            f"{100.0 * max(result.change(variant, metric, f) for f in result.doubt.factors(BY[variant])):+.0f} %"
            for metric in ("rms", "reversal_peak", "noise")
        )
        changes = (rms, peak, noise) if result.resolved_motions() else (f"({rms})", f"({peak})", noise)
        loop = found.after if variant == Variant.OBSERVER else found.before
        corner = found.worst.speed if variant == Variant.OBSERVER else found.worst_before
        safe = safe_gain(result.windows["observer" if variant == Variant.OBSERVER else "reference"])
        rows.append(
            (variant, *changes, f"{loop.phase_margin:.0f} deg", f"{loop.sensitivity_peak:.2f}",
             f"{corner.sensitivity_peak:.2f}", safe)
        )  # fmt: skip
    header = ("", "reversals", "peak", "noise", "phase margin", "abs(S)", "worst corner", "safe gain")
    caption = (
        f"Worst change at a gain of 100 %, parameters right and {percent(result.doubt.share, 0)} wrong (of the "
        "observer: its inertia, 20 %); bandwidth of "
        f"the observer {found.bandwidth:.4g} rad/s ({found.bandwidth / (2.0 * math.pi):.0f} Hz); margins at the "
        f"motor's current, position controlled; worst corner of the tolerances: {found.worst.name}"
    )
    if not result.resolved_motions():
        caption += f"; {BRACKETS}"
    return _worth(result), Table(header, tuple(rows), caption)


def _worth(result: CompensationStudy) -> str:
    """Say whether friction feedforward is worth its model, beside an observer that needs none."""

    def left(variant: Variant, factors: Iterable[float]) -> tuple[float, float]:
        changes = (max(result.change(variant, m, f) for f in factors) for m in ("rms", "reversal_peak"))
        rms, peak = (1.0 + change for change in changes)
        return rms, peak

    if not result.resolved_motions():
        return (
            "Whether friction feedforward is worth its model cannot be told: without compensation the errors at "
            "reversals are below what the encoder resolves."
        )
    (right, wrong), (observed, off) = (
        (left(v, (1.0,)), left(v, result.doubt.factors(BY[v]))) for v in (Variant.ALL, Variant.OBSERVER)
    )
    told = "; ".join(
        f"{when} {percent(a[0], 0)} of the RMS error and {percent(a[1], 0)} of the peak at reversals remain, with "
        f"the observer {percent(b[0], 0)} and {percent(b[1], 0)}"
        for when, a, b in (
            ("with the right parameters", right, observed),
            (f"{percent(result.doubt.share, 0)} wrong", wrong, off),
        )
    )
    cycles = [r for r in result.table if r.variant == Variant.OBSERVER and r.metrics.cycle_amplitude > 0.0]
    rest = f". With the observer the axis has a limit cycle at rest ({cycles[0].motion})" if cycles else ""
    if result.windows["reference"].safe < 1.0:
        return f"At a gain of 100 %, which is not safe by reference speed here, {told}{rest}."
    if right[0] > LESS or right[1] > 1.0:
        verdict = "not worth its model here, since it does not lower both errors"
    elif right <= observed and wrong[0] <= min(off[0], LESS):
        verdict = WORTH
    elif right >= observed and wrong[0] >= off[0]:
        verdict = "not worth its model here"
    else:
        verdict = "worth its model where the friction is known well"
    best = result.recommendation
    taken = best is not None and best.compensation.source == "observer"
    beside = "; at safe gains the observer leaves less all the same" if taken and verdict == WORTH else ""
    return f"Friction feedforward is {verdict}: {told}{rest}{beside}."


def _rest(result: CompensationStudy) -> tuple[Table, ...]:
    """Limit cycles while the reference rests, simulated and in theory."""
    rows = [
        ("without compensation" if row.variant == Variant.NONE else str(row.variant),
         f"{1e3 * row.metrics.cycle_amplitude:.3g}", f"{row.metrics.cycle_frequency:.3g}")
        for row in result.table
        if row.factor == 1.0 and row.motion == "positioning" and row.metrics.cycle_amplitude
        and row.variant != Variant.FLOOR
    ]  # fmt: skip
    if result.theory is not None:
        name = "without compensation, theory for a small Stribeck speed"
        rows.append((name, f"{1e3 * result.theory.amplitude:.3g}", f"{1.0 / result.theory.period:.3g}"))
    header = ("compensated", f"amplitude [m{axis_unit('rad', result.design.motion)}]", "frequency [Hz]")
    return (Table(header, tuple(rows), "Limit cycles at rest after positioning"),) if rows else ()


def _acceptance(result: CompensationStudy) -> tuple[Table, ...]:
    if not result.verdicts:
        return ()
    rows = tuple((sentence(v).partition(": ")[2], "passed" if v.passed else "failed") for v in result.verdicts)
    return (Table(("limit", "outcome"), rows, "Acceptance of the design"),)


def _sweep(result: CompensationStudy) -> Table:
    rows = tuple(
        (w.source, percent(gain, 0), percent(rms, 0), percent(judged, 0), percent(peak, 0), percent(other, 0),
         f"{cycle:.2g}" if cycle else "none", "safe" if gain <= w.safe else "not safe")
        for w in result.windows.values()
        for gain, rms, other, judged, peak, cycle in zip(
            w.gains, w.rms, w.assumed_rms, w.judged, w.reversal_peak, w.cycle_counts, strict=True
        )
    )  # fmt: skip
    angle = axis_unit("rad", result.design.motion)
    header = (
        "speed",
        "gain",
        "worst RMS, without compensation = 100 %",
        "for a safe gain: parameters 20 % wrong, errors of at least one count, the assumed bristle too",
        "worst reversal peak, the same",
        "worst RMS with the assumed bristle",
        f"limit cycle [{'encoder counts' if any(w.count > 0.0 for w in result.windows.values()) else angle}]",
        "judged",
    )
    caption = "Sweep of the gain; errors below one encoder count are taken as one count where a safe gain is judged"
    return Table(header, rows, caption, folded=True)


def _runs(result: CompensationStudy) -> Table:
    metrics = (f"{name.replace('_', ' ')} [{unit}]" for name, unit in units_of(result.design.motion).items())
    rows = tuple(
        (r.variant, r.motion, f"{100 * (r.factor - 1):+.0f} %", *(f"{v:.3g}" for v in asdict(r.metrics).values()))
        for r in result.table
    )
    return Table(("compensated", "motion", "parameters", *metrics), rows, "All runs", folded=True)

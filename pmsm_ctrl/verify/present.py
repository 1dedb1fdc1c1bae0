"""The check of a downloaded compensator as a section."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

from pmsm_ctrl.rendering.numbers import percent, with_error, with_prefix
from pmsm_ctrl.result import Estimate
from pmsm_ctrl.section import Block, Picture, Section, Table, present
from pmsm_ctrl.verify.quadrants import QuadrantError
from pmsm_ctrl.verify.result import Outcome, Verification

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__: list[str] = []

SENTENCES = {
    Outcome.APPLIED: "The compensator's feedforward is applied as the design says.",
    Outcome.PARTLY_APPLIED: "Only a part of the compensator's feedforward is applied.",
    Outcome.NOT_APPLIED: "The compensator's feedforward is not applied.",
    Outcome.WRONG_GAIN: "The compensator's feedforward is applied with another gain than the design's.",
    Outcome.WRONG_SIGN: "The compensator's feedforward is applied with the wrong sign.",
    Outcome.LATE: "The compensator's feedforward is applied too late.",
    Outcome.LIMIT_CYCLE: "The axis has a limit cycle at rest since the download.",
    Outcome.INCONCLUSIVE: "These two logs do not tell whether the compensator's feedforward is applied.",
}
ADDED = (
    "Current of the second log less that of its controller, over the feedforward that the compensator computes from "
    "the reference: on the line the gain is 1."
)
REVERSAL = "Mean tracking error around a reversal, in the direction of the motion that begins, before and after."
ERRORS = {"rms": "rms", "peak": "largest", "reversal_peak": "after a reversal (median)"}


@present.register
def _(result: Verification) -> Section:
    low, high = result.interval
    found = (f"Gain {result.gain.value:.3f} (95 %: {low:.3f} to {high:.3f}), the design says {result.expected:g}; "
             f"found in {result.channel}.")  # fmt: skip
    change = f"What to change: {result.advice}"
    blocks: list[Block] = [f"{SENTENCES[result.verdict]} {found}", change, *result.notices, _gains(result)]
    blocks.append(_errors(result))
    blocks.append(Picture(lambda: _draw(result, "added"), ADDED))
    if len(result.after.t):
        blocks.append(Picture(lambda: _draw(result, "reversal"), REVERSAL))
    names = f"{Path(result.before_name).name or 'before'} and {Path(result.after_name).name or 'after'}"
    return Section(f"Compensation in the drive: {names}", tuple(blocks))


def _gains(result: Verification) -> Table:
    rows = [("total", with_error(result.gain.value, result.gain.stderr), f"{result.expected:g}", "")]
    rows += [
        (name, _gain(one, name in result.implausible), f"{result.expected:g}", percent(result.weight[name], 1))
        for name, one in result.parts.items()
    ]  # fmt: skip
    if result.delay is not None:
        low, high = result.delay_interval
        rows.append(("delay [ms]", f"{1e3 * result.delay.value:.3g} ({1e3 * low:.3g} to {1e3 * high:.3g})", "0", ""))
    if result.smoothing is not None:
        low, high = result.smoothing_interval
        rows.append(
            (
                f"smoothing of the sign, {result.smoothing_shape} [{result.smoothing.unit}]",
                f"{result.smoothing.value:.3g} ({low:.3g} to {high:.3g})",
                f"{result.smoothing.nominal:.3g}",
                "",
            )
        )
    rows.append(("before the download", with_error(result.before_gain.value, result.before_gain.stderr), "0", ""))
    return Table(
        ("part of the feedforward", "gain", "design", "share of the current"), tuple(rows), "Applied feedforward"
    )


def _gain(found: Estimate, implausible: bool) -> str:
    if implausible:
        return "implausible"
    return with_error(found.value, found.stderr) if math.isfinite(found.stderr) else "-"


def _errors(result: Verification) -> Table:
    unit = result.before.unit
    rows: list[tuple[str, ...]] = [
        (words, with_prefix(getattr(result.before, name), unit), with_prefix(getattr(result.after, name), unit),
         percent(result.measured.get(name, math.nan), 1), percent(result.promised.get(name, math.nan), 1))
        for name, words in ERRORS.items()
    ]  # fmt: skip
    if not math.isnan(result.after.cycle_amplitude):
        cells = (_cycle(one.cycle_amplitude, one.cycle_frequency, unit) for one in (result.before, result.after))
        rows.append(("limit cycle at rest", *cells, "", ""))
    header = ("tracking error", "before", "after", "change", "predicted by simulation")
    return Table(header, tuple(rows), "Tracking error before and after")


def _cycle(amplitude: float, frequency: float, unit: str) -> str:
    if math.isnan(amplitude):
        return "-"
    return f"{with_prefix(amplitude, unit)} at {frequency:.3g} Hz" if amplitude > 0.0 else "none"


def _draw(result: Verification, what: str) -> Figure:
    from pmsm_ctrl.verify import figures

    return figures.added(result) if what == "added" else figures.reversal(result)


@present.register
def _(result: QuadrantError) -> Section:
    before, after, unit = result.before, result.after, result.unit
    said = f"Quadrant error {with_prefix(before.worst, unit)}"
    if after is not None:
        said += f" before and {with_prefix(after.worst, unit)} after ({percent(result.change, 0)})"
    said += f"; circle of {with_prefix(before.radius, unit, 3)} at {with_prefix(before.speed, unit, 3)}/s, "
    said += f"{before.turns:.2g} turns."
    columns = [before, *([after] if after is not None else [])]
    rows = [
        (f"{90 * k} deg", *(_spike(float(one.spikes[k]), float(one.scatter[k]), unit) for one in columns))
        for k in range(4)
    ]
    rows.append(("elsewhere, rms", *(with_prefix(one.rest, unit) for one in columns)))
    rows.append(("radius less the reference's", *(with_prefix(one.radius_error, unit) for one in columns)))
    header = ("place on the circle", *("before", "after")[: len(columns)])
    table = Table(header, tuple(rows), "Radial deviation behind the reversals, outwards; +- from turn to turn")
    picture = Picture(
        lambda: _polar(result), "Radial deviation around the circle, enlarged; spikes follow the reversals."
    )
    return Section("Quadrant error", (said, *result.notices, table, picture))


def _spike(value: float, scatter: float, unit: str) -> str:
    around = "" if math.isnan(scatter) else f" +- {with_prefix(scatter, unit)}"
    return f"{with_prefix(value, unit)}{around}"


def _polar(result: QuadrantError) -> Figure:
    from pmsm_ctrl.verify import figures

    return figures.polar(result)

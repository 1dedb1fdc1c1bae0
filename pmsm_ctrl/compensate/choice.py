"""Why a compensation is recommended, in words, with the table of every number that the reason names."""

from __future__ import annotations

import json
import math

from pmsm_ctrl.compensate.notices import named, why_none
from pmsm_ctrl.compensate.plants import DEFLECTION
from pmsm_ctrl.compensate.result import CompensationStudy
from pmsm_ctrl.compensate.window import WORSE, GainWindow, best_place
from pmsm_ctrl.rendering.numbers import percent
from pmsm_ctrl.section import Table

__all__ = ["assumptions", "recommended_blocks"]

CHOICE = "RMS error left at safe gains"


def assumptions(result: CompensationStudy) -> str:
    """Return what the recommendation takes for granted: how wrong the parameters are, and a bristle.

    Parameters
    ----------
    result : CompensationStudy
    """
    source = "observer" if result.recommendation is None else result.recommendation.compensation.source
    if source == "observer":
        wrong = "for an inertia within 20 %"
    else:
        why = "two standard errors, 6 % at least" if result.doubt.stated else "assumed, without standard errors"
        wrong = f"for parameters within {percent(result.doubt.share, 0)} ({why})"
    bristle = _bristle(result)
    return f"{wrong}; safe also with an assumed bristle of {bristle}" if bristle else wrong


def recommended_blocks(result: CompensationStudy) -> tuple[str | Table, ...]:
    """Return which source and gain to take, why, the numbers of that, and the table of the design that says so.

    Parameters
    ----------
    result : CompensationStudy
    """
    found, best = result.recommendation, result.recommended
    table = _table(result)
    if found is None or best is None:
        return f"Why no compensation: {why_none(result.verdict)}.", *table
    chosen = best.compensation
    window = result.windows["reference" if chosen.source == "adaptive" else chosen.source]
    others = ", ".join(f"{named(source)} {percent(left, 0)}" for source, left in found.others.items())
    where = f", {found.worst}" if found.worst else ""
    beside = _beside(result, window)
    said = (
        f"Why {named(chosen.source)}: at safe gains no other source leaves less of the RMS error, "
        f"{percent(found.rms, 0)} in the worst of the motions and parameter errors on the design's own plant{where} "
        f"({others}){beside}"
    )
    said += f'; see the table "{CHOICE}".'
    if chosen.source == "observer" and (observer := result.observer) is not None:
        margins = f"{observer.before.phase_margin:.0f} to {observer.after.phase_margin:.0f} deg"
        said = f"{said[:-1]}. At full gain it lowers the phase margin from {margins}."
    if chosen == result.design.compensation:
        return f"{said} The design states it already.", *table
    fields = chosen.model_dump(exclude_none=True, exclude_defaults=True)
    stated = {"source": chosen.source, "gain": chosen.gain, "effects": chosen.effects} | fields
    if chosen.source == "observer":  # which needs no model of the friction
        del stated["effects"]
    return (
        said, "[compensation]\n" + "\n".join(f"{key} = {json.dumps(value)}" for key, value in stated.items()), *table
    )  # fmt: skip


def _bristle(result: CompensationStudy) -> str:
    """Return the deflection of the assumed bristle; empty where none was assumed."""
    if not any(window.assumed is not None for window in result.windows.values()):
        return ""
    size = DEFLECTION[result.design.motion]
    return f"{1e6 * size:.0f} um" if result.design.motion == "linear" else f"{1e3 * size:.1g} mrad"


def _beside(result: CompensationStudy, window: GainWindow) -> str:
    """Return what is left with the assumed bristle, which decides what is safe and not what is best."""
    size, left = _bristle(result), float(window.assumed_rms[_place(window)])
    if not size or not math.isfinite(left):
        return ""
    small = ", less than an encoder count" if left > WORSE else ""
    return f"; with an assumed bristle of {size}, by which a gain is judged safe, {percent(left, 0)}{small}"


def _place(window: GainWindow) -> int:
    return best_place(window.gains, window.rms, window.safe)


def _table(result: CompensationStudy) -> tuple[Table, ...]:
    """Return what every source leaves at its best safe gain."""
    if not any(window.resolved for window in result.windows.values()):
        return ()
    rows = []
    for source, window in result.windows.items():
        place = _place(window)
        beside = float(window.assumed_rms[place])
        rows.append((
            named(source), percent(float(window.gains[place]), 0) if window.gains[place] else "none",
            percent(max(result.doubt.factors(source)) - 1.0, 0),
            percent(float(window.rms[place]), 0), (window.worst[place] if window.worst else "") or "-",
            percent(beside, 0) if math.isfinite(beside) else "-",
        ))  # fmt: skip
    header = (
        "source", "best safe gain", "parameters off by", "left on the design's plant", "worst motion",
        "left with the assumed bristle",
    )  # fmt: skip
    return (Table(header, tuple(rows), f"{CHOICE}, without compensation = 100 %"),)

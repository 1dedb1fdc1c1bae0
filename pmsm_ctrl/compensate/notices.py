"""The words of the reasons to doubt a compensation, and of one line of its acceptance."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING

from pmsm_ctrl.compensate.metrics import units_of
from pmsm_ctrl.compensate.recommendation import first_unsafe
from pmsm_ctrl.compensate.window import LESS
from pmsm_ctrl.section import Template

if TYPE_CHECKING:
    from pmsm_ctrl.compensate.acceptance import Verdict
    from pmsm_ctrl.compensate.window import GainWindow, Unresolved

__all__ = [
    "ACCEPTANCE", "CYCLES", "FLOOR", "NONE_RESOLVED", "NOT_COMPENSATED", "UNRESOLVED", "UNSAFE", "UNSAFE_DESIGN",
    "motions_in_counts", "named", "safe_gain", "sentence", "why_none",
]  # fmt: skip

ACCEPTANCE = Template("acceptance_failed", "acceptance {line}")
NOT_COMPENSATED = Template(
    "not_compensated", "{effect} cannot be compensated: the drive cannot evaluate it from its own signals"
)
UNSAFE_DESIGN = Template(
    "design_gain_unsafe",
    "the design's gain of {gain:.0f} % with {source}-speed feedforward is not safe; the highest safe gain is {safe}",
)
UNSAFE = Template("full_gain_unsafe", "with {source}-speed feedforward the highest safe gain is {safe}")
CYCLES = Template(
    "cycle_without_compensation",
    "the axis has a limit cycle at rest also without compensation ({motions}); a gain that does not enlarge it counts "
    "as safe",
)
UNRESOLVED = Template(
    "motion_not_resolved",
    "{motions}: without compensation below what the encoder resolves, so it cannot show an improvement",
)
NONE_RESOLVED = Template(
    "friction_not_resolved",
    "the encoder cannot show the error due to friction: in all motions that are judged the error is below what it "
    "resolves without compensation ({motions})",
)
FLOOR = Template(
    "noise_floor",
    "with compensation the error at reversals ({change:+.0f} % RMS) equals that of the axis without friction: it is "
    "noise of the current measurement and the encoder, which no compensation lowers; {own:.0f} % of the error due to "
    "friction is removed",
)


# Why nothing is recommended, by the verdict of a study.
WHY_NONE = {
    "finer_step": "no gain of the sweep lowers the RMS error to {least} or less in the worst of the motions; one "
    "between them may",
    "not_lowered": "no safe gain lowers the RMS error to {least} or less in the worst of the motions",
    "not_resolved": "the encoder does not resolve the error due to friction, so no gain can be shown to lower it",
}


def why_none(verdict: str) -> str:
    """Return why no compensation is recommended.

    Parameters
    ----------
    verdict : str
        An `Outcome`.
    """
    return WHY_NONE[verdict].format(least=f"{100.0 * LESS:.0f} %")


def named(source: str) -> str:
    """Return a source of the compensation in words.

    Parameters
    ----------
    source : str
    """
    return "disturbance observer" if source == "observer" else f"{source} speed"


def safe_gain(window: GainWindow) -> str:
    """Return the highest safe gain; where the first one of the sweep is not safe, that it is below that one."""
    end = first_unsafe(window)
    return f"{100.0 * window.safe:.0f} %" if end is None else f"below {100.0 * end:.0f} % (smallest gain of the sweep)"


def motions_in_counts(found: Iterable[Unresolved]) -> str:
    """Return motions with their errors without compensation in encoder counts, of which the encoder resolves none."""
    return "; ".join(f"{one.motion}, RMS {one.rms:.2f} and largest {one.peak:.2f} encoder counts" for one in found)


def _limit(percent: float) -> str:
    """Return a limit with one decimal, or with the digits that were stated."""
    short = f"{percent:+.1f}"
    return short if math.isclose(float(short), percent, abs_tol=1e-9) else f"{percent:+.6g}"


def sentence(verdict: Verdict) -> str:
    """Return outcome, scenario, metric, value and limit in one line."""
    w = verdict.wanted
    if w.metric.endswith("_change"):
        unit = units_of(verdict.design.motion)[w.metric.removesuffix("_change")]
        said = f"{w.metric} = {100 * verdict.value:+.1f} %, limit {_limit(100 * w.limit)} %"
        said += f" ({verdict.found:.4g} {unit}; without compensation {verdict.reference:.4g} {unit})"
    else:
        unit = "" if verdict.unit == "1" else f" {verdict.unit}"
        said = f"{w.metric} = {verdict.value:.4g}{unit}, limit {w.limit:.4g}{unit}"
    off = "" if w.factor == 1.0 else f", compensated parameters {100 * (w.factor - 1.0):+.0f} %"
    return f"{'passed' if verdict.passed else 'FAILED'}: {w.scenario}{off}: {said}"

"""Whether a comparison gives reason to doubt the design: a verdict, and what it rests on."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from pmsm_ctrl.compare import notices, policy
from pmsm_ctrl.plausibility import ACCOUNTED, Plausibility
from pmsm_ctrl.residuals import policy as of_residuals
from pmsm_ctrl.residuals.dependence import ResidualStructure
from pmsm_ctrl.result import Verdict
from pmsm_ctrl.section import Notice

__all__ = ["judged"]


def judged(
    relative: float, structure: Mapping[str, ResidualStructure], ratios: Mapping[str, float], believed: Plausibility,
    zero: Notice | None = None, wave: Notice | None = None,
) -> tuple[Verdict, tuple[Notice, ...]]:  # fmt: skip
    """Return the verdict of a comparison and its reasons, the likeliest first.

    Parameters
    ----------
    relative : float
        Error of the torque as a share of the torque.
    structure : dict of channel to ResidualStructure
    ratios : dict of channel to float
        Residual over its noise floor.
    believed : Plausibility
        Of the log.
    zero : Notice, optional
        That the position has another zero than the design's.
    wave : Notice, optional
        That most of the residual of the torque is a single wave.
    """
    if believed.contradictions:
        return Verdict.IMPLAUSIBLE, believed.contradictions
    curves = tuple(_structured(structure))
    told = {notice.detail["channel"] for notice in curves}
    single = wave if "torque" not in told else None  # a curve says more
    found = (*(one for one in (zero, single) if one is not None), *curves)
    told |= {"torque"} if single is not None else set()
    little = tuple(_unlike(relative, {name: ratio for name, ratio in ratios.items() if name not in told}))
    if found:
        return Verdict.UNEXPLAINED, (*found, *little)
    doubts = tuple(doubt for doubt in believed.doubts if doubt.code not in ACCOUNTED)
    if little or doubts:
        return Verdict.INCONCLUSIVE, (*little, *doubts)
    return Verdict.CONSISTENT, ()


def _structured(structure: Mapping[str, ResidualStructure]) -> Iterator[Notice]:
    for name, found in structure.items():
        if found.named or found.offset_significant:
            yield notices.STRUCTURE(channel=name, words=notices.structure_words(found))


def _unlike(relative: float, ratios: Mapping[str, float]) -> Iterator[Notice]:
    """Yield where the prediction explains too little, or a residual without structure is more than noise."""
    explained = 1.0 - relative**2
    if not explained >= policy.EXPLAINED:
        yield notices.LITTLE_EXPLAINED(percent=100.0 * relative, explained=100.0 * max(0.0, explained))
    for name, ratio in ratios.items():
        if math.isfinite(ratio) and ratio > (
            of_residuals.ABOVE_FLOOR if name == "torque" else of_residuals.VOLTAGE_ABOVE_FLOOR
        ):
            yield notices.ABOVE_FLOOR(channel=name, ratio=ratio)

"""What a study of the compensation returns."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Any

from pmsm_ctrl.compensate import notices
from pmsm_ctrl.compensate.acceptance import Verdict
from pmsm_ctrl.compensate.doubt import Doubt
from pmsm_ctrl.compensate.examples import Example
from pmsm_ctrl.compensate.metrics import Metrics, units_of
from pmsm_ctrl.compensate.recommendation import Recommendation, finer_may_help, first_unsafe
from pmsm_ctrl.compensate.theory import Hunting
from pmsm_ctrl.compensate.window import GainWindow, Unresolved, resolves
from pmsm_ctrl.design import Design
from pmsm_ctrl.result import Result, jsonable
from pmsm_ctrl.section import Notice

if TYPE_CHECKING:
    from pmsm_ctrl.tune.observer import ObserverDesign

__all__ = ["CompensationStudy", "Outcome", "Row", "Variant", "own_change"]

AT_FLOOR = 1.2  # RMS error, as a share of that of the axis without friction, that compensation cannot lower further
FRICTION_SHOWS = -0.9  # change of the RMS error from which on the floor is of no interest


def own_change(compensated: float, plain: float, floor: float) -> float:
    """Return the change of an RMS error after that of the axis without friction is taken out of both.

    Parameters
    ----------
    compensated, plain, floor : float
        RMS error with and without compensation, and of the axis without friction.

    Returns
    -------
    float
        -0.9 is -90 %; NaN where `plain` is not above `floor`.
    """
    if not plain > floor:
        return math.nan
    return math.sqrt(max(compensated**2 - floor**2, 0.0) / (plain**2 - floor**2)) - 1.0


class Outcome(StrEnum):
    """Whether a compensation is recommended, and why none is."""

    RECOMMENDED = "recommended"
    FINER_STEP = "finer_step"  # no gain of the sweep lowers the error; one between them may
    NOT_LOWERED = "not_lowered"  # no safe gain does
    NOT_RESOLVED = "not_resolved"  # the encoder does not resolve the error without compensation


class Variant(StrEnum):
    """What is compensated, and by which speed."""

    NONE = "none"
    SIMPLE = "Coulomb + viscous"
    ALL = "all effects"
    COMMANDED = "all effects, commanded speed"
    ADAPTIVE = "adaptive"
    PERFECT = "perfect model"
    OBSERVER = "disturbance observer"
    RECOMMENDED = "as recommended"
    FLOOR = "axis without friction"


@dataclass(frozen=True)
class Row:
    """One run of the study.

    Attributes
    ----------
    variant : Variant
    motion : str
        Name of the trial.
    factor : float
        On the compensated parameters.
    metrics : Metrics
    """

    variant: Variant
    motion: str
    factor: float
    metrics: Metrics


def _window(window: GainWindow) -> dict[str, Any]:
    """Return a window for JSON: where already the first gain is not safe, no highest safe gain but the one below it."""
    below = first_unsafe(window)
    told = {name: value for name, value in vars(window).items() if name != "unresolved"}
    safe = {"safe": window.safe if below is None else None, "safe_below": below}
    return told | safe | {"cycle_counts": window.cycle_counts}


@dataclass(frozen=True, eq=False)
class CompensationStudy(Result):
    """What compensation does to an axis.

    Attributes
    ----------
    design : Design
        As given.
    table : tuple of Row
    windows : dict of str to GainWindow
        By source.
    not_compensated : tuple of str
        Effects that a compensator cannot evaluate, and why.
    theory : Hunting or None
        Limit cycle at rest without compensation, solved exactly for loops without lags; None when there is none.
    verdicts : tuple of Verdict
        Of the design's own acceptance.
    observer : ObserverDesign or None
        The disturbance observer that friction feedforward is compared with; None where the loops leave no margin.
    examples : tuple of Example
        A reversal and a circle, sample by sample, as recommended; with all effects at full gain where nothing is.
    recommendation : Recommendation or None
        None where no safe gain lowers the error, or the encoder does not resolve it: see `verdict`.
    doubt : Doubt
        By how much the compensated parameters are assumed to be off where the error is judged.
    """

    design: Design
    table: tuple[Row, ...]
    windows: dict[str, GainWindow]
    not_compensated: tuple[str, ...] = ()
    theory: Hunting | None = None
    verdicts: tuple[Verdict, ...] = ()
    observer: ObserverDesign | None = None
    examples: tuple[Example, ...] = field(default=(), repr=False)
    recommendation: Recommendation | None = None
    doubt: Doubt = field(default_factory=Doubt)

    @property
    def recommended(self) -> Design | None:
        """The design with the recommended compensation; None where nothing is recommended."""
        if self.recommendation is None:
            return None
        chosen = self.recommendation.compensation
        if chosen.source == "observer" and chosen.bandwidth is None and self.observer is not None:
            chosen = chosen.model_copy(update={"bandwidth": float(f"{self.observer.bandwidth:.4g}")})
        return self.design.model_copy(update={"compensation": chosen})

    @property
    def verdict(self) -> Outcome:
        """Whether a compensation is recommended, and why none is."""
        if self.recommendation is not None:
            return Outcome.RECOMMENDED
        if not any(window.resolved for window in self.windows.values()):
            return Outcome.NOT_RESOLVED
        finer = any(finer_may_help(window) for window in self.windows.values())
        return Outcome.FINER_STEP if finer else Outcome.NOT_LOWERED

    @property
    def unresolved(self) -> tuple[Unresolved, ...]:
        """Motions of the sweep whose error the encoder does not resolve without compensation: no source changes it."""
        return next((window.unresolved for window in self.windows.values()), ())

    @property
    def accepted(self) -> bool:
        """Whether every line of the design's acceptance is met; true where it has none."""
        return all(verdict.passed for verdict in self.verdicts)

    @property
    def notices(self) -> tuple[Notice, ...]:
        """Reasons to doubt the compensation."""
        failed = (verdict for verdict in self.verdicts if not verdict.passed)
        out = [notices.ACCEPTANCE(line=notices.sentence(verdict)) for verdict in failed]
        out += [notices.NOT_COMPENSATED(effect=effect) for effect in self.not_compensated]
        gain, source = self.design.compensation.share, self.design.compensation.source
        window = self.windows.get("reference" if source == "adaptive" else source)
        if window is not None and gain > window.safe:
            out.append(notices.UNSAFE_DESIGN(gain=100.0 * gain, source=source, safe=notices.safe_gain(window)))
        short = (window for source, window in self.windows.items() if window.safe < 1.0 and source != "observer")
        out += [notices.UNSAFE(source=window.source, safe=notices.safe_gain(window)) for window in short]
        if self.unresolved:
            none = self.verdict == Outcome.NOT_RESOLVED
            told = notices.motions_in_counts(self.unresolved)
            out.append((notices.NONE_RESOLVED if none else notices.UNRESOLVED)(motions=told))
        if (floor := self._at_floor()) is not None:
            out.append(notices.FLOOR(change=100.0 * floor, own=-100.0 * self.friction_change(Variant.ALL)))
        cycles = {r.motion for r in self.table if r.variant == Variant.NONE and r.metrics.cycle_amplitude > 0.0}
        if cycles:
            out.append(notices.CYCLES(motions=", ".join(sorted(cycles))))
        return tuple(out)

    def _at_floor(self) -> float | None:
        """Return the change of the RMS error at reversals where only noise is left; None where more can be gained."""
        rms = {(r.variant, r.motion): r.metrics.rms for r in self.table if r.factor == 1.0}
        pairs = [(rms[Variant.ALL, motion], value) for (variant, motion), value in rms.items()
                 if variant == Variant.FLOOR and motion.startswith("reversal")]  # fmt: skip
        reached = pairs and self.resolved_motions() and all(left <= AT_FLOOR * floor for left, floor in pairs)
        change = self.change(Variant.ALL) if reached else -1.0
        return change if change > FRICTION_SHOWS else None

    def change(self, variant: str, metric: str = "rms", factor: float = 1.0, motion: str = "reversal") -> float:
        """Return the worst change of a metric against no compensation; -0.8 is -80 %.

        Of the motions those count whose error the encoder resolves without compensation; all where it resolves none.

        Parameters
        ----------
        variant : str
            A `Variant`.
        metric : str
        factor : float
            On the compensated parameters.
        motion : str
            Motions whose name begins so count.

        Returns
        -------
        float
        """
        plain = {row.motion: row.metrics for row in self.table if row.variant == Variant.NONE}
        shown = self.resolved_motions(motion) or plain
        return max(
            float(getattr(row.metrics, metric) / getattr(plain[row.motion], metric)) - 1.0
            for row in self.table
            if row.variant == variant and row.factor == factor and row.motion.startswith(motion) and row.motion in shown
        )

    def resolved_motions(self, motion: str = "reversal") -> tuple[str, ...]:
        """Return the motions of the table whose error the encoder resolves without compensation.

        Parameters
        ----------
        motion : str
            Motions whose name begins so count.

        Returns
        -------
        tuple of str
        """
        count = next((window.count for window in self.windows.values()), 0.0)
        rows = (row for row in self.table if row.variant == Variant.NONE and row.motion.startswith(motion))
        return tuple(row.motion for row in rows if resolves(row.metrics, count))

    def friction_change(self, variant: str, factor: float = 1.0, motion: str = "reversal") -> float:
        """Return the worst change of the RMS error that friction causes; -0.9 is -90 %.

        The RMS error of the axis without friction (noise, loops) is taken out of both sides: the errors of friction
        and of the noise are independent, so their squares add.

        Parameters
        ----------
        variant : str
            A `Variant`.
        factor : float
            On the compensated parameters.
        motion : str
            Motions whose name begins so count.

        Returns
        -------
        float
            NaN where friction adds nothing to the error.
        """
        rms = {(r.variant, r.motion, r.factor): r.metrics.rms for r in self.table}
        changes = [
            own_change(value, rms[Variant.NONE, name, 1.0], rms[Variant.FLOOR, name, 1.0])
            for (which, name, by), value in rms.items()
            if which == variant and by == factor and name.startswith(motion)
        ]
        return max(changes)

    def to_dict(self) -> dict[str, Any]:
        """Return plain values fit for JSON."""
        return dict(jsonable({
            "schema": "pmsm-ctrl/compensation/1",
            "verdict": self.verdict,
            **self.doubts(),
            "units": units_of(self.design.motion),
            "parameter_error": asdict(self.doubt),
            "runs": [
                {"variant": r.variant, "motion": r.motion, "factor": r.factor, **asdict(r.metrics)} for r in self.table
            ],
            "windows": {source: _window(window) for source, window in self.windows.items()},
            "unresolved": [
                {"motion": one.motion, "rms_counts": one.rms, "peak_counts": one.peak} for one in self.unresolved
            ],
            "recommended": None if self.recommendation is None or self.recommended is None else {
                **self.recommended.compensation.model_dump(include={"source", "gain", "effects", "bandwidth"}),
                "rms": self.recommendation.rms, "rms_of_others": self.recommendation.others,
            },
            "observer": None if self.observer is None else {
                "bandwidth": self.observer.bandwidth, "worst_corner": self.observer.worst.name,
                "sensitivity_peak": [
                    self.observer.before.sensitivity_peak, self.observer.after.sensitivity_peak,
                    self.observer.worst.speed.sensitivity_peak,
                ],
            },
            "hunting_in_theory": None if self.theory is None else asdict(self.theory),
            "acceptance": [
                {**v.wanted.model_dump(), "value": v.value, "unit": v.unit, "passed": v.passed} for v in self.verdicts
            ],
        }))  # fmt: skip

"""diagnose: which effect is missing from a design, and the result that says so."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose.calibration import Calibration, calibrated, repeated
from pmsm_ctrl.diagnose.exchange import select_with_exchange
from pmsm_ctrl.diagnose.fit import fit_design
from pmsm_ctrl.diagnose.leftover import Leftover
from pmsm_ctrl.diagnose.outcome import build_outcome
from pmsm_ctrl.diagnose.selection import Selection
from pmsm_ctrl.effects.base import Effect
from pmsm_ctrl.effects.catalogue import catalogue_of
from pmsm_ctrl.errors import RequestError, nearest
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.balances import STANDSTILL, Record, make_record
from pmsm_ctrl.regression.conditioning import Processing
from pmsm_ctrl.result import Estimate, Result, Section, jsonable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Diagnosis", "DiagnosisStep", "Ranked", "diagnose"]

Errors = Mapping[str, Mapping[str, Any]]


@dataclass(frozen=True)
class DiagnosisStep:
    """One accepted effect.

    Attributes
    ----------
    parameters : dict of symbol to Estimate
    error_before, error_after, holdout_before, holdout_after : dict of balance to rms, unit and relative error
        The held-out ones are empty without a held-out record.
    """

    effect: str
    equivalents: tuple[str, ...]
    parameters: Mapping[str, Estimate]
    error_before: Errors
    error_after: Errors
    holdout_before: Errors
    holdout_after: Errors
    evidence: Mapping[str, Any]


@dataclass(frozen=True)
class Ranked:
    """One candidate of the last round: what it would explain, and why it was not taken.

    Attributes
    ----------
    shown_from : dict of symbol to Estimate
        Amounts, each alone, from which on this log would show an effect that it does not show: those that a test that
        knows its shape finds in half of all logs. Infinite where no amount inside its bounds is enough; empty where
        the log shows the effect, or cannot evaluate it.
    """

    effect: str
    explained: float
    p_value: float
    accepted: bool
    why_not: str
    shown_from: Mapping[str, Estimate] = field(default_factory=dict)


@dataclass(frozen=True)
class Deviation:
    """A base parameter, estimated inside its tolerance."""

    parameter: str
    nominal: float
    estimate: float
    stderr: float
    unit: str
    flagged: bool
    note: str = ""


@dataclass(frozen=True, eq=False)
class Diagnosis(Result):
    """Which effects a log says are missing from a design.

    Attributes
    ----------
    verdict : {"consistent", "effects_missing", "unexplained", "not_excited"}
    design : Design
        With the accepted effects, their parameters and standard errors, and the base parameters refitted.
    errors : dict of {"nominal", "base", "final", "noise_floor"} to balance to rms, unit, relative
    next_experiment : dict or None
    unexplained : str
        What is left and on what it depends; empty when nothing is.
    calibration : Calibration or None
        False alarms at the accepted model, simulated; None where that was not asked for.
    """

    verdict: str
    design: Design
    errors: Mapping[str, Errors]
    steps: tuple[DiagnosisStep, ...]
    ranking: tuple[Ranked, ...]
    parameter_deviations: tuple[Deviation, ...]
    next_experiment: Mapping[str, Any] | None
    reasons: tuple[str, ...]
    unexplained: str
    log_name: str
    holdout_name: str
    left: Leftover | None = field(repr=False)
    record: Record = field(repr=False)
    selection: Selection = field(repr=False)
    calibration: Calibration | None = None

    @property
    def warnings(self) -> tuple[str, ...]:
        """Reasons to doubt the answer."""
        doubt = self.calibration.doubt if self.calibration is not None else ""
        return (*self.reasons, doubt) if doubt else self.reasons

    def summary(self) -> str:
        """Return the verdict, the ladder of errors and the ranking as text, trust first."""
        from pmsm_ctrl.diagnose.text import summary_text

        return summary_text(self)

    def plot(self) -> Figure:
        """Draw the ladder of errors and the residual before and after."""
        from pmsm_ctrl.diagnose.figures import ladder_figure

        return ladder_figure(self)

    def to_dict(self) -> dict[str, Any]:
        """Return the schema ``pmsm-ctrl/diagnosis/1``."""
        return jsonable({
            "schema": "pmsm-ctrl/diagnosis/1",
            "verdict": self.verdict,
            "log": self.log_name,
            "holdout": self.holdout_name or None,
            "errors": self.errors,
            "steps": [
                {
                    "effect": s.effect,
                    "equivalents": s.equivalents,
                    "parameters": s.parameters,
                    "error_before": s.error_before,
                    "error_after": s.error_after,
                    "holdout_before": s.holdout_before,
                    "holdout_after": s.holdout_after,
                    "evidence": s.evidence,
                }
                for s in self.steps
            ],
            "ranking": [vars(r) for r in self.ranking],
            "parameter_deviations": [vars(d) for d in self.parameter_deviations],
            "next_experiment": self.next_experiment,
            "unexplained": self.unexplained,
            "calibration": vars(self.calibration) if self.calibration is not None else None,
            "warnings": self.warnings,
        })  # fmt: skip

    def section(self) -> Section:
        """Return the section of the report: ladder, ranking, residual maps, contributions."""
        from pmsm_ctrl.diagnose.text import report_section

        return report_section(self)


def diagnose(
    design: Design,
    log: Log,
    *,
    holdout: Log | None = None,
    progress: Callable[[float], None] | None = None,
    candidates: Iterable[str] | None = None,
    processing: Processing | None = None,
    calibrate: int = 0,
    plan: bool = True,
) -> Diagnosis:
    """Name the physical effects that a design lacks, judged by a log.

    The base parameters are re-estimated inside their tolerance; candidates are accepted one at a time by a
    prewhitened group F-test (Holm over all candidates), the gain on left-out blocks, and the gain on the held-out
    record; everything is refitted each time, until nothing passes.

    Parameters
    ----------
    design : Design
    log : Log
        With ``theta`` or ``omega``, and ``torque`` or ``i_q``; with ``u_d`` and ``u_q`` the winding is judged too.
    holdout : Log, optional
        Another record of the same axis; no effect is accepted that makes it worse.
    progress : function, optional
        Called with the share done, 0 to 1.
    candidates : iterable of str, optional
        Ids to choose from; the whole catalogue and the own effects when left out.
    processing : Processing, optional
        Filter, derivative and mask.
    calibrate : int
        Simulations of the accepted model, each diagnosed again, that say how often this diagnosis raises a false
        alarm on this motion; each takes about as long as the diagnosis itself.
    plan : bool
        Whether to look for the next experiment where the log cannot tell two effects apart: eight motions are
        simulated, some seconds.

    Raises
    ------
    LogError
        When a channel is missing or the axis hardly moves; with `calibrate`, when the log has no references.
    DesignError, RequestError
        When the design or `candidates` names an unknown effect; with `calibrate`, when the drive cannot be simulated.
    """
    if calibrate < 0:
        raise RequestError(f"calibrate: found {calibrate}; the number of simulations, 0 or more, was expected")
    if calibrate:
        repeated(design, log)  # what cannot be simulated is said before the work, not after it
    effects = catalogue_of(design)
    offered = _offered(effects, candidates)
    record = _record(design, log, processing)
    same = processing or Processing(standstill=STANDSTILL, cutoff=record.prepared.cutoff)
    other = make_record(design, holdout, same, record.age or 0.0) if holdout is not None else None
    share = 1.0 / (1.0 + calibrate)
    first = None if progress is None else partial(_part, progress, 0.0, share)
    selection = select_with_exchange(design, record, offered, other, first)
    outcome = build_outcome(design, record, other, selection, offered, plan)
    record.kept.clear()  # hundreds of columns, for which no one asks any more
    found = Diagnosis(
        **outcome,
        log_name=log.provenance.file or "the given log",
        holdout_name=(holdout.provenance.file or "the held-out log") if holdout is not None else "",
        record=record,
        selection=selection,
    )
    if calibrate:
        rest = None if progress is None else partial(_part, progress, share, 1.0 - share)
        found = replace(found, calibration=calibrated(found, log, calibrate, tuple(offered), rest))
    if progress is not None:
        progress(1.0)
    return found


def _record(design: Design, log: Log, processing: Processing | None) -> Record:
    """Make a log ready; where it has a speed alone, its age is estimated with the base model, and undone."""
    record = make_record(design, log, processing)
    for _ in range(2 if record.age is not None else 0):
        fit = fit_design(design, record, (), {}, explore=False)
        late = float(fit.plain.values[fit.model.names.index("tau_speed")])
        record = make_record(design, log, processing, (record.age or 0.0) + late)
    return record


def _part(progress: Callable[[float], None], start: float, share: float, done: float) -> None:
    progress(start + share * done)


def _offered(effects: Mapping[str, Effect], candidates: Iterable[str] | None) -> dict[str, Effect]:
    if candidates is None:
        return dict(effects)
    out = {}
    for identifier in candidates:
        if identifier not in effects:
            raise RequestError(f"unknown effect '{identifier}'{nearest(identifier, effects)}")
        out[identifier] = effects[identifier]
    return out

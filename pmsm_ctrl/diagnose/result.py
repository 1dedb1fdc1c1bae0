"""The answer of a diagnosis: frozen values, no words and no figures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose.contributions import Contributions, contributions_of
from pmsm_ctrl.diagnose.event import Event
from pmsm_ctrl.diagnose.held_out import held_out
from pmsm_ctrl.diagnose.refusal import Refusal
from pmsm_ctrl.diagnose.selection import Selection
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.regression.drive_timing import LATENESS, DriveTiming
from pmsm_ctrl.regression.lateness import lateness
from pmsm_ctrl.regression.record_result import Errors, RecordResult, RecordSpread
from pmsm_ctrl.result import Estimate, Result, Verdict, jsonable
from pmsm_ctrl.section import Notice

__all__ = [
    "Agreement",
    "Calibration",
    "Deviation",
    "Diagnosis",
    "DiagnosisStep",
    "Errors",
    "Ranked",
    "Structure",
    "Verdict",
]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class DiagnosisStep:
    """One accepted effect.

    Attributes
    ----------
    effect, name, title : str
        The id; the id with the order where the effect has one; the title.
    equivalents : tuple of str
        Ids of the effects that this log cannot tell from it.
    parameters : dict of symbol to Estimate
    error_before, error_after, holdout_before, holdout_after : dict of balance to rms, unit and relative error
        The held-out ones are empty without a held-out record.
    evidence : dict
        Gains and p-values.
    free_run : dict
        Error of the position when the whole log is simulated from the torque alone, after this step: ``rms``, ``unit``
        and ``fit``, 1 less the error's share of the position's standard deviation. Empty where that is not possible.
    """

    effect: str
    name: str
    title: str
    equivalents: tuple[str, ...]
    parameters: Mapping[str, Estimate]
    error_before: Errors
    error_after: Errors
    holdout_before: Errors
    holdout_after: Errors
    evidence: Mapping[str, Any]
    free_run: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Ranked:
    """One candidate of the last round: what it would explain, and why it was not accepted.

    Attributes
    ----------
    effect : str
    explained : float
        Share of the design's sum of squares.
    p_value : float
    refusal : Refusal or None
        None for an accepted effect.
    shown_from : dict of symbol to Estimate
        Amounts, each alone, from which on this log would show an effect that it does not show: those that a test that
        knows its shape finds in half of all logs. Infinite where no amount inside its bounds is enough; empty where
        the log shows the effect, or cannot evaluate it.
    """

    effect: str
    explained: float
    p_value: float
    refusal: Refusal | None = None
    shown_from: Mapping[str, Estimate] = field(default_factory=dict)

    @property
    def accepted(self) -> bool:
        """Whether the effect was accepted."""
        return self.refusal is None

    @property
    def why_not(self) -> str:
        """Why not, in words; empty for an accepted effect."""
        return "" if self.refusal is None else str(self.refusal)

    def to_dict(self) -> dict[str, Any]:
        """Return plain values fit for JSON."""
        return {
            "effect": self.effect, "explained": self.explained, "p_value": self.p_value, "accepted": self.accepted,
            "why_not": self.why_not, "why_not_code": "" if self.refusal is None else self.refusal.reason.value,
            "shown_from": self.shown_from,
        }  # fmt: skip


@dataclass(frozen=True)
class Deviation:
    """A base parameter, estimated inside its tolerance.

    Attributes
    ----------
    parameter : str
    nominal, estimate, stderr : float
        In `unit`.
    unit : str
    outside : bool
        Whether it is outside by more than its standard error allows.
    flagged : bool
        Whether it is outside, and explains most of the residual where it acts by being there.
    note : str
        Why it is flagged, or why it is not.
    """

    parameter: str
    nominal: float
    estimate: float
    stderr: float
    unit: str
    outside: bool
    flagged: bool
    note: str = ""


@dataclass(frozen=True, eq=False)
class Structure:
    """A dependence of the residual that no effect of the catalogue explains.

    Attributes
    ----------
    coordinate, unit : str
    channel : str
        The balance it shows in.
    share : float
        Part of the residual's mean square that a smooth curve explains, by cross-validation; or else the effect that
        it resembles.
    p_value : float
    curve : (array, array, array)
        Coordinate, and fitted residual moving forward and backward, SI units; means where nothing was fitted.
    notice : Notice
    resembles : str
        The effect, or the part of the winding, that it resembles without being it; empty where a curve was fitted.
    confirmed : bool
        Whether left-out blocks confirm it, as far as they can: otherwise it is an open question.
    """

    coordinate: str
    unit: str
    channel: str
    share: float
    p_value: float
    curve: tuple[Array, Array, Array]
    notice: Notice
    resembles: str = ""
    confirmed: bool = True


@dataclass(frozen=True)
class Calibration:
    """False alarms of the diagnosis at the accepted model, simulated through the log's own experiment.

    Attributes
    ----------
    runs : int
    alarms : tuple of str
        What was named, or the verdict, one a run that was not ``consistent``.
    """

    runs: int
    alarms: tuple[str, ...]

    @property
    def most(self) -> float:
        """Upper end of the 95 % interval of the false-alarm rate. Source: Clopper and Pearson, Biometrika 26 (1934)."""
        from scipy.special import betaincinv

        k = len(self.alarms)
        return 1.0 if k >= self.runs else float(betaincinv(k + 1, self.runs - k, 0.975 if k else 0.95))


@dataclass(frozen=True)
class Agreement:
    """Whether a spring that a diagnosis names, or none, is what a frequency response has shown.

    Attributes
    ----------
    log_name : str
        What the response was measured on.
    effect : str
        The id; empty where none was named.
    agrees : bool or None
        Within the joint errors; None where these are not known, or allow either answer.
    diagnosed, frf : dict of name to Estimate
        Antiresonance, load inertia and damping ratio; empty where there is none. Of a log that names no spring the
        load inertia behind that of the response.
    """

    log_name: str
    effect: str
    agrees: bool | None
    diagnosed: Mapping[str, Estimate] = field(default_factory=dict)
    frf: Mapping[str, Estimate] = field(default_factory=dict)

    @property
    def apart(self) -> dict[str, float]:
        """By how many joint standard errors the two differ."""
        common = [name for name in self.diagnosed if name in self.frf]
        pairs = {name: (self.diagnosed[name], self.frf[name]) for name in common}
        return {
            name: abs(own.value - other.value) / max(float(np.hypot(own.stderr, other.stderr)), 1e-300)
            for name, (own, other) in pairs.items()
        }


@dataclass(frozen=True, eq=False)
class Diagnosis(Result):
    """Which effects a log says are missing from a design.

    Attributes
    ----------
    verdict : Verdict
    design : Design
        With the accepted effects, their parameters and standard errors, and the base parameters refitted.
    errors : dict of {"nominal", "base", "final", "noise_floor"} to balance to rms, unit, relative
    steps : tuple of DiagnosisStep
        In the order of acceptance.
    ranking : tuple of Ranked
        Accepted effects, then the candidates of the last round, best first.
    parameter_deviations : tuple of Deviation
    next_experiment : dict or None
        The motion that would separate an accepted effect from one that this log cannot tell from it.
    notices : tuple of Notice
        Reasons to doubt the answer.
    left : Notice or None
        What no effect of the catalogue explains; one of the notices.
    structure : Structure or None
        The same as a curve, where it has one.
    record : Record
    selection : Selection
        The fits before and after every step.
    calibration : Calibration or None
        False alarms at the accepted model, simulated; None where that was not asked for.
    reasons : tuple of Notice
        What the verdict rests on, the likeliest first; empty for ``consistent`` and ``effects_missing``, which the
        errors and the steps support.
    events : tuple of Event
        Stretches that were left out, and steps of the friction.
    free_run : dict of {"nominal", "base", "final"} to dict
        As in `DiagnosisStep`.
    base : dict of symbol to Estimate
        Inertia and friction of the base model, refitted, with what the design states: `nominal` is None for friction
        that it does not state.
    records : tuple of RecordResult
        Every record, those that were held out last.
    spreads : tuple of RecordSpread
        By how much friction and a constant torque differ between records; empty for a log that is one record.
    log_name, holdout_name : str
        The latter is empty without a held-out record.
    improved : bool
        False where the fitted design would be worse on its own log than the given one: then `design` is the given one.
    remarks : tuple of Notice
        Whether the parameters were refined by simulation, where that was asked for.
    resonance : Agreement or None
        With the frequency response that was given; None without one.
    holdouts : tuple of Record
        Those that were held out.
    """

    verdict: Verdict
    design: Design
    errors: Mapping[str, Errors]
    steps: tuple[DiagnosisStep, ...]
    ranking: tuple[Ranked, ...]
    parameter_deviations: tuple[Deviation, ...]
    next_experiment: Mapping[str, Any] | None
    notices: tuple[Notice, ...]
    left: Notice | None
    structure: Structure | None = field(repr=False)
    record: Record = field(repr=False)
    selection: Selection = field(repr=False)
    calibration: Calibration | None = None
    reasons: tuple[Notice, ...] = ()
    events: tuple[Event, ...] = ()
    free_run: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    base: Mapping[str, Estimate] = field(default_factory=dict)
    records: tuple[RecordResult, ...] = ()
    spreads: tuple[RecordSpread, ...] = ()
    log_name: str = "the given log"
    holdout_name: str = ""
    improved: bool = True
    remarks: tuple[Notice, ...] = ()
    resonance: Agreement | None = None
    holdouts: tuple[Record, ...] = field(default=(), repr=False)

    @property
    def timing(self) -> DriveTiming:
        """How far the drive signal lags the position, and the filter that it passed."""
        fit, undone = self.selection.fit, self.record.timing
        return DriveTiming(undone.late + lateness(fit.model, fit.plain.values), undone.lag)

    @property
    def timing_stderr(self) -> float:
        """Standard error of that lag, s; 0 where the log does not tell it."""
        names, stderr = self.selection.fit.model.names, self.selection.fit.plain.stderr
        return float(stderr[names.index(LATENESS)]) if LATENESS in names else 0.0

    @property
    def level_refitted(self) -> bool:
        """Whether held-out records are judged with the level of their friction refitted: where several are fitted."""
        return sum(not row.held_out for row in self.records) > 1

    def contributions(self, channel: str = "torque") -> Contributions:
        """Take the prediction of a balance apart: what every effect that was found contributes, over time.

        Parameters
        ----------
        channel : str
            The balance: ``torque``, ``u_d`` or ``u_q``.

        Returns
        -------
        Contributions
            Its `rest` and `effects` sum to `predicted`.

        Raises
        ------
        RequestError
            When the log has no such balance.
        """
        return contributions_of(self.selection.fit, channel, self.record.signals["direction"])

    def held_out(self, number: int) -> dict[str, Contributions]:
        """Take the prediction of a held-out record apart.

        Parameters
        ----------
        number : int
            Which of them, from 0.

        Returns
        -------
        dict of balance to Contributions
            The balances that the fitted record has as well.

        Raises
        ------
        RequestError
            When there is no such record.
        """
        if not 0 <= number < len(self.holdouts):
            raise RequestError(f"held-out record {number}: there are {len(self.holdouts)}")
        record, fit, design = self.holdouts[number], self.selection.fit, self.record.design
        found = held_out(design, record, fit, len(self.record.records) > 1)
        return found.contributions(design, fit, record.signals["direction"])

    @property
    def unexplained(self) -> str:
        """What no effect of the catalogue explains, in words; empty when there is nothing."""
        return self.left.text if self.left is not None else ""

    def to_dict(self) -> dict[str, Any]:
        """Return the schema ``pmsm-ctrl/diagnosis/1``."""
        out: dict[str, Any] = jsonable({
            "schema": "pmsm-ctrl/diagnosis/1",
            "verdict": self.verdict.value,
            "reasons": [reason.text for reason in self.reasons],
            "reason_codes": [reason.code for reason in self.reasons],
            "log": self.log_name,
            "holdout": self.holdout_name or None,
            "errors": self.errors,
            "base": {"parameters": self.base},
            "free_run": self.free_run,
            "steps": [vars(step) for step in self.steps],
            "ranking": [row.to_dict() for row in self.ranking],
            "parameter_deviations": [vars(d) for d in self.parameter_deviations],
            "timing": {
                **{name: getattr(self.timing, name) for name in ("late", "lag", "sure")}, "stderr": self.timing_stderr,
            },
            "next_experiment": self.next_experiment,
            "unexplained": self.unexplained,
            "unexplained_code": self.left.code if self.left is not None else "",
            "records": [row.to_dict() for row in self.records],
            "spread_between_records": [vars(one) for one in self.spreads],
            "improved": self.improved,
            "notes": [note.text for note in self.remarks],
            "events": [event.to_dict() for event in self.events],
            "frf": vars(self.resonance) if self.resonance is not None else None,
            "calibration": vars(self.calibration) if self.calibration is not None else None,
            **self.doubts(),
        })  # fmt: skip
        return out

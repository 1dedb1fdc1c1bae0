"""identify: friction and inertia from any log, by inverse dynamics or by simulation."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from itertools import count
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects.catalogue import catalogue_of
from pmsm_ctrl.errors import RequestError, nearest
from pmsm_ctrl.identify import notices as words
from pmsm_ctrl.identify.beside import apart, by_instruments
from pmsm_ctrl.identify.doubts import contradictions_of, doubts, large, left_out, verdict
from pmsm_ctrl.identify.effective import effective_only
from pmsm_ctrl.identify.evaluation import as_diagnosed, by_method, sampled_log
from pmsm_ctrl.identify.instrumental import BiasTest
from pmsm_ctrl.identify.over_cutoff import inertia_over_cutoff, moved
from pmsm_ctrl.identify.replay import replayable
from pmsm_ctrl.identify.solution import Method
from pmsm_ctrl.log import Log, Logs, as_logs, names_of
from pmsm_ctrl.plausibility import doubts_about, with_inertia
from pmsm_ctrl.plausibility.late_steps import moved_by_its_steps
from pmsm_ctrl.regression.conditioning import Processing
from pmsm_ctrl.regression.drive_timing import SYNCHRONOUS, DriveTiming, Sampling
from pmsm_ctrl.regression.fast_orders import orders_beyond
from pmsm_ctrl.regression.inverse_dynamics import Problem
from pmsm_ctrl.regression.least_squares import Fit
from pmsm_ctrl.regression.notices import SAMPLED_IN_STEP
from pmsm_ctrl.regression.record_result import RecordResult, RecordSpread, record_notices
from pmsm_ctrl.regression.timed_record import with_friction
from pmsm_ctrl.result import Estimate, Result, jsonable
from pmsm_ctrl.section import Notice
from pmsm_ctrl.units import axis_unit

__all__ = ["Identification", "Method", "identify"]

Array = NDArray[np.float64]
SAMPLED, SOLVED = 0.2, 0.8  # share of the work that is done when the sampling is known, and when the fit is made
ROUNDS = 10.0  # of a fit by simulation after which half of its share is told; how many it takes is not known before


@dataclass(frozen=True, eq=False)
class Identification(Result):
    """What a log says about a design's parameters.

    Attributes
    ----------
    design : Design
        The given design with the identified values and their standard errors; parameters that could not be
        identified keep the values they had.
    estimates : dict of name to Estimate
    intervals : dict of name to (float, float)
        95 % intervals by Student's t with the effective degrees of freedom.
    unidentifiable : dict of name to Notice
        Parameters that got no number, and why.
    problem, fit : Problem, Fit
        The regression that was solved; of "output_error" the problem linear at the solution.
    shown : Problem
        The regression with nothing blanked, for errors and figures.
    unexplained : array, shape (m,)
        Measured less predicted torque of `shown`.
    relative_error : float
        norm(unexplained) / norm(torque) on its moving samples.
    rms : float
        Of the unexplained torque there, N m (N).
    log_name : str
    notices : tuple of Notice
        Reasons to doubt the numbers.
    method : {"regression", "iv", "output_error"}
    bias : BiasTest or None
        Whether least squares is biased on this log; of the method "iv".
    remarks : tuple of Notice
        What was understood of the log's experiment; no reason to doubt anything.
    contradictions : tuple of Notice
        Why log and design do not belong together, the likeliest reason first; they stand first in `notices`.
    records : tuple of RecordResult
        Each of several records: its errors, and what it has of its own.
    spreads : tuple of RecordSpread
        By how much friction and a constant torque differ between them.
    sampling : Sampling
        How the drive signal was sampled: stated, found and undone, or a nuisance of the fit.
    improved : bool
        Whether `design` is the identified one: False where that would be worse on this log than the given one.
    over_cutoff : dict of float to Estimate
        The inertia by cutoff in Hz, that of the answer included; empty where that was not asked for.
    """

    design: Design
    estimates: Mapping[str, Estimate]
    intervals: Mapping[str, tuple[float, float]]
    unidentifiable: Mapping[str, Notice]
    relative_error: float
    rms: float
    problem: Problem
    fit: Fit
    shown: Problem
    unexplained: Array
    log_name: str
    notices: tuple[Notice, ...] = ()
    method: Method = "regression"
    bias: BiasTest | None = None
    remarks: tuple[Notice, ...] = ()
    contradictions: tuple[Notice, ...] = ()
    records: tuple[RecordResult, ...] = ()
    spreads: tuple[RecordSpread, ...] = ()
    sampling: Sampling = SYNCHRONOUS
    improved: bool = True
    over_cutoff: Mapping[float, Estimate] = field(default_factory=dict)

    @property
    def timing(self) -> DriveTiming:
        """How the drive signal was sampled, beside the position."""
        return self.sampling.whole

    def to_dict(self) -> dict[str, Any]:
        """Return plain values fit for JSON."""
        plain: dict[str, Any] = jsonable({
            "schema": "pmsm-ctrl/identification/1",
            "log": self.log_name,
            "method": self.method,
            "plausible": not self.contradictions,
            **self.doubts(),
            "parameters": self.estimates,
            "intervals_95": self.intervals,
            "at_bound": list(self.fit.at_bound),
            "not_identifiable": {name: why.text for name, why in self.unidentifiable.items()},
            "not_identifiable_codes": {name: why.code for name, why in self.unidentifiable.items()},
            "records": [row.to_dict() for row in self.records],
            "spread_between_records": [vars(one) for one in self.spreads],
            "relative_error": self.relative_error,
            "improved": self.improved,
            "rms": {"value": self.rms, "unit": self.problem.unit},
            "condition_number": self.fit.condition,
            "effective_degrees_of_freedom": self.fit.dof,
            "samples": int(self.problem.mask.sum()),
            "rate": self.problem.rate,
            "cutoff": self.problem.cutoff,
            "inertia_cutoff": self.problem.inertia_cutoff,
            "inertia_over_cutoff": [{"cutoff": hz, **jsonable(found)} for hz, found in self.over_cutoff.items()],
            "timing": {
                "late": self.timing.late, "filter": self.timing.lag, "stderr": self.sampling.stderr, "unit": "s",
            },
            "notes": [note.text for note in self.remarks],
            "least_squares_bias": None if self.bias is None else vars(self.bias),
        })  # fmt: skip
        return plain


def identify(
    design: Design, log: Logs, *, method: Method = "regression", processing: Processing | None = None,
    check_cutoff: bool = False, check_method: bool = False, progress: Callable[[float], None] | None = None,
) -> Identification:  # fmt: skip
    """Identify the inertia and the parameters of the design's effects from a log.

    ``T_em - T_load = J alpha + sum of effect terms``, both sides through the same zero-phase filter. Source of the
    method: M. Gautier, A. Janot, P. O. Vandanjon, IEEE Trans. Control Syst. Technol. 21 (2013) 428.

    Parameters
    ----------
    design : Design
    log : Log or sequence of Log
        Several records share the inertia and, on average, the friction; each has friction and a constant torque of its
        own, which are fitted beside them and drawn towards the others by as much as they are uncertain.
        With ``theta`` or ``omega``, and ``torque`` or ``i_q``; for the methods that simulate, the references as well.
    method : {"regression", "iv", "output_error"}
        "regression": least squares for every linear parameter of the torque effects; needs nothing but the log.
        "iv": the same by instrumental variables from the simulated drive, unbiased by noise in the motion; also
        tests whether least squares is biased; it needs the design's loops and the log's ``omega_ref`` or ``theta_ref``.
        "output_error": all parameters, nonlinear ones included, by simulation: of the drive with its controller where
        log and design have these, else of the axis alone, driven by the logged torque in short stretches.
    processing : Processing, optional
        Filter, derivative and mask; the defaults suit a log of 1 kHz. Without a cutoff given, the methods that
        simulate work up to 100 Hz or an eighth of the log's rate, and up to 250 Hz or a quarter of it where an effect
        has a shape; least squares does so where the log tells much beyond 40 Hz and its angle is fine enough. Rests
        and reversals are blanked unless told otherwise.
    check_cutoff : bool
        Whether the inertia is found again at other cutoffs, with a warning where it moves beyond its interval. Of
        "regression" only.
    check_method : bool
        Whether the inertia is found again by "iv" where the drive can be simulated, with a warning where the two differ
        by more than both intervals. Of "regression" only.
    progress : function, optional
        Called with the share of the work that is done, after every round of a fit by simulation as well; an
        exception that it raises ends the identification.

    Returns
    -------
    Identification

    Raises
    ------
    RequestError
        For an unknown method.
    LogError
        When a channel is missing or the axis hardly moves.
    DesignError
        When the design names an unknown effect, or lacks what a simulation needs.
    SimulationError
        When the design's loops are not stable on the plant that the log suggests.
    """
    logs, advance = _checked(as_logs(log), method), progress or (lambda share: None)
    given, design = design, with_friction(with_inertia(design, logs))
    whole = (believed := doubts_about(design, log)).log
    blanked, usual = _blanking(processing or Processing()), method == "regression"
    advance(SAMPLED)
    if usual and processing is None:
        made = as_diagnosed(design, whole)
        if (late := moved_by_its_steps(believed, made.record)) is not None:
            believed, whole = late, late.log
            made = as_diagnosed(design, whole)
    else:
        made = by_method(method, design, *sampled_log(design, whole, blanked, method), _rounds(advance))
    advance(SOLVED)
    solution, used = made.solution, made.several.log
    problem, fit = solution.problem, solution.fit
    over: Mapping[float, Estimate] = {}
    if check_cutoff and usual:
        cut = (used, made.processing) if made.processing else sampled_log(design, used, blanked, method)
        over = inertia_over_cutoff(design, *cut, problem, fit)
    contradictions = (*believed.contradictions, *contradictions_of(design, fit))
    effective = None if contradictions else effective_only(made.found, made.record, used, made.sampling)
    advance(1.0)
    held = [note for note in problem.notes if note.code == SAMPLED_IN_STEP.code]
    notes = [note for note in problem.notes if note not in held]
    said = (
        *contradictions, *filter(None, (made.worse, effective)), *made.far, *held,
        *(left_out(given, made.record) if usual else ()), *record_notices(made.several.rows),
        *large(made.size["relative_error"]), *believed.notices[len(believed.contradictions) :], *notes,
        *made.folded, *orders_beyond(design, used, problem.cutoff), *solution.notices, *made.near, *doubts(design, fit),
        *moved(over, fit), *(_beside(design, whole, fit) if check_method and usual else ()),
    )  # fmt: skip
    return Identification(
        design=made.found if made.worse is None else design,
        improved=made.worse is None,
        estimates=_estimates(given, problem, fit),
        intervals={name: fit.interval(name) for name in fit.values},
        unidentifiable=_why_not(design, fit),
        **made.size,
        problem=problem,
        fit=fit,
        shown=made.shown,
        unexplained=made.unexplained,
        log_name=names_of(logs, "the given log"),
        notices=said,
        contradictions=contradictions,
        records=made.rows,
        spreads=made.several.spreads,
        method=method,
        bias=solution.bias,
        sampling=made.sampling,
        over_cutoff=over,
        remarks=(*solution.remarks, *verdict(solution.bias, fit)),
    )


def _beside(design: Design, log: Log, fit: Fit) -> tuple[Notice, ...]:
    """Return a notice where the simulated drive, if there is one, contradicts the inertia."""
    other = by_instruments(lambda: identify(design, log, method="iv")) if replayable(design, log) else None
    return apart(fit, other, axis_unit("kg m^2", log.motion))


def _rounds(advance: Callable[[float], None]) -> Callable[[], None]:
    """Return what a fit by simulation calls in every round."""
    done = count(1)

    def tell() -> None:
        k = next(done)
        advance(SAMPLED + (SOLVED - SAMPLED) * k / (k + ROUNDS))

    return tell


def _estimates(given: Design, problem: Problem, fit: Fit) -> dict[str, Estimate]:
    """Return the estimates beside what the given design states; None where that is nothing."""
    known = [column for column in problem.columns if column.name in fit.values]
    stated = {"", *(entry.id for entry in given.effects)}
    nominal = {c.name: c.nominal if (c.effect or "") in stated else None for c in known}
    return {c.name: Estimate(fit.values[c.name], c.unit, fit.stderr[c.name], nominal[c.name]) for c in known}


def _blanking(processing: Processing) -> Processing:
    """Return the processing with rests and reversals blanked, unless it says otherwise."""
    return replace(processing, blank=True) if processing.blank is None else processing


def _checked(logs: tuple[Log, ...], method: str) -> tuple[Log, ...]:
    """Return the logs; refuse an unknown method, and one that simulates a single log where there are several."""
    if method not in get_args(Method):
        known = ", ".join(get_args(Method))
        raise RequestError(f"identification method '{method}'{nearest(method, get_args(Method))} (known: {known})")
    if len(logs) > 1 and method == "iv":
        raise RequestError(f"method 'iv': {len(logs)} logs, but it simulates one; use 'regression' or 'output_error'")
    return logs


def _why_not(design: Design, fit: Fit) -> dict[str, Notice]:
    effects = catalogue_of(design)
    return {
        name: words.not_identifiable(lost, effects[lost.effect].needs if lost.effect else "acceleration")
        for name, lost in fit.unidentifiable.items()
    }

"""What a method finds in a log, and the error that it leaves there: for `identify`, which says what to think of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.evidence.linalg import factored
from pmsm_ctrl.identify.as_compared import as_compared, sizes
from pmsm_ctrl.identify.between_samples import with_folded_errors
from pmsm_ctrl.identify.several import Joint, joint, with_joint_errors
from pmsm_ctrl.identify.solution import Method, Solution, identified, solved
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.regression.base_problem import based
from pmsm_ctrl.regression.conditioning import Processing
from pmsm_ctrl.regression.drive_timing import LATENESS, SYNCHRONOUS, DriveTiming, Sampling
from pmsm_ctrl.regression.evaluated import with_evaluation
from pmsm_ctrl.regression.inverse_dynamics import Problem, build_problem
from pmsm_ctrl.regression.least_squares import Fit
from pmsm_ctrl.regression.record_result import RecordResult
from pmsm_ctrl.regression.timed_record import sampling_of, timed_record
from pmsm_ctrl.regression.worse_than_given import worse_by_error, worse_than_given
from pmsm_ctrl.section import Notice

__all__ = ["Evaluation", "as_diagnosed", "by_method", "sampled_log"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Evaluation:
    """A solved log, with the error that is left.

    Attributes
    ----------
    solution : Solution
        Its fit has the errors that the residual does not show as well.
    several : Joint
        The records that it was solved on, as one log.
    record : Record
        The same, as `diagnose` and `compare` read it.
    found : Design
        With the identified values.
    far, near : tuple of Notice
        Parameters at their bounds, beyond their error and within it.
    folded : tuple of Notice
        What the torque does between the samples, where that is most of an error.
    shown : Problem
        The regression whose error is told.
    unexplained : array, shape (m,)
        What the found design leaves of it.
    worse : Notice or None
        Said where the given design leaves less.
    size : dict of str to float
        Error as a share of the torque, and the rms of the residual.
    rows : tuple of RecordResult
    sampling : Sampling
    processing : Processing or None
        Of a method with a band of its own.
    """

    solution: Solution
    several: Joint
    record: Record
    found: Design
    far: tuple[Notice, ...]
    near: tuple[Notice, ...]
    folded: tuple[Notice, ...]
    shown: Problem
    unexplained: Array
    worse: Notice | None
    size: Mapping[str, float]
    rows: tuple[RecordResult, ...]
    sampling: Sampling
    processing: Processing | None = None


def as_diagnosed(design: Design, log: Log) -> Evaluation:
    """Evaluate a log by the base model of the diagnosis: its band, weights, sampling and error.

    Parameters
    ----------
    design : Design
    log : Log
    """
    several, base = joint(design, log), based(design, log)
    known = with_joint_errors(base.fit, several.stderr)
    fit, folded = with_folded_errors(design, several.log, base, base.problem, known)
    found, far, near = identified(design, base.problem, fit)
    if base.record.in_step:  # which nothing but the log that it was fitted to says of a design
        found = with_evaluation(found, replace(timed_record(found, log), in_step=True), log)
    size, rows = as_compared(found, log, several.rows)
    return Evaluation(
        Solution(base.problem, fit), several, base.record, found, far, near, folded, base.problem, fit.residual,
        worse_than_given(design, found, base.record), size, rows, base.sampling,
    )  # fmt: skip


def by_method(
    method: Method, design: Design, log: Log, processing: Processing, each: Callable[[], None]
) -> Evaluation:  # fmt: skip
    """Evaluate a log by a method in a band of its own.

    Parameters
    ----------
    method : {"regression", "iv", "output_error"}
    design : Design
    log : Log
        With its filter undone.
    processing : Processing
    each : function
        Called in every round of a fit by simulation.
    """
    several = joint(design, log) if method != "iv" else Joint(log)
    solution = solved(method, design, several.log, processing, each)
    problem, known = solution.problem, with_joint_errors(solution.fit, several.stderr)
    how = processing if method == "regression" else None
    fit, folded = with_folded_errors(design, several.log, how, problem, known)
    found, far, near = identified(design, problem, fit)
    record = timed_record(design, several.log)
    if method == "output_error":  # it has no columns of the given design
        shown, left, worse = problem, fit.residual, worse_than_given(design, found, record)
    else:
        cut = replace(processing, cutoff=problem.cutoff)
        shown, left, worse = _shown(design, several.log, cut, problem, fit)
    return Evaluation(
        replace(solution, fit=fit), several, record, found, far, near, folded, shown, left, worse,
        sizes(left[shown.mask], shown.torque[shown.mask]), several.rows, _sampled(processing.sampling, fit), processing,
    )  # fmt: skip


def sampled_log(design: Design, log: Log, processing: Processing, method: Method) -> tuple[Log, Processing]:
    """Return the log with its filter undone, and the processing with what else is known of its sampling.

    Parameters
    ----------
    design : Design
    log : Log
    processing : Processing
        Returned as it is where it states the sampling.
    method : {"regression", "iv", "output_error"}
    """
    if processing.sampling is not None:
        return log, processing
    log, sampling = sampling_of(design, log)
    if method == "iv":  # derivatives of a motion without noise are weak instruments where the axis hardly speeds up
        log = DriveTiming(sampling.late).undone(log)
        sampling = Sampling(sampling.whole, stderr=sampling.stderr)
    return log, replace(processing, sampling=sampling)


def _shown(
    design: Design, log: Log, processing: Processing, problem: Problem, fit: Fit
) -> tuple[Problem, Array, Notice | None]:
    """Return the regression with reversals, which are part of the error, and what the design that is written leaves.

    Third comes what is to be said where the given design leaves less.
    """
    shown = build_problem(design, log, replace(processing, blank=False), problem.inertia is not None)
    # what got no number is in there with the value that it had
    found = {name: value for name, (value, _) in fit.nuisances.items()} | dict(fit.values)
    left = shown.target - shown.matrix() @ [found.get(column.name, column.nominal) for column in shown.columns]
    return shown, left, worse_by_error(_best_error(shown, fit.values), _best_error(shown, {}))


def _best_error(shown: Problem, found: Mapping[str, float]) -> float:
    """Return the error as a share of the torque, with the sampling that suits the parameters best.

    What was not found is the given design's.
    """
    mask, own, x = shown.mask, shown.physical, shown.matrix()
    values = np.array([found.get(column.name, column.nominal) for column in shown.columns])
    left = (shown.target - x[:, own] @ values[own])[mask]
    beside = x[mask][:, ~own]
    if beside.shape[1]:
        left = left - beside @ factored(beside).solve(left)
    return float(np.linalg.norm(left) / np.linalg.norm(shown.torque[mask]))


def _sampled(sampling: Sampling | None, fit: Fit) -> Sampling:
    """Return how the drive signal was sampled, with the delay that the fit has."""
    sampling = sampling or SYNCHRONOUS
    late, stderr = fit.nuisances.get(LATENESS, (sampling.late, sampling.stderr))
    return replace(sampling, late=late, stderr=stderr)

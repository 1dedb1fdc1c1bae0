"""What a log does not tell of the torque between its samples, and how far that may shift the parameters.

A log that takes instants of a faster drive folds what the torque holds around the log's rate f_s into the band. That is
not known, but what it holds around f_s / 2 is: multiplied by (-1)^k it lies in the band, and the regression tells what
it would do there. The spectrum of a torque with edges falls as 1/f, of one with kinks as 1/f^2, so that twice as high
there is at most half as much. Without edge or kink only noise is there, which the standard error holds already.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.identify import notices as words
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.base_problem import Based
from pmsm_ctrl.regression.conditioning import Prepared, Processing, prepare
from pmsm_ctrl.regression.drive_timing import drive_sampling
from pmsm_ctrl.regression.inverse_dynamics import Problem
from pmsm_ctrl.regression.least_squares import Fit, solve
from pmsm_ctrl.regression.signals import logged_torque
from pmsm_ctrl.section import Notice

__all__ = ["folded_errors", "with_folded_errors"]

Array = NDArray[np.float64]

# Standard deviation of what lies anywhere within plus or minus half of the content around f_s / 2.
SHARE = 0.5 / math.sqrt(3.0)
# Standard error of an inertia, as its share, that a delay and a variance leave of a sampling that is not stated: the
# reference is held, the current loop has its own response, and a log meets both at the same places. Of 77 worlds 64 had
# the inertia in its 95 % interval without it, 72 with it; of 78 that it was not chosen on 60 and 68.
UNSTATED = 5e-4
FASTER, SAME = 1.5, 1e-3  # rate of a drive that moves between the samples over that of the log; what is no other rate


def folded_errors(
    design: Design, log: Log, prepared: Prepared, problem: Problem, fit: Fit, weight: Array | None = None
) -> dict[str, float]:
    """Return standard errors of the parameters by what the torque does between the samples.

    Parameters
    ----------
    design : Design
    log : Log
    prepared : Prepared
        What the problem was made of.
    problem, fit : Problem, Fit
        Of a regression, not weighted.
    weight : array, shape (m,), optional
        Of the samples in the fit.

    Returns
    -------
    dict of str to float
        Empty where the drive is not faster than the log, or the log is stated to hold means: nothing of them is folded.
    """
    if drive_sampling(design, log).sampling == "mean":
        return {}
    taken = abs(prepared.rate - log.rate) < SAME * log.rate and len(prepared.keep) == len(problem.t)
    if not (taken and design.motor.electrical and design.drive.f_control > FASTER * log.rate):
        return {}
    raw = {name: np.interp(prepared.t, log.t, log[name]) for name in ("torque", "i_d", "i_q") if name in log}
    torque = logged_torque(design, raw)
    around = prepared.column(torque * np.where(np.arange(len(torque)) % 2, -1.0, 1.0))
    w = np.ones(len(problem.t)) if weight is None else weight
    columns = tuple(replace(column, values=w * column.values) for column in problem.columns)
    other = solve(replace(problem, target=w * (problem.target + around), columns=columns), by_blocks=weight is not None)
    found = {}
    for name, stderr in fit.stderr.items():
        if name in other.values and name in fit.values and np.isfinite(stderr):
            beyond = (other.values[name] - fit.values[name]) ** 2 - stderr**2
            found[name] = SHARE * math.sqrt(max(beyond, 0.0))
    return found


def with_folded_errors(
    design: Design, log: Log, made: Based | Processing | None, problem: Problem, fit: Fit
) -> tuple[Fit, tuple[Notice, ...]]:
    """Return a fit whose standard errors allow for the torque between the samples, and a notice where that is most.

    That of the inertia allows for a sampling that is not stated as well.

    Parameters
    ----------
    design : Design
    log : Log
    made : Based or Processing, optional
        How the problem was made; left out, the fit simulates the samples, and nothing is changed.
    problem, fit : Problem, Fit
    """
    if made is None:
        return fit, ()
    if isinstance(made, Processing):
        same = replace(made, cutoff=problem.cutoff, inertia_cutoff=problem.inertia_cutoff)
        prepared, weight = prepare(design, log, same), None
    else:
        prepared, weight = made.record.prepared, made.record.weight[0]
    found = folded_errors(design, log, prepared, problem, fit, weight)
    units = {column.name: column.unit for column in problem.columns}
    unstated = 0.0 if drive_sampling(design, log).stated else UNSTATED
    sampled = {"J": unstated * abs(fit.values["J"])} if "J" in fit.stderr else {}
    wider = {
        name: math.hypot(error, found.get(name, 0.0), sampled.get(name, 0.0)) for name, error in fit.stderr.items()
    }
    said = [
        words.BETWEEN_SAMPLES(name=name, error=error, unit=units[name], rate=1.0 / design.drive.speed_period)
        for name, error in found.items() if error > fit.stderr[name]
    ]  # fmt: skip
    return replace(fit, stderr=wider), tuple(said)

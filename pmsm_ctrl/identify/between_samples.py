"""What a log does not tell of the torque between its samples, and how far that may shift the parameters.

A log that takes instants of a faster drive folds what the torque holds around the log's rate f_s into the band. That is
not known, but what it holds around a fraction of f_s is: multiplied by a wave of that frequency it lies in the band,
and the regression tells what it would do there.

*Edges at any time* have a spectrum without lines that falls as 1/f, and kinks one that falls as 1/f^2: around f_s it is
at most half as large as around f_s / 2. *A drive that holds its reference* for N control periods makes a saw tooth of
height A, and a log of every D-th period meets q = N / gcd(N, D) of its places. Their mean is up to A / (2 q) off, and
their discrete Fourier transform has lines of amplitude A / (q sin(pi k / q)) at all k / q of f_s, k < q / 2. *Without
edge or kink* only noise is there, which the standard error holds already.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from fractions import Fraction

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

PLACES = range(2, 11)  # of a held reference that a log may meet, q
HALF = Fraction(1, 2)
LINE = 3.0  # times what noise and the other fractions do to a parameter is a line of the spectrum
UNIFORM = 1.0 / math.sqrt(3.0)  # standard deviation of what lies anywhere within plus or minus one
# Standard error of an inertia, as its share, that a delay and a variance leave of a sampling that is not stated: the
# reference is held, the current loop has its own response, and a log meets both at the same places. Of 77 worlds 64 had
# the inertia in its 95 % interval without it, 72 with it; of 78 that it was not chosen on 60 and 68.
UNSTATED = 5e-4
FASTER = 1.5  # rate of a drive that moves between the samples, over that of the log


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
    if len(prepared.keep) != len(problem.t) or not _faster(design, log):
        return {}
    w = np.ones(len(problem.t)) if weight is None else weight
    # by the motion itself: what a reference or a known value holds in its place is folded all the same
    columns = tuple(replace(c, values=w * c.values, held=c.is_nuisance and c.held, prior=None) for c in problem.columns)
    free = solve(replace(problem, target=w * problem.target, columns=columns), by_blocks=weight is not None)
    shifts = _shifts(design, log, prepared, free.weights, w, problem.mask)
    return {
        name: _folded({r: sizes[problem.names.index(name)] for r, sizes in shifts.items()}, free.stderr[name])
        for name, stderr in fit.stderr.items()
        if np.isfinite(stderr) and np.isfinite(free.stderr.get(name, np.nan))
    }


def _faster(design: Design, log: Log) -> bool:
    """Whether the drive moves its torque between the samples; one of which nothing is stated may."""
    stated = design.motor.electrical or "f_control" in design.drive.model_fields_set
    return not stated or design.drive.f_control > FASTER * log.rate


def _folded(sizes: Mapping[Fraction, float], stderr: float) -> float:
    """Return the standard error by what the torque holds around these fractions of the log's rate."""
    bounds = [0.5 * math.sqrt(max(sizes[HALF] ** 2 - stderr**2, 0.0))]
    usual = max(stderr, float(np.median(list(sizes.values()))))
    for q in PLACES:
        lines = sorted(size for r, size in sizes.items() if (q * r).denominator == 1 and (r < HALF or q == 2))
        most = max(1, (q - 1) // 2)
        if lines and lines[0] > LINE * usual:
            # a wave multiplied by one of its own frequency leaves half of itself in the band, one of f_s / 2 all of it;
            # a tooth that lasts for less than q samples has its lines in another order
            bounds.append(min(size * math.sin(math.pi * (most - k) / q) for k, size in enumerate(lines)))
    return UNIFORM * max(bounds)


def _shifts(
    design: Design, log: Log, prepared: Prepared, weights: Array, w: Array, mask: NDArray[np.bool_]
) -> dict[Fraction, list[float]]:
    """Return by how much what the torque holds around each fraction of the rate would shift every parameter."""
    from scipy.ndimage import uniform_filter1d

    raw = {name: log[name] for name in ("torque", "i_d", "i_q") if name in log}
    torque, place = logged_torque(design, raw), np.round((log.t - log.t[0]) * log.rate)
    ratio = max(1, round(log.rate / prepared.rate))  # of a log that was thinned by means
    found = {}
    for r in sorted({Fraction(k, q) for q in PLACES for k in range(1, q // 2 + 1)}):
        if r < HALF and r * log.rate < 2.0 * prepared.cutoff:
            continue  # the motion itself is there
        angle = 2.0 * np.pi * float(r) * place
        waves = (np.cos(angle), np.sin(angle)) if r < HALF else (np.cos(angle),)
        slow = [np.interp(prepared.t, log.t, uniform_filter1d(torque * wave, ratio)) for wave in waves]
        around = (w * prepared.columns(slow))[:, mask]
        found[r] = np.linalg.norm(weights @ around.T, axis=1).tolist()
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
    shifts = ", ".join(
        f"{name} by some {error:.2g} {units[name]}"
        for name, error in found.items()
        if error > max(fit.stderr[name], UNSTATED * abs(fit.values[name]))
    )
    said = (words.BETWEEN_SAMPLES(shifts=shifts, rate=1.0 / design.drive.speed_period),) if shifts else ()
    return replace(fit, stderr=wider), said

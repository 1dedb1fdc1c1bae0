"""How wide a band an identification takes: what is to be learnt against what noise in the motion spoils."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects.catalogue import bound_effects
from pmsm_ctrl.errors import LogError
from pmsm_ctrl.identify.instrumental import MATTERS
from pmsm_ctrl.identify.problem import Problem, build_problem
from pmsm_ctrl.identify.regression import solve
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.conditioning import Processing, derivative, low_pass, prepare
from pmsm_ctrl.regression.timebase import uniform, unwrapped

__all__ = ["regression_problem", "searches_shapes", "widest"]

Array = NDArray[np.float64]

# Low-pass of the methods that noise in the motion does not bias, Hz: they need not hide from it below 40 Hz.
WIDE = 100.0
# The same where the shape of an effect is searched, Hz: what tells it is the first few milliseconds after a reversal.
SHAPES = 250.0
# A band that holds this share of what a wider one would tell, of every parameter, is wide enough.
ENOUGH = 0.97


def widest(log: Log, shapes: bool = False) -> float:
    """Return the band, Hz, of a method that noise in the motion does not bias, and that may search `shapes`."""
    return float(min(SHAPES, log.rate / 4.0) if shapes else min(WIDE, log.rate / 8.0))


def searches_shapes(design: Design) -> bool:
    """Whether the design has an effect whose shape a simulation can fit; the order of a ripple is no shape."""
    return any(p.symbol != "order" for effect, _ in bound_effects(design) for p in effect.searched)


def regression_problem(design: Design, log: Log, processing: Processing) -> Problem:
    """Build the regression for least squares: in the usual band, or a wider one where much is to be learnt beyond it.

    A band that `processing` gives is taken. A wider one is taken only where the usual one finds every parameter, lest
    the drive's answer to noise counts as excitation, and a still wider one for the parameters of an effect with a
    shape. The inertia has a band of its own: the usual one, unless `WIDE` tells more of it and noise of the
    acceleration leaves it alone there. Errors in a column shrink its parameter by the share of the column's power that
    is theirs (W. A. Fuller, Measurement Error Models, Wiley 1987, sec. 1.1).
    """
    usual = build_problem(design, log, processing=processing)
    if processing.cutoff is not None or usual.cutoff >= widest(log) or "theta" not in log:
        return usual
    if solve(usual).unidentifiable:
        return usual
    found = usual
    for cutoff in sorted({widest(log), widest(log, searches_shapes(design))}):
        inertia = found.inertia_cutoff or found.cutoff
        try:
            prepared = prepare(design, log, replace(processing, cutoff=cutoff))
        except LogError:  # in a wide band a coarse encoder hardly ever moves
            break
        if processing.blank and prepared.weight is None:  # or is turned by its noise
            break
        wide = build_problem(design, prepared)
        lacking = dict(zip(found.names, _information(found) < ENOUGH * _information(wide), strict=True))
        if lacking.pop("J", False) and cutoff <= WIDE and _shrinkage(design, log, wide) <= MATTERS:
            found = wide
        elif any(lacking.values()):
            found = replace(wide, inertia_cutoff=inertia)
    return found


def _information(problem: Problem) -> Array:
    """Return what is known of each parameter, the others unknown, for noise of one and the same density."""
    x = problem.matrix()[problem.mask]
    size = np.sqrt(np.mean(x**2, axis=0))
    size[size == 0.0] = 1.0
    return size**2 / (np.diag(np.linalg.pinv((x / size).T @ (x / size))) * problem.rate)


def _shrinkage(design: Design, log: Log, problem: Problem) -> float:
    """Return by how much noise of the acceleration makes the inertia too small at most, in standard errors.

    The noise of the angle is what it holds above a quarter of the log's rate, taken for white. The noise of the current
    turns the shaft as well, against the torque that is logged. Most of what is logged is too fast to do so: a current
    sampled every D-th control period holds in its band the noise of D bands, of which the shaft feels the lowest,
    less what the speed loop takes off it.
    """
    fit = solve(problem)
    if "J" not in fit.values:
        return float("inf")
    rate = log.rate
    theta = unwrapped(uniform(log)[1]["theta"])
    fast = float(np.var(theta - low_pass(theta, rate, rate / 4.0)))
    # what white noise of variance 1 leaves of itself in either: the squares of the impulse responses
    one = np.zeros(2 * round(4.0 * rate / problem.cutoff) + 1)
    one[len(one) // 2] = 1.0
    accelerating = low_pass(derivative(derivative(one, 1.0 / rate), 1.0 / rate), rate, problem.cutoff, steep=True)
    acceleration = fast * float(np.sum(accelerating**2) / np.sum((one - low_pass(one, rate, rate / 4.0)) ** 2))
    felt = min(rate / design.drive.f_control, 1.0) if design.motor.electrical else 1.0
    acceleration += felt * float(np.mean(fit.residual[problem.mask] ** 2)) / fit.values["J"] ** 2
    x = problem.matrix()[problem.mask]
    size = np.sqrt(np.mean(x**2, axis=0))
    size[size == 0.0] = 1.0
    inverse = np.linalg.pinv((x / size).T @ (x / size)) / np.outer(size, size)
    k = problem.names.index("J")
    return float(abs(fit.values["J"]) * len(x) * acceleration * inverse[k, k] / fit.stderr["J"])

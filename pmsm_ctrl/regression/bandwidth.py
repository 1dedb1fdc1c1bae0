"""The bandwidth of an evaluation: a wider band adds information, and bias by noise of the motion."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects.catalogue import bound_effects
from pmsm_ctrl.errors import LogError
from pmsm_ctrl.evidence.linalg import factored
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.conditioning import Processing, default_cutoff, prepare
from pmsm_ctrl.regression.filters import derivative, low_pass
from pmsm_ctrl.regression.inverse_dynamics import Problem, build_problem
from pmsm_ctrl.regression.least_squares import NEGLIGIBLE_BIAS, Fit, solve, t_quantile
from pmsm_ctrl.regression.timing import uniform, unwrapped

__all__ = ["regression_problem", "signal_band", "widest_band"]

Array = NDArray[np.float64]

# Longest log, s, whose band follows its signal. A longer one keeps the default: it has samples enough, and memory
# stays small.
LONGEST = 200.0
# Share of the drive signal's power above its noise floor that the low-pass has to let through.
PASSED = 0.95
# Low-pass, Hz, of methods that noise in the motion does not bias, and where the shape of an effect is searched: that
# shows in the first few milliseconds after a reversal.
UNBIASED, SHAPES = 100.0, 250.0
# Share of the information on every parameter that a band must hold; a wider one is tried otherwise.
INFORMATION = 0.97
# The inertia's band is halved so often at most, down to this, Hz, as long as its standard error does not grow by more.
HALVINGS, NARROWEST, LOSS = 4, 2.0, 2.0
# Confidence from which on two bands give different inertias.
SURE = 0.95


def signal_band(log: Log) -> float:
    """Return the low-pass of a comparison or a diagnosis, Hz: the default, or more where the drive signal has more.

    `PASSED` of the power of ``torque`` or ``i_q`` above its noise floor lies below two thirds of it; the floor is the
    level of the uppermost quarter of the spectrum.
    """
    from scipy.signal import welch

    source = next((name for name in ("torque", "i_q") if name in log), None)
    rate = log.rate if log.records else (len(log) - 1) / log.duration
    usual = default_cutoff(rate)
    if source is None or log.duration > LONGEST:
        return usual
    values = log[source]
    frequency, power = welch(values - np.mean(values), rate, nperseg=min(len(values), 2048))
    excess = np.maximum(power - np.median(power[frequency > 0.375 * rate]), 0.0)
    total = np.cumsum(excess)
    if total[-1] <= 0.0:
        return usual
    reach = float(frequency[int(np.searchsorted(total, PASSED * total[-1]))])
    return usual if reach < 0.8 * usual else float(min(max(usual, 1.5 * reach), rate / 8.0))


def widest_band(design: Design, log: Log) -> float:
    """Return the low-pass of a method that noise in the motion does not bias, Hz.

    It is wider where the design has an effect whose shape a simulation can fit.
    """
    return float(min(SHAPES, log.rate / 4.0) if _has_shapes(design) else min(UNBIASED, log.rate / 8.0))


def _has_shapes(design: Design) -> bool:
    """Whether an effect has a shape to be searched; the order of a ripple is a whole number and none."""
    return any(p.symbol != effect.order for effect, _ in bound_effects(design) for p in effect.searched)


def regression_problem(design: Design, log: Log, processing: Processing) -> Problem:
    """Build the regression for least squares in the default band, or in a wider one that holds more information.

    A wider band is taken only where the default one identifies every parameter: the response of the drive to noise is
    no excitation. The inertia keeps a narrower band of its own where errors in the acceleration would bias it. They
    make it too small by their share of the column's power (W. A. Fuller, Measurement Error Models, Wiley 1987, sec.
    1.1). A cutoff given in `processing` is taken.
    """
    usual = build_problem(design, log, processing)
    if processing.cutoff is not None:
        return usual
    if solve(usual).unidentifiable:
        return usual
    return with_sound_inertia(design, log, _in_best_band(design, log, processing, usual))


def _in_best_band(design: Design, log: Log, processing: Processing, usual: Problem) -> Problem:
    """Return the problem in the band that holds the information."""
    widest = widest_band(design, log)
    if usual.cutoff >= min(UNBIASED, log.rate / 8.0) or "theta" not in log:
        return usual
    found = usual
    for cutoff in sorted({min(UNBIASED, log.rate / 8.0), widest}):
        inertia = found.inertia_cutoff or found.cutoff
        try:
            prepared = prepare(design, log, replace(processing, cutoff=cutoff))
        except LogError:  # in a wide band a coarse encoder hardly ever moves
            break
        if processing.blank and prepared.weight is None:  # or is turned by its noise
            break
        wide = build_problem(design, prepared)
        lacking = dict(zip(found.physical_names, _information(found) < INFORMATION * _information(wide), strict=True))
        if lacking.pop("J", False) and cutoff <= UNBIASED and _shrinkage(design, log, wide) <= NEGLIGIBLE_BIAS:
            found = wide
        elif any(lacking.values()):
            found = replace(wide, inertia_cutoff=inertia)
    return found


def with_sound_inertia(design: Design, log: Log, problem: Problem) -> Problem:
    """Lower the band of the inertia until errors in the acceleration do not bias it.

    That is until their known part, its white noise, shrinks it by less than `NEGLIGIBLE_BIAS`, or by no less in half
    the band, its standard error counted; and until half the band gives an inertia inside the interval of this one:
    whatever else is wrong with an acceleration (lines of the encoder, channels that are not synchronous) grows with the
    frequency. Two estimates from one log differ by a noise that is known (J. A. Hausman, Econometrica 46 (1978) 1251).
    An inertia that the whole band does not give, not even a positive one, is not looked for in narrower ones.
    """
    top = problem.inertia_cutoff or problem.cutoff
    if "J" not in problem.names:
        return problem
    bands = [top / 2.0**k for k in range(HALVINGS + 1) if top / 2.0**k >= NARROWEST or k == 0]
    tried = [problem if band == problem.cutoff else replace(problem, inertia_cutoff=band) for band in bands]
    fits = [solve(one) for one in tried]
    if "J" not in fits[0].values:
        return problem
    best, bias = 0, _shrinkage(design, log, tried[0])
    for k in range(len(bands) - 1):
        if "J" not in fits[k + 1].values or fits[k + 1].stderr["J"] > LOSS * fits[best].stderr["J"]:
            break
        narrow = _shrinkage(design, log, tried[k + 1])
        error, less = (f.stderr["J"] * math.hypot(1.0, b) for f, b in ((fits[k], bias), (fits[k + 1], narrow)))
        if not (bias > NEGLIGIBLE_BIAS and less < error) and not _differ(tried[k], fits[k], fits[k + 1]):
            break
        best, bias = k + 1, narrow
    return tried[best]


def _differ(problem: Problem, wide: Fit, narrow: Fit) -> bool:
    """Whether a narrower band has an inertia beyond the interval of a wide one, and beyond the noise of both."""
    k = problem.names.index("J")
    contrast = np.zeros(len(problem.target))
    contrast[problem.mask] = wide.weights[k] - narrow.weights[k]
    variance = narrow.spread * float(contrast @ narrow.noise.toeplitz(contrast[:, None])[:, 0])
    apart = abs(wide.values["J"] - narrow.values["J"])
    return apart > t_quantile(SURE, narrow.dof) * max(float(np.sqrt(variance)), wide.stderr["J"])


def _information(problem: Problem) -> Array:
    """Return the information on each parameter, the others unknown, for noise of the same density in every band."""
    return 1.0 / (_variances(problem) * problem.rate)


def _variances(problem: Problem) -> Array:
    """Return the variances of the estimates, shape (columns,), for white noise of unit variance, the sampling known."""
    rows = problem.matrix()[problem.mask][:, problem.physical]
    return np.asarray(np.sum(factored(rows).inverse ** 2, axis=1))


def _shrinkage(design: Design, log: Log, problem: Problem) -> float:
    """Return the bias of the inertia by noise of the acceleration, at most, in its standard errors.

    The current's noise turns the shaft as well, against the logged torque; but a current sampled every D-th control
    period holds in its band the noise of D bands, of which the shaft feels the lowest alone.
    """
    fit = solve(problem)
    if "J" not in fit.values:
        return float("inf")
    band = problem.inertia_cutoff or problem.cutoff
    felt = min(log.rate / design.drive.f_control, 1.0) if design.motor.electrical else 1.0
    left = fit.residual if band == problem.cutoff else low_pass(fit.residual, problem.rate, band, steep=True)
    noise = _acceleration_noise(log, problem.cutoff, band)
    noise += felt * float(np.mean(left[problem.mask] ** 2)) / fit.values["J"] ** 2
    squares = float(np.sum(fit.weights[problem.names.index("J")] ** 2)) * int(problem.mask.sum())
    return float(abs(fit.values["J"]) * noise * squares / fit.stderr["J"])


def _acceleration_noise(log: Log, cutoff: float, band: float) -> float:
    """Mean product of the noise of the acceleration in two bands, Hz, one of them the instrument of the other.

    The noise of the angle, or of a logged speed, is what it holds above a quarter of the log's rate, taken for white.
    """
    rate = log.rate
    name = "theta" if "theta" in log else "omega"
    values = uniform(log)[1][name]
    motion = unwrapped(values) if name == "theta" else values
    fast = float(np.var(motion - low_pass(motion, rate, rate / 4.0)))
    # what white noise of variance 1 leaves of itself in either: products of the impulse responses
    one = np.zeros(2 * round(4.0 * rate / band) + 1)
    one[len(one) // 2] = 1.0
    made = derivative(one, 1.0 / rate)
    made = derivative(made, 1.0 / rate) if name == "theta" else made
    made = low_pass(made, rate, cutoff, steep=True)
    instrument = made if band == cutoff else low_pass(made, rate, band, steep=True)
    return fast * float(instrument @ made / np.sum((one - low_pass(one, rate, rate / 4.0)) ** 2))

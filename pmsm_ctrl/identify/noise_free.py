"""Inertia and sampling of a simulation in open loop by instrumental variables: columns that hold next to no noise.

Noise of the current sensor is answered by the current loop, and moves the shaft against what the log calls the torque.
The measured acceleration, which is the column of the inertia, is then correlated with the residual, and so are the
columns of the sampling, slopes of the logged torque. Least squares finds the inertia too small, and a variance of the
drive signal that is far beyond its prior. The same columns of a motion and of a torque in a narrow band hold the axis's
motion and a small share of that noise: they are the instruments.

Source: T. Soderstrom, P. Stoica, Instrumental Variable Methods for System Identification, Springer 1983, ch. 3.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.identify import policy
from pmsm_ctrl.identify.open_loop import OpenLoop
from pmsm_ctrl.regression.drive_timing import LATENESS, SPREAD, sampling_columns
from pmsm_ctrl.regression.filters import low_pass
from pmsm_ctrl.regression.inverse_dynamics import Problem
from pmsm_ctrl.regression.least_squares import Fit, solve

__all__ = ["NOISY", "by_narrow_band", "pinned"]

Array = NDArray[np.float64]

NOISY = ("J", LATENESS, SPREAD)  # columns that are made of the measured motion or torque


def by_narrow_band(
    loop: OpenLoop, values: Array, again: Callable[[OpenLoop, Array], Array]
) -> tuple[Array, Problem, Fit] | None:  # fmt: skip
    """Return values, the problem that is linear there, and its fit, the inertia and the sampling by instruments.

    Parameters
    ----------
    loop : OpenLoop
    values : array, shape (columns,)
        Of least squares.
    again : function
        Returns the values of all other columns by least squares, of a simulation that pins those of `NOISY`.

    Returns
    -------
    (array, Problem, Fit) or None
        None where the simulation holds the inertia.
    """
    if loop.corrected or not any(column.is_inertia and not column.held for column in loop.columns):
        return None
    problem = loop.problem(values)
    band = _band(loop, problem)
    for _ in range(policy.INSTRUMENT_ROUNDS):
        fit = _solved(loop, problem, band)
        found = np.array([c.clipped(v) for c, v in zip(loop.columns, fit.coefficients.tolist(), strict=True)])
        values = again(pinned(loop, found), np.where(_noisy(loop), found, values))
        problem = loop.problem(values)
    return values, problem, _solved(loop, problem, band)


def pinned(loop: OpenLoop, values: Array) -> OpenLoop:
    """Return the same simulation with the columns of `NOISY` held at these values.

    Parameters
    ----------
    loop : OpenLoop
    values : array, shape (columns,)
    """
    columns = tuple(
        replace(c, nominal=value, held=True, prior=(value, abs(step))) if noisy else c
        for c, value, step, noisy in zip(
            loop.columns, values.tolist(), loop.steps.tolist(), _noisy(loop).tolist(), strict=True
        )
    )
    return replace(loop, columns=columns)


def _noisy(loop: OpenLoop) -> NDArray[np.bool_]:
    return np.array([column.name in NOISY for column in loop.columns])


def _solved(loop: OpenLoop, problem: Problem, band: float) -> Fit:
    """Return the fit by instruments in a band, Hz, the error of the inertia with what noise in them may make of it."""
    instruments = problem.matrix().copy()
    for name, column in _narrow(loop, band).items():
        if name in problem.names:
            instruments[:, problem.names.index(name)] = column
    fit = solve(problem, instruments, ratio=policy.LEAST_ACCELERATION)
    if "J" not in fit.values:
        return fit
    return replace(fit, stderr={**fit.stderr, "J": math.hypot(fit.stderr["J"], _bias(loop, problem, fit, band))})


def _bias(loop: OpenLoop, problem: Problem, fit: Fit, band: float) -> float:
    """Return how far noise that moves the shaft may shift the inertia, if all of the residual is white noise.

    The shaft feels the lowest of the bands that a log of every D-th control period holds in one.
    """
    design, J = loop.design, fit.values["J"]
    rate = min(record.prepared.rate for record in loop.records)
    felt = min(rate / design.drive.f_control, 1.0) if design.motor.electrical else 1.0
    share = min(band / (policy.TRIANGLE * problem.rate), 1.0)
    noise = felt * share * float(np.mean(fit.residual[problem.mask] ** 2)) / J**2
    squares = float(np.sum(fit.weights[problem.names.index("J")] ** 2)) * int(problem.mask.sum())
    return abs(J) * noise * squares


def _narrow(loop: OpenLoop, band: float) -> dict[str, Array]:
    """Return the columns of the inertia and of the sampling from motion and torque in a band, shape (increments,)."""
    parts: dict[str, list[Array]] = {name: [] for name in NOISY}
    for record in loop.records:
        rate, torque = record.prepared.rate, record.prepared.signals["torque"]
        made = {"J": np.gradient(low_pass(record.prepared.signals["omega"], rate, band)) * rate}
        made |= sampling_columns(low_pass(torque, rate, min(band, policy.SAMPLING_BAND)), 1.0 / rate, 0.0)
        for name, values in made.items():
            parts[name].append(record.at(values)[:, record.first :: record.step][:, 1:].ravel())
    return {name: np.concatenate(values) for name, values in parts.items()}


def _band(loop: OpenLoop, problem: Problem) -> float:
    """Return the narrowest band of the instruments, Hz, in which the inertia is nearly as sure as in any other."""
    rate = min(record.prepared.rate for record in loop.records)
    errors = {}
    for band in policy.INSTRUMENT_BANDS:
        stderr = _solved(loop, problem, band).stderr.get("J", math.inf) if band < 0.25 * rate else math.inf
        errors[band] = stderr if math.isfinite(stderr) else math.inf
    least = min(errors.values())
    return next(band for band, stderr in errors.items() if stderr <= policy.NARROWER * least)

"""The parameters of a fitted design refined by simulation, where that is better on stretches that were left out.

The regression judges by inverse dynamics, in a band and by columns; a simulation has every effect as it is, springs,
gaps and bristles with their memory. It replaces the regression's values only where it predicts what it was not fitted
to.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose.case import Case
from pmsm_ctrl.diagnose.notices import NOT_POLISHED, POLISHED
from pmsm_ctrl.diagnose.result import Diagnosis, DiagnosisStep
from pmsm_ctrl.effects.catalogue import catalogue_of
from pmsm_ctrl.errors import LogError
from pmsm_ctrl.identify.open_loop import OpenLoop, open_loop
from pmsm_ctrl.identify.open_loop_fit import fitted, solved
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.regression.drive_timing import LATENESS, SPREAD, in_time
from pmsm_ctrl.regression.least_squares import Fit
from pmsm_ctrl.regression.prediction import predict
from pmsm_ctrl.regression.total_inertia import with_total_inertia
from pmsm_ctrl.regression.worse_than_given import worse_than_given
from pmsm_ctrl.result import Estimate
from pmsm_ctrl.section import Notice

__all__ = ["polished", "with_polish"]

Array = NDArray[np.float64]

FOLDS, BLOCK = 4, 1  # parts of the log, each left out in turn, and how many seconds of each lie together
SURE = 2.0  # standard errors by which the mean gain of the stretches left out must exceed zero


def polished(design: Design, record: Record, log: Log) -> tuple[Design, tuple[Notice, ...]]:
    """Return a design with its parameters refined by simulation of its log, or as it is, and which of the two.

    Parameters
    ----------
    design : Design
        As the regression left it, with standard errors.
    record : Record
        Of the log.
    log : Log
    """
    timed = predict(design, record).timing.undone(in_time(design, log))
    sigma = {LATENESS: (record.sampling + record.early) / math.sqrt(12.0), SPREAD: record.sampling**2 / 6.0}
    try:
        loop = open_loop(design, timed, {} if record.sampling_stated else sigma)
    except LogError as error:
        return design, (NOT_POLISHED(why=str(error)),)
    prior = {
        column.name: design.effects[column.entry].stderr.get(column.symbol, 0.0)
        for column in loop.columns
        if column.entry >= 0
    }
    values, converged = fitted(loop, prior)
    if not converged:
        return design, (NOT_POLISHED(why="the fit by simulation did not converge"),)
    before, after, sure = _left_out(loop, prior, values)
    unit = record.unit("torque")
    if not sure:
        why = f"stretches left out are predicted to {after:.3g} {unit} in place of {before:.3g} {unit}, no sure gain"
        return design, (NOT_POLISHED(why=why),)
    found = _written(design, loop, values, solved(loop, values)[1])
    if worse := worse_than_given(design, found, record):
        return design, (NOT_POLISHED(why=worse.text),)
    return found, (POLISHED(before=before, after=after, unit=unit),)


def _left_out(loop: OpenLoop, prior: dict[str, float], values: Array) -> tuple[float, float, bool]:
    """Return the rms error of stretches left out before and after, and whether it is surely smaller.

    Before with the design's values, which know these stretches: that is in their favour.
    """
    used, stretch = loop.used, loop.stretch
    count = int(stretch[-1]) + 1
    fold = loop.seconds.astype(int) // BLOCK % FOLDS
    squares = np.zeros((2, count))
    for number in range(FOLDS):
        part = replace(loop, chosen=fold != number, kept={})
        found, _ = fitted(part, prior, 0, values)
        rows = used & (fold[stretch] == number)
        for k, at in enumerate((loop.start, found)):
            squares[k] += np.bincount(stretch[rows], loop.left(at)[rows] ** 2, count)
    before, after = np.sqrt(squares.sum(axis=1) / max(int(used.sum()), 1)).tolist()
    gain = squares[0] - squares[1]
    return before, after, bool(gain.sum() > SURE * math.sqrt(count) * float(np.std(gain)))


def _written(design: Design, loop: OpenLoop, values: Array, fit: Fit) -> Design:
    """Return the design with these values, and the standard errors of the fit by simulation."""
    entries = list(design.effects)
    for column, value in zip(loop.columns, values.tolist(), strict=True):
        if column.is_inertia:
            design = with_total_inertia(design, value, fit.stderr.get(column.name, float("nan")))
        if column.entry < 0:
            continue
        entry = entries[column.entry]
        stderr = {symbol: e for symbol, e in entry.stderr.items() if symbol != column.symbol}
        own = fit.stderr.get(column.name, float("nan"))
        if np.isfinite(own):
            stderr[column.symbol] = float(own)
        parameters = {**entry.parameters, column.symbol: value}
        entries[column.entry] = entry.model_copy(update={"parameters": parameters, "stderr": stderr})
    return design.replace_effects(tuple(entries))


def with_polish(case: Case, found: Diagnosis) -> Diagnosis:
    """Return the answer with the parameters of its design refined by simulation.

    Parameters
    ----------
    case : Case
    found : Diagnosis
    """
    if case.believed is None or found.design is case.as_given:
        return found
    design, said = polished(found.design, found.record, case.believed.log)
    steps = found.steps if design is found.design else tuple(_step(step, design) for step in found.steps)
    return replace(found, design=design, steps=steps, remarks=said)


def _step(step: DiagnosisStep, design: Design) -> DiagnosisStep:
    """Return a step with the parameters of the design, where it has the effect once."""
    entries = [entry for entry in design.effects if entry.id == step.effect]
    if len(entries) != 1 or step.effect not in catalogue_of(design):
        return step
    values, stderr = entries[0].parameters, entries[0].stderr
    parameters = {
        symbol: Estimate(values.get(symbol, e.value), e.unit, stderr.get(symbol, float("nan")))
        for symbol, e in step.parameters.items()
    }
    return replace(step, parameters=parameters)

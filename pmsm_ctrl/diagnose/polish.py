"""The parameters of a fitted design refined by simulation, where that is better on stretches that were left out.

The regression judges by inverse dynamics, in a band and by columns; a simulation has every effect as it is, springs,
gaps and bristles with their memory. It replaces the regression's values only where it predicts what it was not fitted
to.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose.case import Case
from pmsm_ctrl.diagnose.notices import NOT_POLISHED, POLISHED
from pmsm_ctrl.diagnose.result import Diagnosis, DiagnosisStep
from pmsm_ctrl.effects.catalogue import catalogue_of
from pmsm_ctrl.errors import LogError
from pmsm_ctrl.identify.open_loop import OpenLoop, open_loop
from pmsm_ctrl.identify.open_loop_fit import fitted, profiled, solved
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.regression.drive_timing import LATENESS, SPREAD, in_time
from pmsm_ctrl.regression.least_squares import Fit
from pmsm_ctrl.regression.prediction import predict
from pmsm_ctrl.regression.total_inertia import with_total_inertia
from pmsm_ctrl.regression.worse_than_given import worse_than_given
from pmsm_ctrl.result import Estimate
from pmsm_ctrl.section import Notice

__all__ = ["Polish", "polished", "with_polish"]

Array = NDArray[np.float64]

FOLDS, BLOCK = 4, 1  # parts of the log, each left out in turn, and how many seconds of each lie together
# Standard errors by which the mean gain of what was left out must exceed zero, and by which two methods may differ.
SURE = 2.0


@dataclass(frozen=True, eq=False)
class Polish:
    """A design whose parameters were to be refined by simulation.

    Attributes
    ----------
    design : Design
        Refined, or as it was given.
    said : tuple of Notice
        Which of the two, and why.
    ends : dict of (int, str) to (float, float)
        95 % intervals where the sum of squares is no parabola, by position of the effect in the design and symbol.
    worse : bool
        Whether the design was refined, and the torque error rose by it.
    """

    design: Design
    said: tuple[Notice, ...]
    ends: Mapping[tuple[int, str], tuple[float, float]] = field(default_factory=dict)
    worse: bool = False

    def told(self, found: Mapping[str, Estimate], position: int) -> dict[str, Estimate]:
        """Return estimates of the parameters of an effect of the design as that has them.

        Parameters
        ----------
        found : dict of symbol to Estimate
        position : int
            Of the effect in the design.
        """
        entry = self.design.effects[position]
        return {
            symbol: replace(
                one,
                value=entry.parameters.get(symbol, one.value),
                stderr=entry.stderr.get(symbol, float("nan")),
                ends=self.ends.get((position, symbol)),
            )
            for symbol, one in found.items()
        }


def polished(design: Design, record: Record, log: Log, inertia: float = math.nan) -> Polish:
    """Return a design with its parameters refined by simulation of its log, or as it is, and which of the two.

    Parameters
    ----------
    design : Design
        As the regression left it, with standard errors.
    record : Record
        Of the log.
    log : Log
    inertia : float
        Standard error of the design's inertia.
    """
    timed = predict(design, record).timing.undone(in_time(design, log))
    sigma = {LATENESS: (record.sampling + record.early) / math.sqrt(12.0), SPREAD: record.sampling**2 / 6.0}
    try:
        loop = open_loop(design, timed, {} if record.sampling_stated else sigma, inertia)
    except LogError as error:
        return Polish(design, (NOT_POLISHED(why=str(error)),))
    prior = {
        column.name: design.effects[column.entry].stderr.get(column.symbol, 0.0)
        for column in loop.columns
        if column.entry >= 0
    }
    made = _refined(design, loop, prior, record)
    if made.worse and any(column.is_inertia and not column.held for column in loop.columns):
        # the balance tells the inertia best, and every thousandth of it shows there
        made = _refined(design, loop.with_inertia_held(inertia), prior, record)
    return made


def _refined(design: Design, loop: OpenLoop, prior: Mapping[str, float], record: Record) -> Polish:
    """Return the design refined by one simulation, or as it is."""
    values, converged = fitted(loop, prior)
    if not converged:
        return Polish(design, (NOT_POLISHED(why="the fit by simulation did not converge"),))
    if apart := _contradicted(loop, prior, values):
        return Polish(design, (NOT_POLISHED(why=apart),))
    before, after, sure = _left_out(loop, prior, values)
    unit = record.unit("torque")
    if not sure:
        why = f"stretches left out are predicted to {after:.3g} {unit} in place of {before:.3g} {unit}, no sure gain"
        return Polish(design, (NOT_POLISHED(why=why),))
    fit = solved(loop, values)[1]
    found = _written(design, loop, values, fit)
    if worse := worse_than_given(design, found, record):
        return Polish(design, (NOT_POLISHED(why=worse.text),), worse=True)
    columns = {column.name: column for column in loop.columns}
    ends = {(columns[n].entry, columns[n].symbol): e for n, e in profiled(loop, prior, values, fit).items()}
    return Polish(found, (POLISHED(before=before, after=after, unit=unit),), ends)


def _contradicted(loop: OpenLoop, prior: Mapping[str, float], values: Array) -> str:
    """Say which parameter of a simulation that is corrected at every sample contradicts the regression; empty if none.

    Both follow the same bristle, by other parts of the band and with other errors by noise: where they differ one of
    them is biased.
    """
    for column, value in zip(loop.columns, values.tolist(), strict=True):
        stderr = prior.get(column.name, 0.0)
        if loop.corrected and stderr > 0.0 and abs(value - column.nominal) > SURE * stderr:
            unit = f" {column.unit}" if column.unit != "1" else ""
            return (
                f"{column.name} is {value:.3g}{unit} by simulation, {column.nominal:.3g} +- {stderr:.2g}{unit} before"
            )
    return ""


def _left_out(loop: OpenLoop, prior: Mapping[str, float], values: Array) -> tuple[float, float, bool]:
    """Return the rms error of stretches left out before and after, and whether it is surely smaller.

    Before with the design's values, which know these stretches: that is in their favour. If the simulation is
    corrected at every sample it must not be surely larger: it uses all of the band, and has the smaller errors.
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
    sure = math.copysign(SURE, -1.0 if loop.corrected else 1.0)
    return before, after, bool(gain.sum() > sure * math.sqrt(count) * float(np.std(gain)))


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
    inertia = next((one.stderr for one in found.parameter_deviations if one.parameter == "J"), math.nan)
    made = polished(found.design, found.record, case.believed.log, inertia)
    refined = made.design is not found.design
    steps = tuple(_step(step, made) for step in found.steps) if refined else found.steps
    return replace(found, design=made.design, steps=steps, remarks=made.said)


def _step(step: DiagnosisStep, made: Polish) -> DiagnosisStep:
    """Return a step with the parameters of the design, where it has the effect once."""
    positions = [k for k, entry in enumerate(made.design.effects) if entry.id == step.effect]
    if len(positions) != 1 or step.effect not in catalogue_of(made.design):
        return step
    return replace(step, parameters=made.told(step.parameters, positions[0]))

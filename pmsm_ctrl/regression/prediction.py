"""Prediction of a record by a design: its parameters as they stand, with the sampling of the log fitted."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.regression.base_fit import (
    Settled,
    assembled,
    delay_of,
    false_torque,
    laid_out_again,
    settled_model,
    weighted,
    with_bristles,
)
from pmsm_ctrl.regression.bounds import holding
from pmsm_ctrl.regression.drive_timing import AGE, EMF, EMF_FILTERED, LATENESS, DriveTiming
from pmsm_ctrl.regression.lateness import stopped
from pmsm_ctrl.regression.model import TURNING, Model, Solved
from pmsm_ctrl.regression.modelled import with_modelled_torque

__all__ = ["Prediction", "better_without", "errors", "physical_columns", "predict"]

Array = NDArray[np.float64]

# The parameters that a design states without an effect.
STATED = ("J", "R", "L_d", "L_q", "psi_f")
# Times with a prior that says what is possible; the delay of the drive signal has bounds of its own.
TIMES = (AGE, EMF, EMF_FILTERED, TURNING)
SURE = 3.0  # standard deviations of the prior
# Share of the sum of squares that a lateness at its bound leaves at most where the drive signal is late: 23 to 28 % in
# a log that is a period late, 77 % where the design lacks a cogging.
MOST = 0.5
READINGS = 3  # of the torque that a design with a delay makes, beside the nuisances


@dataclass(frozen=True, eq=False)
class Prediction:
    """The balances of a record as a design predicts them.

    Attributes
    ----------
    record : Record
        With modelled torque in its signals.
    predicted : array, shape (channels, m)
        What is predicted of `record.target`.
    nuisances : dict of str to (float, float)
        What was fitted beside the design: sampling, moments of reversal, age of the voltages; value and standard error.
    notes : tuple of str
        What of the design this record cannot evaluate.
    """

    record: Record
    predicted: Array
    nuisances: Mapping[str, tuple[float, float]]
    notes: tuple[str, ...] = ()

    @property
    def residual(self) -> Array:
        """Measured less predicted, shape (channels, m)."""
        return self.record.target - self.predicted

    @property
    def torque_error(self) -> tuple[float, float]:
        """Rms of what is left of the torque, N m (N), and its share of the torque."""
        return errors(self.record, self.residual, ("torque",))["torque"]

    @property
    def timing(self) -> DriveTiming:
        """How the drive signal was sampled beside the position: undone in the record, and found beside the design."""
        undone = self.record.timing
        if self.record.age is not None:
            return replace(undone, late=undone.late - self.record.age.delay - self.nuisances[AGE][0])
        return replace(undone, late=undone.late + self.nuisances[LATENESS][0])

    @property
    def timing_stderr(self) -> float:
        """Standard error of that delay, s."""
        return self.nuisances[LATENESS if self.record.age is None else AGE][1]


def predict(design: Design, record: Record, like: Prediction | None = None) -> Prediction:
    """Return what a design predicts of a record; nothing of the design is fitted.

    The sampling of the channels, which no design can state for every log, is fitted as in every fit.

    Parameters
    ----------
    design : Design
    record : Record
    like : Prediction, optional
        Of another record that was sampled in the same way: what was fitted there is taken. Where one of the two has a
        position and the other a speed alone, they were not.
    """
    if like is not None and (like.record.age is None) == (record.age is None):
        return _alike(design, record, like)
    found = settled_model(design, record)
    fit, at = weighted(found), _stated(design, found.model)
    beside = holding(fit, at)
    if _small_at_its_bound(found, fit, at, beside):
        at[found.model.names.index(LATENESS)] = 0.0
        beside = holding(fit, at)
    usual, change = (found, fit, beside), np.inf
    for _ in range(READINGS if any(group.delays for group in found.model.groups) else 0):
        before, torque = change, beside.predicted()[0]
        found = _about_its_delay(design, found, beside.values)
        fit = weighted(found)
        beside = holding(fit, at)
        change = float(np.linalg.norm(beside.predicted()[0] - torque))
        if change > before:  # those of a delay as long as the motion is fast do not settle
            found, fit, beside = usual
            break
    if _impossible(found.model, beside.values):
        beside = holding(fit, {k: at.get(k, float(value)) for k, value in enumerate(fit.values)})
    if at_zero := better_without(found.record, found.model, beside.predicted(), at):
        beside = holding(fit, at_zero)
    held = physical_columns(found.model)
    free = [k for k in range(len(found.model.names)) if k not in held]
    stderr = np.nan_to_num(beside.stderr)
    nuisances = {found.model.names[k]: (float(beside.values[k]), float(stderr[k])) for k in free}
    return Prediction(found.record, beside.predicted(), nuisances, found.notes)


def _small_at_its_bound(found: Settled, fit: Solved, at: Mapping[int, float], beside: Solved) -> bool:
    """Return whether a lateness is held at the end of what sampling can do, and is not most of the error without it.

    What no sampling can do is something that the design lacks, and belongs to the residual. A drive signal that is just
    as late as sampling can make it is most of the error.
    """
    if LATENESS not in found.model.names or not stopped(found.record, found.model):
        return False
    without = holding(fit, {**at, found.model.names.index(LATENESS): 0.0})
    target, record = found.record.target[0], found.record
    for used in (record.weight[0] * record.mask, record.mask):  # as the fit weighs it, and as it is reported
        left, whole = (float(np.sum(((target - one.predicted()[0]) * used) ** 2)) for one in (beside, without))
        if left <= MOST * whole:
            return False
    return True


def _about_its_delay(design: Design, found: Settled, values: Array) -> Settled:
    """Return the model of a design that states a delay, met exactly by the design's torque and not by that of a fit."""
    torque = found.model.matrix[0] @ values - false_torque(found.model, values)
    record = with_modelled_torque(found.record, torque, delay_of(found.model, values))
    return replace(found, record=record, model=laid_out_again(design, record, found.model))


def _impossible(model: Model, values: Array) -> bool:
    """Return whether a time that was fitted beside the design is beyond what is possible.

    Beside parameters that are far off, a time takes their place: the one of the free fit is then the sampling's.
    """
    times = [k for k, name in enumerate(model.names) if name in TIMES]
    return any(abs(values[k] - model.nominal[k]) > SURE * model.sigma[k] for k in times)


def better_without(record: Record, model: Model, predicted: Array, at: Mapping[int, float]) -> dict[int, float]:
    """Return all columns with the nuisances at zero, where these raise the error of the torque; else none.

    In the weighted fit of a design that is far off, the nuisances can take wrong values that suit the samples of the
    largest weight.

    Parameters
    ----------
    record : Record
    model : Model
    predicted : array, shape (channels, m)
        With the nuisances.
    at : dict of column to float
        Of the parameters that are none.
    """
    values = np.zeros(len(model.names))
    values[list(at)] = list(at.values())
    used = record.mask
    fitted, plain = (record.target[0][used] - one[used] for one in (predicted[0], model.matrix[0] @ values))
    if np.linalg.norm(fitted) <= np.linalg.norm(plain):
        return {}
    return dict(enumerate(values.tolist()))


def _stated(design: Design, model: Model) -> dict[int, float]:
    """Return the columns whose values the design states, and these values.

    The model's nominal inertia is another one where noise hides the acceleration, and the log contradicts the design.
    """
    held, nominal = physical_columns(model), model.nominal.tolist()
    return {k: design.J if model.names[k] == "J" else nominal[k] for k in held}


def physical_columns(model: Model) -> tuple[int, ...]:
    """Return the columns whose values a design states; all others are nuisances of the record.

    Parameters
    ----------
    model : Model
    """
    columns = enumerate(model.names)
    return tuple(k for k, name in columns if model.group_of(k).effect is not None or name in STATED)


def _alike(design: Design, record: Record, like: Prediction) -> Prediction:
    """Predict a record with the nuisances of another one."""
    record = with_bristles(design, record)
    notes: tuple[str, ...] = ()
    predicted = record.target
    for _ in range(2):
        model, notes = assembled(design, record, ())
        stated = _stated(design, model)
        known = {name: value for name, (value, _) in like.nuisances.items()}
        values = np.array([stated.get(k, known.get(name, 0.0)) for k, name in enumerate(model.names)])
        predicted = model.matrix @ values
        record = with_modelled_torque(record, predicted[0] - false_torque(model, values), delay_of(model, values))
    return Prediction(record, predicted, like.nuisances, notes)


def errors(record: Record, residual: Array, channels: Iterable[str] | None = None) -> dict[str, tuple[float, float]]:
    """Return the rms residual and its share of the measured balance, over the moving samples.

    Parameters
    ----------
    record : Record
    residual : array, shape (channels, m)
    channels : iterable of str, optional
        All of the record's when left out.
    """
    out = {}
    for row, name in enumerate(record.channels):
        if channels is not None and name not in channels:
            continue
        used = record.mask
        size = float(np.sqrt(np.mean(record.target[row][used] ** 2)))
        rms = float(np.sqrt(np.mean(residual[row][used] ** 2)))
        out[name] = (rms, rms / size if size > 0.0 else float("nan"))
    return out

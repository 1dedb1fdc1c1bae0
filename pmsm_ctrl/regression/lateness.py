"""The delay of the drive signal inside its bounds; values by the reference where noise biases least squares."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.regression.drive_timing import LATENESS, SPREAD
from pmsm_ctrl.regression.instruments import ReferenceEstimates, by_reference
from pmsm_ctrl.regression.model import FIXED, Model, Solved

__all__ = ["UNDETERMINED", "lateness", "stopped", "with_sampling_bounded"]

Array = NDArray[np.float64]

# Standard error of the lateness, as a share of what sampling can do, above which a log does not determine it. Slow
# reversals alone do not: an error in the inertia or in the moment of a reversal has the same effect there.
UNDETERMINED = 0.2
SURE = 3.0  # standard errors by which least squares must differ from the reference to be called biased


def lateness(model: Model, values: Array) -> float:
    """Return the delay of the drive signal behind the position, s; zero where it is not fitted.

    Parameters
    ----------
    model : Model
    values : array, shape (k,)
        Of its parameters.
    """
    return float(values[model.names.index(LATENESS)]) if LATENESS in model.names else 0.0


def stopped(record: Record, model: Model) -> bool:
    """Return whether the lateness of a model is held at the end of what sampling can do.

    Parameters
    ----------
    record : Record
    model : Model
        With a lateness among its parameters.
    """
    k = model.names.index(LATENESS)
    late = _undone(record) + float(model.nominal[k])
    ends = (-record.early, record.sampling)
    return bool(model.nominal[k] != 0.0 and min(abs(late - end) for end in ends) < FIXED * record.sampling)


def _undone(record: Record) -> float:
    """Return the delay that was corrected before the fit, s; 0 for a stated one, around which it is possible."""
    return 0.0 if record.sampling_stated else record.timing.late


def with_sampling_bounded(record: Record, model: Model, fit: Solved, sigma: float) -> Model:
    """Hold the delay of the drive signal inside what sampling can cause. A larger delay is the effect `delay`.

    Where the log does not determine the delay, the one that was corrected before the fit stays. Where least squares and
    the reference differ, noise that moves the axis biases least squares: delay and variance by the reference are then
    held, and so is the inertia where that noise makes it too small. A held parameter keeps its standard error.

    Parameters
    ----------
    record : Record
    model : Model
    fit : Solved
        With the lateness free.
    sigma : float
        Noise of a sample of the torque balance that has full weight, N m (N).
    """
    if LATENESS not in model.names:
        return model
    estimates = by_reference(record, model, sigma)
    model = _with_sampling_held(record, model, fit, estimates)
    return model if estimates is None else _with_inertia_held(model, fit, estimates)


def _with_sampling_held(record: Record, model: Model, fit: Solved, estimates: ReferenceEstimates | None) -> Model:
    k = model.names.index(LATENESS)
    undone, value, stderr = _undone(record), float(fit.values[k]), float(fit.stderr[k])
    delayed = any(group.delays for group in model.groups)
    undetermined = UNDETERMINED * record.sampling
    free = not (delayed or record.sampling_stated)
    by = estimates if free and estimates is not None and _biased(model, fit, estimates) else None
    if by is not None and by.late[1] > undetermined >= stderr:
        # a reference that does not determine the delay shows no bias of it, but an error of the model: of either
        model = replace(model, bias={**model.bias, k: _beyond_noise(by.late, value)})
        by = None
    held: dict[int, tuple[float, float]] = {}
    late, error = (value, stderr) if by is None else by.late
    late += undone
    # that much a log tells in any case, unless its sampling is stated
    beyond = not record.sampling_stated and max(late - record.sampling, -record.early - late) > SURE * error
    if delayed or (max(stderr, error) > undetermined and not beyond):
        possible = (record.sampling + record.early) / math.sqrt(12.0)
        held[k] = 0.0, 0.0 if delayed else min(error, possible)
    else:
        if by is None and -record.early <= late <= record.sampling:
            return model
        held[k] = min(max(late, -record.early), record.sampling) - undone, error
        if by is not None:
            held[model.names.index(SPREAD)] = by.spread
    settled = _holding(model, held, {k: record.sampling, model.names.index(SPREAD): record.sampling**2})
    if by is None:
        return settled
    inside = -record.early <= late <= record.sampling  # at its bound a delay stays, whatever the torque is
    names = (LATENESS, SPREAD) if inside else (SPREAD,)
    return replace(settled, responses=tuple(by.responses[name] for name in names))


def _with_inertia_held(model: Model, fit: Solved, estimates: ReferenceEstimates) -> Model:
    """Return the model with the inertia by the reference held, where it is the more certain one.

    Noise of the motion makes the inertia by least squares too small, at most by its share of the acceleration. Where
    the reference is less certain than that, the inertia stays free. Its bias is then the difference of the two
    estimates beyond the standard error of the one by the reference.
    """
    k = model.names.index("J")
    value, stderr = estimates.inertia
    if value <= 0.0 or stderr <= 0.0:
        return model
    short = value - float(fit.values[k])
    if stderr > estimates.noise * value and short < SURE * stderr:
        return replace(model, bias={**model.bias, k: _beyond_noise(estimates.inertia, float(fit.values[k]))})
    tolerance = model.doubt.get(k, float(model.sigma[k]))  # of the datasheet, which counts as ever
    known = 1.0 / stderr**2 + 1.0 / tolerance**2
    value = (value / stderr**2 + float(model.nominal[k]) / tolerance**2) / known
    share, response = 1.0 / (stderr**2 * known), estimates.responses["J"]
    responses = (*model.responses, replace(response, slope=share * response.slope))
    return replace(_holding(model, {k: (value, 1.0 / math.sqrt(known))}, {k: value}), responses=responses)


def _beyond_noise(by_reference: tuple[float, float], value: float) -> float:
    """Return how far a value lies from an estimate by the reference, beyond the standard error of that."""
    told, stderr = by_reference
    return math.sqrt(max((told - value) ** 2 - stderr**2, 0.0))


def _holding(model: Model, held: Mapping[int, tuple[float, float]], scale: Mapping[int, float]) -> Model:
    """Return the model with columns held at values that are known to within their standard errors."""
    nominal, known = model.nominal.copy(), model.sigma.copy()
    doubt = dict(model.doubt)
    for k, (value, stderr) in held.items():
        nominal[k], known[k] = value, FIXED * scale[k]
        doubt[k] = max(stderr, known[k])
    return replace(model, nominal=nominal, sigma=known, doubt=doubt)


def _biased(model: Model, fit: Solved, estimates: ReferenceEstimates) -> bool:
    """Return whether least squares differs from the reference in the way of noise: earlier, with a larger variance.

    Any other difference is an error of the model, against which instruments are no better.
    """
    late, spread = (float(fit.values[model.names.index(name)]) for name in (LATENESS, SPREAD))
    earlier = (estimates.late[0] - late) / max(estimates.late[1], 1e-300)
    wider = (spread - estimates.spread[0]) / max(estimates.spread[1], 1e-300)
    return max(earlier, wider) > SURE and min(earlier, wider) > 0.0

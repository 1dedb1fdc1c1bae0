"""How late the drive signal of a fit was sampled, and how late it can have been."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.regression.drive_timing import LATENESS, SPREAD
from pmsm_ctrl.regression.instruments import Referred, sampling_by_reference
from pmsm_ctrl.regression.model import FIXED, Model, Solved

__all__ = ["lateness", "stopped", "with_sampling_bounded"]

Array = NDArray[np.float64]

# Share of what sampling can do from which on an error says that a log does not tell the lateness: slow reversals alone
# do not, as an error in the inertia or in the moment of a reversal is the same there.
UNTOLD = 0.2
SURE = 3.0  # standard errors by which least squares must differ from the reference to be called biased


def lateness(model: Model, values: Array) -> float:
    """Return how late the drive signal was sampled, s; zero where that is not fitted.

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
    """Return what of the lateness was undone, s: a sampling that is stated is the centre of what is possible."""
    return 0.0 if record.sampling_told else record.timing.late


def with_sampling_bounded(record: Record, model: Model, fit: Solved, sigma: float) -> Model:
    """Hold the lateness of the drive signal inside what sampling can do: the rest is a delay, an effect.

    Where the log does not tell it, it stays where it was taken out. Where the reference tells another one than least
    squares does, noise that moves the axis biases the latter; delay and variance are then those by the reference.

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
    nominal, known = model.nominal.copy(), model.sigma.copy()
    k = model.names.index(LATENESS)
    undone, value = _undone(record), float(fit.values[k])
    delayed = any(group.effect is not None and group.effect.structure.delays for group in model.groups)
    untold = UNTOLD * record.sampling
    told = None if delayed or record.sampling_told else sampling_by_reference(record, model, sigma)
    biased = told is not None and _biased(model, fit, told)
    if delayed or fit.stderr[k] > untold or (told is not None and biased and told.late_stderr > untold):
        nominal[k] = 0.0
    else:
        late = undone + (told.late if told is not None and biased else value)
        if not biased and -record.early <= late <= record.sampling:
            return model
        nominal[k] = min(max(late, -record.early), record.sampling) - undone
        if told is not None and biased:
            j = model.names.index(SPREAD)
            nominal[j], known[j] = told.spread, FIXED * record.sampling**2
    known[k] = FIXED * record.sampling
    return replace(model, nominal=nominal, sigma=known)


def _biased(model: Model, fit: Solved, told: Referred) -> bool:
    """Return whether least squares differs from the reference as noise makes it: earlier, and with a larger variance.

    Anything else is an error of the model, which instruments do not bear better.
    """
    late, spread = (float(fit.values[model.names.index(name)]) for name in (LATENESS, SPREAD))
    earlier = (told.late - late) / max(told.late_stderr, 1e-300)
    wider = (spread - told.spread) / max(told.spread_stderr, 1e-300)
    return max(earlier, wider) > SURE and min(earlier, wider) > 0.0

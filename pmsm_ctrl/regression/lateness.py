"""How late the drive signal of a fit was sampled, and how late it can have been."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.regression.drive_timing import LATENESS
from pmsm_ctrl.regression.model import FIXED, Model, Solved

__all__ = ["lateness", "stopped", "with_sampling_bounded"]

Array = NDArray[np.float64]

# Share of what sampling can do from which on an error says that a log does not tell the lateness: slow reversals alone
# do not, as an error in the inertia or in the moment of a reversal is the same there.
UNTOLD = 0.2


def lateness(model: Model, values: Array) -> float:
    """Return how late the drive signal was sampled, s; zero where that is not fitted.

    Parameters
    ----------
    model : Model
    values : array, shape (k,)
        Of its parameters.
    """
    return float(values[model.names.index(LATENESS)]) if LATENESS in model.names else 0.0


def stopped(model: Model) -> bool:
    """Return whether the lateness of a model is held at the end of what sampling can do.

    Parameters
    ----------
    model : Model
        With a lateness among its parameters.
    """
    k = model.names.index(LATENESS)
    return bool(model.nominal[k] != 0.0)


def with_sampling_bounded(record: Record, model: Model, fit: Solved) -> Model:
    """Hold the lateness of the drive signal inside what sampling can do: the rest is a delay, an effect.

    Where the log does not tell it, it stays where it was taken out.

    Parameters
    ----------
    record : Record
    model : Model
    fit : Solved
        With the lateness free.
    """
    if LATENESS not in model.names:
        return model
    nominal, sigma = model.nominal.copy(), model.sigma.copy()
    k = model.names.index(LATENESS)
    # a sampling that the design states is the centre of what is possible, else the time of the position is
    undone = 0.0 if record.sampling_told else record.timing.late
    late = undone + float(fit.values[k])
    delayed = any(group.effect is not None and group.effect.structure.delays for group in model.groups)
    if delayed or fit.stderr[k] > UNTOLD * record.sampling:
        nominal[k] = 0.0
    elif not -record.early <= late <= record.sampling:
        nominal[k] = (record.sampling if late > 0.0 else -record.early) - undone
    else:
        return model
    sigma[k] = FIXED * record.sampling
    return replace(model, nominal=nominal, sigma=sigma)

"""What a candidate would take from the residual, before anything is fitted again."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.diagnose.fit import Fitted
from pmsm_ctrl.diagnose.search import Trial

__all__ = ["beside_model"]

Array = NDArray[np.float64]

SLIGHT = 1e-3  # weight below which a sample says nothing of a curve's height


def beside_model(fit: Fitted, trial: Trial) -> Array:
    """Return the part of the residual that a candidate explains and the model, its parameters freed, does not.

    With the weights of the estimate, and the priors of the parameters. Over samples that take no part the curve is
    a straight line.

    Parameters
    ----------
    fit : Fitted
    trial : Trial
        One of its trials.

    Returns
    -------
    array, shape (channels, m)
        Zero for a candidate that the model has already.
    """
    record, used = fit.record, fit.weights.used
    out = np.zeros(record.target.shape)
    if trial.singular:
        return out
    told = trial.plain_direction[: len(used) * len(out)].reshape(len(out), len(used))
    for row, channel in enumerate(fit.weights.channels):  # the estimate's weights know no correlation: one factor each
        kept = channel.weight > SLIGHT
        height = told[row, kept] / (channel.weight[kept] * channel.filters[0, 0])
        out[row] = np.interp(record.t, record.t[used[kept]], height)
    return out

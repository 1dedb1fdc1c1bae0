"""What a candidate would take from the residual, before anything is fitted again."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.diagnose.fit import Fitted
from pmsm_ctrl.diagnose.search import Trial

__all__ = ["beside_model"]

Array = NDArray[np.float64]


def beside_model(fit: Fitted, trial: Trial) -> Array:
    """Return the part of a candidate's columns that the model cannot imitate, at its estimated size.

    The projection uses the weights of the estimate; the priors of the parameters take no part.

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
    record, matrix = fit.record, fit.model.matrix
    own = trial.group.values @ trial.values if not trial.singular else np.zeros(record.target.shape)
    sigma = np.array([channel.sigma for channel in fit.weights.channels])[:, None]
    weight = np.where(record.mask, record.weight, 0.0) / sigma
    inside = (weight[:, :, None] * matrix).reshape(-1, matrix.shape[2])
    size = np.linalg.norm(inside, axis=0)
    size[size == 0.0] = 1.0
    values = np.linalg.lstsq(inside / size, (weight * own).ravel(), rcond=None)[0] / size
    beside: Array = own - matrix @ values
    return beside

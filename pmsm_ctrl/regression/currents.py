"""The currents that terms read: what was meant to flow, and what is faster than the low-pass of the signals."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.conditioning import Prepared
from pmsm_ctrl.regression.edges import UPPER
from pmsm_ctrl.regression.filters import low_pass
from pmsm_ctrl.regression.weights import on_grid, scatter

__all__ = ["intended_i_d", "with_noise"]

Array = NDArray[np.float64]

INTENDED = 0.25  # of the cutoff: a current that is meant to flow along d changes no faster


def intended_i_d(log: Log, prepared: Prepared, i_d: Array) -> Array:
    """Return the d-current without its noise: the reference where it is logged, else the slow part if there is any.

    Parameters
    ----------
    log : Log
    prepared : Prepared
    i_d : array, shape (n,)
        Measured and pre-filtered, A.
    """
    if "i_d_ref" in log:
        return on_grid(log, prepared, "i_d_ref")
    slow = low_pass(i_d, prepared.rate, INTENDED * prepared.cutoff)
    noise = float(np.std(i_d - slow))
    return slow if float(np.sqrt(np.mean(slow**2))) > 3.0 * noise else np.zeros_like(i_d)


def with_noise(log: Log, prepared: Prepared) -> dict[str, Array]:
    """Return the q-current as it was logged, and the standard deviation of its noise, shape (n,) each, A.

    A term that bends over the current needs the current as fast as it was: its mean over a fast current is not its
    value at the mean. The noise above a quarter of the rate is taken for that of all frequencies alike.

    Parameters
    ----------
    log : Log
    prepared : Prepared
    """
    logged = on_grid(log, prepared, "i_q")
    noise = scatter(logged, prepared.rate) / math.sqrt(1.0 - 2.0 * UPPER)
    return {"i_q_logged": logged, "i_q_noise": np.broadcast_to(noise, logged.shape)}

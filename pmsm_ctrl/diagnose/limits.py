"""The amounts of an effect that a log can show, by a test that knows its shape."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.diagnose.search import beyond
from pmsm_ctrl.evidence.tests import noncentrality
from pmsm_ctrl.evidence.whitening import Whitener
from pmsm_ctrl.regression.columns import Group
from pmsm_ctrl.regression.model import Solved

__all__ = ["amounts_that_gain", "detection_limits"]

Array = NDArray[np.float64]


def detection_limits(
    solved: Solved, whitener: Whitener, group: Group, level: float, along: Array | None = None
) -> Array:
    """Return the amounts that a test which knows shape and noise detects in half of all logs.

    Parameters
    ----------
    solved : Solved
    whitener : Whitener
    group : Group
    level : float
        Significance level of the test.
    along : array, shape (k,), optional
        Proportion of the parameters; each alone when left out.

    Returns
    -------
    array, shape (k,), or (1,) with `along`
        In the units of the parameters, or of `along`; infinite where the model has the columns already.
        Source: Cramer and Rao's bound in the power of the chi-square test, S. M. Kay, Fundamentals of Statistical
        Signal Processing II, Prentice Hall 1998, sec. 6.5.
    """
    rank, seen = _seen(solved, whitener, group, along)
    amounts: Array = (
        np.sqrt(noncentrality(level, rank)) / np.maximum(seen, 1e-300) if rank else np.full(len(seen), np.inf)
    )
    return amounts


def amounts_that_gain(solved: Solved, whitener: Whitener, group: Group, gain: float) -> Array:
    """Return the amount of each parameter, alone, that raises the sum of squares by this gain.

    Parameters
    ----------
    solved : Solved
    whitener : Whitener
    group : Group
    gain : float
        In units of the noise.

    Returns
    -------
    array, shape (k,)
    """
    rank, seen = _seen(solved, whitener, group)
    amounts: Array = np.sqrt(gain) / np.maximum(seen, 1e-300) if rank else np.full(len(seen), np.inf)
    return amounts


def _seen(solved: Solved, whitener: Whitener, group: Group, along: Array | None = None) -> tuple[int, Array]:
    """Return the rank of a group beside the model, and the residual by one unit of it, in units of the noise."""
    _, own = beyond(solved, whitener, group)
    parts = np.eye(len(own.size)) if along is None else np.asarray(along, dtype=float)[:, None]
    if own.rank == 0:
        return 0, np.zeros(parts.shape[1])
    seen: Array = np.linalg.norm(np.linalg.pinv(own.back * own.size[:, None]) @ (own.size[:, None] * parts), axis=0)
    return own.rank, seen

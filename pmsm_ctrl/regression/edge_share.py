"""How far off the edges of the drive signal are in a log: what a fit leaves around them and elsewhere.

A log of instants may hold an edge one period too early or too late. A log of means over its period, or of a drive that
is no faster than it, holds the edges where they are, and they tell the inertia better than anything else does. Which of
the two a log is, its residual tells: that of a sample has the variance ``s^2 (1 + q^2 e^2)``, where ``e`` is the error
that a whole period makes, over the noise. The share ``q`` is found by maximum likelihood.

Source: H. O. Hartley, J. N. K. Rao, Biometrika 54 (1967) 93, with one component of the variance beside the noise.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.evidence.linalg import factored
from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.regression.base_fit import Estimated
from pmsm_ctrl.regression.edges import by_variance
from pmsm_ctrl.regression.model import MOST_NOISE, noise_share

__all__ = ["FEWEST", "edge_share", "falsified", "has_edges", "likeliest_share"]

Array = NDArray[np.float64]

# Share of the samples that must lose half of their weight: fewer edges are not worth a fit of their own, nor a word.
FEWEST, LOST = 0.005, 0.5
# Weight of a sample without its edges, from which on they are what is left to doubt of it.
SOUND = 0.5
# Error by edges, over the noise, below which a sample counts as one without.
QUIET = 0.02
# The shares that are tried: a tenth of a decade apart, and none.
SHARES = (0.0, *np.logspace(-3.0, 0.0, 31).tolist())


def falsified(record: Record, share: float = 1.0) -> float:
    """Return the share of the samples that lose half of their weight by edges.

    Parameters
    ----------
    record : Record
        Whose weights may be worked out again.
    share : float
        Error of the edges as a share of the one that a period of the log makes.
    """
    assert record.weighing is not None
    return float(np.mean(by_variance(share * record.weighing.edges(record.wrong))[record.mask] < LOST))


def has_edges(record: Record) -> bool:
    """Return whether edges may take the weight of a noticeable part of a log, and a fit can tell how far off they are.

    Noise of the acceleration may be most of what a fit leaves, and is no error of the edges.

    Parameters
    ----------
    record : Record
        Whose weights may be worked out again.
    """
    return falsified(record) >= FEWEST and noise_share(record, record.acceleration()) < MOST_NOISE


def edge_share(record: Record, fit: Estimated) -> float:
    """Return the error of the edges of a log as a share of the one that a period of it makes, at most 1.

    What an effect outside the model may add where the torque is large is fitted as well: it is no error of the edges.

    Parameters
    ----------
    record : Record
        In which edges have their full weight.
    fit : Estimated
        Of it.
    """
    assert record.weighing is not None
    used = record.mask & (record.weight[0] > SOUND)
    weight = (record.weight[0] * record.mask)[:, None]
    columns = np.hstack([fit.model.matrix[0], np.stack(_under_torque(fit.record), axis=1)])
    left = record.target[0] - columns @ factored(weight * columns).solve(weight[:, 0] * record.target[0])
    return likeliest_share(left[used], record.weighing.edges(record.wrong)[used])


def _under_torque(record: Record) -> list[Array]:
    """Return what effects add where the torque is large, each of shape (m,): friction by load, saturation, a spring."""
    torque, alpha = record.signals["torque"], record.signals["alpha"]
    twisted = record.rate_of(record.rate_of(alpha))
    return [
        record.shaped(one)
        for one in (np.abs(torque) * record.signals["direction"], torque * np.abs(torque), torque**3, twisted)
    ]


def likeliest_share(left: Array, edges: Array) -> float:
    """Return the likeliest share of the edges' errors.

    Parameters
    ----------
    left : array, shape (n,)
        Residual.
    edges : array, shape (n,)
        Error of each sample by edges a whole period off, over the noise.
    """
    far = edges > QUIET
    quiet, size, square = float(np.sum(left[~far] ** 2)), left[far] ** 2, edges[far] ** 2

    def cost(share: float) -> float:
        grown = 1.0 + share**2 * square
        noise = (quiet + float(np.sum(size / grown))) / len(left)
        return len(left) * math.log(max(noise, 1e-300)) + float(np.sum(np.log(grown)))

    return float(min(SHARES, key=cost))

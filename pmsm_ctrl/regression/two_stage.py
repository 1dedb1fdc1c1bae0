"""Candidates beside parameters that are held at values by instruments, as in two-stage least squares.

Where noise moves the axis, the inertia, and delay and variance of the drive signal, are held at their values by the
reference (`instruments`). These values were estimated without the effect that is missing. If the effect resembles the
acceleration, it has changed them: friction by load makes the inertia 2 to 8 % too large. The held inertia then explains
part of the effect, and the candidate loses that part.

So each candidate is judged by its column less the response of the held values to that column. The response lies along
the projection of the parameter's column on the instruments. The measured column is not used for it, because it holds
the noise for which the value was held.

Source: T. Soderstrom, P. Stoica, Instrumental Variable Methods for System Identification, Springer 1983, ch. 3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.regression.columns import Group

__all__ = ["HeldResponse", "beside_held", "gram_beside_held"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class HeldResponse:
    """Response of a value by instruments to the torque.

    Attributes
    ----------
    column : array, shape (m,)
        The parameter's column of the torque balance, projected on the instruments.
    slope : array, shape (m,)
        Derivative of the value with respect to each sample of the torque.
    """

    column: Array
    slope: Array


def beside_held(group: Group, responses: Sequence[HeldResponse]) -> Group:
    """Return the group with its torque columns less the response of the held values to them.

    Parameters
    ----------
    group : Group
    responses : sequence of HeldResponse
        Of the parameters that a model holds at values by instruments. Without any, the group is returned as it is.
    """
    columns = group.rows[0]
    if columns is None or not responses:
        return group
    left = columns.copy()
    for one in responses:
        left -= np.outer(columns @ one.slope, one.column)
    return replace(group, rows=(left, *group.rows[1:]))


def gram_beside_held(gram: Array, responding: Array) -> Array:
    """Return the Gram matrix of columns less the response of the held values to them.

    Parameters
    ----------
    gram : array, shape (n + k, n + k)
        Of n columns, and of the columns of k responses.
    responding : array, shape (k, n)
        Change of each held value with each column; zero where a column stays.
    """
    n = len(gram) - len(responding)
    turn = np.vstack([np.eye(n), -responding])
    return np.asarray(turn.T @ gram @ turn)

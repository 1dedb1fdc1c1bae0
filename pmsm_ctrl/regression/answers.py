"""Candidates beside values that instruments told: each value was estimated without the effect that is missing.

Where noise moves the axis, the inertia, and delay and variance of the drive signal, are held at their values by the
reference (`instruments`). A missing effect that resembles the acceleration has changed these values: friction by load
makes the inertia 2 to 8 % too large, and what the held inertia explains of it is lost to the candidate. So candidates
are judged as two-stage least squares judges them beside the held parameters: each column less what the held values
answer to it. The answer stands along the parameter's column as far as the instruments tell it, for the measured one
holds the noise for which the value was held.

Source: T. Soderstrom, P. Stoica, Instrumental Variable Methods for System Identification, Springer 1983, ch. 3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.regression.columns import Group

__all__ = ["Answer", "beside_held", "gram_beside_held"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Answer:
    """How a value by instruments follows the torque.

    Attributes
    ----------
    column : array, shape (m,)
        The parameter's column of the torque balance, as far as the instruments tell it.
    slope : array, shape (m,)
        Change of the value with each sample of the torque.
    """

    column: Array
    slope: Array


def beside_held(group: Group, answers: Sequence[Answer]) -> Group:
    """Return the group with its columns of the torque less what held values answer to them.

    Parameters
    ----------
    group : Group
    answers : sequence of Answer
        Of the parameters that a model holds at values by instruments; none changes nothing.
    """
    columns = group.rows[0]
    if columns is None or not answers:
        return group
    left = columns.copy()
    for one in answers:
        left -= np.outer(columns @ one.slope, one.column)
    return replace(group, rows=(left, *group.rows[1:]))


def gram_beside_held(gram: Array, answered: Array) -> Array:
    """Return the Gram matrix of columns less what held values answer to them.

    Parameters
    ----------
    gram : array, shape (n + k, n + k)
        Of n columns, and of the columns of k answers.
    answered : array, shape (k, n)
        Change of each held value with each column; zero where a column stays.
    """
    n = len(gram) - len(answered)
    turn = np.vstack([np.eye(n), -answered])
    return np.asarray(turn.T @ gram @ turn)

"""The noise of a record: the residual of a saturated model, and the weights of the balances that follow from it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.evidence.linalg import gram_of, projection_on_all
from pmsm_ctrl.evidence.whitening import Whitener, make_whitener
from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.regression.columns import Group
from pmsm_ctrl.regression.model import Model, Solved, solve_model
from pmsm_ctrl.regression.two_stage import gram_beside_held

__all__ = [
    "FEWEST_DIRECTIONS",
    "SAMPLES_PER_DIRECTION",
    "Saturated",
    "rough_solution",
    "rough_weights",
    "saturated",
    "whiteners",
]

Array = NDArray[np.float64]

MOST_KEPT = 20e6  # bytes of hat functions that are kept from one fit to the next
APART = 1e-8  # smallest over largest eigenvalue of products that are solved on
KNOTS = 10  # of the hat functions of speed and of time in the saturated model
# Effective samples that the saturated model leaves for each of its directions, and the fewest directions it keeps.
SAMPLES_PER_DIRECTION, FEWEST_DIRECTIONS = 8.0, 10


@dataclass(frozen=True, eq=False)
class Saturated:
    """Residual of a model with further groups, and with curves of speed and time.

    Attributes
    ----------
    residual : array, shape (channels, m)
        Zero where a sample does not count.
    rank : int
        Rank of the fitted columns, in the balance where it is largest.
    grams : arrays, shape (1 + p + columns, 1 + p + columns)
        Per balance, weighted: of the target, the model's columns and those of all groups that enter it, the latter less
        the response of the held values to them.
    entering : int arrays, shape (p,)
        The model's columns in each balance.
    places : tuple of dict of balance to slice
        Per group, where its columns stand in the Gram matrix of a balance.
    """

    residual: Array
    rank: int
    grams: tuple[Array, ...]
    entering: tuple[NDArray[np.int64], ...]
    places: tuple[Mapping[int, slice], ...]


def saturated(record: Record, model: Model, groups: Sequence[Group] = ()) -> Saturated:
    """Fit a model with further groups, and with curves of speed and time, by weighted least squares.

    Parameters
    ----------
    record : Record
    model : Model
    groups : sequence of Group
    """
    places: list[dict[int, slice]] = [{} for _ in groups]
    grams, entering = [], []
    residual, most = np.zeros(record.target.shape), 0
    for row in range(len(record.channels)):
        inside = model.entering[row]
        blocks = [record.target[row][None], model.matrix[row].T[inside]]
        end = 1 + len(inside)
        for place, group in zip(places, groups, strict=True):
            columns = group.rows[row]
            if columns is not None:
                place[row] = slice(end, end + len(columns))
                end = place[row].stop
                blocks.append(columns)
        if row == 0:
            blocks.append(_smooth(record))
        weight = record.weight[row] * record.mask
        responses = model.responses if row == 0 and groups else ()
        whole = gram_of([*blocks, *(one.column[None] for one in responses)], weight)
        fitted = len(whole) - len(responses)
        gram = whole[:fitted, :fitted]
        room = max(FEWEST_DIRECTIONS, int(_effective(weight) / SAMPLES_PER_DIRECTION))
        coefficients, rank = projection_on_all(gram[1:, 1:], gram[1:, 0], room, len(inside))
        residual[row] = record.target[row]
        start = 0
        for block in blocks[1:]:
            residual[row] -= coefficients[start : start + len(block)] @ block
            start += len(block)
        residual[row][weight == 0.0] = 0.0
        most = max(most, rank)
        if responses:
            kept = np.r_[:end, fitted : len(whole)]
            responding = np.zeros((len(responses), end))
            responding[:, 1 + len(inside) :] = _responses_to(model, groups)
            gram = gram_beside_held(whole[np.ix_(kept, kept)], responding)
        grams.append(gram[:end, :end])
        entering.append(inside)
    return Saturated(residual, most, tuple(grams), tuple(entering), tuple(places))


def _responses_to(model: Model, groups: Sequence[Group]) -> Array:
    """Return the response of each held value to the torque columns of the groups, shape (responses, k)."""
    slopes = np.array([one.slope for one in model.responses])
    entering = (slopes @ columns.T for group in groups if (columns := group.rows[0]) is not None)
    return np.hstack([np.zeros((len(slopes), 0)), *entering])  # none of them may enter the torque


def whiteners(record: Record, residual: Array, rank: int) -> tuple[Whitener, Whitener]:
    """Fit the noise model to the residual of a saturated model.

    Returns the prewhitener, and the same noise without its correlation: point estimates use that one, because
    whitening shifts the weight to high frequencies, where differentiation and timing errors live.

    Parameters
    ----------
    record : Record
    residual : array, shape (channels, m)
    rank : int
        Rank of the fitted columns.
    """
    noise = residual, record.weight, record.mask, record.rate, rank
    return make_whitener(*noise), make_whitener(*noise, 0)


def rough_solution(record: Record, model: Model, left: Saturated, weights: Whitener) -> Solved:
    """Solve a model by weights alone, with the products of columns that its saturated model was fitted by.

    It has no bases and no residual. Where its columns are nearly dependent it is solved on the columns themselves:
    products square what rounding does there.

    Parameters
    ----------
    record : Record
    model : Model
    left : Saturated
        Of these columns, no other group in it; whatever is known of their values.
    weights : Whitener
    """
    count = len(model.sigma)
    gram, right = np.diag(model.sigma**-2.0), model.nominal * model.sigma**-2.0
    for whole, inside, sigma in zip(left.grams, left.entering, weights.sigma.tolist(), strict=True):
        end = 1 + len(inside)
        gram[np.ix_(inside, inside)] += whole[1:end, 1:end] / sigma**2
        right[inside] += whole[1:end, 0] / sigma**2
    size = np.sqrt(np.diag(gram))
    there = size > 0.0
    size = size[there]
    powers, vectors = np.linalg.eigh(gram[np.ix_(there, there)] / np.outer(size, size))
    if powers[0] <= APART * powers[-1]:
        return solve_model(record, model, weights)
    inverse = np.zeros((count, len(size)))
    inverse[there] = vectors / np.sqrt(powers) / size[:, None]
    stderr = np.sqrt(np.sum(inverse**2, axis=1))
    none = np.zeros((0, count))
    rows = len(weights.channels) * len(weights.used)
    return Solved(model, inverse @ (inverse.T @ right), stderr, none[:, 0], rows, inverse, (), none, none, none[:, 0])


def rough_weights(record: Record, left: Saturated) -> Whitener:
    """Return weights from the residual of a saturated model.

    Parameters
    ----------
    record : Record
    left : Saturated
        Of the model alone, no other group in it.
    """
    return make_whitener(left.residual, record.weight, record.mask, record.rate, left.rank, 0)


def _effective(weight: Array) -> float:
    """Number of samples of full weight that carry the same information."""
    top = float(weight.max())
    return float(np.sum(weight**2)) / top**2 if top > 0.0 else 0.0


def _smooth(record: Record) -> Array:
    """Return hat functions of speed and of time, shape (k, m): structure of the torque that no effect may explain."""
    key = ("hat functions",)
    known: Array | None = record.kept.get(key)
    if known is not None:
        return known
    out = []
    for x in (record.at_grid(record.signals["omega"]), record.t):
        knots = np.unique(np.quantile(x[record.mask], np.linspace(0.0, 1.0, KNOTS)))
        out += [np.interp(x, knots, hat) for hat in np.eye(len(knots))]
    made = np.array(out)
    if made.nbytes <= MOST_KEPT:
        record.kept[key] = made
    return made

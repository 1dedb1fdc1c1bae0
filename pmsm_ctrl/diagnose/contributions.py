"""What every effect that was found contributes to the prediction of a balance, as arrays over time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose.fit import Elsewhere, Fitted
from pmsm_ctrl.errors import RequestError, nearest
from pmsm_ctrl.regression.base_fit import assembled, with_bristles
from pmsm_ctrl.regression.modelled import with_direction

__all__ = ["Contributions", "contributions_of", "parts_of"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Contributions:
    """The prediction of one balance, part by part; `rest` and the effects sum to `predicted`.

    Attributes
    ----------
    channel, unit : str
        The balance: ``torque``, ``u_d`` or ``u_q``.
    t : array, shape (m,)
        Time, s.
    measured, predicted : array, shape (m,)
        Both sides of the balance, filtered alike, with all effects.
    rest : array, shape (m,)
        What the design predicts without the effects that were found, its parameters as estimated with them.
    effects : dict of name to array, shape (m,)
        In the order of acceptance; only those that enter this balance.
    used : bool array, shape (m,)
        Samples that the errors are taken over.
    """

    channel: str
    unit: str
    t: Array
    measured: Array
    predicted: Array
    rest: Array
    effects: Mapping[str, Array]
    used: NDArray[np.bool_]

    def residual(self, without: tuple[str, ...] = ()) -> Array:
        """Return measured less predicted with some effects switched off, all other parameters held.

        Parameters
        ----------
        without : tuple of str
            Names of the effects that are left out.

        Returns
        -------
        array, shape (m,)

        Raises
        ------
        RequestError
            For a name that is not among `effects`.
        """
        left = self.measured - self.predicted
        for name in without:
            if name not in self.effects:
                raise RequestError(f"unknown effect '{name}'{nearest(name, self.effects)}")
            left = left + self.effects[name]
        return left

    @property
    def size(self) -> float:
        """Rms of the measured side."""
        return float(np.sqrt(np.mean(self.measured[self.used] ** 2)))

    @property
    def products(self) -> Array:
        """Mean products of the residual and all effects, shape (1 + effects, 1 + effects).

        They give the error with any of the effects switched off.
        """
        rows = np.array([self.residual()[self.used], *(values[self.used] for values in self.effects.values())])
        return np.asarray(rows @ rows.T / max(rows.shape[1], 1))

    def error(self, without: tuple[str, ...] = ()) -> float:
        """Return the rms of the residual of the fit as a share of the rms of the measured side.

        Parameters
        ----------
        without : tuple of str
            Names of the effects that are left out.

        Returns
        -------
        float
        """
        return float(np.sqrt(np.mean(self.residual(without)[self.used] ** 2))) / self.size


def contributions_of(fit: Fitted, channel: str, direction: Array) -> Contributions:
    """Take the prediction of a balance apart.

    An effect that turns dry friction, a bristle, has no column of its own: it contributes the difference that it makes
    to the columns of the dry friction.

    Parameters
    ----------
    fit : Fitted
    channel : str
    direction : array, shape (n,)
        Direction of motion without a bristle, at the log's rate.

    Returns
    -------
    Contributions

    Raises
    ------
    RequestError
        When the log has no such balance.
    """
    record = fit.record
    if channel not in record.channels:
        raise RequestError(f"unknown balance '{channel}': this log has {', '.join(record.channels)}")
    row, predicted = record.channels.index(channel), record.target - fit.left
    here = Elsewhere(record, fit.model, fit.values, predicted)
    parts = parts_of(record.design, fit, here, row, direction)
    rest = predicted[row] - sum(parts.values(), np.zeros_like(predicted[row]))
    unit, measured = record.unit(channel), record.target[row]
    return Contributions(channel, unit, record.t, measured, predicted[row], rest, parts, record.mask)


def parts_of(design: Design, fit: Fitted, there: Elsewhere, row: int, direction: Array) -> dict[str, Array]:
    """Return what every accepted effect contributes to one balance of a record, the fitted one or another.

    Parameters
    ----------
    design : Design
        That was fitted.
    fit : Fitted
    there : Elsewhere
        The fit's model on the record.
    row : int
        Of the balance.
    direction : array, shape (n,)
        Direction of motion without a bristle, at the log's rate.

    Returns
    -------
    dict of name to array, shape (m,)
        In the order of acceptance; only those that enter this balance.
    """
    parts: dict[str, Array] = {}
    for number, one in enumerate(fit.accepted):
        name, position = one.effect.label(one.shape), fit.position(number, there.model)
        if position is None:
            values = _of_bristle(design, fit, number, there, row, direction)
        else:
            columns = there.model.columns_of(position)
            values = there.model.matrix[row][:, columns] @ there.values[columns]
        if np.any(values):
            parts[name] = parts[name] + values if name in parts else values
    return parts


def _of_bristle(design: Design, fit: Fitted, number: int, there: Elsewhere, row: int, direction: Array) -> Array:
    """Return what a balance gains by a bristle in place of a friction that turns at once."""
    others = fit.accepted[:number] + fit.accepted[number + 1 :]
    plain = with_bristles(design, with_direction(there.record, direction), others)
    values = dict(zip(there.model.names, there.values, strict=True))
    lagging, at_once = (assembled(design, one, fit.accepted)[0] for one in (there.record, plain))
    held = np.array([values.get(name, 0.0) for name in lagging.names])
    gained: Array = (lagging.matrix[row] - at_once.matrix[row]) @ held
    return gained

"""A fit on a record that was held out: what it leaves over, and what every effect contributes there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.compare.notices import HOLDOUT_IS_LOG
from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose.contributions import Contributions, parts_of
from pmsm_ctrl.diagnose.fit import Elsewhere, Fitted, predicted_elsewhere
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.regression.spread import spreads, without_level
from pmsm_ctrl.section import Notice

__all__ = ["HeldOut", "held_out", "same_as_log"]

Array = NDArray[np.float64]


def same_as_log(logs: Sequence[Log], holdouts: Sequence[Log]) -> tuple[Notice, ...]:
    """Return that a held-out record holds the numbers of one that is fitted, wherever it comes from.

    Parameters
    ----------
    logs, holdouts : sequence of Log
    """
    known = {one.fingerprint for one in logs} if holdouts else set()
    return (HOLDOUT_IS_LOG(),) if any(one.fingerprint in known for one in holdouts) else ()


@dataclass(frozen=True, eq=False)
class HeldOut:
    """A held-out record with the parameters of a fit.

    Attributes
    ----------
    record : Record
        With the balances that the fitted record has as well.
    left : array, shape (channels, m)
        Measured less predicted; of the torque less its refitted level, where that was asked for.
    there : Elsewhere
        The model on the record, with all balances of it.
    rows : tuple of int
        Those of `record` among them.
    """

    record: Record
    left: Array
    there: Elsewhere
    rows: tuple[int, ...]

    def contributions(self, design: Design, fit: Fitted, direction: Array) -> dict[str, Contributions]:
        """Take the prediction of every balance apart.

        Parameters
        ----------
        design : Design
            That was fitted.
        fit : Fitted
        direction : array, shape (n,)
            Direction of motion without a bristle, at the log's rate.

        Returns
        -------
        dict of balance to Contributions
        """
        record, out = self.record, {}
        for channel, row, target, left in zip(record.channels, self.rows, record.target, self.left, strict=True):
            parts = parts_of(design, fit, self.there, row, direction)
            predicted = target - left
            rest = predicted - sum(parts.values(), np.zeros_like(predicted))
            out[channel] = Contributions(
                channel, record.unit(channel), record.t, target, predicted, rest, parts, record.mask
            )
        return out


def held_out(design: Design, record: Record, fit: Fitted, refitted: bool) -> HeldOut:
    """Return what a fit leaves over on a record that nothing was fitted to.

    Parameters
    ----------
    design : Design
        That was fitted.
    record : Record
    fit : Fitted
    refitted : bool
        Whether dry friction, viscous friction and a constant torque of the record are fitted to it.
    """
    there = predicted_elsewhere(design, record, fit.accepted, fit)
    record = there.record
    common = [k for k, name in enumerate(record.channels) if name in fit.record.channels]
    channels = tuple(record.channels[k] for k in common)
    record = replace(
        record, channels=channels, target=record.target[common], weight=record.weight[common],
        coarse=record.coarse[common],
    )  # fmt: skip
    left = record.target - there.predicted[common]
    if refitted:
        count = len(fit.record.records)
        spread = spreads(fit.model, count) if count > 1 else None
        left[0] = without_level(record, left[0], spread, float(fit.weights.sigma[0]))
    return HeldOut(record, left, there, tuple(common))

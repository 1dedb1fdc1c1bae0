"""Samples that the recorder clipped: at an extreme of the channel, where the motion needs more."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.importers.timebase import saturated_share
from pmsm_ctrl.log import Log
from pmsm_ctrl.plausibility import notices as say
from pmsm_ctrl.plausibility.bins import Bins, binned, summed
from pmsm_ctrl.plausibility.policy import POLICY
from pmsm_ctrl.plausibility.relations import BOXES, fitted, moved, moving, torque_of
from pmsm_ctrl.plausibility.result import Stretch
from pmsm_ctrl.section import Notice

__all__ = ["unclipped"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

REACH = 6  # samples beside a clipped one; a gap in time has to be longer than five periods to be one


def unclipped(design: Design, log: Log) -> tuple[Log, tuple[Notice, ...], tuple[Stretch, ...]]:
    """Leave out samples of the current or torque that were clipped by the recorder.

    With too many of them nothing is left out. A drive's own limit holds the current too; but there the motion needs no
    more than the limit.
    """
    name = "torque" if "torque" in log else "i_q"
    if name not in log or saturated_share(log[name]) == 0.0:
        return log, (), ()
    size = np.abs(log[name])
    limit = float(size.max())
    at_limit = size >= limit * (1.0 - 1e-9)
    if not _needs_more(design, binned(log), name, at_limit):
        return log, (), ()
    out = summed(at_limit.astype(np.float64), 2 * REACH + 1) > 0.5
    share = 100.0 * float(np.mean(at_limit))
    reason = say.CLIPPED_CHANNEL(channel=name, limit=limit, unit=log.unit(name), percent=share)
    if float(np.mean(at_limit)) > POLICY.most_clipped:
        return log, (reason,), ()
    edges = np.flatnonzero(np.diff(np.concatenate(([False], out, [False])).astype(np.int8)))
    stretches = tuple(
        Stretch(float(log.t[first]), float(log.t[last - 1]), reason)
        for first, last in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
    )
    kept = {channel: values[~out] for channel, values in log.channels.items()}
    return Log(kept, log.motion, provenance=log.provenance), (reason,), stretches


def _needs_more(design: Design, bins: Bins, name: str, at_limit: Mask) -> bool:
    """Whether the motion at the limit needs more torque than the limit, by the balance of all other samples."""
    motion, torque = moved(bins, BOXES), torque_of(design, bins.channels)
    if motion is None or torque is None:
        return False
    omega, alpha = motion
    fast = moving(omega)
    k, m = bins.samples, len(torque)
    share = bins.smooth(at_limit[: m * k].reshape(m, k).mean(axis=1), BOXES)
    side = np.sign(np.where(fast, omega, 0.0))
    columns = {"J": alpha, "F_c": side, "F_v": omega, "constant": np.ones_like(omega)}
    seen = bins.smooth(torque, BOXES)
    fit = fitted(seen, columns, fast & (share == 0.0))
    if fit is None or fit.value("J") <= 0.0:
        return False
    predicted = sum(value * columns[column] for column, value in zip(fit.names, fit.values, strict=True))
    judged = (share > POLICY.clipped_share) & np.isfinite(predicted)
    if int(judged.sum()) < POLICY.clipped_bins:
        return False
    missing = ((predicted - seen) * np.sign(predicted))[judged]
    limit = float(np.max(np.abs(torque)))
    # what a drive's own limit leaves is as often too much as too little
    sure = float(np.mean(missing)) > 3.0 * float(np.std(missing)) / np.sqrt(judged.sum() / (3.0 * BOXES))
    return sure and float(np.mean(missing)) > POLICY.excess * limit * float(np.mean(share[judged]))

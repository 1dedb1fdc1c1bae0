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

# Share by which a recorder's limit lies beside the drive's own one, at least: a drive that needs more than it has is no
# spoiled log, as one that answers the steps of a coarse encoder.
OWN_LIMIT = 1e-3
SURE, LARGEST = 3.0, 0.99  # standard errors; quantile of what other samples leave
REACH = 6  # samples beside a clipped one; a gap in time has to be longer than five periods to be one


def unclipped(design: Design, log: Log) -> tuple[Log, tuple[Notice, ...], tuple[Stretch, ...]]:
    """Leave out samples of the current or torque that were clipped by the recorder.

    With too many of them nothing is left out. A drive's own limit holds the current too: it is the one of the design,
    or the motion needs no more there.
    """
    name = "torque" if "torque" in log else "i_q"
    if name not in log or saturated_share(log[name]) == 0.0:
        return log, (), ()
    size = np.abs(log[name])
    limit = float(size.max())
    if abs(limit - _own_limit(design, name)) < OWN_LIMIT * limit:
        return log, (), ()
    at_limit = size >= limit * (1.0 - 1e-9)
    if not _needs_more(design, binned(log), at_limit):
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


def _own_limit(design: Design, name: str) -> float:
    """Return the drive's limit in a channel; infinite where the design states none."""
    return design.drive.i_max * (design.K_t_assumed if name == "torque" else 1.0)


def _needs_more(design: Design, bins: Bins, at_limit: Mask) -> bool:
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
    # what a drive's own limit leaves is as often too much as too little, and no more than what all other samples leave
    independent = np.sqrt(judged.sum() / (3.0 * BOXES))
    mean, others = float(np.mean(missing)), np.abs(predicted - seen)[fast & (share == 0.0)]
    sure = mean > SURE * float(np.std(missing)) / independent or mean > float(np.quantile(others, LARGEST))
    return bool(sure) and mean > POLICY.excess * limit * float(np.mean(share[judged]))

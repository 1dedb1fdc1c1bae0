"""A lag of the torque that only the steps of the friction show.

On one sine an inertia and a viscous friction make up for any lag. The moment at which the friction steps does not: see
`pmsm_ctrl.regression.stepped_reversals`.
"""

from __future__ import annotations

from dataclasses import replace

from pmsm_ctrl.plausibility.foreign import DRIVE, moved_back
from pmsm_ctrl.plausibility.notices import NOT_SYNCHRONOUS
from pmsm_ctrl.plausibility.result import Plausibility
from pmsm_ctrl.regression.balances import Record

__all__ = ["moved_by_its_steps"]


def moved_by_its_steps(believed: Plausibility, record: Record) -> Plausibility | None:
    """Return the examination of a log with a lag taken out that is more than sampling can make; None without one.

    Parameters
    ----------
    believed : Plausibility
    record : Record
        Of the log that is believed.
    """
    timing = record.timing
    if timing.stepped is None or believed.lag or record.sampling_stated or not timing.late > record.sampling:
        return None
    lag = timing.late + timing.stepped * believed.log.period
    channel = next(name for name in DRIVE if name in believed.log)
    said = NOT_SYNCHRONOUS(channel=channel, lag_ms=1e3 * lag)
    log = moved_back(believed.log, timing.late)  # by whole periods: between them a step is no step
    return replace(believed, log=log, doubts=(*believed.doubts, said), lag=lag, logged=believed.log)

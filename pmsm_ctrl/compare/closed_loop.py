"""The design's own drive, simulated in closed loop with the reference that the log holds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.compare import policy
from pmsm_ctrl.compare.notices import CLOSED_LOOP_FAILED
from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import PmsmCtrlError
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.conditioning import Processing, prepare
from pmsm_ctrl.section import Notice

__all__ = ["ClosedLoop", "closed_loop"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """Measured and simulated channels through the same processing on the log's thinned grid, shape (m,) each.

    They are empty where the simulation failed. `added_current` says that a current beside the speed controller's output
    was found in the log and fed in.
    """

    measured: Mapping[str, Array]
    simulated: Mapping[str, Array]
    mask: NDArray[np.bool_]
    control: str
    added_current: bool = False
    notices: tuple[Notice, ...] = ()


def closed_loop(design: Design, log: Log, processing: Processing) -> ClosedLoop | None:
    """Simulate the drive with the log's reference, from the log's first state; sensors without noise.

    Returns None where the log has no speed reference, or the design no loops or no electrical data.
    """
    if design.loops is None or not design.motor.electrical or "omega_ref" not in log:
        return None
    from pmsm_ctrl.identify.replay import build_replay

    if log.duration > policy.LONGEST:
        log = log.between(float(log.t[0]), float(log.t[0]) + policy.LONGEST)
    replay = build_replay(design, log)
    control = replay.scenario.control
    try:
        twin = replay.run(design)
    except PmsmCtrlError as error:
        failed = CLOSED_LOOP_FAILED(error=str(error))
        return ClosedLoop({}, {}, np.zeros(0, dtype=bool), control, replay.adds_current, (failed,))
    kept = [name for name in ("theta", "omega", "i_d", "i_q") if name in log]
    measured = prepare(design, Log({"t": replay.t} | {n: replay.channels[n] for n in kept}, log.motion), processing)
    simulated = prepare(design, Log({"t": replay.t} | {n: twin[n] for n in kept}, log.motion), processing)
    names = [name for name in ("omega", "theta", "i_q") if name in measured.signals]
    return ClosedLoop(
        {n: measured.column(measured.signals[n]) for n in names},
        {n: simulated.column(simulated.signals[n]) for n in names},
        measured.mask,
        control,
        replay.adds_current,
    )

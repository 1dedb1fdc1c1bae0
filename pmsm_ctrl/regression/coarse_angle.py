"""An angle that was written with few digits: its steps grow with it, and nothing later makes them small again."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from pmsm_ctrl.design import Design
from pmsm_ctrl.importers.timebase import growing_steps
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.notices import COARSE_ANGLE, SPEED_FOR_COARSE_ANGLE
from pmsm_ctrl.section import Notice

__all__ = ["without_coarse_angle"]

# Share of the drive's torque that the steps may make of the inertia's, rms, before the angle is no use.
BEARABLE = 0.02


def without_coarse_angle(design: Design, log: Log, cutoff: float) -> tuple[Log, tuple[Notice, ...]]:
    """Leave the angle out where its digits do not suffice for an acceleration and the log has a speed as well.

    The error of a step q, even over q and white, has an rms of q / sqrt(12), of which a low-pass at f (`cutoff`, Hz)
    lets through sqrt(2 f / rate). Twice differentiated that is (2 pi f)^2 / sqrt(5) times as much.
    """
    step = growing_steps(log["theta"]) if "theta" in log else 0.0
    if step == 0.0:
        return log, ()
    alpha = (2.0 * math.pi * cutoff) ** 2 * step * math.sqrt(2.0 * cutoff / (60.0 * log.rate))
    drive = log["torque"] if "torque" in log else design.K_t_assumed * log["i_q"] if "i_q" in log else np.zeros(1)
    if design.J * alpha <= BEARABLE * float(np.sqrt(np.mean(drive**2))):
        return log, ()
    found = {"step": step, "unit": log.unit("theta")}
    if "omega" not in log:
        return log, (COARSE_ANGLE(**found),)
    channels = {name: values for name, values in log.channels.items() if name != "theta"}
    return replace(log, channels=channels), (SPEED_FOR_COARSE_ANGLE(**found),)

"""What an axis was doing, from its speed."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.compare import policy

__all__ = ["Kind", "Motion", "motion_of"]

Array = NDArray[np.float64]


class Kind(Enum):
    """Kinds of motion."""

    REST = "rest"
    CONSTANT = "constant"
    UNSTEADY = "unsteady"
    ACCELERATING = "accelerating"
    DECELERATING = "decelerating"
    STARTING = "starting"
    STOPPING = "stopping"
    STOP_AND_GO = "stop_and_go"
    REVERSAL = "reversal"
    REVERSALS = "reversals"
    BACK_AND_FORTH = "back_and_forth"


@dataclass(frozen=True)
class Motion:
    """A piece of motion: its kind, its direction (1 or -1), and least and greatest speed without sign, rad/s (m/s)."""

    kind: Kind
    direction: int
    low: float
    high: float


def motion_of(omega: Array, fast: float) -> Motion:
    """Return the motion of speeds of shape (n,), rad/s (m/s); `fast` is the fast speed of the whole log."""
    size = np.abs(omega)
    top, mean = float(size.max()), float(omega.mean())
    direction = 1 if mean > 0.0 else -1
    whole = Motion(Kind.REST, direction, 0.0, top)
    if top <= policy.AT_REST * fast:  # as slow as this an axis may still move steadily
        steady = abs(mean) > float(omega.std())
        return Motion(Kind.CONSTANT, direction, abs(mean), abs(mean)) if steady else whole
    spread = float(np.ptp(omega))
    turns = int(np.sum(np.diff(np.sign(omega[size > 0.02 * top])) != 0))
    if turns:
        kind = Kind.REVERSAL if turns == 1 else Kind.REVERSALS if turns == 2 else Kind.BACK_AND_FORTH
        return Motion(kind, direction, 0.0, top)
    if spread <= policy.CONSTANT * abs(mean):
        return Motion(Kind.CONSTANT, direction, abs(mean), abs(mean))
    start, stop = float(size[0]), float(size[-1])
    slow, quick = min(start, stop), max(start, stop)
    if float(size.min()) < 0.1 * top and slow > 0.2 * top:
        return Motion(Kind.STOP_AND_GO, direction, 0.0, top)
    if quick - slow < 0.5 * spread:
        return Motion(Kind.UNSTEADY, direction, min(abs(float(omega.min())), abs(float(omega.max()))), top)
    if slow <= 0.02 * top:
        return Motion(Kind.STARTING if stop > start else Kind.STOPPING, direction, 0.0, top)
    return Motion(Kind.ACCELERATING if stop > start else Kind.DECELERATING, direction, slow, quick)

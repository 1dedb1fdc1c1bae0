"""Which samples of a log take part: rests, reversals, torque jumps, gaps and both ends are left out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.evidence.noise import stretches

__all__ = ["count_reversals", "resting", "slow_speed", "torque_jumps", "without_edges"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# A jump of the torque between two samples: this share of its range, and so many times the scatter of all steps.
JUMP_SHARE, JUMP_SCATTER = 0.2, 10.0


def slow_speed(omega: Array, standstill: float) -> float:
    """Return the speed below which the axis rests: a share of the 99 % quantile."""
    return standstill * float(np.quantile(np.abs(omega), 0.99))


def count_reversals(omega: Array, slow: float) -> int:
    """Return how often a speed changes its direction; speeds below `slow` do not count."""
    return int(np.count_nonzero(np.diff(np.sign(omega[np.abs(omega) > slow]))))


def resting(omega: Array, slow: float, memory: int, blank: bool, through_reversals: bool) -> Mask:
    """Return the samples, shape (n,), at which the axis rests or reverses.

    Where rests are masked after the filter and not blanked before it, a rest longer than the filter's memory, in
    samples, includes its neighbours, which are contaminated. With `through_reversals` shorter rests take part.
    """
    rest = np.abs(omega) <= slow
    turns = np.flatnonzero(np.diff(np.sign(omega)) != 0.0)
    if blank and not through_reversals:
        rest[turns] = rest[turns + 1] = True
    for piece in stretches(rest):
        if piece.stop - piece.start > memory and not blank:
            rest[max(0, piece.start - memory) : piece.stop + memory] = True
        elif piece.stop - piece.start <= memory and through_reversals:
            rest[piece] = False
    return rest


def torque_jumps(torque: Array, most: float = 1.0) -> NDArray[np.int64]:
    """Return the samples after which the torque jumps: its course until the next one was not sampled, and is aliased.

    It is the answer of a stiff loop to a step of its reference, not the torque of a motion that the log can follow.
    None where more than the share `most` of all steps are so large: the answer to steps of a coarse encoder is noise.
    """
    step = np.abs(np.diff(torque))
    span = float(np.subtract(*np.quantile(torque, [0.9999, 0.0001])))
    scatter = 1.4826 * float(np.median(step))
    jumps = np.flatnonzero(step > max(JUMP_SHARE * span, JUMP_SCATTER * scatter))
    return jumps if len(jumps) <= most * len(step) else jumps[:0]


def without_edges(moving: Mask, good: Mask, edge: int) -> Mask:
    """Return samples that move, without gaps (not `good`) and `edge` samples around gaps and at both ends."""
    for k in np.flatnonzero(np.diff(good.astype(np.int8))) + 1:
        moving[max(0, k - edge) : k + edge] = False
    moving &= good
    if edge:
        moving[:edge] = False
        moving[-edge:] = False
    return moving

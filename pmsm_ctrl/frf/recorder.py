"""What the recorder of a sampled drive makes of the current, as the design states it.

The speed loop's reference is a staircase, and so the current contains images of every frequency around the multiples of
that loop's rate. Samples taken in the tick of the loop fold them back onto the frequency itself: the current appears
earlier or later than it flows, by up to T^2 / (12 tau) with the loop's period T and the current's time constant tau.
The axis hardly answers the images. The EMF, which disturbs the current, is that of the axis: a spring shows in it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects.structures import SecondMass
from pmsm_ctrl.errors import DesignError, RequestError
from pmsm_ctrl.tune.linearise import mobility
from pmsm_ctrl.tune.sampled import Cascade

__all__ = ["free_cascade", "recorded", "stated"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

SAME = 1e-3  # relative difference of two periods that are the same


def recorded(
    design: Design, frequency: Array, periods: Sequence[float], J: float, speed: float, mass: SecondMass | None = None
) -> Complex:
    """Return what the samples of a log show of an axis, over the axis' own response, shape (n,).

    One where the design does not state how the log is taken: its loops or motor data are missing, or the log has
    another period.

    Parameters
    ----------
    design : Design
        Its drive, current loop and ``sensor.log_divider``, in the instant of whose control periods samples are taken.
    frequency : array, shape (n,)
        Hz.
    periods : sequence of float
        Of the records, s.
    J : float
        Inertia, kg m^2: how much the EMF answers.
    speed : float
        rad/s.
    mass : SecondMass, optional
        A load behind a spring; part of `J`.
    """
    one = np.ones(len(frequency), dtype=np.complex128)
    cascade = free_cascade(design, J, speed, mass) if stated(design, periods) else None
    if cascade is None:
        return one
    seen = cascade.sampled_motion(2.0 * math.pi * frequency, design.sensor.log_divider)
    s = np.asarray(2j * math.pi * frequency, dtype=np.complex128)
    return np.asarray(seen / (cascade.design.K_t * s * mobility(s, J, 0.0, mass)))


def stated(design: Design, periods: Sequence[float]) -> bool:
    """Whether the design states how logs of these periods (s) are taken, and by which loops."""
    own = design.log_period
    return design.loops is not None and design.motor.electrical and all(abs(T - own) <= SAME * own for T in periods)


def free_cascade(design: Design, J: float, speed: float, mass: SecondMass | None = None) -> Cascade | None:
    """Return the loops of a design around an axis without friction; None at a speed that the drive cannot hold."""
    assert design.loops is not None
    free = reduce(lambda found, effect: found.without_effect(effect.id), design.effects, design)
    try:
        return Cascade.of(free.with_parameters(J=J), design.loops.current, at=speed, mass=mass)
    except (DesignError, RequestError):
        return None

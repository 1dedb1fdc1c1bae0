"""Loops that the drive can run: what the voltage and the encoder allow, beside the margins.

Fast sampling lets the rules ask for more than a slow winding takes from the dc link, and for so much gain that the
encoder's counts alone drive the current. Both are limits of the hardware, so the loops are made slower.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from pmsm_ctrl.design import CurrentLoop, Design, SpeedLoop
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.tune.noise import noise
from pmsm_ctrl.tune.sampled import Cascade

__all__ = ["USABLE_STEP", "within_ripple", "within_voltage"]

USABLE_STEP = 0.05  # of the current limit: a step that must not ask for more than the voltage at standstill
SWAMPED = 0.1  # current ripple from the encoder, as a share of the current limit, that no loop can do with
RATIO = 1.25  # between two speed loops that are tried
SLOWEST = 60.0


def within_voltage(design: Design, loop: CurrentLoop) -> CurrentLoop:
    """Return the current controller, its gains reduced where a small step would already need the whole voltage."""
    if not math.isfinite(design.drive.i_max):
        return loop
    highest = design.drive.u_dc / math.sqrt(3.0) / (USABLE_STEP * design.drive.i_max)
    factor = max(loop.K_p, loop.K_p_d or 0.0) / highest
    if factor <= 1.0:
        return loop
    reduced = {"K_p": loop.K_p / factor} | ({"K_p_d": loop.K_p_d / factor} if loop.K_p_d is not None else {})
    return loop.model_copy(update=reduced)


def within_ripple(cascade: Cascade, make: Callable[[float], SpeedLoop], factor: float) -> tuple[SpeedLoop, float]:
    """Return the fastest speed loop from a factor on whose encoder ripple leaves the current to the motion.

    `make` returns the gains for a factor >= 1, by which the loop is slower than asked. The slowest one that the method
    has gains for is the last that is tried.
    """
    limit = SWAMPED * cascade.design.drive.i_max
    speed = make(factor)
    while noise(cascade.with_gains(speed=speed)).encoder_ripple > limit and factor < SLOWEST:
        try:
            speed = make(RATIO * factor)
        except RequestError:
            break
        factor *= RATIO
    return speed, factor

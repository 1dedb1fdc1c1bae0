"""Take out of a log what the design knows to be wrong with its measurements."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects.base import Effect
from pmsm_ctrl.effects.catalogue import CATALOGUE
from pmsm_ctrl.effects.evaluate import column
from pmsm_ctrl.regression.notices import MEASUREMENT_EFFECT_LEFT_IN
from pmsm_ctrl.section import Notice

__all__ = ["undone"]

Array = NDArray[np.float64]

CURRENTS = ("i_d", "i_q")


def undone(design: Design, t: Array, channels: Mapping[str, Array]) -> tuple[dict[str, Array], tuple[Notice, ...]]:
    """Return channels as they would be without the design's measurement effects, and notes on those left in.

    A delay is undone exactly, an offset too; a wrong gain or angle to first order, since its term reads the measured
    value in place of the true one. Of currents: a logged torque is moved in time, and an offset or a gain stays in it.

    Parameters
    ----------
    t : array, shape (n,)
        Uniform time base, s.
    channels : mapping of str to array, shape (n,)
        Measured, in SI units; the angle unwrapped.
    """
    out = {name: np.asarray(values) for name, values in channels.items()}
    notes = []
    for entry in design.effects:
        effect = CATALOGUE.get(entry.id)
        if effect is None or effect.enters != "measurement":
            continue
        values = effect.values(entry)
        if effect.structure == "delay":
            out |= _earlier(t, out, values["tau"])
        elif not _subtracted(design, effect, values, t, out):
            notes.append(MEASUREMENT_EFFECT_LEFT_IN(effect=effect.id))
    return out, tuple(notes)


def _earlier(t: Array, channels: Mapping[str, Array], tau: float) -> dict[str, Array]:
    """Currents, or the torque that was made of them, moved back to when they flowed."""
    from scipy.interpolate import CubicSpline

    then = np.clip(t + tau, t[0], t[-1])
    late = [name for name in (*CURRENTS, "torque") if name in channels]
    return {name: CubicSpline(t, channels[name])(then) for name in late}


def _subtracted(
    design: Design, effect: Effect, values: Mapping[str, float], t: Array, channels: dict[str, Array]
) -> bool:
    """Take the effect's own term off the channels it spoils; False where it cannot be evaluated."""
    known: dict[str, Array | float] = {"i_d": np.zeros_like(t), **channels}
    if design.motor.p is not None:
        known["p"] = float(design.motor.p)
    spoiled = [name for name in effect.channels if name in channels]
    if not spoiled or any(name not in known for name in effect.signals):
        return False
    wrong = np.atleast_2d(column(effect, known, values))
    for name, error in zip(effect.channels, wrong, strict=True):
        if name in spoiled:
            channels[name] = channels[name] - error
        if name == "theta" and "omega" in channels:
            channels["omega"] = channels["omega"] - np.gradient(error, t)
    return True

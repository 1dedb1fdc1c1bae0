"""Correct a log for the measurement effects of its design."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects.catalogue import bound_effects, catalogue_of
from pmsm_ctrl.regression.notices import MEASUREMENT_EFFECT_LEFT_IN
from pmsm_ctrl.section import Notice

__all__ = ["known_delay", "undone"]

Array = NDArray[np.float64]


def known_delay(design: Design) -> float:
    """Return by how much torque and currents are late as the design says, s.

    Parameters
    ----------
    design : Design
    """
    stated = ((one.structure, one, values) for one, values in bound_effects(design))
    return sum(how.delay(one, [values[s] for s in how.symbols(one)]) for how, one, values in stated if how.delays)


def undone(design: Design, t: Array, channels: Mapping[str, Array]) -> tuple[dict[str, Array], tuple[Notice, ...]]:
    """Return channels as they would be without the design's measurement effects, and notes on those left in.

    A delay is undone exactly, an offset too; a wrong gain or angle to first order, since its term reads the measured
    value in place of the true one. Of currents: a logged torque is moved in time, and an offset or a gain stays in it.

    Parameters
    ----------
    design : Design
    t : array, shape (n,)
        Uniform time base, s.
    channels : mapping of str to array, shape (n,)
        Measured, in SI units; the angle unwrapped.
    """
    out = {name: np.asarray(values) for name, values in channels.items()}
    notes = []
    effects = catalogue_of(design)
    p = float(design.motor.p) if design.motor.p is not None else None
    for entry in design.effects:
        effect = effects.get(entry.id)
        if effect is None or effect.enters != "measurement":
            continue
        corrected = effect.structure.corrected(effect, effect.values(entry), t, out, p)
        if corrected is None:
            notes.append(MEASUREMENT_EFFECT_LEFT_IN(effect=effect.id))
        else:
            out = corrected
    return out, tuple(notes)

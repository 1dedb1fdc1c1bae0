"""What the width of the windows does to a fitted axis.

In a window the response counts as a polynomial of the frequency. A resonance that is narrower than the window is none,
and comes out flatter. How much follows from the fitted axis: its speed for the measured torque is passed through the
same windows, and the axis is fitted once more to what comes out.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.evidence.local_polynomial import local_polynomial
from pmsm_ctrl.frf.fit import Axis, refitted
from pmsm_ctrl.frf.measured import lines_of
from pmsm_ctrl.frf.result import Response
from pmsm_ctrl.frf.stretches import Stretch

__all__ = ["largest", "widths", "window_bias"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

JUDGED = ("J", "antiresonance", "resonance", "damping")


def window_bias(records: Sequence[Stretch], response: Response, axis: Axis) -> Mapping[str, float]:
    """Return by how much the windows change each parameter, relative to it.

    Parameters
    ----------
    records : sequence of Stretch
    response : Response
        From drive torque to speed, of these records.
    axis : Axis
        Fitted to it.
    """
    through = np.mean([_through(one, response, axis) for one in records], axis=0)
    passed = refitted(axis, response, axis.response(response.frequency) * through).errors()
    own = axis.errors()
    return {name: passed[name][0] / own[name][0] - 1.0 for name in JUDGED if name in own}


def widths(axis: Axis) -> tuple[float, float]:
    """Return the width of antiresonance and resonance between half the power, Hz: 2 zeta f each; the axis has both."""
    found = {name: value for name, (value, _) in axis.errors().items()}
    antiresonance, resonance = found["antiresonance"], found["resonance"]
    return 2.0 * found["damping_ratio"] * antiresonance, 2.0 * found["damping_ratio"] * resonance**2 / antiresonance


def _through(record: Stretch, response: Response, axis: Axis) -> Complex:
    """Return what the windows of a record make of the axis, over the axis itself, at the frequencies of a response."""
    torque, width = record.spectrum("torque"), float(record.rate / record.count)
    sent = record.spectrum(response.instrument) if response.instrument else torque
    speed = np.zeros_like(torque)
    speed[1:] = torque[1:] * axis.response(width * np.arange(1.0, len(torque)))
    local = local_polynomial(sent, np.stack([speed, torque], axis=1), lines_of(record, sent))
    with np.errstate(all="ignore"):  # lines without content are not among those of the response
        found = local.response[:, 0] / local.response[:, 1] / axis.response(width * local.place)
    nearest = np.argmin(np.abs(width * local.place[:, None] - response.frequency), axis=0)
    taken = found[nearest]
    return np.asarray(np.where(np.isfinite(taken), taken, 1.0))


def largest(bias: Mapping[str, float], axis: Axis) -> tuple[str, float]:
    """Return the parameter that the windows change most in its standard errors, and by how many.

    Parameters
    ----------
    bias : mapping of str to float
        Of `window_bias`.
    axis : Axis
    """
    own = axis.errors()
    counted = {name: abs(part) * own[name][0] / own[name][1] for name, part in bias.items()}
    name = max(counted, key=lambda one: counted[one])
    return name, counted[name] if math.isfinite(counted[name]) else 0.0

"""The records of a diagnosis for a page on which one zooms, and switches the effects that were found on and off."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.compare.notices import motion_words
from pmsm_ctrl.compare.stretches import worst_stretches
from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.section import Balance, Traces

if TYPE_CHECKING:
    from pmsm_ctrl.diagnose.contributions import Contributions
    from pmsm_ctrl.diagnose.fit import Fitted
    from pmsm_ctrl.diagnose.result import Diagnosis, Errors

__all__ = ["coordinates_of", "traces_between", "traces_of"]

Array = NDArray[np.float64]

STRETCHES = 4


def traces_of(d: Diagnosis) -> Traces:
    """Return the torque balance over time, and every other balance that an effect enters.

    Parameters
    ----------
    d : Diagnosis

    Returns
    -------
    Traces
    """
    return traces_between(d.selection.fits[0], d.selection.fit, d.contributions, d.errors["noise_floor"])


def traces_between(first: Fitted, fit: Fitted, contributions: Callable[[str], Contributions], floor: Errors) -> Traces:
    """Return the torque balance over time, and every other balance that an effect enters.

    Parameters
    ----------
    first : Fitted
        Before the first effect; where it fails worst, the stretches are.
    fit : Fitted
        With all of them.
    contributions : function
        Of a balance by its name.
    floor : dict of balance to rms, unit and relative error
        What noise alone leaves.

    Returns
    -------
    Traces
    """
    record, linear = fit.record, fit.record.linear
    balances = [
        _balance(contributions(channel), record.drive, float(floor[channel]["relative"])) for channel in record.channels
    ]
    shown = tuple(b for k, b in enumerate(balances) if k == 0 or b.parts)
    coordinates = coordinates_of(record)
    speed = next(iter(coordinates.values()))
    stretches = worst_stretches(record.t, first.residual[0], record.mask, speed, STRETCHES)
    unit = "m/s" if linear else "rad/s"
    words = tuple((s.start, s.stop, motion_words(s.motion, unit)) for s in stretches)
    return Traces(record.t, coordinates, shown, words)


def coordinates_of(record: Record) -> dict[str, Array]:
    """Return what a residual can be drawn over, by label: speed, position, acceleration, and what was measured.

    Parameters
    ----------
    record : Record

    Returns
    -------
    dict of label to array, shape (m,)
        The speed first.
    """
    linear = record.linear
    omega, theta, alpha = (record.at_grid(record.signals[name]) for name in ("omega", "theta", "alpha"))
    return {
        "speed [m/s]" if linear else "speed [rad/s]": omega,
        "position [m]" if linear else "angle in a turn [rad]": theta if linear else np.mod(theta, 2.0 * np.pi),
        f"acceleration [{'m/s²' if linear else 'rad/s²'}]": alpha,
        f"measured {record.drive} [{record.unit('torque')}]": record.target[0],
    }


def _balance(parts: Contributions, drive: str, floor: float) -> Balance:
    name = drive if parts.channel == "torque" else parts.channel
    return Balance(
        name, parts.unit, parts.measured, parts.predicted, parts.effects, parts.products, parts.size, floor
    )  # fmt: skip

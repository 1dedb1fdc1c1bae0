"""The records of a diagnosis for a page on which one zooms, and switches the effects that were found on and off."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.compare.notices import motion_words
from pmsm_ctrl.compare.stretches import worst_stretches
from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.section import Balance, Traces

if TYPE_CHECKING:
    from pmsm_ctrl.diagnose.result import Diagnosis

__all__ = ["coordinates_of", "traces_of"]

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
    fit = d.selection.fit
    record, linear = fit.record, fit.record.linear
    balances = [_balance(d, channel) for channel in record.channels]
    shown = tuple(b for k, b in enumerate(balances) if k == 0 or b.parts)
    coordinates = coordinates_of(record)
    first = d.selection.fits[0].residual[0]
    stretches = worst_stretches(record.t, first, record.mask, next(iter(coordinates.values())), STRETCHES)
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


def _balance(d: Diagnosis, channel: str) -> Balance:
    parts = d.contributions(channel)
    used = parts.used
    rows = np.array([parts.residual()[used], *(values[used] for values in parts.effects.values())])
    return Balance(
        d.record.drive if channel == "torque" else channel,
        parts.unit,
        parts.measured,
        parts.predicted,
        parts.effects,
        rows @ rows.T / max(rows.shape[1], 1),
        float(np.sqrt(np.mean(parts.measured[used] ** 2))),
        float(d.errors["noise_floor"][channel]["relative"]),
    )

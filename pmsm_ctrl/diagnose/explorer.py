"""The records of a diagnosis for a page on which one zooms, and switches the effects that were found on and off."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
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

__all__ = ["HeldOutTraces", "coordinates_of", "traces_between", "traces_of"]

Array = NDArray[np.float64]

STRETCHES = 4


@dataclass(frozen=True, eq=False)
class HeldOutTraces:
    """A held-out record for a page.

    Attributes
    ----------
    name : str
    record : Record
    contributions : dict of balance to Contributions
    """

    name: str
    record: Record
    contributions: Mapping[str, Contributions]


def traces_of(d: Diagnosis) -> Traces:
    """Return the torque balance over time, and every other balance that an effect enters, of all records.

    Parameters
    ----------
    d : Diagnosis

    Returns
    -------
    Traces
    """
    names = [row.name for row in d.records if row.held_out]
    others = tuple(
        HeldOutTraces(name, record, d.held_out(number))
        for number, (name, record) in enumerate(zip(names, d.holdouts, strict=True))
    )
    fitted = {channel: d.contributions(channel) for channel in d.selection.fit.record.channels}
    return traces_between(d.selection.fits[0], d.selection.fit, fitted, d.errors["noise_floor"], others, d.log_name)


def traces_between(
    first: Fitted, fit: Fitted, contributions: Mapping[str, Contributions], floor: Errors,
    others: tuple[HeldOutTraces, ...] = (), name: str = "",
) -> Traces:  # fmt: skip
    """Return the torque balance over time, and every other balance that an effect enters, of all records.

    Parameters
    ----------
    first : Fitted
        Before the first effect; where it fails worst, the stretches are.
    fit : Fitted
        With all of them.
    contributions : dict of balance to Contributions
    floor : dict of balance to rms, unit and relative error
        What noise alone leaves.
    others : tuple of HeldOutTraces
        Where they fail worst without the effects, their stretches are.
    name : str
        Of the fitted record.

    Returns
    -------
    Traces
    """
    drive = fit.record.drive
    balances = [_balance(one, drive, floor) for one in contributions.values()]
    shown = tuple(b for k, b in enumerate(balances) if k == 0 or b.parts)
    known = {b.name for b in shown}
    held = []
    for one in others:
        own = tuple(b for b in (_balance(c, drive, floor) for c in one.contributions.values()) if b.name in known)
        before = next(iter(one.contributions.values()))
        held.append(_traces(one.record, own, before.residual(tuple(before.effects)), one.name))
    return replace(_traces(fit.record, shown, first.left[0], name), held_out=tuple(held))


def _traces(record: Record, balances: tuple[Balance, ...], residual: Array, name: str) -> Traces:
    coordinates = coordinates_of(record)
    speed = next(iter(coordinates.values()))
    stretches = worst_stretches(record.t, residual, record.mask, speed, STRETCHES)
    unit = "m/s" if record.linear else "rad/s"
    words = tuple((s.start, s.stop, motion_words(s.motion, unit)) for s in stretches)
    return Traces(record.t, coordinates, balances, words, Path(name).name, used=record.mask)


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


def _balance(parts: Contributions, drive: str, floor: Errors) -> Balance:
    name, size = drive if parts.channel == "torque" else parts.channel, parts.size
    share = float(floor[parts.channel]["rms"]) / size if size > 0.0 else 0.0
    return Balance(
        name, parts.unit, parts.measured, parts.predicted, parts.effects, parts.products, size, share,
        int(np.sum(parts.used)),
    )  # fmt: skip

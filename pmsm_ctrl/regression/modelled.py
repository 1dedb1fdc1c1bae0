"""A record whose terms read what the model predicts in place of what was measured."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.regression.balances import ALWAYS, Record
from pmsm_ctrl.regression.currents import add_slopes
from pmsm_ctrl.regression.filters import shifted

__all__ = ["in_time", "inside_band", "with_direction", "with_modelled_torque"]

Array = NDArray[np.float64]


def with_modelled_torque(record: Record, predicted: Array, late: float = 0.0) -> Record:
    """Return a copy whose terms read the torque and current that the model predicts, not the measured ones.

    A column made of the measured torque would explain the measured torque, noise and missing effects included. The
    drive's voltage responds to the noise of the measured current, and this would look like a resistance.

    Parameters
    ----------
    record : Record
    predicted : array, shape (m,)
        Torque balance as the model predicts it, on the thinned grid.
    late : float
        Delay of the currents that the model has, s.
    """
    signals = dict(record.signals)
    t = record.prepared.t
    signals["torque"] = torque = record.at_full_rate(predicted) + signals.get("T_load", np.zeros_like(t))
    signals["torque_whole"] = torque + _beyond_band(record, "torque_logged", late)
    motor, per_ampere = record.design.motor, np.full(len(t), record.design.K_t_assumed)
    if motor.p is not None and motor.L_d is not None and motor.L_q is not None and "i_d" in signals:
        per_ampere = per_ampere + 1.5 * motor.p * (motor.L_d - motor.L_q) * signals["i_d"]
    signals["i_q"] = torque / per_ampere
    signals["i_q_whole"] = signals["i_q"] + _beyond_band(record, "i_q_logged", late)
    if "u_d" in record.channels:
        signals["i_q_wide"] = signals["i_q"] + _beyond_band(record, "i_q_meas", late)
    add_slopes(signals, record.prepared, record.signals)
    return replace(record, signals=signals, late=late, memo={})


def inside_band(record: Record) -> Record:
    """Return a copy whose terms read nothing of the measured torque and current, and no noise of theirs.

    Parameters
    ----------
    record : Record
        With modelled torque in its signals.
    """
    signals, still = dict(record.signals), np.zeros(len(record.prepared.t))
    for name in ("torque", "i_q"):
        signals |= {f"{name}_whole": signals[name], f"{name}_noise": still}
    return replace(record, signals=signals, memo={}, kept={})


def in_time(record: Record, late: float) -> Array:
    """Return the measured torque balance as it was this much later, shape (m,): in time, where it is late.

    Parameters
    ----------
    record : Record
    late : float
        s.
    """
    return shifted(record.at_full_rate(record.target[0]), record.period, late)[record.prepared.keep]


def _beyond_band(record: Record, name: str, late: float) -> Array:
    """Return what a measured signal holds beyond the band, at the time of the position, shape (n,).

    A modelled torque is filtered already. Voltages hold products of current and speed, a saturation those of torque and
    current, and friction by load the torque without its sign: filtered after that, a fast signal comes back into the
    band, and one that was filtered twice lacks the ripple of the passband.
    """
    key = ("beyond the band", name)
    if key not in record.kept:
        measured = record.signals[name]
        record.kept[key] = measured - record.at_full_rate(record.shaped(measured))
    beyond: Array = record.kept[key]
    return beyond if late == 0.0 else shifted(beyond, record.period, late)


def with_direction(record: Record, direction: Array) -> Record:
    """Return a copy in which dry friction follows this direction instead; what does not hang on it stays remembered.

    Parameters
    ----------
    record : Record
    direction : array, shape (n,)
    """
    kept = {key: value for key, value in record.kept.items() if key[0] in ALWAYS}
    return replace(record, signals={**record.signals, "direction": direction}, memo={}, kept=kept)

"""What the terms of effects read: the drive torque behind the currents, and the signals of a log by their names."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects.base import Effect
from pmsm_ctrl.errors import LogError, NextCommand
from pmsm_ctrl.kernels.balance import torque_em
from pmsm_ctrl.units import psi_f_from

__all__ = ["drive_torque", "logged_torque", "missing_signals", "term_signals"]

Array = NDArray[np.float64]


def drive_torque(design: Design, i_d: ArrayLike, i_q: ArrayLike) -> Array:
    """Return the torque that currents make, N m (N), with the torque constant that the evaluation assumes.

    Currents in A, arrays of shape (n,) or numbers. With pole pairs and inductances the reluctance torque is included.
    """
    motor = design.motor
    if motor.p is None or motor.L_d is None or motor.L_q is None:
        return design.K_t_assumed * np.asarray(i_q, dtype=np.float64)
    psi_f = psi_f_from(design.K_t_assumed, motor.p)
    # the kernel's own Python source works on arrays as well
    torque: Array = torque_em.py_func(motor.p, psi_f, motor.L_d, motor.L_q, i_d, i_q)
    return torque


def logged_torque(design: Design, channels: Mapping[str, Array], label: str = "") -> Array:
    """Return the drive torque of a log, N m (N), shape (n,): its torque channel, or else the torque of its currents.

    `label` begins an error message.

    Raises
    ------
    LogError
        When there is neither ``torque`` nor ``i_q``.
    """
    if "torque" in channels:
        return channels["torque"]
    if "i_q" not in channels:
        message = f"{label}neither torque nor i_q (usable: {', '.join(channels)})"
        raise LogError(message, next_command=NextCommand.IMPORT)
    i_q = channels["i_q"]
    return drive_torque(design, channels.get("i_d", np.zeros_like(i_q)), i_q)


def term_signals(design: Design, signals: Mapping[str, Array]) -> dict[str, Array | float]:
    """Return the signals by the names that terms read: those of the log, and the pole pairs."""
    known: dict[str, Array | float] = dict(signals)
    if design.motor.p is not None:
        known["p"] = float(design.motor.p)
    return known


def missing_signals(effect: Effect, known: Mapping[str, Array | float]) -> str:
    """Return the names of the signals that a term reads and that are not known, separated by commas."""
    return ", ".join(name for name in effect.signals if name not in known)

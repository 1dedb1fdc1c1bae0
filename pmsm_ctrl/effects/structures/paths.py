"""What lies between an axis and its log: the path of the drive signal, observers, periodic errors of the angle."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.effects.structures.views import Balances

__all__ = ["bent_torque", "drive_path", "observed_path", "swings_of_angle", "voltage_path"]

Array = NDArray[np.float64]

BENT = 0.1  # share of the largest torque that a saturated motor lacks
OBSERVERS = (1e-3, 2e-3, 5e-3, 1e-2, 2e-2, 4e-2)  # s, 1 / w of an observer of 4 to 160 Hz
HIGHEST_SLOPE = 4  # derivatives of the acceleration: with two a filter over several periods still looks like a spring


def drive_path(balances: Balances) -> list[dict[str, Array]]:
    """Return what lies between the logged drive signal and the torque, shape (n,) each, as large as it may be.

    Channels that are late, averaged or filtered, by a time tau, and a current loop, make a response that is smooth in
    the frequency: a Taylor series in s tau, of the torque and of what accelerates the axis.

    Parameters
    ----------
    balances : Balances
    """
    s, design = balances.signals, balances.design
    tau = max(balances.period, design.drive.speed_period if design.motor.electrical else 0.0)
    columns: list[Array] = []
    for start, order in ((s["torque"], 2), (design.J * s["alpha"], HIGHEST_SLOPE)):
        slope = start
        for _ in range(order):
            slope = tau * balances.rate_of(slope)
            columns.append(slope)
    return [{"torque": column} for column in columns]


def voltage_path(balances: Balances) -> list[dict[str, Array]]:
    """Return what lies between logged voltages and speed and those that act, shape (n,) each, as large as it may be.

    A voltage that is late, averaged or filtered lacks a part of its slope, and of the slope of that. So does its
    back-emf by a speed that was.

    Parameters
    ----------
    balances : Balances
    """
    s, tau, motor = balances.signals, balances.period, balances.design.motor
    columns = []
    for name in (one for one in ("u_d", "u_q") if one in s):
        starts = [s[name]]
        if name == "u_q" and not balances.angle:
            starts.append((motor.p or 0.0) * (motor.psi_f or 0.0) * s["omega"])
        for start in starts:
            slope = start
            for _ in range(2):
                slope = tau * balances.rate_of(slope)
                columns.append({name: slope})
    return columns


def bent_torque(balances: Balances) -> list[dict[str, Array]]:
    """Return what a torque that is not in proportion to the current lacks, shape (n,) each, as large as it may be.

    In motions of one frequency the position is the acceleration, and a smooth function of one is one of the other.

    Parameters
    ----------
    balances : Balances
    """
    torque = balances.signals["torque"]
    share = np.abs(torque) / max(float(np.max(np.abs(torque))), 1e-300)
    return [{"torque": BENT * torque * share**power} for power in (1, 2)]


def observed_path(balances: Balances) -> list[dict[str, Array]]:
    """Return what an observer makes of a speed of which nothing is stated, shape (n,) each, as large as it may be.

    A tracking observer (phase-locked loop) follows ``(2 zeta w s + w^2) / (s^2 + 2 zeta w s + w^2)``. It is not late at
    slow changes, and too large around w, as a load on a spring is: what accelerates lacks
    ``s^2 / (2 zeta w s + w^2)`` of what is seen, here for a damping of a half, and less for a larger one.

    Parameters
    ----------
    balances : Balances
    """
    if balances.angle or balances.design.log.of("omega").stated:
        return []
    from scipy.signal import lfilter

    curved = balances.rate_of(balances.rate_of(balances.design.J * balances.signals["alpha"]))
    columns = []
    for tau in OBSERVERS:
        kept = math.exp(-balances.period / tau)
        columns.append(tau**2 * np.asarray(lfilter([1.0 - kept], [1.0, -kept], curved)))
    return [{"torque": column} for column in columns]


def swings_of_angle(balances: Balances, order: float, error: float) -> tuple[Array, Array]:
    """Return the torque that a periodic error of the angle pretends, shape (n,): of its sine, and of its cosine.

    Parameters
    ----------
    balances : Balances
    order : float
        Periods of a turn.
    error : float
        Amplitude, rad.

    Returns
    -------
    (array, array)
        Inertia times second derivative, at the log's rate.
    """
    waves = (error * wave(order * balances.signals["theta"]) for wave in (np.sin, np.cos))
    sine, cosine = (balances.design.J * balances.rate_of(balances.rate_of(one)) for one in waves)
    return sine, cosine

"""A load on a spring that has dry friction of its own: it is held, let go, swings and is held again.

The spring's torque over the load's inertia follows from the motion of the shaft in time (`kernels.springs`), and the
column is linear in the inertia: with ``f = F_load / J_load`` the torque of the axis is
``J alpha + F_c direction + J_load (T_s / J_load - alpha - f direction)``.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.effects.structures.interface import Balances, LogView
from pmsm_ctrl.effects.structures.load_table import LoadTable, made_table, peaks, rigid_axis
from pmsm_ctrl.effects.structures.transmission import DAMPING, FREQUENCY, RUBBING

__all__ = ["bristle_column", "rubbing_column", "rubbing_shapes"]

Array = NDArray[np.float64]

NAMES = (FREQUENCY, DAMPING, RUBBING)
# What is searched: so many frequencies up to the band, and decelerations in ratios to that of the whole axis by its
# friction; the best few of a table are refined. A spring loses a few per cent of its energy in a swing.
FREQUENCIES, RATIOS = 18, np.geomspace(0.2, 5.0, 9)
DAMPED = 0.03
SEEN = ("seen", RUBBING)  # under which the searched loads are remembered: they follow from the motion alone
PART_OF_RADIAN, MOST = 0.1, 64  # of a swing that a step of the load covers, and most of these a sample


def rubbing_column(balances: Balances, shape: Mapping[str, float]) -> Array:
    """Return what a load that rubs adds to the torque of a rigid axis, per unit of its inertia, shape (n,).

    Parameters
    ----------
    balances : Balances
    shape : mapping
        With the load's own frequency, its damping and its deceleration.
    """
    s = balances.signals
    spring = np.array([[shape[name] for name in NAMES]])
    followed = _followed(s["theta"], s["omega"], balances.period, spring)[0]
    return np.asarray(followed - s["alpha"] - shape[RUBBING] * s["direction"])


def bristle_column(balances: Balances, reach: float) -> Array:
    """Return what a load without a mass adds, per unit of the torque's rms, shape (n,): a spring that slides.

    Parameters
    ----------
    balances : Balances
    reach : float
        By how much the spring bends before it slides, rad (m).
    """
    from pmsm_ctrl.kernels.springs import slider

    s = balances.signals
    bent = np.empty(len(s["theta"]))
    slider(np.ascontiguousarray(s["theta"]), reach, bent)
    return np.asarray(float(np.std(s["torque"])) * (bent / reach - s["direction"]))


def rubbing_shapes(log: LogView, lowest: float) -> tuple[list[dict[str, float]], int]:
    """Return the loads that rub and lower the torque's sum of squares most, and how many were looked at.

    Parameters
    ----------
    log : LogView
    lowest : float
        Frequency, rad/s.
    """
    balances = log.balances
    if lowest >= 2.0 * np.pi * balances.cutoff:
        return [], 0
    if SEEN not in balances.kept:
        made = _table(balances, lowest)
        if made is None:
            return [], 0
        balances.kept[SEEN] = made
    table: LoadTable = balances.kept[SEEN]
    best = table.loads[peaks(table.gains(log.residual).reshape(FREQUENCIES, len(RATIOS)))]
    return [dict(zip(NAMES, spring, strict=True)) for spring in best.tolist()], len(table.loads)


def _table(balances: Balances, lowest: float) -> LoadTable | None:
    """Return the loads that are searched; None where the axis has no dry friction."""
    axis = rigid_axis(balances)
    if axis is None:
        return None
    springs = np.array([
        (w, DAMPED, f)
        for w in np.geomspace(lowest, 2.0 * np.pi * balances.cutoff, FREQUENCIES).tolist()
        for f in (axis.deceleration * RATIOS).tolist()
    ])  # fmt: skip

    def followed(some: slice, theta: Array, omega: Array, period: float) -> Array:
        return _followed(theta, omega, period, springs[some])

    return made_table(balances, axis, springs, np.full(len(springs), np.inf), followed)


def _followed(theta: Array, omega: Array, period: float, springs: Array) -> Array:
    """Return the torques of springs over the inertia of their loads, shape (k, n)."""
    from pmsm_ctrl.kernels.springs import rubbing_loads

    out = np.empty((len(springs), len(theta)))
    steps = min(MOST, max(1, int(np.ceil(period * float(springs[:, 0].max()) / PART_OF_RADIAN))))
    rubbing_loads(np.ascontiguousarray(theta), np.ascontiguousarray(omega), period, steps, springs, out)
    return out

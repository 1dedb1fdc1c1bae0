"""What a reference that is held does to voltages which are instants: the log shows it, sample by sample of the period.

A position reference that is held for a period steps by omega times that period, one of the speed by alpha times it.
The voltages answer each step with a jump that fades until the next one. A log with several samples in a period takes
them at the same places of every period, and each place has its own share of the speed or of the acceleration. So has
their mean, which is taken for back-emf, resistance or dead time.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.conditioning import Prepared
from pmsm_ctrl.regression.filters import low_pass
from pmsm_ctrl.regression.timing import uniform

__all__ = ["HELD", "swings", "with_swings"]

Array = NDArray[np.float64]

HELD = 4e-3  # s: the longest time for which a reference is held
SURE = 5.0  # rms of the places' shares in standard errors: chance has 1, and looks at some thirty periods
LONGEST = 100_000  # samples that are looked at


def swings(design: Design, log: Log, prepared: Prepared) -> Mapping[str, tuple[float, float]]:
    """Return how far each voltage swings over the places of a reference's period, per speed and per acceleration.

    Nothing of those that show no period, or of which the design states how they were sampled.

    Parameters
    ----------
    design : Design
    log : Log
        As it was logged: at a lower rate nothing is left of it.
    prepared : Prepared
        The motion.

    Returns
    -------
    dict of channel to (float, float)
        V per rad/s and per rad/s^2 (m/s, m/s^2), rms over the places.
    """
    if not design.motor.electrical or not {"u_d", "u_q"} <= set(log) or 2.0 * log.period > HELD * (1.0 + 1e-6):
        return {}
    t, channels, _, _ = uniform(log)
    rate, some = (len(t) - 1) / float(t[-1] - t[0]), slice(0, LONGEST)
    motion = [np.interp(t[some], prepared.t, one) for one in (prepared.signals["omega"], prepared.alpha)]
    names = [name for name in ("u_d", "u_q") if not design.log.of(name).stated]
    fast = {name: channels[name][some] - low_pass(channels[name][some], rate, prepared.cutoff) for name in names}
    found = {name: _swing(one, motion, math.floor(HELD * rate * (1.0 + 1e-6))) for name, one in fast.items()}
    return {name: one for name, one in found.items() if any(one)}


def with_swings(design: Design, log: Log, prepared: Prepared) -> Prepared:
    """Return the signals with what `swings` finds in the log.

    Parameters
    ----------
    design : Design
    log : Log
    prepared : Prepared
    """
    return replace(prepared, swings=swings(design, log, prepared))


def _swing(fast: Array, motion: list[Array], longest: int) -> tuple[float, float]:
    """Return the swing of what is fast over the surest period of up to so many samples."""
    best, found = SURE, (0.0, 0.0)
    terms = [(along**2, fast * along, (fast * along) ** 2) for along in motion]
    for period in range(2, longest + 1):
        place = np.arange(len(fast)) % period
        shares = [_shares(*one, place, period) for one in terms]
        sure = max(math.sqrt(float(np.mean((share / error) ** 2))) for share, error in shares)
        if sure > best:
            best, found = sure, (_rms(*shares[0]), _rms(*shares[1]))
    return found


def _shares(square: Array, product: Array, squared: Array, place: NDArray[np.intp], period: int) -> tuple[Array, Array]:
    """Return by how much the share of a signal in what is fast differs at each place of a period, and the error.

    By the square of the signal, its product with what is fast, and the square of that. What all places share is the
    filter's.
    """
    squares = np.maximum(np.bincount(place, square, period), 1e-300)
    share = np.bincount(place, product, period) / squares
    error = np.sqrt(np.bincount(place, squared, period)) / squares
    return share - np.mean(share), np.maximum(error, 1e-300)


def _rms(share: Array, error: Array) -> float:
    """Return the rms of the shares without that of their errors."""
    return math.sqrt(max(float(np.mean(share**2 - error**2)), 0.0))

"""Orders of a turn above the bandwidth, searched in the log as it is, since the low-pass removes them.

A speed loop answers a slow wave, which the drive signal then shows; a fast one moves the axis, and only the drive
signal less the torque of the inertia holds it. Both are searched.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.filters import low_pass
from pmsm_ctrl.regression.joining import thinning
from pmsm_ctrl.regression.notices import ORDERS_BEYOND_BAND
from pmsm_ctrl.regression.timing import uniform, unwrapped
from pmsm_ctrl.section import Notice
from pmsm_ctrl.units import axis_unit

__all__ = ["CLIPPED", "PIECE", "RESOLVED", "WIDEST", "AsLogged", "Beyond", "as_logged", "beyond_band", "orders_beyond"]

Array = NDArray[np.float64]

# Highest mechanical order that is looked for: twice the ratio of a large harmonic drive.
HIGHEST = 400
# Frequencies of an order that are judged lie below this share of the log's rate: what is faster is aliased.
RESOLVED = 0.45
# Samples an order needs, turns that tell it from its neighbours, and most samples that are used.
FEWEST, TURNS, MOST = 400, 1.0, 40000
# A wave stands out from the spectrum, and from so many orders on either side, by this ratio of its power to the median,
# also without the two speeds at which it is strongest: there it may be a vibration. It is at least this share of the
# drive signal's rms.
STANDS_OUT, NEIGHBOURS, BEST, LEAST = 30.0, 8, 2, 0.02
# Speeds that are judged apart, since loops turn the phase of a wave with its frequency, and length of the pieces of
# time that must agree, s.
SPEEDS, PIECE = 8, 0.5
# A wave that is in the band for more than this share of the motion is judged there.
JUDGED = 0.1
# Further orders are named down to this share of the largest, so many at most.
NAMED, MOST_NAMED = 0.4, 3
# A band that holds an order is this much wider than the order's frequency in the slow part of the motion, and no wider
# than this share of the rate at which the log is evaluated.
WIDER, WIDEST = 1.25, 0.3
CLIPPED = 5.0  # median magnitudes of the fast part of the drive signal: edges are no waves


@dataclass(frozen=True, eq=False)
class AsLogged:
    """Angle and drive signal of a log with all that they hold above a band, at a uniform rate.

    Attributes
    ----------
    t, theta, drive : array, shape (n,)
        s, rad, N m.
    good : bool array, shape (n,)
        False around gaps.
    rate : float
        Hz.
    """

    t: Array
    theta: Array
    drive: Array
    good: NDArray[np.bool_]
    rate: float

    def speed(self, cutoff: float) -> Array:
        """Return the size of the speed, low-passed, shape (n,).

        Parameters
        ----------
        cutoff : float
            Hz.
        """
        slow = low_pass(self.theta, self.rate, min(cutoff, 0.2 * self.rate))
        return np.asarray(np.abs(np.gradient(slow, 1.0 / self.rate)))

    def without_inertia(self, J: float) -> Array:
        """Return the drive signal less the torque of the inertia, shape (n,); the second difference is unfiltered.

        Parameters
        ----------
        J : float
            kg m^2.
        """
        left = self.drive.copy()
        left[1:-1] -= J * self.rate**2 * np.diff(self.theta, 2)
        return left


def as_logged(design: Design, log: Log) -> AsLogged | None:
    """Return angle and drive signal of a log; None for a linear axis, and without either.

    Parameters
    ----------
    design : Design
        For the torque constant.
    log : Log
    """
    source = next((name for name in ("torque", "i_q") if name in log), None)
    if log.motion == "linear" or source is None or "theta" not in log:
        return None
    t, raw, good, _ = uniform(log)
    drive = raw[source] * (1.0 if source == "torque" else design.K_t_assumed)
    return AsLogged(t, unwrapped(raw["theta"]), drive, good, (len(t) - 1) / float(t[-1] - t[0]))


@dataclass(frozen=True)
class Beyond:
    """Orders of a turn that lie above the bandwidth at nearly all speeds.

    Attributes
    ----------
    orders : tuple of int
        The largest first.
    notice : Notice
        What is said of them.
    band : float
        Bandwidth, Hz, that holds the largest for a good part of the motion; 0 where the log has no such band.
    """

    orders: tuple[int, ...]
    notice: Notice
    band: float


def orders_beyond(design: Design, log: Log, cutoff: float) -> tuple[Notice, ...]:
    """Return what `beyond_band` says, as notices.

    Parameters
    ----------
    design : Design
    log : Log
    cutoff : float
        Hz.
    """
    found = beyond_band(design, log, cutoff)
    return () if found is None else (found.notice,)


def beyond_band(design: Design, log: Log, cutoff: float) -> Beyond | None:
    """Return the orders of a turn that lie above the bandwidth at nearly all speeds; None without any.

    A wave over the angle is demodulated with the logged angle, at any speed at which the log resolves it.

    Parameters
    ----------
    design : Design
        For torque constant and inertia.
    log : Log
    cutoff : float
        Bandwidth of the evaluation, Hz.
    """
    whole = as_logged(design, log)
    if whole is None or not 0.0 < cutoff < 0.4 * whole.rate:
        return None
    t, theta, drive, good, rate = whole.t, whole.theta, whole.drive, whole.good, whole.rate
    speed = whole.speed(cutoff)
    moving = good & (speed > 0.002 * float(np.quantile(speed, 0.99)))
    chosen = np.flatnonzero(moving)[:: max(1, int(moving.sum()) // MOST)]
    if len(chosen) < FEWEST:
        return None
    chosen = chosen[np.argsort(speed[chosen], kind="stable")]
    odd = np.floor((t[chosen] - t[0]) / PIECE) % 2.0

    def waves(signal: Array) -> tuple[Array, NDArray[np.bool_]]:
        fast = signal - low_pass(signal, rate, cutoff)
        limit = CLIPPED * float(np.median(np.abs(fast[good])))
        fast = np.clip(fast[chosen], -limit, limit)
        return _waves(theta[chosen], speed[chosen], fast, odd, (cutoff, RESOLVED * rate))

    answered, _ = waves(drive)
    unanswered, of_angle = waves(whole.without_inertia(design.J))
    # a line of the encoder is no wave of the torque, though the loop may answer it
    found = np.where(of_angle & (unanswered > 0.0), 0.0, np.maximum(answered, unanswered))
    rms = float(np.sqrt(np.mean(drive[moving] ** 2)))
    standing = np.flatnonzero(found > LEAST * rms) + 1
    unseen = [k for k in standing.tolist() if float(np.mean(k * speed[chosen] < 2.0 * np.pi * cutoff)) < JUDGED]
    if not unseen:
        return None
    largest = max(float(found[k - 1]) for k in unseen)
    named = sorted((k for k in unseen if found[k - 1] > NAMED * largest), key=lambda k: -found[k - 1])[:MOST_NAMED]
    above = float(np.mean(min(named) * speed[chosen] >= 2.0 * np.pi * cutoff))
    frequency = speed[chosen] * named[0] / (2.0 * np.pi)
    band = min(WIDER * float(np.quantile(frequency, 2.0 * JUDGED)), WIDEST * rate / thinning(rate, len(t)))
    said = ORDERS_BEYOND_BAND(
        orders=", ".join(map(str, named)), amplitude=largest, unit=axis_unit("N m", log.motion), cutoff=cutoff,
        percent=100.0 * above, slow=2.0 * np.pi * cutoff / min(named),
    )  # fmt: skip
    return Beyond(tuple(named), said, band if float(np.mean(frequency < band)) > JUDGED else 0.0)


def _waves(
    theta: Array, speed: Array, fast: Array, odd: Array, band: tuple[float, float]
) -> tuple[Array, NDArray[np.bool_]]:
    """Return the amplitude of every order over the samples whose frequency is in a band, Hz; 0 where none stands out.

    Beside it whether it grows with the square of the speed, as an error of the angle does in an acceleration.

    Samples are in the order of their speed; the power is the product of two means, over `odd` pieces of time and over
    the others, and noise has none.
    """
    from pmsm_ctrl.kernels.orders import apart_sums

    orders = np.arange(1, HIGHEST + 1)
    start, stop = (np.searchsorted(speed, 2.0 * np.pi * edge / orders) for edge in band)
    bins = start[:, None] + np.linspace(0, stop - start, SPEEDS + 1, axis=1).astype(np.int64)
    sums, span = np.empty((HIGHEST, SPEEDS, 2, 2)), np.empty(HIGHEST)
    enough = 2.0 * np.pi * TURNS
    apart_sums(theta, 2.0 * fast * np.stack([odd, 1.0 - odd]), bins, enough, sums, span)
    judged = np.flatnonzero((stop - start >= FEWEST) & (span >= enough))
    power, standing, of_angle = np.zeros(HIGHEST), np.zeros(HIGHEST), np.zeros(HIGHEST, dtype=bool)
    if not len(judged):
        return power, of_angle
    labelled = np.diff(np.concatenate([[0.0], np.cumsum(odd)])[bins[judged]], axis=1)
    counts = np.stack([labelled, np.diff(bins[judged], axis=1) - labelled], axis=-1)
    means = sums[judged] / np.maximum(counts, 1.0)[..., None]
    each = np.sum(means[:, :, 0] * means[:, :, 1], axis=-1)
    power[judged], standing[judged] = np.mean(each, axis=1), np.mean(np.sort(each, axis=1)[:, :-BEST], axis=1)
    total = np.diff(np.concatenate([[0.0], np.cumsum(speed)])[bins[judged]], axis=1)
    squared = (total / np.maximum(np.diff(bins[judged], axis=1), 1)) ** 4
    of_angle[judged] = _left(each, squared) < _left(each, np.ones_like(each))
    size = np.abs(power)
    least = STANDS_OUT * float(np.median(size[judged]))
    for k in np.flatnonzero(standing > least).tolist():
        near = size[judged[np.abs(judged - k) <= NEIGHBOURS]]
        if not standing[k] > STANDS_OUT * float(np.median(near)):
            standing[k] = 0.0
    return np.where(standing > least, np.sqrt(np.maximum(power, 0.0)), 0.0), of_angle


def _left(values: Array, shape: Array) -> Array:
    """Return what a multiple of a shape leaves of each row, sums of squares."""
    along = np.sum(values * shape, axis=1) / np.sum(shape**2, axis=1)
    return np.asarray(np.sum((values - along[:, None] * shape) ** 2, axis=1))

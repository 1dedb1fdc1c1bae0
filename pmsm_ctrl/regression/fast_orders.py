"""Orders of a turn above the bandwidth, searched in the drive signal as logged, since the low-pass removes them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.filters import low_pass
from pmsm_ctrl.regression.notices import ORDERS_BEYOND_BAND
from pmsm_ctrl.regression.timing import uniform, unwrapped
from pmsm_ctrl.section import Notice
from pmsm_ctrl.units import axis_unit

__all__ = ["orders_beyond"]

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
CLIPPED = 5.0  # median magnitudes of the fast part of the drive signal: edges are no waves


def orders_beyond(design: Design, log: Log, cutoff: float) -> tuple[Notice, ...]:
    """Return notices of orders of a turn that lie above the bandwidth at nearly all speeds.

    A wave over the angle is demodulated with the logged angle, at any speed at which the log resolves it.

    Parameters
    ----------
    design : Design
        For the torque constant.
    log : Log
    cutoff : float
        Bandwidth of the evaluation, Hz.
    """
    source = next((name for name in ("torque", "i_q") if name in log), None)
    if log.motion == "linear" or source is None or "theta" not in log:
        return ()
    t, raw, good, _ = uniform(log)
    rate = (len(t) - 1) / float(t[-1] - t[0])
    if not 0.0 < cutoff < 0.4 * rate:
        return ()
    theta = unwrapped(raw["theta"])
    drive = raw[source] * (1.0 if source == "torque" else design.K_t_assumed)
    fast = drive - low_pass(drive, rate, cutoff)
    limit = CLIPPED * float(np.median(np.abs(fast[good])))
    speed = np.abs(np.gradient(low_pass(theta, rate, min(cutoff, 0.2 * rate)), 1.0 / rate))
    moving = good & (speed > 0.002 * float(np.quantile(speed, 0.99)))
    chosen = np.flatnonzero(moving)[:: max(1, int(moving.sum()) // MOST)]
    if len(chosen) < FEWEST:
        return ()
    chosen = chosen[np.argsort(speed[chosen], kind="stable")]
    odd = np.floor((t[chosen] - t[0]) / PIECE) % 2.0
    signal = np.clip(fast[chosen], -limit, limit)
    found = _waves(theta[chosen], speed[chosen], signal, odd, (cutoff, RESOLVED * rate))
    rms = float(np.sqrt(np.mean(drive[moving] ** 2)))
    standing = np.flatnonzero(found > LEAST * rms) + 1
    unseen = [k for k in standing.tolist() if float(np.mean(k * speed[chosen] < 2.0 * np.pi * cutoff)) < JUDGED]
    if not unseen:
        return ()
    largest = max(float(found[k - 1]) for k in unseen)
    named = sorted((k for k in unseen if found[k - 1] > NAMED * largest), key=lambda k: -found[k - 1])[:MOST_NAMED]
    above = float(np.mean(min(named) * speed[chosen] >= 2.0 * np.pi * cutoff))
    return (
        ORDERS_BEYOND_BAND(
            orders=", ".join(map(str, named)), amplitude=largest, unit=axis_unit("N m", log.motion), cutoff=cutoff,
            percent=100.0 * above, slow=2.0 * np.pi * cutoff / min(named),
        ),
    )  # fmt: skip


def _waves(theta: Array, speed: Array, fast: Array, odd: Array, band: tuple[float, float]) -> Array:
    """Return the amplitude of every order over the samples whose frequency lies in a band, Hz; 0 where none stands out.

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
    power, standing = np.zeros(HIGHEST), np.zeros(HIGHEST)
    if not len(judged):
        return power
    labelled = np.diff(np.concatenate([[0.0], np.cumsum(odd)])[bins[judged]], axis=1)
    counts = np.stack([labelled, np.diff(bins[judged], axis=1) - labelled], axis=-1)
    means = sums[judged] / np.maximum(counts, 1.0)[..., None]
    each = np.sum(means[:, :, 0] * means[:, :, 1], axis=-1)
    power[judged], standing[judged] = np.mean(each, axis=1), np.mean(np.sort(each, axis=1)[:, :-BEST], axis=1)
    size = np.abs(power)
    least = STANDS_OUT * float(np.median(size[judged]))
    for k in np.flatnonzero(standing > least).tolist():
        near = size[judged[np.abs(judged - k) <= NEIGHBOURS]]
        if not standing[k] > STANDS_OUT * float(np.median(near)):
            standing[k] = 0.0
    return np.where(standing > least, np.sqrt(np.maximum(power, 0.0)), 0.0)

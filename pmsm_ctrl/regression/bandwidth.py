"""How much of the spectrum a comparison needs, and which samples have a time that can be believed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.conditioning import Prepared

__all__ = ["band", "punctual"]

USUAL = 40.0  # Hz
# A longer log, s, keeps the usual band: its length makes up for it, and memory stays small.
LONG = 200.0
PASSED = 0.95
LATE = 0.5  # of a period
JUMP = 12.0  # of the usual change of the speed from sample to sample


def band(log: Log) -> float:
    """Return the low-pass for both sides, Hz: the usual one, or more where the drive's torque lives above it.

    Of what the drive signal holds above its noise floor `PASSED` has to get through; the floor is the level of the
    uppermost quarter of the spectrum.
    """
    from scipy.signal import welch

    source = next((name for name in ("torque", "i_q") if name in log), None)
    rate = (len(log) - 1) / log.duration
    usual = min(USUAL, rate / 8.0)
    if source is None or log.duration > LONG:
        return usual
    values = log[source]
    frequency, power = welch(values - np.mean(values), rate, nperseg=min(len(values), 2048))
    excess = np.maximum(power - np.median(power[frequency > 0.375 * rate]), 0.0)
    total = np.cumsum(excess)
    if total[-1] <= 0.0:
        return usual
    reach = float(frequency[int(np.searchsorted(total, PASSED * total[-1]))])
    return usual if reach < 0.8 * usual else float(min(max(usual, 1.5 * reach), rate / 8.0))


def punctual(log: Log, prepared: Prepared, jumps: bool = True) -> NDArray[np.bool_]:
    """Return samples, shape (n,), away from time stamps that miss their turn by more than half a period.

    Such a stamp, or the count that went with it, makes the speed jump: where there are any, samples around jumps of
    the speed are left out as well, unless `jumps` are dealt with elsewhere. Where that would be nearly everywhere,
    nothing is.
    """
    from pmsm_ctrl.regression.conditioning import low_pass

    good = np.ones(len(prepared.t), dtype=bool)
    late = np.flatnonzero(np.abs(np.diff(log.t) - log.period) > LATE * log.period)
    if len(late) == 0:
        return good
    reach = 1.5 / prepared.cutoff
    spans = [(log.t[k] - reach, log.t[k + 1] + reach) for k in late]
    if jumps and "theta" in log:
        speed = np.gradient(np.interp(prepared.t, log.t, np.unwrap(log["theta"])))
        fast = np.abs(speed - low_pass(speed, prepared.rate, 0.25 * prepared.rate))
        jumping = np.flatnonzero(fast > JUMP * max(float(np.median(fast)), 1e-300))
        spans += [(prepared.t[k] - reach, prepared.t[k] + reach) for k in jumping]
    for first, last in np.searchsorted(prepared.t, np.array(spans)):
        good[first:last] = False
    return good if good.mean() > 0.4 else np.ones_like(good)

"""A log as most drives record it: a speed, made of the angle and filtered, and no angle."""

from __future__ import annotations

import numpy as np

from pmsm_ctrl.log import Log

# Not tried without an angle: a filtered speed tells no travel of a bristle.
UNTRIED = ("presliding",)
LAGS = (0.0, 1e-3, 2e-3, 4e-3)  # s, of the filter of the speed


def speed_alone(log: Log, seed: int) -> Log:
    """Return a log without its angle; its speed is a difference quotient behind a filter of first order.

    The quotient is central or backward, by half of the seeds each. Half of the references of a position go with it.

    Parameters
    ----------
    log : Log
        With an angle.
    seed : int
        Of the quotient and of the filter.
    """
    from scipy.signal import lfilter

    rng = np.random.default_rng([seed, 77])
    t, theta = log.t, log["theta"]
    backward = rng.random() < 0.5
    omega = np.concatenate([[0.0], np.diff(theta) / np.diff(t)]) if backward else np.gradient(theta, t)
    lag = float(rng.choice(LAGS))
    if lag > 0.0:
        kept = float(np.exp(-log.period / lag))
        omega = lfilter([1.0 - kept], [1.0, -kept], omega, zi=[kept * omega[0]])[0]
    channels = {name: log[name] for name in log.channels if name not in ("theta", "theta_ref")} | {"omega": omega}
    if "theta_ref" in log and rng.random() < 0.5:
        channels["omega_ref"] = np.gradient(log["theta_ref"], t)
    return Log(channels, motion=log.motion)

"""Plateaus of a speed staircase: found from the reference, cut where they have settled, averaged."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import LogError, NextCommand
from pmsm_ctrl.evidence.noise import mean_of
from pmsm_ctrl.identify import policy
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.measurement_correction import corrected_log
from pmsm_ctrl.regression.signals import logged_torque

__all__ = ["Plateau", "find_plateaus", "settled_from"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Plateau:
    """One constant reference speed.

    Means over its settled part, rad/s and N m (m/s and N), the standard error of the torque with its degrees of
    freedom, the autocorrelation allowed for, and begin, begin of the settled part and end, s. One that did not settle
    is not trusted.
    """

    omega_ref: float
    omega: float
    torque: float
    stderr: float
    dof: float
    start: float
    settled: float
    stop: float
    trusted: bool


def settled_from(values: Array) -> tuple[int, bool]:
    """Return the first settled sample of a record, shape (n,), and whether it settles at all.

    The start is cut where the marginal standard error of the rest is least (K. P. White, Simulation 69 (1997) 323),
    within the first three quarters. The rest is settled when its two halves agree.
    """
    n = len(values)
    batch = max(1, n // 200)
    blocks = values[: n // batch * batch].reshape(-1, batch).mean(axis=1)
    m = len(blocks)
    tail = np.arange(m, 0, -1)
    shifted = blocks - blocks[-1]  # the sums of squares must not cancel where the level is far above the noise
    mean = np.cumsum(shifted[::-1])[::-1] / tail
    square = np.cumsum(shifted[::-1] ** 2)[::-1] / tail
    error = np.maximum(square - mean**2, 0.0) / tail
    start = int(np.argmin(error[: max(1, 3 * m // 4)])) * batch
    rest = values[start:]
    half = len(rest) // 2
    first, second = mean_of(rest[:half]), mean_of(rest[half:])
    gap = abs(first.value - second.value)
    tolerance = policy.HALVES * float(np.hypot(first.stderr, second.stderr)) + policy.LEVEL * abs(second.value)
    return start, bool(gap <= tolerance)


def find_plateaus(design: Design, log: Log) -> tuple[Plateau, ...]:
    """Find and average the plateaus of a staircase, in order of time.

    Standstill is left out: friction is set-valued there. The log needs ``omega_ref``, ``omega`` or ``theta``, and
    ``torque`` or ``i_q``.

    Raises
    ------
    LogError
        When a channel is missing or there is no plateau.
    """
    where = f"{log.provenance.file}: " if log.provenance.file else ""
    log, _ = corrected_log(design, log)
    reference, t = log["omega_ref"], log.t
    torque = logged_torque(design, log.channels, where)
    if "T_load" in log:
        torque = torque - log["T_load"]
    if "omega" not in log and "theta" not in log:
        raise LogError(f"{where}neither omega nor theta (present: {', '.join(log)})", next_command=NextCommand.IMPORT)
    top = float(np.max(np.abs(reference)))
    change = np.flatnonzero(np.abs(np.diff(reference)) > 1e-6 * top) + 1
    edges = np.concatenate([[0], change, [len(t)]])
    found = []
    for start, stop in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        level = float(reference[start])
        if stop - start >= policy.SHORTEST_PLATEAU and abs(level) > 1e-6 * top:
            found.append(_average(log, torque, level, start, stop))
    if not found:
        message = f"{where}no plateau: omega_ref is never constant and nonzero over {policy.SHORTEST_PLATEAU} samples"
        raise LogError(message, next_command=NextCommand.IDENTIFY)
    return tuple(found)


def _average(log: Log, torque: Array, level: float, start: int, stop: int) -> Plateau:
    t = log.t[start:stop]
    steady = torque[start:stop]
    speed = log["omega"][start:stop] if "omega" in log else np.gradient(log["theta"][start:stop], t)
    cut_torque, calm_torque = settled_from(steady)
    cut_speed, calm_speed = settled_from(speed)
    cut = max(cut_torque, cut_speed)
    mean = mean_of(steady[cut:])
    if "theta" in log:  # the exact mean speed, whatever filter the speed signal went through
        theta = log["theta"][start:stop]
        omega = float((theta[-1] - theta[cut]) / (t[-1] - t[cut]))
    else:
        omega = float(np.mean(speed[cut:]))
    reached = abs(omega - level) < policy.REACHED * abs(level)
    trusted = calm_torque and calm_speed and reached
    return Plateau(level, omega, mean.value, mean.stderr, mean.dof, float(t[0]), float(t[cut]), float(t[-1]), trusted)

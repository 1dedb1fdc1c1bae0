"""Speed and position by simulation: the model run free in short windows.

An inverse-dynamics error says how much torque is missing; this says what that does to the motion. The position error of
a whole log is the random walk of a tiny torque bias, so the model is restarted from the measured state.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.compare import policy
from pmsm_ctrl.compare.notices import NOT_IN_FREE_RUN
from pmsm_ctrl.design import Design
from pmsm_ctrl.effects.base import Effect
from pmsm_ctrl.effects.evaluate import column
from pmsm_ctrl.regression.conditioning import Prepared
from pmsm_ctrl.regression.signals import evaluable_terms, term_signals
from pmsm_ctrl.section import Notice

__all__ = ["FreeRun", "free_run"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class FreeRun:
    """The mechanical model driven by the measured torque, restarted in windows.

    Attributes
    ----------
    t, omega, theta, omega_meas, theta_meas : array, shape (windows, steps)
        Time, and speed and position, simulated and measured.
    window : float
        s.
    notices : tuple of Notice
        Effects that could not take part.
    """

    t: Array
    omega: Array
    theta: Array
    omega_meas: Array
    theta_meas: Array
    window: float
    notices: tuple[Notice, ...] = ()

    @property
    def travel(self) -> Array:
        """Measured distance since the restart, shape (windows, steps)."""
        return self.theta_meas - self.theta_meas[:, :1]

    def floors(self, left: Array, rate: float, J: float, mask: NDArray[np.bool_]) -> tuple[float, float]:
        """Return the rms errors of speed and position that noise alone makes, from a torque noise of shape (m,).

        The noise of the log is integrated over windows of the same length; that of the restart is left out.
        """
        width = max(2, round(self.window * rate))
        count = len(left) // width
        inside = mask[: count * width].reshape(count, width)
        full = inside.mean(axis=1) > 0.9
        if full.sum() < 2:
            return float("nan"), float("nan")
        speed = np.cumsum(left[: count * width].reshape(count, width)[full] / (J * rate), axis=1)
        place = np.cumsum(speed / rate, axis=1)
        return float(np.sqrt(np.mean(speed**2))), float(np.sqrt(np.mean(place**2)))


def free_run(design: Design, prepared: Prepared, window: float = policy.WINDOW) -> FreeRun | None:
    """Run the design's mechanics from the measured torque, restarted from the measured state every `window` s.

    All windows run side by side. Dry friction is set-valued: where the speed meets zero within a step the axis rests,
    and it moves on when torque exceeds what friction can hold. Midpoint rule otherwise. Returns None for a log that is
    shorter than two windows.
    """
    every = max(1, int(policy.STEP * prepared.rate * (1 + 1e-9)))
    h = every / prepared.rate
    steps = max(1, round(window / h))  # a slow log's samples are further apart than a window
    count = (len(prepared.t) - every) // (steps * every)
    if count < 2:
        return None
    everything = term_signals(design, prepared.signals)
    terms, left_out = evaluable_terms(design, "torque", everything)
    drive = _averaged(prepared, every)
    signals = {name: values for name, values in everything.items() if isinstance(values, np.ndarray)}
    fixed = {name: values for name, values in everything.items() if not isinstance(values, np.ndarray)}
    starts = np.arange(count) * steps
    model = _Model(terms, design.J, h)
    omega = np.array(prepared.signals["omega"][starts * every])
    theta = np.array(prepared.signals["theta"][starts * every])
    run = np.empty((2, count, steps + 1))
    run[:, :, 0] = omega, theta
    for k in range(steps):
        at = (starts + k) * every + every // 2
        known = {name: np.ascontiguousarray(values[at]) for name, values in signals.items()} | fixed
        omega, theta = model.step(omega, theta, drive[starts + k], known)
        run[:, :, k + 1] = omega, theta
    at = (starts[:, None] + np.arange(steps + 1)) * every
    measured = prepared.signals["omega"][at], prepared.signals["theta"][at]
    good = prepared.moving[at].mean(axis=1) > 0.2
    if good.sum() < 2:
        return None
    notices = tuple(NOT_IN_FREE_RUN(effect=name, why=why) for name, why in left_out.items())
    return FreeRun(
        prepared.t[at][good], run[0][good], run[1][good], measured[0][good], measured[1][good], steps * h, notices
    )


def _averaged(prepared: Prepared, every: int) -> Array:
    """Drive torque less load torque, averaged over each step by the trapezoidal rule."""
    torque = prepared.signals["torque"] - prepared.signals.get("T_load", np.zeros_like(prepared.t))
    total = np.concatenate([[0.0], np.cumsum(0.5 * (torque[1:] + torque[:-1]))])
    return np.diff(total[::every]) / every


@dataclass(frozen=True, eq=False)
class _Model:
    """J domega/dt = torque - terms, one step for many windows at once."""

    terms: list[tuple[Effect, dict[str, float]]]
    J: float
    h: float

    def _opposing(self, omega: Array, theta: Array, direction: Array, known: Mapping[str, Array | float]) -> Array:
        signals = {**known, "omega": omega, "theta": theta, "direction": direction}
        total = np.zeros(len(omega))
        for effect, parameters in self.terms:
            total += column(effect, signals, parameters)
        return total

    def step(
        self, omega: Array, theta: Array, torque: Array, known: Mapping[str, Array | float]
    ) -> tuple[Array, Array]:
        """Return speed and position one step later, shape (windows,)."""
        h, J = self.h, self.J
        direction = np.sign(omega)
        rests = omega == 0.0
        if rests.any():  # the way it is pushed, if friction cannot hold it
            ones = np.ones(len(omega))
            ahead = torque - self._opposing(omega, theta, ones, known) > 0.0
            back = torque - self._opposing(omega, theta, -ones, known) < 0.0
            direction = np.where(rests, ahead.astype(np.float64) - (back & ~ahead), direction)
        first = (torque - self._opposing(omega, theta, direction, known)) / J
        half = omega + 0.5 * h * first
        half = np.where(half * direction < 0.0, 0.0, half)
        slope = (torque - self._opposing(half, theta + 0.25 * h * (omega + half), direction, known)) / J
        new = omega + h * slope
        landed = new * direction < 0.0
        share = np.divide(omega, omega - new, out=np.zeros_like(new), where=landed & (omega != new))
        new = np.where(landed | (direction == 0.0), 0.0, new)
        moved = np.where(landed, 0.5 * omega * share * h, 0.5 * (omega + new) * h)
        return new, theta + np.where(direction == 0.0, 0.0, moved)

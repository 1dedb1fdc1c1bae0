"""Speed and position by simulation from the measured torque alone: in short windows, and over the whole record.

An inverse-dynamics error says how much torque is missing; this says what that does to the motion. The position error of
a whole record is the random walk of a tiny torque bias, so the model is also restarted from the measured state.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.compare import policy
from pmsm_ctrl.compare.notices import NOT_IN_FREE_RUN
from pmsm_ctrl.design import Design
from pmsm_ctrl.regression.conditioning import EDGE, Prepared
from pmsm_ctrl.section import Notice
from pmsm_ctrl.simulate.mechanics import INPUTS, Mechanics

__all__ = ["FreeRun", "WholeRun", "free_run", "over_parts", "whole_run"]

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


@dataclass(frozen=True, eq=False)
class WholeRun:
    """The mechanical model driven by the measured torque from the begin of a record to its end.

    Attributes
    ----------
    t, omega, theta, omega_meas, theta_meas : array, shape (n,)
        Time, and speed and position, simulated and measured.
    """

    t: Array
    omega: Array
    theta: Array
    omega_meas: Array
    theta_meas: Array

    @property
    def rms(self) -> float:
        """Rms error of the position, rad (m)."""
        return float(np.sqrt(np.mean((self.theta - self.theta_meas) ** 2)))

    @property
    def fit(self) -> float:
        """1 - norm(error) / norm(position less its mean); 1 is perfect, 0 as good as the mean."""
        spread = float(np.std(self.theta_meas))
        return 1.0 - self.rms / spread if spread > 0.0 else float("nan")


def free_run(design: Design, prepared: Prepared, window: float = policy.WINDOW) -> FreeRun | None:
    """Run the design's mechanics from the measured torque, restarted from the measured state every `window` s.

    Springs start relaxed. Returns None for a log that is shorter than two windows.

    Parameters
    ----------
    design : Design
    prepared : Prepared
    window : float
        s.
    """
    steps = max(1, round(window * prepared.rate))  # a slow log's samples are further apart than a window
    count = (len(prepared.t) - 1) // steps
    if count < 2:
        return None
    mechanics, inputs = _driven(design, prepared)
    signals = prepared.signals
    starts = np.arange(count) * steps
    run = mechanics.run(inputs, starts, (signals["omega"], signals["theta"]), steps + 1)
    at = starts[:, None] + np.arange(steps + 1)
    good = (prepared.moving[at].mean(axis=1) > 0.2) & np.isfinite(run).all(axis=(1, 2))
    if good.sum() < 2:
        return None
    measured = signals["omega"][at], signals["theta"][at]
    notices = tuple(NOT_IN_FREE_RUN(effect=name, why=why) for name, why in mechanics.left_out.items())
    return FreeRun(
        prepared.t[at][good], run[good, :, 0], run[good, :, 1], measured[0][good], measured[1][good],
        steps / prepared.rate, notices,
    )  # fmt: skip


def whole_run(design: Design, prepared: Prepared, progress: Callable[[float], None] | None = None) -> WholeRun | None:
    """Run the design's mechanics from the measured torque over a whole record, from the measured state at its begin.

    Returns None where the model is unstable, or the record is too short for its filter.

    Parameters
    ----------
    design : Design
    prepared : Prepared
        Without gaps.
    progress : function, optional
        Called with the share done, 0 to 1.
    """
    first = round(EDGE * prepared.rate / prepared.cutoff)  # until then the filters of the state are not in
    length = len(prepared.t) - 2 * first
    if length < 2:
        return None
    mechanics, inputs = _driven(design, prepared)
    omega, theta = prepared.signals["omega"], prepared.signals["theta"]
    start = np.array([first])
    run = mechanics.run(inputs, start, (omega, theta), length, progress)[0]
    if not np.isfinite(run).all():
        return None
    part = slice(first, first + length)
    return WholeRun(prepared.t[part], run[:, 0], run[:, 1], omega[part], theta[part])


def over_parts(design: Design, prepared: Prepared, parts: Iterable[slice]) -> tuple[float, float] | None:
    """Return rms error of the position, rad (m), and fit of records that are each run from begin to end.

    Returns None where none of them can be.

    Parameters
    ----------
    design : Design
    prepared : Prepared
        Without gaps inside the records.
    parts : iterable of slice
        The samples of each.
    """
    square, spread, count = 0.0, 0.0, 0
    for part in parts:
        signals = {name: values[part] for name, values in prepared.signals.items()}
        run = whole_run(design, replace(prepared, t=prepared.t[part], signals=signals))
        if run is not None:
            square += len(run.t) * run.rms**2
            spread += len(run.t) * float(np.var(run.theta_meas))
            count += len(run.t)
    if count == 0:
        return None
    return math.sqrt(square / count), 1.0 - math.sqrt(square / spread) if spread > 0.0 else math.nan


def _driven(design: Design, prepared: Prepared) -> tuple[Mechanics, dict[str, Array]]:
    """Return the mechanics of a design, and what drives them."""
    inputs = {name: prepared.signals[name] for name in INPUTS if name in prepared.signals}
    fastest = float(np.max(np.abs(prepared.signals["omega"])))
    return Mechanics.of(design, 1.0 / prepared.rate, fastest, inputs), inputs

"""Step responses of the linear sampled cascade."""

from __future__ import annotations

import math
from dataclasses import dataclass

import control as ct
import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.tune.sampled import Cascade

__all__ = ["Step", "current_headroom", "linear_step", "linear_steps", "voltage_headroom"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Step:
    """A response to a step, as a share of the step (load: in rad/s per N m).

    Attributes
    ----------
    t : array, shape (n,)
        From the step on, s.
    y : array, shape (n,)
    overshoot : float
        % of the step; for a load step the largest deviation, rad/s per N m.
    settling : float
        Until it stays within 2 % (load: 5 % of the largest deviation), s; NaN when it does not within the record.
    """

    t: Array
    y: Array
    overshoot: float
    settling: float

    @classmethod
    def of(cls, t: Array, y: Array) -> Step:
        """Evaluate the response `y` to a unit step of a reference at `t` (s) with `control.step_info`."""
        if np.abs(y).max() < 0.95:  # control.step_info needs a response that has risen
            return cls(t, y, 0.0, math.nan)
        info = ct.step_info(y, T=t, yfinal=1.0, SettlingTimeThreshold=0.02)
        settled = abs(y[-1] - 1.0) <= 0.02
        return cls(t, y, float(info["Overshoot"]), float(info["SettlingTime"]) if settled else math.nan)

    @classmethod
    def of_load(cls, t: Array, y: Array) -> Step:
        """Evaluate the speed `y` (rad/s per N m) at `t` (s) after a load step."""
        outside = np.flatnonzero(np.abs(y) > 0.05 * np.abs(y).max())
        settling = float(t[outside[-1] + 1]) if outside[-1] + 1 < len(t) else math.nan
        return cls(t, y, float(np.abs(y).max()), settling)


def linear_step(cascade: Cascade, source: str, output: str, duration: float) -> tuple[Array, Array]:
    """Return time (s) and response of the cascade to a unit step of one of its inputs."""
    t: Array = cascade.period * np.arange(math.ceil(duration / cascade.period) + 1, dtype=np.float64)
    out = ct.forced_response(cascade.system((source,), (output,)), T=t, inputs=np.ones_like(t))
    return t, np.asarray(out.outputs, dtype=np.float64).reshape(-1)


def linear_steps(cascade: Cascade, durations: dict[str, float]) -> dict[str, Step]:
    """Return the predicted responses to the steps named in `durations` (s): current, speed, load, position.

    The current step includes the accelerating shaft and the late feedforward of its EMF, the speed step the
    reference filter; the position step has no feedforward.
    """
    inner, found = cascade.with_gains(position=None), {}
    for name, duration in durations.items():
        if name == "current":
            y = cascade.current_step(duration)
            found[name] = Step.of(np.arange(len(y)) / cascade.design.drive.f_control, y)
        elif name == "speed":
            found[name] = Step.of(*linear_step(inner, "omega_ref", "omega", duration))
        elif name == "load":
            found[name] = Step.of_load(*linear_step(inner, "T_load", "omega", duration))
        else:
            found[name] = Step.of(*linear_step(cascade, "theta_ref", "theta", duration))
    return found


def voltage_headroom(design: Design) -> float:
    """Return the control error (A) of the current that the voltage can follow.

    A control error needs K_p times its size at once, and beyond the voltage limit the loop is not linear. A quarter of
    the voltage is taken; the rest is for the speed.
    """
    return 0.25 * design.drive.u_dc / math.sqrt(3.0) / design.require_loops().current.K_p


def current_headroom(design: Design, i_0: float) -> float:
    """Return the current (A) available for tests around a bias i_0 (A).

    Half of the limit, and no more than the voltage can follow in a step of the reference.
    """
    by_voltage = voltage_headroom(design)
    by_current = 0.5 * (design.drive.i_max - abs(i_0)) if math.isfinite(design.drive.i_max) else math.inf
    return min(by_voltage, by_current)

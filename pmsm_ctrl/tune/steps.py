"""Step responses: promised by the linear sampled cascade, and run on the simulated drive."""

from __future__ import annotations

import math
from dataclasses import dataclass

import control as ct
import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.simulate import Scenario, simulate
from pmsm_ctrl.tune.sampled import Cascade

__all__ = ["Step", "linear_current", "linear_load", "linear_position", "linear_speed", "run_current", "run_steps"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Step:
    """A response to a step, in shares of the step (load: in rad/s per N m).

    Attributes
    ----------
    t : array in s from the step on
    y : array of the same shape
    overshoot : % of the step; for a load step the largest deviation
    settling : s until it stays within 2 %; NaN when it does not within the record
    """

    t: Array
    y: Array
    overshoot: float
    settling: float

    @classmethod
    def of(cls, t: Array, y: Array, final: float = 1.0) -> Step:
        """Measure a response with `control.step_info`."""
        if np.abs(y).max() < 0.95 * abs(final):  # control.step_info needs a response that has risen
            return cls(t, y, 0.0, math.nan)
        info = ct.step_info(y, T=t, yfinal=final, SettlingTimeThreshold=0.02)
        outside = np.flatnonzero(np.abs(y - final) > 0.02 * abs(final))
        settled = outside.size == 0 or outside[-1] < len(y) - 1
        return cls(t, y, float(info["Overshoot"]), float(info["SettlingTime"]) if settled else math.nan)


def _respond(system: object, duration: float, period: float) -> tuple[Array, Array]:
    t: Array = period * np.arange(math.ceil(duration / period) + 1, dtype=np.float64)
    out = ct.forced_response(system, T=t, inputs=np.ones_like(t))
    return t, np.asarray(out.outputs, dtype=np.float64).reshape(-1)


def linear_current(design: Design, cascade: Cascade, duration: float) -> Step:
    """Promised step of i_q at the rate of the current loop.

    The shaft accelerates meanwhile, and the feedforward of its EMF lags by the speed filter: that is in it.
    """
    y = cascade.current_step(duration)
    return Step.of(np.arange(len(y)) / design.drive.f_control, y)


def linear_speed(cascade: Cascade, duration: float) -> Step:
    """Promised step of the speed, reference filter included."""
    system = cascade.with_gains(position=None).system(("omega_ref",), ("omega",))
    return Step.of(*_respond(system, duration, cascade.period))


def linear_position(cascade: Cascade, duration: float) -> Step:
    """Promised step of the position, without feedforward (a step has none)."""
    return Step.of(*_respond(cascade.system(("theta_ref",), ("theta",)), duration, cascade.period))


def linear_load(cascade: Cascade, duration: float) -> Step:
    """Promised speed after a load step of 1 N m; `overshoot` is the largest dip in rad/s."""
    t, y = _respond(cascade.with_gains(position=None).system(("T_load",), ("omega",)), duration, cascade.period)
    return Step(t, y, float(np.abs(y).max()), _return_time(t, y))


def _return_time(t: Array, y: Array) -> float:
    """Time until a dip stays below 5 % of its largest value."""
    outside = np.flatnonzero(np.abs(y) > 0.05 * np.abs(y).max())
    return float(t[outside[-1] + 1]) if outside[-1] + 1 < len(t) else math.nan


def current_headroom(design: Design, i_0: float) -> float:
    """Current in A that is left for tests around a bias: half of the limit, and no more than the voltage can step.

    A step of the reference asks for K_p times it at once; beyond the voltage limit the loop is not linear.
    """
    assert design.loops is not None
    by_voltage = 0.25 * design.drive.u_dc / math.sqrt(3.0) / design.loops.current.K_p
    by_current = 0.5 * (design.drive.i_max - abs(i_0)) if math.isfinite(design.drive.i_max) else math.inf
    return min(by_voltage, by_current)


def run_current(
    design: Design, speed: float, i_0: float, step: float, duration: float, *, truth: Design | None = None,
    seed: int = 0,
) -> Step:  # fmt: skip
    """Step i_q by `step` A on the simulated drive that turns at `speed` with i_q = i_0, outer loops open."""
    wait = 400.0 / design.drive.f_control
    wait = math.ceil(wait / design.drive.speed_period) * design.drive.speed_period

    def inputs(t: Array) -> dict[str, Array]:
        return {"i_q_add": np.asarray(i_0 + step * (t >= wait - 1e-9), dtype=np.float64)}

    # Settling to 2 % cannot be read off a record with 1 % of noise; without it stands for the mean of many.
    logged = {"log_divider": 1, "current_noise": 0.0}
    log = simulate(
        design.replace(sensor=logged),
        Scenario("current step", wait + duration, inputs, control="current", omega_0=speed),
        truth=(truth or design).replace(sensor=logged), seed=seed,
    )  # fmt: skip
    after = log.between(wait - 1e-9, wait + duration)
    return Step.of(after.t - after.t[0], (after["i_q"] - i_0) / step)


def run_steps(
    design: Design, speed: float, sizes: dict[str, float], durations: dict[str, float], *,
    truth: Design | None = None, seed: int = 0,
) -> dict[str, Step]:  # fmt: skip
    """Run the steps named in `sizes` ("speed" rad/s, "position" rad, "load" N m) on the simulated drive.

    Each starts from constant `speed`, so that dry friction stays on one side, and is measured against the same
    run without the step.
    """
    out = {}
    T_s = design.drive.speed_period
    for name, size in sizes.items():
        wait = math.ceil(2.0 * max(durations.values()) / T_s) * T_s
        runs = [
            simulate(
                _logged(design), _step_scenario(name, speed, amount, wait, durations[name]),
                truth=_logged(truth or design),
                seed=seed, keep_truth=True,
            )
            for amount in (size, 0.0)
        ]  # fmt: skip
        channel = "theta_true" if name == "position" else "omega_true"
        stepped, still = (run.between(wait - 0.5 * T_s, wait + durations[name]) for run in runs)
        y = (stepped[channel] - still[channel]) / size
        t = stepped.t - wait
        out[name] = Step(t, y, float(np.abs(y).max()), _return_time(t, y)) if name == "load" else Step.of(t, y)
    return out


def _logged(design: Design) -> Design:
    return design.replace(sensor={"log_divider": design.drive.speed_divider})


def _step_scenario(name: str, speed: float, size: float, wait: float, duration: float) -> Scenario:
    def inputs(t: Array) -> dict[str, Array]:
        after = t >= wait - 1e-9
        out = {"omega_ref": np.full_like(t, speed), "theta_ref": speed * t}
        if name == "load":
            out["T_load"] = np.asarray(size * after, dtype=np.float64)
        else:
            key = "theta_ref" if name == "position" else "omega_ref"
            out[key] = out[key] + size * after
        return out

    control = "position" if name == "position" else "speed"
    return Scenario(f"{name} step", wait + duration, inputs, control=control, omega_0=speed)  # type: ignore[arg-type]


def ripple(design: Design, speed: float, *, truth: Design | None = None) -> float:
    """Return the rms of the current reference about its mean at constant speed on the simulated drive, A."""
    T_s = design.drive.speed_period
    n = 8192

    def inputs(t: Array) -> dict[str, Array]:
        return {"omega_ref": np.full_like(t, speed)}

    log = simulate(
        _logged(design), Scenario("constant speed", 2.0 * n * T_s, inputs, omega_0=speed),
        truth=_logged(truth or design),
    )  # fmt: skip
    return float(np.std(log["i_q_ref"][-n:]))

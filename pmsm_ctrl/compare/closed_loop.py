"""The design's own drive, simulated in closed loop with the reference that the log holds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import PmsmCtrlError
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.conditioning import Processing, prepare
from pmsm_ctrl.regression.timing import uniform

__all__ = ["ClosedLoop", "closed_loop"]

Array = NDArray[np.float64]

# What the speed controller does not account for in the logged current reference, as a share of it: more is a test
# signal or a feedforward of the drive, and has to be fed in.
INJECTED = 0.05
LONGEST = 120.0  # s; a longer log is simulated only so far


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """Measured and simulated signals through the same processing, on the log's thinned grid, shape (m,) each.

    `fed` says that the logged current reference holds more than the design's speed controller answers (a test signal,
    a feedforward, or other gains), and that this was fed in as logged.
    """

    t: Array
    measured: Mapping[str, Array]
    simulated: Mapping[str, Array]
    mask: NDArray[np.bool_]
    control: str
    fed: bool = False
    notes: tuple[str, ...] = ()


def closed_loop(design: Design, log: Log, processing: Processing | None = None) -> ClosedLoop | None:
    """Simulate the drive with the log's reference, from the log's first state; sensors without noise.

    Returns None where the log has no reference, or the design no loops or no electrical data.
    """
    if design.loops is None or not design.motor.electrical or "omega_ref" not in log:
        return None
    if log.duration > LONGEST:
        log = log.between(float(log.t[0]), float(log.t[0]) + LONGEST)
    from pmsm_ctrl.simulate import Scenario, simulate

    t, channels, _, _ = uniform(log)
    position = "theta_ref" in channels and design.loops.position.K_v > 0.0
    inputs = _references(design, channels, t, position)
    added, fed = _injected(design, channels, t, position, inputs.get("alpha_ref"))
    if added is not None:
        inputs["i_q_add"] = added
    theta = np.unwrap(channels["theta"]) if "theta" in channels else None
    start = float(channels["omega"][0]) if "omega" in channels else 0.0

    def references(at: Array) -> dict[str, Array]:
        return {name: np.interp(at, t - t[0], values) for name, values in inputs.items()}

    motion = Scenario(
        "the log's reference", float(t[-1] - t[0]), references, "position" if position else "speed", start,
        0.0 if theta is None else float(theta[0]),
    )  # fmt: skip
    ideal = design.replace(sensor={"current_noise": 0.0, "encoder_counts": 0})
    try:
        table = simulate(ideal, motion)
    except PmsmCtrlError as error:
        return ClosedLoop(t[:0], {}, {}, np.zeros(0, dtype=bool), motion.control, fed, (f"closed loop: {error}",))
    kept = [n for n in ("theta", "omega", "i_d", "i_q") if n in channels]
    at = t - t[0]
    again = {n: np.interp(at, table.t, table[n]) for n in ("theta", "omega", "i_d", "i_q")}
    measured = prepare(design, Log({"t": t} | {n: channels[n] for n in kept}), processing)
    simulated = prepare(design, Log({"t": t} | {n: again[n] for n in kept}), processing)
    names = [n for n in ("omega", "theta", "i_q") if n in measured.signals]
    return ClosedLoop(
        measured.t[measured.keep],
        {n: measured.column(measured.signals[n]) for n in names},
        {n: simulated.column(simulated.signals[n]) for n in names},
        measured.mask,
        motion.control,
        fed,
    )


def _references(design: Design, channels: Mapping[str, Array], t: Array, position: bool) -> dict[str, Array]:
    names = ("omega_ref", "i_d_ref", "T_load", *(("theta_ref", "alpha_ref") if position else ()))
    inputs = {name: channels[name] for name in names if name in channels}
    if position and "alpha_ref" not in inputs:
        inputs["alpha_ref"] = np.gradient(channels["omega_ref"], t)
    return inputs


def _injected(
    design: Design, channels: Mapping[str, Array], t: Array, position: bool, alpha_ref: Array | None
) -> tuple[Array | None, bool]:
    """What the logged current reference holds beyond the speed controller's answer to the logged speed."""
    if "i_q_ref" not in channels or "omega" not in channels or design.loops is None:
        return None, False
    loops, wanted = design.loops, channels["i_q_ref"]
    if position and "theta" not in channels:
        return None, False
    if np.mean(np.abs(wanted) >= 0.99 * design.drive.i_max) > 0.001 or loops.speed.reference_filter > 0.0:
        return None, False
    error = channels["omega_ref"] - channels["omega"]
    known = np.zeros(len(t))
    if position:
        place = loops.position
        error = place.velocity_feedforward * channels["omega_ref"] - channels["omega"]
        error = error + place.K_v * (channels["theta_ref"] - channels["theta"])
        assumed = design.assumed.J or design.J
        known = place.acceleration_feedforward * assumed / design.K_t_assumed * np.asarray(alpha_ref)
    steps = 0.5 * (error[1:] + error[:-1]) * np.diff(t)
    integral = np.concatenate([[0.0], np.cumsum(steps)]) / loops.speed.T_n
    left = wanted - known - loops.speed.K_p * (error + integral)
    left = left - np.median(left)
    share = _beyond_integral(left, t, 2.0 * loops.speed.T_n) / max(float(np.sqrt(np.mean(wanted**2))), 1e-300)
    if share <= INJECTED:
        return None, False
    return left, True


def _beyond_integral(left: Array, t: Array, tau: float) -> float:
    """Size of what the integral does not take away within `tau` s: a high-pass, and the 90 % quantile of what passes.

    A step of the reference between two samples leaves a wrong integral behind, which is no test signal.
    """
    from scipy.signal import lfilter

    a = float(np.exp(-np.median(np.diff(t)) / tau))
    fast = lfilter([1.0, -1.0], [1.0, -a], left)
    return float(np.quantile(np.abs(fast), 0.9))

"""A log's own experiment, repeated on a simulated drive: the same references, the same sampled controller, no noise.

What the log does not hold is rebuilt where it can be: a test signal, or a feedforward, added to the speed
controller's output is the logged current reference less what the speed controller answers to the logged speed.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design, EffectEntry
from pmsm_ctrl.errors import DesignError, LogError
from pmsm_ctrl.identify.notices import CURRENT_LIMIT, REPLAYED_CURRENT
from pmsm_ctrl.identify.policy import ADDED_CURRENT
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.inverse_dynamics import Column
from pmsm_ctrl.regression.timing import uniform, unwrapped
from pmsm_ctrl.section import Notice
from pmsm_ctrl.simulate.motions import Scenario
from pmsm_ctrl.simulate.parameters import Controller
from pmsm_ctrl.simulate.run import simulate

__all__ = ["Replay", "build_replay", "plant_with", "replayable"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Replay:
    """The experiment of one log, ready to be run on any plant.

    Attributes
    ----------
    controller : Design
        Its loops run in the simulated drive.
    scenario : Scenario
        The references of the log at any time.
    t, channels : array and dict of arrays, shape (n,)
        The log on a uniform time base, s from its begin.
    divider : int
        Control periods per sample.
    notes : tuple of Notice
        On a current beside the speed controller's output.
    """

    controller: Design
    scenario: Scenario
    t: Array
    channels: Mapping[str, Array]
    divider: int
    notes: tuple[Notice, ...] = ()

    @property
    def adds_current(self) -> bool:
        """Whether a current beside the speed controller's output is replayed."""
        return any(note.code == REPLAYED_CURRENT.code for note in self.notes)

    def run(self, plant: Design) -> Log:
        """Return the log that a plant without sensor noise gives, on the time grid of the original."""
        ideal = plant.replace(sensor={"encoder_counts": 0, "current_noise": 0.0, "log_divider": self.divider})
        log = simulate(self.controller, self.scenario, truth=ideal)
        if len(log) == len(self.t) and abs(log.t[-1] - self.t[-1]) < 0.01 * log.period:
            return log
        from scipy.interpolate import CubicSpline

        grid = np.minimum(self.t, log.t[-1])
        channels = {name: CubicSpline(log.t, values)(grid) for name, values in log.channels.items() if name != "t"}
        return Log({"t": self.t, **channels}, log.motion)


def replayable(design: Design, log: Log) -> bool:
    """Return whether log and design hold what a simulation of the drive with its controller needs.

    Parameters
    ----------
    design : Design
    log : Log
    """
    if design.loops is None or not design.motor.electrical or log.records:
        return False
    return "omega_ref" in log or ("theta_ref" in log and design.loops.position.K_v > 0.0)


def build_replay(design: Design, log: Log) -> Replay:
    """Read the experiment from a log: ``theta_ref`` (position control) or ``omega_ref`` (speed control).

    Raises
    ------
    LogError
        When the log holds no reference, or too little to be evaluated.
    DesignError
        When the design knows no loops or no electrical data: the drive cannot be simulated.
    """
    where = f"{log.provenance.file}: " if log.provenance.file else ""
    log.check_evaluable(100)
    t, raw, _, _ = uniform(log)
    t = t - t[0]
    rate = (len(t) - 1) / float(t[-1])
    position = "theta_ref" in raw and design.loops is not None and design.loops.position.K_v > 0.0
    if not position and "omega_ref" not in raw:
        raise LogError(
            f"{where}no omega_ref and no theta_ref: the experiment cannot be repeated on the model; "
            "a log with its references is needed, or method = 'regression'"
        )
    if not design.motor.electrical or design.loops is None:
        raise DesignError(
            f"{design.source or design.name}: the drive is simulated from loops and from p, psi_f, R, L_d and L_q; "
            "add them, or use method = 'regression'"
        )
    controller = Controller.of(design, "position" if position else "speed")
    names: list[str] = ["omega_ref", "T_load", "i_d_ref", *(["theta_ref"] if position else [])]
    inputs = {name: raw[name] for name in names if name in raw}
    added, notes = _added(design, controller, raw, t)
    if added is None:
        if position and "omega_ref" in raw:
            inputs["alpha_ref"] = raw["alpha_ref"] if "alpha_ref" in raw else np.gradient(raw["omega_ref"], t[1])
    else:
        # The addition holds the feedforward as it was: it must not be fed forward twice.
        design = design.replace(compensation={"gain": 0.0})
        if np.any(added != 0.0):
            inputs["i_q_add"] = added
    return Replay(
        controller=design,
        scenario=_scenario(inputs, raw, t, rate, position),
        t=t,
        channels=raw,
        divider=max(1, round(design.drive.f_control / rate)),
        notes=notes,
    )


def _scenario(inputs: Mapping[str, Array], raw: Mapping[str, Array], t: Array, rate: float, position: bool) -> Scenario:
    smooth = {name: _knots(t, values) for name, values in inputs.items() if name != "i_q_add"}
    added = inputs.get("i_q_add")
    spline = None
    if added is not None:
        from scipy.interpolate import CubicSpline

        spline = CubicSpline(t, added)

    made: dict[tuple[int, float, float], Mapping[str, Array]] = {}

    def references(at: Array) -> Mapping[str, Array]:
        # Every run of a fit asks for the same times.
        asked = len(at), float(at[0]), float(at[-1])
        if asked not in made:
            made[asked] = evaluated(at)
        return made[asked]

    def evaluated(at: Array) -> Mapping[str, Array]:
        out = {name: np.interp(at, *knots) for name, knots in smooth.items()}
        if spline is not None:
            out["i_q_add"] = spline(np.minimum(at, t[-1]))
        return out

    theta = unwrapped(raw["theta"]) if "theta" in raw else np.zeros(1)
    return Scenario(
        "replay",
        len(t) / rate,
        references,
        control="position" if position else "speed",
        omega_0=_starting_speed(raw, t),
        theta_0=float(theta[0]),
    )


def _starting_speed(raw: Mapping[str, Array], t: Array) -> float:
    """Return the speed at which the log begins, and with it the filter of the reference; 0 for an axis at rest."""
    omega = raw["omega"] if "omega" in raw else np.gradient(unwrapped(raw["theta"]), t)
    start = float(omega[0])
    return start if abs(start) > 0.01 * float(np.quantile(np.abs(omega), 0.99)) else 0.0


def _knots(t: Array, values: Array) -> tuple[Array, Array]:
    """Return times and values between which the reference runs straight; jumps and corners stay what they are.

    A reference that jumps is new at the sample that shows it first: a knot just before holds the old value. A corner
    between two samples lies where the straight pieces on either side meet.
    """
    step = np.diff(values)
    size = np.abs(step)
    around = np.maximum(np.concatenate([[0.0], size[:-1]]), np.concatenate([size[1:], [0.0]]))
    jumps = np.flatnonzero(size > np.maximum(5.0 * around, 1e-9 * (float(np.ptp(values)) or 1.0)))
    corners, at = _corners(step)
    times = np.concatenate([t, t[jumps + 1] - 1e-6 * t[1], t[corners] + at * (t[1] - t[0])])
    order = np.argsort(times, kind="stable")
    held = np.concatenate([values, values[jumps], values[corners] + at * step[corners - 1]])
    return times[order], held[order]


def _corners(step: Array) -> tuple[NDArray[np.intp], Array]:
    """Return the steps inside which two straight pieces meet, and where in them, as a share of the step."""
    if len(step) < 5:
        return np.zeros(0, dtype=np.intp), np.zeros(0)
    k = np.arange(2, len(step) - 2)
    same = 1e-6 * float(np.max(np.abs(step))) + 1e-300
    before, after = step[k - 1], step[k + 1]
    straight = (np.abs(before - step[k - 2]) < same) & (np.abs(after - step[k + 2]) < same)
    bent = (np.abs(step[k] - before) > same) & (np.abs(step[k] - after) > same) & (np.abs(before - after) > same)
    k = k[straight & bent]
    at = (step[k] - step[k + 1]) / (step[k - 1] - step[k + 1])
    inside = (at > 0.0) & (at < 1.0)
    return k[inside], at[inside]


def _added(
    design: Design, controller: Controller, raw: Mapping[str, Array], t: Array
) -> tuple[Array | None, tuple[Notice, ...]]:
    """Return what was added to the speed controller's output, A, shape (n,); None where the log does not tell.

    Between two samples the controller's integrator grows by its gain times the sum of its errors. The sum of the
    filtered speed over those ticks follows from the angle turned and from the filter's own equation, exactly.
    """
    if not {"theta", "omega", "omega_ref", "i_q_ref"} <= raw.keys() or controller.speed_gain == 0.0:
        return None, ()
    limited = np.abs(raw["i_q_ref"]) > 0.999 * controller.i_max
    if limited.any():
        return None, (CURRENT_LIMIT(),)
    T_s = design.drive.speed_period
    kept = _ticks(raw["i_q_ref"], max(1, round(T_s / t[1])))
    when, theta, omega = t[kept], unwrapped(raw["theta"])[kept], raw["omega"][kept]
    ticks = when[0] + np.arange(round((when[-1] - when[0]) / T_s) + 1) * T_s
    reference = np.interp(ticks, *_knots(t, raw["omega_ref"]))
    wanted = controller.velocity_feedforward * reference
    if controller.reference_filter < 1.0:
        from scipy.signal import lfilter

        a, first = controller.reference_filter, _starting_speed(raw, t)
        wanted = first + lfilter([a], [1.0, a - 1.0], wanted - first)
    if controller.position_gain > 0.0:
        wanted = wanted + controller.position_gain * np.interp(ticks, *_knots(t, raw["theta_ref"]))
        wanted -= controller.position_gain * np.interp(ticks, when, theta)
    sums = np.concatenate([[0.0], np.cumsum(wanted)])  # of all ticks before this one
    at = np.round((when - when[0]) / T_s).astype(np.intp)
    turned = (theta - theta[0]) / T_s - (omega - omega[0]) / controller.speed_filter
    gain = controller.speed_gain
    integral = controller.speed_integral * gain * (sums[at] - turned)
    added = raw["i_q_ref"][kept] - gain * (wanted[at] - omega) - integral
    size, rms = (float(np.sqrt(np.mean(values**2))) for values in (raw["i_q_ref"], added))
    if rms < ADDED_CURRENT * size:
        return np.zeros_like(t), ()
    return added if len(kept) == len(t) else np.interp(t, when, added), (REPLAYED_CURRENT(rms=rms),)


def _ticks(i_q_ref: Array, every: int) -> NDArray[np.intp]:
    """Return the samples at which the speed controller ran, of a log that is sampled faster than that."""
    steps = np.abs(np.diff(i_q_ref, prepend=i_q_ref[0]))
    phase = max(range(every), key=lambda first: float(np.sum(steps[first::every])))
    return np.arange(phase, len(i_q_ref), every)


def plant_with(design: Design, columns: Iterable[Column], values: Iterable[float]) -> Design:
    """Return the plant with these parameter values, moved inside their bounds.

    What a fit finds is inside already. A step of a difference quotient may leave them, where there is no plant.

    Its torque constant is the one that the evaluation assumes, so that torque means the same on both sides.
    """
    changed: dict[int, dict[str, float]] = {}
    inertia = design.J
    for column, value in zip(columns, values, strict=True):
        inside = column.clipped(value)
        if column.entry >= 0:
            changed.setdefault(column.entry, {})[column.symbol] = inside
        elif column.is_inertia and inside > design.load.J / design.load.gear**2:
            inertia = inside
    effects = tuple(
        EffectEntry(id=entry.id, parameters={**entry.parameters, **changed.get(k, {})})
        for k, entry in enumerate(design.effects)
    )
    return design.replace_effects(effects).with_parameters(J=inertia, K_t=design.K_t_assumed)

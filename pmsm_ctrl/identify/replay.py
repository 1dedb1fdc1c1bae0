"""A log's own experiment, repeated on a simulated drive: the same references, the same sampled controller, no noise.

What the log does not hold is rebuilt where it can be: a test signal, or a feedforward, added to the speed
controller's output is the logged current reference less what the speed controller answers to the logged speed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design, EffectEntry
from pmsm_ctrl.errors import DesignError, LogError
from pmsm_ctrl.identify.notices import CURRENT_LIMIT, REPLAYED_CURRENT
from pmsm_ctrl.identify.policy import ADDED_CURRENT
from pmsm_ctrl.identify.references import held, running
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.inverse_dynamics import Column
from pmsm_ctrl.regression.timing import uniform, unwrapped
from pmsm_ctrl.section import Notice
from pmsm_ctrl.simulate.motions import Scenario
from pmsm_ctrl.simulate.parameters import Controller
from pmsm_ctrl.simulate.run import simulate

__all__ = ["Replay", "build_replay", "plant_with", "replayable"]

Array = NDArray[np.float64]
Between = Callable[[Array, Array, Array], Array]
Sampled = Literal["on ticks", "interpolated", "held"]

REFERENCES = ("omega_ref", "theta_ref", "alpha_ref")  # channels that the controller's source may hold
HELD = 0.9  # of the current that a running reference leaves, at most what a held one must leave


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
        Control periods per sample of the simulated log.
    sampled : {"on ticks", "interpolated", "held"}
        How the recorder sampled the drive. At a rate that does not divide the speed controller's, it interpolates
        between two ticks or holds the values of the last one.
    notes : tuple of Notice
        On a current beside the speed controller's output.
    """

    controller: Design
    scenario: Scenario
    t: Array
    channels: Mapping[str, Array]
    divider: int
    sampled: Sampled = "on ticks"
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
        grid = np.minimum(self.t, log.t[-1])
        channels = {name: values for name, values in log.channels.items() if name != "t"}
        if self.sampled == "held":
            channels = {name: held(grid, log.t, values) for name, values in channels.items()}
        elif self.sampled == "interpolated":
            channels = {name: np.interp(grid, log.t, values) for name, values in channels.items()}
        else:
            from scipy.interpolate import CubicSpline

            channels = {name: CubicSpline(log.t, values)(grid) for name, values in channels.items()}
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
    reading = _read(design, controller, raw, t)
    added = reading.added
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
        scenario=_scenario(inputs, raw, (t, _made(design, t, reading.sampled)), rate, position, reading.between),
        t=t,
        channels=raw,
        divider=_divider(design, rate, reading.sampled),
        sampled=reading.sampled,
        notes=reading.notes,
    )


def _divider(design: Design, rate: float, sampled: Sampled) -> int:
    """Return the control periods between two samples of the simulated log."""
    if sampled == "on ticks":
        return max(1, round(design.drive.f_control / rate))
    return 1 if sampled == "held" else design.drive.speed_divider


def _scenario(
    inputs: Mapping[str, Array], raw: Mapping[str, Array], times: tuple[Array, Array], rate: float, position: bool,
    between: Between,
) -> Scenario:  # fmt: skip
    t, made = times
    added = inputs.get("i_q_add")
    spline = None
    if added is not None:
        from scipy.interpolate import CubicSpline

        spline = CubicSpline(t, added)

    known: dict[tuple[int, float, float], Mapping[str, Array]] = {}

    def references(at: Array) -> Mapping[str, Array]:
        # Every run of a fit asks for the same times.
        asked = len(at), float(at[0]), float(at[-1])
        if asked not in known:
            known[asked] = evaluated(at)
        return known[asked]

    def evaluated(at: Array) -> Mapping[str, Array]:
        ways = {name: between if name in REFERENCES else running for name in inputs if name != "i_q_add"}
        out = {name: way(at, made if name in REFERENCES else t, inputs[name]) for name, way in ways.items()}
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


@dataclass(frozen=True, eq=False)
class _Reading:
    """How a log is read.

    Attributes
    ----------
    between : callable
        The reference between two samples, `running` or `held`.
    sampled : {"on ticks", "interpolated", "held"}
        As of `Replay`.
    added : array, shape (n,), or None
        What was added to the speed controller's output, A; None where the log does not tell.
    notes : tuple of Notice
    """

    between: Between
    sampled: Sampled
    added: Array | None = None
    notes: tuple[Notice, ...] = ()


def _read(design: Design, controller: Controller, raw: Mapping[str, Array], t: Array) -> _Reading:
    """Return how the log was sampled, and what was added to the speed controller's output.

    A wrong reading of the samples adds a current that was not there: of all readings that leave the least is taken.
    """
    T_s = design.drive.speed_period
    aligned = _whole((t - t[0]) / T_s) or _whole((t - t[0]) * design.drive.f_control)
    default = _Reading(running, "on ticks" if aligned else "interpolated")
    if not {"theta", "omega", "omega_ref", "i_q_ref"} <= raw.keys() or controller.speed_gain == 0.0:
        return default
    if (np.abs(raw["i_q_ref"]) > 0.999 * controller.i_max).any():
        return replace(default, notes=(CURRENT_LIMIT(),))
    kept = _ticks(raw["i_q_ref"], max(1, round(T_s / t[1])))
    ways: tuple[Sampled, ...] = ("on ticks",) if aligned else ("interpolated", "held")
    between: Between
    found: list[tuple[float, Between, Sampled, Array]] = []
    for between in (running, held):
        for sampled in ways:
            left = _added(design, controller, raw, t, kept, between, sampled)
            power = float(np.mean(left**2)) * (1.0 if between is running else 1.0 / HELD**2)
            found.append((power, between, sampled, left))
    _, between, sampled, left = min(found, key=lambda way: way[0])
    size, rms = (float(np.sqrt(np.mean(values**2))) for values in (raw["i_q_ref"], left))
    if rms < ADDED_CURRENT * size:
        return _Reading(between, sampled, np.zeros_like(t))
    whole = left if len(kept) == len(t) else np.interp(t, t[kept], left)
    return _Reading(between, sampled, whole, (REPLAYED_CURRENT(rms=rms),))


def _added(
    design: Design, controller: Controller, raw: Mapping[str, Array], t: Array, kept: NDArray[np.intp],
    between: Between, sampled: Sampled,
) -> Array:  # fmt: skip
    """Return what was added to the speed controller's output at the kept samples, A.

    Between two samples the controller's integrator grows by its gain times the sum of its errors.
    """
    when, theta, omega, T_s = t[kept], unwrapped(raw["theta"])[kept], raw["omega"][kept], design.drive.speed_period
    ticks = when[0] + np.arange(round((when[-1] - when[0]) / T_s) + 1) * T_s
    made = _made(design, t, sampled)
    wanted = controller.velocity_feedforward * between(ticks, made, raw["omega_ref"])
    if controller.reference_filter < 1.0:
        from scipy.signal import lfilter

        a, first = controller.reference_filter, _starting_speed(raw, t)
        wanted = first + lfilter([a], [1.0, a - 1.0], wanted - first)
    if controller.position_gain > 0.0:
        wanted = wanted + controller.position_gain * between(ticks, made, raw["theta_ref"])
        from scipy.interpolate import CubicSpline

        # a straight line between two angles misses the curve that the reference follows
        wanted -= controller.position_gain * CubicSpline(when, theta)(ticks)
    elapsed = (when - when[0]) / T_s
    at = {"on ticks": np.round(elapsed), "interpolated": elapsed, "held": np.floor(elapsed + 1e-6)}[sampled]
    n = np.arange(len(wanted) + 1)
    if sampled == "held":
        # the angle is that of the last control period, speed and current reference are older
        T = 1.0 / design.drive.f_control
        theta = theta - omega * (np.floor((when - when[0]) / T + 1e-6) * T - at * T_s)
    sums = np.interp(at, n, np.concatenate([[0.0], np.cumsum(wanted)]))  # of all ticks before the sample's
    asked = controller.speed_gain * (np.interp(at, n[:-1], wanted) + controller.speed_integral * sums)
    left: Array = raw["i_q_ref"][kept] - asked + controller.speed_answer(theta, omega, T_s)
    return left


def _made(design: Design, t: Array, sampled: Sampled) -> Array:
    """Return when the controller made the references that the log shows at `t`."""
    T_s = design.drive.speed_period
    return np.floor(t / T_s + 1e-6) * T_s if sampled == "held" else t


def _whole(ticks: Array) -> bool:
    """Return whether samples at these multiples of the speed controller's period fall on its ticks."""
    return float(np.max(np.abs(ticks - np.round(ticks)))) < 0.05


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
        elif column.is_inertia and inside > design.load.kept(design.motor.J):
            inertia = inside
    effects = tuple(
        EffectEntry(id=entry.id, parameters={**entry.parameters, **changed.get(k, {})})
        for k, entry in enumerate(design.effects)
    )
    return design.replace_effects(effects).with_parameters(J=inertia, K_t=design.K_t_assumed)

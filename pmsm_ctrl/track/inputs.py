"""From channels to what the filters read: drive torque, and the torque of effects that are taken as known."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects.base import Effect
from pmsm_ctrl.effects.catalogue import bound_effects
from pmsm_ctrl.effects.evaluate import column
from pmsm_ctrl.errors import LogError, NextCommand, RequestError
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.measurement_correction import undone
from pmsm_ctrl.regression.signals import drive_torque
from pmsm_ctrl.section import Notice
from pmsm_ctrl.track.notices import EFFECT_LEFT_OUT, MEASUREMENT_EFFECT_IN_STREAM
from pmsm_ctrl.track.settings import Settings

__all__ = ["AsMeasured", "KnownTorque", "Samples", "located", "noise_from_samples", "samples_of", "scatter"]

Array = NDArray[np.float64]
OF_A_COUNT, COUNTED = 0.1, 0.8  # a step is a multiple of the least one to this; a fifth of any steps are, by chance
AVAILABLE = ("omega", "theta", "direction", "i_d", "i_q", "torque", "t", "p")


@dataclass(frozen=True, eq=False)
class Samples:
    """The filter's inputs over a log.

    Attributes
    ----------
    t : array, shape (n,)
        Time, s.
    z : array, shape (n,)
        Measured angle, rad, or speed, rad/s.
    torque : array, shape (n,)
        Drive torque less the known load, N m.
    known : array, shape (n,)
        Torque of the design's further effects, N m.
    notices : tuple of Notice
        Effects that are left out.
    """

    t: Array
    z: Array
    torque: Array
    known: Array
    notices: tuple[Notice, ...] = ()


class KnownTorque:
    """Torque of every effect of a design beside the tracked Coulomb and viscous friction.

    Attributes
    ----------
    notices : tuple of Notice
        Effects that cannot be evaluated sample by sample, and are left out.
    """

    def __init__(self, design: Design) -> None:
        self._effects: list[tuple[Effect, dict[str, float]]] = []
        self._p = float(design.motor.p or 0)
        notices = []
        tracked = {"coulomb", "viscous"}
        for effect, values in bound_effects(design):
            if effect.enters != "torque" or not effect.active(values):
                continue
            if effect.id in tracked:
                tracked.remove(effect.id)
                continue
            missing = [name for name in effect.signals if name not in AVAILABLE]
            if effect.has_state or missing:
                notices.append(EFFECT_LEFT_OUT(effect=effect.id))
                continue
            self._effects.append((effect, values))
        self.notices = tuple(notices)

    @property
    def effects(self) -> tuple[tuple[Effect, dict[str, float]], ...]:
        """The effects whose torque is known, with their parameter values."""
        return tuple(self._effects)

    def __bool__(self) -> bool:
        return bool(self._effects)

    def over(self, signals: Mapping[str, Array]) -> Array:
        """Return the torque over a log, shape (n,)."""
        total = np.zeros(len(signals["t"]))
        for effect, values in self._effects:
            total += column(effect, {**signals, "p": self._p}, values)
        return total

    def at(self, signals: Mapping[str, float]) -> float:
        """Return the torque at one sample."""
        total = 0.0
        for effect, values in self._effects:
            given = {**signals, "p": self._p, **values}
            total += effect.term(*(float(given[name]) for name in effect.arguments))
        return total


class AsMeasured:
    """The measurement effects of a design, taken off one sample at a time.

    Attributes
    ----------
    notices : tuple of Notice
        Effects that no single sample can be corrected for, and are left in: a delay, and the error of an angle where
        the speed is what is measured.
    """

    def __init__(self, design: Design, measure: str) -> None:
        self._stated, notices = design, []
        self._corrects = False
        for effect, values in bound_effects(design):
            if effect.enters != "measurement" or not effect.active(values):
                continue
            if effect.structure.delays or (measure == "omega" and "theta" in effect.channels):
                notices.append(MEASUREMENT_EFFECT_IN_STREAM(effect=effect.id))
                self._stated = self._stated.without_effect(effect.id)
            else:
                self._corrects = True
        self.notices: tuple[Notice, ...] = tuple(notices)

    def __bool__(self) -> bool:
        return self._corrects

    def corrected(self, t: float, channels: Mapping[str, float]) -> dict[str, float]:
        """Return the channels of a sample without the effects; those that are not finite as they are.

        Parameters
        ----------
        t : float
            Time, s.
        channels : mapping of str to float
            Measured; a channel that no sample has is left out.
        """
        present = {name: np.array([value]) for name, value in channels.items() if math.isfinite(value)}
        without, left_in = undone(self._stated, np.array([t]), present)
        self.notices = tuple(dict.fromkeys((*self.notices, *left_in)))
        return {**channels, **{name: float(values[0]) for name, values in without.items()}}


def samples_of(design: Design, log: Log, measure: str) -> Samples:
    """Return the filter's inputs from a log.

    Parameters
    ----------
    design : Design
        The torque constant and the further effects.
    log : Log
        With the measured channel, and ``torque`` or ``i_q``.
    measure : {"theta", "omega"}
        The measured channel.

    Returns
    -------
    Samples
        Arrays of the log's length.

    Raises
    ------
    LogError
        When a channel is missing.
    """
    if measure not in log:
        message = f"{located(log)}no channel '{measure}' to track from (present: {', '.join(log)})"
        raise LogError(message, next_command=NextCommand.MAP)
    if "torque" not in log and "i_q" not in log:
        message = f"{located(log)}neither torque nor i_q (present: {', '.join(log)})"
        raise LogError(message, next_command=NextCommand.IMPORT)
    z = _unwrap(log["theta"]) if measure == "theta" else np.array(log["omega"])
    zero = np.zeros(len(log))
    i_d, i_q = (log.channels.get(name, zero) for name in ("i_d", "i_q"))
    drive = np.asarray(log["torque"] if "torque" in log else drive_torque(design, i_d, i_q), dtype=np.float64)
    known, torque = KnownTorque(design), drive
    if "T_load" in log:
        torque = drive - log["T_load"]
    extra = zero
    if known:
        speed = _speed(log.t, z, drive) if measure == "theta" else z
        theta = z if measure == "theta" else log.channels.get("theta")
        signals = {"t": log.t, "omega": speed, "direction": np.sign(speed), "i_d": i_d, "i_q": i_q, "torque": drive}
        extra = known.over(signals if theta is None else {**signals, "theta": theta})
    return Samples(np.array(log.t), z, np.array(torque), np.array(extra), known.notices)


def _speed(t: Array, theta: Array, drive: Array) -> Array:
    """Speed from each angle and the last used one before it, as on a live stream."""
    speed = np.zeros(t.size)
    later = np.append(True, t[1:] > np.maximum.accumulate(t)[:-1])
    taken = np.flatnonzero(np.isfinite(theta) & np.isfinite(drive) & later)
    speed[taken[1:]] = np.diff(theta[taken]) / np.diff(t[taken])
    return speed


def located(log: Log) -> str:
    """Return the log's file as the head of a message; empty where it has none."""
    return f"{log.provenance.file}: " if log.provenance.file else ""


def _unwrap(theta: Array) -> Array:
    """Undo a wrap at one turn: jumps of nearly 2 pi within a range of one turn, and nothing else."""
    if np.ptp(theta) <= 2 * np.pi * (1 + 1e-6) and float(np.max(np.abs(np.diff(theta)))) > 1.5 * np.pi:
        return np.unwrap(theta)
    return np.array(theta)


def scatter(samples: Samples) -> float:
    """Return by how much the torque scatters from sample to sample, N m rms.

    The second difference of a smooth signal is noise; the median passes over steps.

    Parameters
    ----------
    samples : Samples
    """
    return 1.4826 * float(np.median(np.abs(np.diff(samples.torque, 2)))) / math.sqrt(6.0)


def _angle_noise(theta: Array) -> float:
    """Return the noise of an angle: that of its finest step, unless that is no encoder's and the angle scatters less.

    An axis that only turns fast shows no single step of its encoder: its steps are no multiples of the least one. The
    third difference of a smooth angle is noise.
    """
    step = np.abs(np.diff(theta))
    step = step[step > 1e-12 * max(1.0, float(np.max(np.abs(theta))))]
    finest = float(step.min()) if step.size else 1e-6
    counted = step / finest
    if len(theta) < 4 or np.mean(np.abs(counted - np.round(counted)) < OF_A_COUNT) > COUNTED:
        return max(finest / math.sqrt(12.0), 1e-9)
    scattered = 1.4826 * float(np.median(np.abs(np.diff(theta, 3)))) / math.sqrt(20.0)
    return max(min(finest / math.sqrt(12.0), scattered or math.inf), 1e-9)


def noise_from_samples(design: Design, settings: Settings, samples: Samples, where: str = "") -> Settings:
    """Fill in the noise that neither the settings nor the design state, from the samples themselves.

    Parameters
    ----------
    design : Design
        Its sensor's noise and encoder counts; zero where they are not known.
    settings : Settings
        Noise given here is kept.
    samples : Samples
        What the noise is estimated from.
    where : str
        Head of the message.

    Returns
    -------
    Settings
        With torque and angle noise.

    Raises
    ------
    RequestError
        When the drive torque is zero throughout.
    """
    if settings.torque_noise is None and design.sensor.current_noise == 0.0:
        noise = scatter(samples)
        floor = 1e-4 * float(np.quantile(np.abs(samples.torque), 0.95))
        if not max(noise, floor) > 0.0:
            raise RequestError(f"{where}the drive torque is zero throughout; tracking needs a driven motion")
        settings = replace(settings, torque_noise=max(noise, floor))
    if settings.angle_noise is None and design.sensor.encoder_counts == 0 and settings.measure == "theta":
        settings = replace(settings, angle_noise=_angle_noise(samples.z))
    return settings

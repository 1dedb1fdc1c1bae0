"""Stretches of steady motion in logs, as channels at an even rate, and their spectra."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects.structures import SecondMass
from pmsm_ctrl.errors import LogError, NextCommand, NotExcitedError
from pmsm_ctrl.evidence.local_polynomial import REACH
from pmsm_ctrl.frf import policy
from pmsm_ctrl.frf.excitation import excitation
from pmsm_ctrl.frf.held import beyond, steps_of
from pmsm_ctrl.frf.recorder import stated
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.joining import name_of, parts_of, with_records
from pmsm_ctrl.regression.measurement_correction import corrected_log
from pmsm_ctrl.regression.signals import logged_torque
from pmsm_ctrl.regression.timing import uniform, unwrapped

__all__ = ["ADDED", "Stretch", "mean_speed", "stretches", "without_steps"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

ADDED = "i_q_add"  # the current reference without what the controllers answer to noise


@dataclass(frozen=True, eq=False)
class Stretch:
    """A stretch of a record at an even rate in which the axis moves steadily.

    Attributes
    ----------
    name : str
    period : float
        s.
    channels : dict of name to array, shape (n,)
        Those of the log, ``torque``, and ``i_q_add``, the `excitation`, where the log tells it.
    reverses : bool
        Whether the axis reverses in it.
    held : str
        The excitation that is held between the samples, if there is one; what its steps fold onto them is not in
        ``torque``, ``i_q`` and ``omega``.
    explained : bool
        Whether nothing of it is left in the current.
    whole : tuple of str
        References of which the log has every value that its controller reads.
    """

    name: str
    period: float
    channels: Mapping[str, Array]
    reverses: bool
    held: str = ""
    explained: bool = False
    whole: tuple[str, ...] = ()

    @property
    def rate(self) -> float:
        """Samples per second."""
        return 1.0 / self.period

    @property
    def count(self) -> int:
        """Samples of a spectrum: a difference of angles takes one more."""
        return len(self.channels["torque"]) - 1

    def spectrum(self, name: str) -> Complex:
        """Return the spectrum of a channel, shape (n // 2 + 1,); of an angle that of its speed."""
        n = self.count
        if name in ("theta", "theta_ref"):
            # the difference of samples is exact: only its own response over a period is undone
            turn = 2j * math.pi * np.fft.rfftfreq(n)
            turn[0] = 1.0
            step = np.where(turn == 1.0, 1.0, turn / np.expm1(turn))
            return np.asarray(np.fft.rfft(np.diff(self.channels[name]) * self.rate) * step)
        return np.asarray(np.fft.rfft(self.channels[name][:-1]))


def stretches(design: Design, logs: Iterable[Log]) -> tuple[Stretch, ...]:
    """Return the longest steady stretch of each record: one direction where the log has one, and not too slow.

    Raises
    ------
    NotExcitedError
        When no record has one of `policy.SHORTEST`.
    LogError
        When a channel is missing.
    """
    found = []
    for number, whole in enumerate(logs, start=1):
        whole.check_evaluable(100)
        log = with_records(corrected_log(design, whole)[0], number)
        names = [one.name for one in log.records] or [name_of(log, number)]
        parts = zip(names, parts_of(log), strict=True)
        found += [one for name, part in parts if (one := _stretch(design, part, name)) is not None]
    if not found:
        raise NotExcitedError(
            f"no stretch of {policy.SHORTEST:g} s in which the axis moves; a frequency response needs excitation: "
            "a multisine, a chirp or noise on the current or the speed reference"
        )
    return tuple(found)


def _stretch(design: Design, log: Log, name: str) -> Stretch | None:
    t, channels, _, _ = uniform(log)
    period = float(t[1] - t[0])
    channels["torque"] = logged_torque(design, channels, f"{name}: ")
    for angle in {"theta", "theta_ref"} & channels.keys():
        channels[angle] = unwrapped(channels[angle])
    if "theta" in channels:
        speed = np.gradient(channels["theta"], period)
    elif "omega" in channels:
        speed = channels["omega"]
    else:
        raise LogError(f"{name}: neither theta nor omega", next_command=NextCommand.MAP)
    smooth = _running_mean(speed, max(1, round(0.1 / period)))
    usual = float(np.median(np.abs(smooth)))
    if usual == 0.0:
        return None
    one_way = max((smooth > policy.SLOWEST * usual, smooth < -policy.SLOWEST * usual), key=_longest)
    start, stop = _run(one_way)
    reverses = (stop - start) * period < policy.SHORTEST or (stop - start) < len(t) // 4
    if reverses:
        start, stop = 0, len(t)
    if (stop - start) * period < policy.SHORTEST or stop - start < 4 * (2 * REACH + 1):
        return None
    cut = {key: values[start:stop] for key, values in channels.items()}
    added = excitation(design, cut, period)
    cut = cut if added is None else cut | {ADDED: added}
    return Stretch(name, period, cut, reverses, whole=_read_whole(design, cut, period))


def _read_whole(design: Design, channels: Mapping[str, Array], period: float) -> tuple[str, ...]:
    """Return the references whose values are logged in every tick of the controller that reads them."""
    if not stated(design, [period]):
        return ()
    every = design.sensor.log_divider
    of_speed = ("theta_ref", "omega_ref", ADDED) if ADDED in channels and every <= design.drive.speed_divider else ()
    return (*of_speed, *(("i_q_ref",) if every == 1 else ()))


def without_steps(design: Design, record: Stretch, J: float, mass: SecondMass | None = None) -> Stretch:
    """Return a record without what an excitation that is held between the samples folds onto them."""
    channels = record.channels
    source = next((name for name in ("omega_ref", ADDED, "i_q_ref") if _stepped(channels, name)), None)
    if source is None:
        return record
    steps = steps_of(
        design, channels, source, channels[source], record.period, J=J, speed=mean_speed([record]), mass=mass
    )
    if steps is None:
        return record
    torque = logged_torque(design, channels, f"{record.name}: ") - design.K_t * steps.torque
    smooth = {"torque": torque, "i_q": channels["i_q"] - steps.current}
    if "omega" in channels:
        smooth["omega"] = channels["omega"] - steps.speed
    return replace(record, channels={**channels, **smooth}, held=source, explained=steps.explained)


def _stepped(channels: Mapping[str, Array], name: str) -> bool:
    """Whether an excitation may be held between the samples.

    A speed reference is one where it has content beyond: ramps have not. It has to be that of a speed loop that is
    known to be closed, without a position loop around it.
    """
    if not {name, "i_q", "i_q_ref"} <= channels.keys() or np.ptp(channels[name]) == 0.0:
        return False
    if name == "omega_ref":
        in_position = "theta_ref" in channels and np.ptp(channels["theta_ref"]) > 0.0
        return ADDED in channels and not in_position and beyond(channels[name]) > policy.BEYOND
    return name != "i_q_ref" or ADDED not in channels


def _running_mean(values: Array, count: int) -> Array:
    from scipy.ndimage import uniform_filter1d

    return np.asarray(uniform_filter1d(values, count, mode="nearest"))


def _run(mask: NDArray[np.bool_]) -> tuple[int, int]:
    """Return the longest run of true samples, start and stop."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    if not edges.size:
        return 0, 0
    k = int(np.argmax(edges[1::2] - edges[::2]))
    return int(edges[2 * k]), int(edges[2 * k + 1])


def _longest(mask: NDArray[np.bool_]) -> int:
    start, stop = _run(mask)
    return stop - start


def mean_speed(records: Sequence[Stretch]) -> float:
    """Return the mean of the records' speeds, rad/s; that of an axis that reverses counts as none."""
    means = [
        float(np.ptp(one.channels["theta"])) / (one.period * (len(one.channels["theta"]) - 1))
        if "theta" in one.channels and not one.reverses
        else 0.0 if one.reverses else float(np.mean(one.channels["omega"]))
        for one in records
    ]  # fmt: skip
    return float(np.mean(np.abs(means)))

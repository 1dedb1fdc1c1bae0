"""Correct a log for the measurement effects of its design."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects.base import Effect
from pmsm_ctrl.effects.catalogue import bound_effects
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.drive_timing import drive_sampling, in_time, stated_timing
from pmsm_ctrl.regression.notices import MEASUREMENT_EFFECT_LEFT_IN
from pmsm_ctrl.regression.timing import unwrapped
from pmsm_ctrl.section import Notice

__all__ = ["corrected_log", "known_delay", "left_in", "undone", "unscaled"]

Array = NDArray[np.float64]


def known_delay(design: Design) -> float:
    """Return by how much torque and currents are late as the design says, s.

    Parameters
    ----------
    design : Design
    """
    stated = ((one.structure, one, values) for one, values in bound_effects(design))
    return sum(how.delay(one, [values[s] for s in how.symbols(one)]) for how, one, values in stated if how.delays)


def undone(
    design: Design, t: Array, channels: Mapping[str, Array], scaled: bool = False
) -> tuple[dict[str, Array], tuple[Notice, ...]]:
    """Return channels as they would be without the design's measurement effects, and notes on those left in.

    A delay, an offset and a common scale are undone exactly; a wrong angle and a mismatch of gains to first order,
    since the term reads the measured value in place of the true one. Of currents: a logged torque is moved in time, and
    an offset or a gain stays in it.

    Parameters
    ----------
    design : Design
    t : array, shape (n,)
        Uniform time base, s.
    channels : mapping of str to array, shape (n,)
        Measured, in SI units; the angle unwrapped.
    scaled : bool
        Whether the common scale was taken off before, by `unscaled`.
    """
    notes: list[Notice] = []
    out = {name: np.asarray(values) for name, values in channels.items()}
    out |= {} if scaled else _unscaled(design, out)
    p = float(design.motor.p) if design.motor.p is not None else None
    for effect, values in _of_the_measurement(design):
        known = {s: 0.0 if s in effect.common_scale else value for s, value in values.items()}
        corrected = effect.structure.corrected(effect, known, t, out, p)
        if corrected is None:
            notes.append(MEASUREMENT_EFFECT_LEFT_IN(effect=effect.id))
        else:
            out = corrected
    return out, tuple(notes)


def unscaled(design: Design, log: Log) -> Log:
    """Return a log without the scale that the design states for all of its current: no column of a balance has it.

    Parameters
    ----------
    design : Design
    log : Log
    """
    return log.with_channels(**known) if (known := _unscaled(design, log.channels)) else log


def corrected_log(design: Design, log: Log) -> tuple[Log, tuple[Notice, ...]]:
    """Return a log as its channels were, by what the design states of their sampling and of its measurement effects.

    For what estimates neither: a filter over the samples, a frequency response, a mean over a plateau. A log with
    samples that are no numbers, or with time that turns back, is returned as it is.

    Parameters
    ----------
    design : Design
    log : Log

    Returns
    -------
    (Log, tuple of Notice)
        The notices name the effects that are left in.
    """
    whole = all(np.isfinite(values).all() for values in log.channels.values()) and bool((np.diff(log.t) > 0.0).all())
    if len(log) < 3 or not whole:
        return log, ()
    log = stated_timing(drive_sampling(design, log), log.period).undone(in_time(design, log))
    if next(_of_the_measurement(design), None) is None:
        return log, ()
    angle = {"theta": unwrapped(log["theta"])} if "theta" in log else {}
    channels, notes = undone(design, log.t, {**log.channels, **angle})
    return log.with_channels(**{name: values for name, values in channels.items() if name != "t"}), notes


def left_in(design: Design, logs: Iterable[Log]) -> tuple[Notice, ...]:
    """Return notices on the measurement effects that `corrected_log` leaves in any of the logs.

    Parameters
    ----------
    design : Design
    logs : iterable of Log
    """
    if next(_of_the_measurement(design), None) is None:
        return ()
    return tuple(dict.fromkeys(notice for log in logs for notice in corrected_log(design, log)[1]))


def _unscaled(design: Design, channels: Mapping[str, Array]) -> dict[str, Array]:
    """Return the channels that have a stated scale without it."""
    one = np.ones(1)
    out: dict[str, Array] = {}
    for effect, values in _of_the_measurement(design):
        scale = {s: value if s in effect.common_scale else 0.0 for s, value in values.items()}
        ones = dict.fromkeys((*effect.channels, "theta", "omega"), one)  # what is one reads one and the scale
        if any(scale.values()) and (read := effect.structure.corrected(effect, scale, one, ones, 0.0)):
            for name in set(effect.channels) & set(channels):
                out[name] = out.get(name, channels[name]) / float(2.0 - read[name][0])
    return out


def _of_the_measurement(design: Design) -> Iterator[tuple[Effect, Mapping[str, float]]]:
    return ((effect, values) for effect, values in bound_effects(design) if effect.enters == "measurement")

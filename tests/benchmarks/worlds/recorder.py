"""How a drive's signals become a log: when and how each channel is sampled, and what gets lost on the way."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.log import Log
from tests.benchmarks.worlds.plant import COLUMNS, TRUTH
from tests.benchmarks.worlds.world import World

__all__ = ["band_of", "record", "truth"]

Array = NDArray[np.float64]

BAND = 25.0  # Hz


def band_of(world: World) -> float:
    """Return the band in which an effect's margin is told, Hz."""
    return float(min(BAND, world.f_control / world.log_divider / 8.0))


def record(world: World, runs: list[Array]) -> Log:
    """Return the log of one or several runs, joined with gaps in time where there are several."""
    return Log(_joined(world, runs, _sampled), motion="linear" if world.linear else "rotary")


def truth(world: World, runs: list[Array]) -> dict[str, Array]:
    """Return what the hidden physics adds (`plant.TRUTH`), sampled as the channels of the log are."""
    return _joined(world, runs, _added)


def _joined(world: World, runs: list[Array], sampled: Callable[[World, Array], dict[str, Array]]) -> dict[str, Array]:
    parts: dict[str, list[Array]] = {}
    start = 0.0
    for table in runs:
        part = sampled(world, table)
        length = float(part["t"][-1])
        part["t"] = part["t"] + start
        start += length + 2.0
        for name, values in part.items():
            parts.setdefault(name, []).append(values)
    channels = {name: np.concatenate(values) for name, values in parts.items()}
    if world.dropped > 0.0:
        rng = np.random.default_rng([world.seed, 23])
        keep = rng.random(len(channels["t"])) >= world.dropped
        keep[[0, -1]] = True
        channels = {name: values[keep] for name, values in channels.items()}
    return channels


def _ticks(world: World, table: Array) -> NDArray[np.int64]:
    return np.arange(world.log_divider + world.phase, len(table), world.log_divider)


def _taken(world: World, values: Array, ticks: NDArray[np.int64]) -> Array:
    """Return a signal of the control periods as the recorder writes it: an instant, a mean, or filtered."""
    step = world.log_divider
    if world.mode == "mean":
        total = np.concatenate([[0.0], np.cumsum(values)])
        return np.asarray((total[ticks + 1] - total[ticks + 1 - step]) / step)
    if world.mode == "filtered":
        from scipy.signal import lfilter

        a = np.exp(-1.0 / (world.f_control * world.lag))
        return np.asarray(lfilter([1.0 - a], [1.0, -a], values, zi=[a * values[0]])[0][ticks])
    return np.asarray(values[ticks])


def _added(world: World, table: Array) -> dict[str, Array]:
    from scipy.signal import butter, sosfiltfilt

    ticks = _ticks(world, table)
    sections = butter(4, band_of(world), fs=world.f_control, output="sos")  # before sampling, so that no ripple aliases
    slow = sosfiltfilt(sections, table[:, len(COLUMNS) :], axis=0)
    out = {"t": np.arange(len(ticks)) * world.log_divider / world.f_control}
    for name, values in zip(TRUTH, slow.T, strict=True):
        out[name] = values[ticks] if name == "angle" else _taken(world, values, ticks)
    return out


def _sampled(world: World, table: Array) -> dict[str, Array]:
    column = dict(zip(COLUMNS, table.T[: len(COLUMNS)], strict=True))
    step, ticks = world.log_divider, _ticks(world, table)
    motor = world.motor
    K_t = motor[4] if world.linear else 1.5 * motor[3] * motor[4]
    source = {"command": "i_q_ref"}.get(world.mode, "i_q")
    if world.channel == "torque command":
        source = "i_q_ref"

    def taken(values: Array) -> Array:
        return _taken(world, values, ticks)

    out = {"t": np.arange(len(ticks)) * step / world.f_control, "theta": column["theta"][ticks]}
    if world.channel == "i_q":
        out["i_q"] = taken(column[source])
        out["i_d"] = taken(column["i_d"])
    elif world.linear:
        out["torque"] = K_t * taken(column[source])
    else:
        out["torque"] = world.design.K_t_assumed * taken(column[source])
    if world.voltages:
        # what the drive writes down is the command it computed in that period
        out["u_d"], out["u_q"] = taken(column["u_d"]), taken(column["u_q"])
    if world.motion != "torque steps":
        out["omega_ref"] = column["omega_ref"][ticks]
    return out

"""What recorders do to logs: coarse steps, stamps that jitter, few digits, missing channels."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from pmsm_ctrl.design import Design
from pmsm_ctrl.log import Log

__all__ = ["SPOILED"]

Array = NDArray[Any]
CURRENTS, VOLTAGES = ("i_d", "i_q"), ("u_d", "u_q")


def _each(log: Log, change: Callable[[Array], Array], *names: str) -> Log:
    return Log({name: change(values) if name in names else values for name, values in log.channels.items()})


def _steps(size: float) -> Callable[[Array], Array]:
    return lambda values: np.round(values / size) * size


def _digits(count: int) -> Callable[[Array], Array]:
    return lambda values: np.array([float(f"{value:.{count}g}") for value in values])


def _without(log: Log, *names: str) -> Log:
    return Log({name: values for name, values in log.channels.items() if name not in names})


def _jitter(log: Log) -> Array:
    return 0.03 * log.period * np.random.default_rng(len(log)).standard_normal(len(log))


def _late_samples(log: Log) -> Log:
    t = np.clip(log.t + _jitter(log), log.t[0], log.t[-1])
    return Log({name: t if name == "t" else CubicSpline(log.t, values)(t) for name, values in log.channels.items()})


def _torque(log: Log, design: Design) -> Log:
    torque = Log({**log.channels, "torque": design.K_t_assumed * log["i_q"]})
    return _without(torque, *CURRENTS, *VOLTAGES)


SPOILED: dict[str, Callable[[Log, Design], Log]] = {
    "currents in steps of 15 mA": lambda log, _: _each(log, _steps(0.015), *CURRENTS),
    "currents in steps of 60 mA": lambda log, _: _each(log, _steps(0.06), *CURRENTS),
    "voltages in steps of 0.5 V": lambda log, _: _each(log, _steps(0.5), *VOLTAGES),
    "angle in 4096 steps a turn": lambda log, _: _each(log, _steps(2.0 * np.pi / 4096.0), "theta"),
    "the same and no speed": lambda log, _: _without(_each(log, _steps(2.0 * np.pi / 4096.0), "theta"), "omega"),
    "three decimals": lambda log, _: _each(log, _steps(1e-3), *(name for name in log.channels if name != "t")),
    "six digits": lambda log, _: _each(log, _digits(6), *(name for name in log.channels if name != "t")),
    "five digits": lambda log, _: _each(log, _digits(5), *(name for name in log.channels if name != "t")),
    "stamps that jitter": lambda log, _: Log({**log.channels, "t": log.t + _jitter(log)}),
    "samples that jitter": lambda log, _: _late_samples(log),
    "half the rate": lambda log, _: Log({name: values[::2] for name, values in log.channels.items()}),
    "no voltages": lambda log, _: _without(log, *VOLTAGES),
    "no position": lambda log, _: _without(log, "theta"),
    "no references": lambda log, _: _without(log, "omega_ref"),
    "a torque in place of currents": _torque,
    "ten seconds of it": lambda log, _: log.between(3.0, 13.0),
}

"""Compensation whose F_c and F_v a tracker renews while the axis runs: tracker and drive in one loop."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import SimulationError
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.signals import drive_torque
from pmsm_ctrl.simulate import Scenario
from pmsm_ctrl.simulate.feedforward import TRUSTED
from pmsm_ctrl.simulate.run import LOGGED, prepare
from pmsm_ctrl.track import Settings
from pmsm_ctrl.track import model as states_of
from pmsm_ctrl.track.inputs import KnownTorque
from pmsm_ctrl.track.settings import covariance, memory, numbers, start

__all__ = ["AdaptiveRun", "simulate_adaptive"]

Array = NDArray[Any]

RENEWED = {"F_c": "coulomb.F_c", "F_v": "viscous.F_v"}
EVERY = 0.05  # s between two updates
UNKNOWN_SPEED = 100.0  # rad/s at which viscous and Coulomb friction are assumed equal where only one is known
SLOW = 1 + states_of.INERTIA  # states of the tracker but the angle
NOISELESS = 0.01  # torque noise as a share of the friction, where the design states no current noise


@dataclass(frozen=True, eq=False)
class AdaptiveRun:
    """A run with the tracker in the loop.

    Attributes
    ----------
    log : Log
    t : array, shape (n,)
        Times at which the compensation was updated, s.
    fed : dict of name to array, shape (n,)
        F_c and F_v fed forward from then on.
    """

    log: Log
    t: Array
    fed: dict[str, Array]


def simulate_adaptive(
    design: Design, motion: Scenario, *, truth: Design | None = None, seed: int = 0,
    every: float = EVERY,
) -> AdaptiveRun:  # fmt: skip
    """Simulate a drive whose compensation takes F_c and F_v from a tracker fed with the drive's own log.

    The drive runs `every` seconds, the tracker reads what the drive logged in them, and its estimates replace the
    design's values in the next interval, once their standard error is below a tenth of them. Other effects keep the
    values of the design.

    Parameters
    ----------
    design : Design
        What the controller and the tracker assume at the start.
    motion : Scenario
    truth : Design, optional
        The plant; `design` itself when left out.
    seed : int
        Of the measurement noise.
    every : float
        s.

    Returns
    -------
    AdaptiveRun
        The log includes the truth.

    Raises
    ------
    DesignError
        When the plant or the loops are not known well enough to simulate.
    SimulationError
        When a state stops being finite.
    """
    drive = prepare(design, motion, truth=truth)
    plant, feedforward = drive.plant, drive.feedforward
    module = drive.kernel()
    unit = math.lcm(plant.speed_divider, plant.log_divider)
    stretch = max(unit, round(every / plant.period / unit) * unit)
    states, noise = drive.states(), np.random.default_rng(seed)
    out = np.empty((-(-drive.total // plant.log_divider), len(LOGGED)))
    values = feedforward.values.copy() if feedforward else np.zeros(0)
    where = {} if feedforward is None else {s: feedforward.names.index(n) for s, n in RENEWED.items()
                                            if n in feedforward.names}  # fmt: skip
    tracker: _Tracker | None = None
    history, row = [], 0
    for k in range(0, drive.total, stretch):
        n = min(stretch, drive.total - k)
        ticks = np.arange(k // plant.speed_divider, -(-(k + n) // plant.speed_divider))
        inputs = motion.inputs(ticks * (plant.period * plant.speed_divider))
        inputs = np.hstack([inputs, np.broadcast_to(values, (ticks.size, values.size))])
        wrote = module.run(
            n, k, states, plant.array(), drive.controller.array(), drive.effects, inputs, out[row:], noise
        )
        if wrote < 0:
            raise SimulationError(f"scenario '{motion.name}': the simulation diverged with the adaptive compensation")
        if where:
            tracker = tracker or _Tracker(design)
            tracker.feed(out[row : row + wrote])
            tracker.renew(values, where)
        row += wrote
        history.append(((k + n) * plant.period, *(float(values[column]) for column in where.values())))
    columns = np.array(history).T
    return AdaptiveRun(drive.log(out[:row], seed, True), columns[0], dict(zip(where, columns[1:], strict=True)))


class _Tracker:
    """The tracker's compiled twin, fed interval by interval; it keeps its state in between."""

    def __init__(self, design: Design) -> None:
        self._design, self._known = design, KnownTorque(design)
        settings = _settings(design)
        self._s = numbers(design, settings, design.log_period)
        self._x, self._P, self._m = start(design), covariance(self._s, settings), memory()
        self._last = np.zeros((0, len(LOGGED)))

    def feed(self, rows: Array) -> None:
        """Take logged rows in."""
        from pmsm_ctrl.track.twin import run

        n, column = len(rows), {name: rows[:, k].copy() for k, name in enumerate(LOGGED)}
        torque = np.asarray(drive_torque(self._design, column["i_d"], column["i_q"]), dtype=np.float64)
        known = self._known_torque(np.vstack([self._last, rows])) if self._known else np.zeros(n)
        self._last = rows[-1:].copy()
        run(
            column["t"], column["theta"], torque, known[known.size - n :], self._s, self._x, self._P, self._m,
            np.empty((n, SLOW)), np.empty((n, SLOW)), np.empty(n), np.empty((n, 3)), np.empty(n, dtype=np.int8),
        )  # fmt: skip

    def _known_torque(self, rows: Array) -> Array:
        column = {name: rows[:, k] for k, name in enumerate(LOGGED)}
        speed = np.concatenate([[0.0], np.diff(column["theta"]) / np.diff(column["t"])])
        torque = np.asarray(drive_torque(self._design, column["i_d"], column["i_q"]), dtype=np.float64)
        names = ("t", "theta", "i_d", "i_q")
        signals = {**{name: column[name] for name in names}, "omega": speed, "direction": np.sign(speed)}
        return self._known.over({**signals, "torque": torque})

    def renew(self, values: Array, where: dict[str, int]) -> None:
        """Replace values by the estimates that can be trusted."""
        for symbol, position in (("F_c", states_of.F_C), ("F_v", states_of.F_V)):
            estimate, variance = float(self._x[position]), float(self._P[position, position])
            if symbol in where and estimate > 0.0 and math.sqrt(variance) < TRUSTED * estimate:
                values[where[symbol]] = estimate


def _settings(design: Design) -> Settings:
    """The tracker's own, with a prior where the design has no Coulomb or no viscous friction."""
    F_c, F_v = design.parameters("coulomb").get("F_c", 0.0), design.parameters("viscous").get("F_v", 0.0)
    return Settings(
        prior_F_c=None if F_c > 0.0 else UNKNOWN_SPEED * F_v,
        prior_F_v=None if F_v > 0.0 else F_c / UNKNOWN_SPEED,
        torque_noise=None if design.sensor.current_noise > 0.0 else NOISELESS * max(F_c, UNKNOWN_SPEED * F_v),
    )

"""Run the composed kernel over a scenario, piece by piece, and return a `Log`."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects import Effect, bound_effects
from pmsm_ctrl.errors import SimulationError
from pmsm_ctrl.log import Log, Provenance, Segment
from pmsm_ctrl.simulate.compose import load
from pmsm_ctrl.simulate.parameters import Controller, Plant
from pmsm_ctrl.simulate.scenarios import Scenario
from pmsm_ctrl.simulate.scenarios import scenario as named_scenario

__all__ = ["simulate"]

Array = NDArray[Any]

# Columns of a logged row, in the kernel's order.
LOGGED = (
    "t", "theta", "omega", "i_d", "i_q", "i_d_ref", "i_q_ref", "u_d", "u_q", "omega_ref", "theta_ref", "T_load",
    "theta_true", "omega_true",
)  # fmt: skip
TRUTHS = ("theta_true", "omega_true")
STATES = 15
CHUNK = 1 << 18  # control periods between two progress reports: a fraction of a second


def simulate(
    design: Design,
    scenario: str | Scenario = "sweep",
    *,
    truth: Design | None = None,
    seed: int = 0,
    own: Iterable[Effect] = (),
    keep_truth: bool = False,
    progress: Callable[[float], None] | None = None,
    compiled: bool = True,
) -> Log:
    """Simulate the sampled drive.

    Parameters
    ----------
    design : Design
        What the controller believes: loops, assumed parameters, compensation.
    scenario : str or Scenario
        A named motion, with parameters from the design, or a scenario object.
    truth : Design, optional
        The plant: machine, effects, sensors. `design` itself when left out.
    seed : int
        Seed of the measurement noise.
    own : iterable of Effect
        A user's own effects, available by their ids.
    keep_truth : bool
        Also log ``theta_true`` and ``omega_true``, which no drive can.
    progress : function, optional
        Called with the share done, 0 to 1.
    compiled : bool
        False runs the readable twin in plain Python, some thousand times slower.

    Returns
    -------
    Log
        Sampled every ``sensor.log_divider`` control periods.

    Raises
    ------
    DesignError
        When the plant or the loops are not known well enough to simulate.
    SimulationError
        When a state stops being finite; the message says where and when.
    """
    motion = named_scenario(scenario, design) if isinstance(scenario, str) else scenario
    plant_design = truth if truth is not None else design
    plant = Plant.of(plant_design)
    controller = Controller.of(design, motion.control)
    bound = [(effect, values) for effect, values in bound_effects(plant_design, own) if _active(effect, values)]
    module = load([effect for effect, _ in bound], compiled=compiled)
    effects = tuple(value for _, values in bound for value in values.values()) or (0.0,)
    table = _run(module, motion, plant, controller, effects, seed, progress)
    names = [name for name in LOGGED if keep_truth or name not in TRUTHS]
    if motion.control != "position":
        names.remove("theta_ref")
    channels = {name: table[:, LOGGED.index(name)] for name in names}
    t = channels["t"]
    segments = tuple(
        Segment(name, int(np.searchsorted(t, start - 1e-12)), int(np.searchsorted(t, stop - 1e-12)))
        for name, start, stop in motion.segments
    )
    note = f"simulated: {plant_design.name}, scenario {motion.name}, seed {seed}"
    return Log(channels, plant_design.motion, segments, Provenance(importer="simulate", notes=(note,)))


def _active(effect: Effect, values: dict[str, float]) -> bool:
    """An effect whose linear parameters are all zero does nothing: it is left out, and costs nothing."""
    linear = effect.linear
    return not linear or any(values[p.symbol] != 0.0 for p in linear)


def _run(
    module: ModuleType,
    motion: Scenario,
    plant: Plant,
    controller: Controller,
    effects: tuple[float, ...],
    seed: int,
    progress: Callable[[float], None] | None,
) -> Array:
    """Return the logged rows, shape (n, len(LOGGED)); memory grows only with the rows kept."""
    total = max(1, round(motion.duration / plant.period))
    states = np.zeros(STATES)
    states[2], states[3] = motion.omega_0, motion.theta_0
    period_s = plant.period * plant.speed_divider
    states[7], states[8] = motion.theta_0 - motion.omega_0 * period_s, motion.omega_0
    states[14] = motion.omega_0
    noise = np.random.default_rng(seed)
    unit = math.lcm(plant.speed_divider, plant.log_divider)
    chunk = max(unit, CHUNK // unit * unit)
    out = np.empty((-(-total // plant.log_divider), len(LOGGED)))
    row = 0
    for k in range(0, total, chunk):
        n = min(chunk, total - k)
        ticks = np.arange(k // plant.speed_divider, -(-(k + n) // plant.speed_divider))
        inputs = motion.inputs(ticks * period_s)
        wrote = module.run(
            n, k, states, plant.array(), controller.array(), effects, inputs, out[row:], noise
        )  # fmt: skip
        if wrote < 0:
            raise SimulationError(_diverged(-1 - wrote, plant, motion))
        row += wrote
        if progress is not None:
            progress((k + n) / total)
    return out[:row]


def _diverged(tick: int, plant: Plant, motion: Scenario) -> str:
    t = tick * plant.period
    return (
        f"scenario '{motion.name}': the simulation left the finite numbers at t = {t:.6g} s "
        f"(control period {tick}); a loop is unstable, or the step of {plant.period / plant.steps:.3g} s is too "
        "long for the plant: check the loop gains, or raise drive.plant_steps"
    )

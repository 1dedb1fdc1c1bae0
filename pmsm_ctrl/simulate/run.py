"""Run the composed kernel over a scenario, piece by piece, and return a `Log`."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects import Effect, bound_effects
from pmsm_ctrl.errors import DesignError, RequestError, SimulationError, require_kind
from pmsm_ctrl.log import Log, Provenance, Segment
from pmsm_ctrl.simulate.compose import BARE_STATES, load, structures
from pmsm_ctrl.simulate.controller_lines import SpeedParts
from pmsm_ctrl.simulate.feedforward import Feedforward
from pmsm_ctrl.simulate.motions import Scenario
from pmsm_ctrl.simulate.parameters import Controller, Plant
from pmsm_ctrl.simulate.resolution import second_mass, steps_needed
from pmsm_ctrl.simulate.scenarios import scenario as named_scenario

__all__ = ["LOGGED", "Prepared", "prepare", "run_kernel", "simulate"]

Array = NDArray[Any]
Bound = tuple[Effect, dict[str, float]]

# Columns of a logged row, in the kernel's order.
LOGGED = (
    "t", "theta", "omega", "i_d", "i_q", "i_d_ref", "i_q_ref", "u_d", "u_q", "omega_ref", "theta_ref", "T_load",
    "theta_true", "omega_true", "theta_load",
)  # fmt: skip
TRUTHS = ("theta_true", "omega_true", "theta_load")
FEWEST_ROWS = 2  # one sample has no rate
MOST_ROWS = 2e8  # two days at 1 kHz, and 25 GB of memory
CHUNK = 1 << 18  # control periods between two progress reports: a fraction of a second


def simulate(
    design: Design,
    scenario: str | Scenario = "sweep",
    *,
    truth: Design | None = None,
    seed: int = 0,
    keep_truth: bool = False,
    progress: Callable[[float], None] | None = None,
    compiled: bool = True,
) -> Log:
    """Simulate the sampled drive.

    Parameters
    ----------
    design : Design
        The controller's: loops, assumed parameters, compensation.
    scenario : str or Scenario
        A named motion, with parameters from the design, or a scenario object.
    truth : Design, optional
        The plant: machine, effects, sensors. `design` itself when left out.
    seed : int
        Seed of the measurement noise.
    keep_truth : bool
        Also log ``theta_true`` and ``omega_true``, which no drive can.
    progress : function, optional
        Called with the share done, 0 to 1.
    compiled : bool
        False runs the kernel's text in plain Python, about a thousand times slower.

    Returns
    -------
    Log
        Sampled every ``sensor.log_divider`` control periods.

    Raises
    ------
    DesignError
        When data of the plant or the loops are missing.
    RequestError
        For an unknown scenario, or a motion too long for a log.
    SimulationError
        When a state stops being finite, with the time.
    """
    drive = prepare(design, scenario, truth=truth)
    module = drive.kernel(compiled=compiled)
    return drive.log(run_kernel(module, drive, seed, progress), seed, keep_truth)


@dataclass(frozen=True, eq=False)
class Prepared:
    """One drive, checked and ready to be simulated.

    Attributes
    ----------
    motion : Scenario
    plant : Plant
    controller : Controller
    feedforward : Feedforward or None
    active : tuple of Effect
        The plant's effects that are not zero, in the design's order.
    effects : tuple of float
        Their parameters, in order; ``(0.0,)`` when there are none.
    design : Design
        The plant's.
    """

    motion: Scenario
    plant: Plant
    controller: Controller
    feedforward: Feedforward | None
    active: tuple[Effect, ...]
    effects: tuple[float, ...]
    design: Design

    @property
    def total(self) -> int:
        """Control periods to simulate."""
        return max(1, round(self.motion.duration / self.plant.period))

    def kernel(self, *, compiled: bool = True) -> ModuleType:
        """Return the module that simulates this drive, compiled or in plain Python."""
        compensated = self.feedforward.effects if self.feedforward is not None else ()
        return load(self.active, compensated, compiled=compiled, parts=self.parts)

    @property
    def parts(self) -> SpeedParts:
        """What the speed controller has beside its PI."""
        forward = self.feedforward
        observes, turns = forward is not None and forward.observes, forward is not None and forward.turns
        return SpeedParts(observes, turns, len(self.controller.filters))

    def states(self) -> Array:
        """Return the kernel's initial states."""
        parts, start = self.parts, dict.fromkeys((name for name, _ in self.parts.memory), 0.0)
        if parts.turns:
            start["swing"] = float(np.sign(self.motion.omega_0))
        if parts.observes and self.feedforward is not None:
            of_speed, start["applied"] = self.feedforward.start
            start["observed"] = of_speed * self.motion.omega_0
        return np.concatenate([_start(self.motion, self.plant, self.active), [*start.values()]])

    def log(self, table: Array, seed: int, keep_truth: bool) -> Log:
        """Return the logged rows, shape (n, len(LOGGED)), as a log."""
        names = [name for name in LOGGED if keep_truth or name not in TRUTHS]
        if keep_truth and not any(effect.structure.splits_inertia for effect in self.active):
            names.remove("theta_load")
        if self.motion.control != "position":
            names.remove("theta_ref")
        columns = table.T[[LOGGED.index(name) for name in names]]
        columns.setflags(write=False)
        channels = dict(zip(names, columns, strict=True))
        t = channels["t"]
        segments = tuple(
            Segment(name, int(np.searchsorted(t, start - 1e-12)), int(np.searchsorted(t, stop - 1e-12)))
            for name, start, stop in self.motion.segments
        )
        note = f"simulated: {self.design.name}, scenario {self.motion.name}, seed {seed}"
        return Log(channels, self.design.motion, segments, Provenance(importer="simulate", notes=(note,)))


def prepare(design: Design, scenario: str | Scenario, *, truth: Design | None = None) -> Prepared:
    """Check one drive and read everything that its simulation needs.

    Parameters
    ----------
    design : Design
        The controller's.
    scenario : str or Scenario
        The motion.
    truth : Design, optional
        The plant's; `design` itself when left out.

    Returns
    -------
    Prepared

    Raises
    ------
    DesignError
        When data of the plant or the loops are missing.
    RequestError
        When the motion is too long or too short for a log.
    """
    require_kind(design, Design, "design")
    motion = named_scenario(scenario, design) if isinstance(scenario, str) else scenario
    plant_design = truth if truth is not None else design
    plant = Plant.of(plant_design)
    controller = Controller.of(design, motion.control)
    rows = motion.duration / (plant.period * plant.log_divider)
    if rows > MOST_ROWS:
        raise RequestError(
            f"scenario '{motion.name}': {motion.duration:.3g} s are {rows:.3g} logged samples, at most {MOST_ROWS:.0e} "
            "are possible; shorten the motion, or raise sensor.log_divider"
        )
    if rows < FEWEST_ROWS:
        raise RequestError(
            f"scenario '{motion.name}': {motion.duration:.3g} s are less than {FEWEST_ROWS} logged samples; "
            "lengthen the motion, or lower sensor.log_divider"
        )
    bound = [(effect, values) for effect, values in bound_effects(plant_design) if effect.active(values)]
    bound, plant = _as_simulated(bound, plant, plant_design)
    effects = tuple(value for _, values in bound for value in values.values()) or (0.0,)
    active = tuple(effect for effect, _ in bound)
    return Prepared(motion, plant, controller, Feedforward.of(design), active, effects, plant_design)


def _start(motion: Scenario, plant: Plant, active: Sequence[Effect]) -> Array:
    """Return the initial states: both masses at omega_0, nothing deflected."""
    kinds = structures(active)
    states = np.zeros(BARE_STATES + sum(kind.memory for kind, _ in kinds))
    states[2], states[3] = motion.omega_0, motion.theta_0
    states[7] = motion.theta_0 - motion.omega_0 * plant.period * plant.speed_divider
    states[8] = states[14] = motion.omega_0
    for kind, offset in kinds:
        states[offset : offset + kind.memory] = kind.start(motion.omega_0, motion.theta_0)
    return states


def _as_simulated(bound: list[Bound], plant: Plant, design: Design) -> tuple[list[Bound], Plant]:
    """Return the effects with the values that the kernel can simulate, and the plant with the steps that they need.

    Raises
    ------
    DesignError
        For an effect with a state of its own given twice, or a mode too fast to simulate.
    """
    where = f"{design.source}: " if design.source else ""
    dry = sum(abs(effect.standing(values, p=float(plant.p))) for effect, values in bound if effect.dry)
    for k, (effect, values) in enumerate(bound):
        if effect.has_state and any(effect is other for other, _ in bound[:k]):
            raise DesignError(f"{where}effects.{effect.id}: given twice; one was expected")
        if effect.structure.splits_inertia:
            bound[k] = effect, effect.structure.simulated(effect, values, plant, dry, f"{where}effects.{effect.id}")
    plant = replace(plant, steps=steps_needed(plant, bound, i_max=design.drive.i_max, label=where))
    mass = second_mass(bound)
    shaft = plant if mass is None else replace(plant, J=plant.J - mass.J_load)  # a bristle acts on the motor alone
    for k, (effect, values) in enumerate(bound):
        if not effect.structure.splits_inertia:
            bound[k] = effect, effect.structure.simulated(effect, values, shaft, dry, f"{where}effects.{effect.id}")
    return bound, plant


def run_kernel(
    module: ModuleType, drive: Prepared, seed: int, progress: Callable[[float], None] | None = None
) -> Array:
    """Run the kernel over a drive's motion; memory grows only with the rows kept.

    Parameters
    ----------
    module : module
        The composed kernel, from `pmsm_ctrl.simulate.compose.load`.
    drive : Prepared
        Its effects are those of the kernel, in the same order.
    seed : int
        Seed of the measurement noise.
    progress : function, optional
        Called with the share done, 0 to 1.

    Returns
    -------
    array, shape (n, len(LOGGED))
        The logged rows.

    Raises
    ------
    SimulationError
        When a state stops being finite.
    """
    plant, motion, total, states = drive.plant, drive.motion, drive.total, drive.states()
    period_s = plant.period * plant.speed_divider
    noise = np.random.default_rng(seed)
    unit = math.lcm(plant.speed_divider, plant.log_divider)
    chunk = max(unit, CHUNK // unit * unit)
    out = np.empty((-(-total // plant.log_divider), len(LOGGED)))
    row = 0
    for k in range(0, total, chunk):
        n = min(chunk, total - k)
        ticks = np.arange(k // plant.speed_divider, -(-(k + n) // plant.speed_divider))
        inputs = motion.inputs(ticks * period_s)
        if drive.feedforward is not None:
            inputs = drive.feedforward.widen(inputs)
        wrote = module.run(
            n, k, states, plant.array(), drive.controller.array(), drive.effects, inputs, out[row:], noise
        )
        if wrote < 0:
            raise SimulationError(_diverged(-1 - wrote, plant, motion))
        row += wrote
        if progress is not None:
            progress((k + n) / total)
    return out[:row]


def _diverged(tick: int, plant: Plant, motion: Scenario) -> str:
    t = tick * plant.period
    return (
        f"scenario '{motion.name}': the simulation diverged at t = {t:.6g} s "
        f"(control period {tick}); the step of {plant.period / plant.steps:.3g} s resolves every mode of the plant, so "
        "a loop is unstable: check the loop gains"
    )

"""Speed gains by optimisation over the nonlinear simulation, friction included. The classical result is the default."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design, SpeedLoop
from pmsm_ctrl.errors import RequestError, SimulationError
from pmsm_ctrl.simulate import Scenario, simulate
from pmsm_ctrl.tune.margins import Margins, margins
from pmsm_ctrl.tune.requirements import Requirements
from pmsm_ctrl.tune.sampled import Cascade
from pmsm_ctrl.tune.speed import open_loop

__all__ = ["Optimum", "optimise"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Optimum:
    """The best speed gains found, beside those the search started from.

    Attributes
    ----------
    design : Design with the gains set
    cost, cost_before : the mean of abs(speed error) in rad/s over the test motion
    margins : of the optimised speed loop
    simulations : how many were run
    """

    design: Design
    cost: float
    cost_before: float
    margins: Margins
    simulations: int


def reversal(*, speed: float, load: float, duration: float) -> Scenario:
    """A slow reversal through standstill and a load step at rest: what friction makes hard.

    Triangle between -`speed` and `speed` (rad/s) for two thirds of `duration` (s), then rest with `load` (N m).
    """
    third = duration / 3.0

    def inputs(t: Array) -> dict[str, Array]:
        phase = (t / third) % 2.0
        triangle = speed * (1.0 - 2.0 * np.abs(phase - 1.0))
        moving = t < 2.0 * third
        return {
            "omega_ref": np.asarray(np.where(moving, triangle, 0.0), dtype=np.float64),
            "T_load": np.asarray(load * (t >= 2.5 * third), dtype=np.float64),
        }

    return Scenario("reversal", duration, inputs, omega_0=-speed)


def optimise(
    design: Design,
    *,
    speed: float,
    load: float | None = None,
    duration: float = 0.6,
    requirements: Requirements | None = None,
    iterations: int = 40,
    progress: Callable[[float], None] | None = None,
) -> Optimum:
    """Search K_p and T_n of the speed loop on the simulated drive, within the margins.

    Parameters
    ----------
    design : Design
        With its loops set (by `tune`): the start of the search.
    speed : rad/s
        Amplitude of the slow reversal.
    load : N m, optional
        Load step; by default a quarter of the drive's largest torque.
    duration : s
    requirements : Requirements, optional
        Gains that miss them are not considered, whatever they would save.
    iterations : int
        Simulations granted to the Nelder-Mead search.

    Returns
    -------
    Optimum

    Raises
    ------
    DesignError
        When the design has no loops.
    RequestError
        When its own gains miss the requirements.
    """
    from scipy.optimize import minimize

    loops, requirements = design.require_loops(), requirements or Requirements()
    load = 0.25 * design.K_t * min(design.drive.i_max, 1e3) if load is None else load
    motion = reversal(speed=speed, load=load, duration=duration)
    cascade = Cascade.of(design, loops.current, at=max(speed, 1e-3))
    runs = 0

    def gains(x: Array) -> SpeedLoop:
        K_p, T_n = loops.speed.K_p * math.exp(x[0]), loops.speed.T_n * math.exp(x[1])
        return SpeedLoop(K_p=K_p, T_n=T_n, reference_filter=loops.speed.reference_filter)

    def cost(x: Array) -> float:
        nonlocal runs
        runs += 1
        if progress is not None:
            progress(min(1.0, runs / iterations))
        candidate = gains(x)
        shortfall = requirements.shortfall(margins(open_loop(cascade, candidate), brief=True))
        if shortfall > 0.0:
            # A wall with a slope leads the search back; its height is the start's own cost.
            return start * (1.5 + min(shortfall, 10.0)) if runs > 1 else math.inf
        return _error(design, candidate, motion)

    start = math.inf
    start = cost(np.zeros(2))
    if not math.isfinite(start):
        raise RequestError("the gains to start from miss the requirements; tune them first, or grant other ones")
    found = minimize(
        cost, np.zeros(2), method="Nelder-Mead",
        options={"maxfev": iterations, "initial_simplex": [[0.0, 0.0], [0.2, 0.0], [0.0, -0.3]], "xatol": 0.01},
    )  # fmt: skip
    best = gains(found.x if found.fun < start else np.zeros(2))
    tuned = design.model_copy(update={"loops": loops.model_copy(update={"speed": best})})
    return Optimum(tuned, float(min(found.fun, start)), float(start), margins(open_loop(cascade, best)), runs)


def _error(design: Design, candidate: SpeedLoop, motion: Scenario) -> float:
    """Mean absolute speed error on the simulated drive, rad/s; infinite when the simulation diverges."""
    assert design.loops is not None
    tried = design.model_copy(update={"loops": design.loops.model_copy(update={"speed": candidate})})
    try:
        log = simulate(tried, motion, keep_truth=True)
    except SimulationError:
        return math.inf
    return float(np.abs(log["omega_ref"] - log["omega_true"]).mean())

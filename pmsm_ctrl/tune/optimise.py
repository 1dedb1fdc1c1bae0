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

__all__ = ["Optimum", "optimise", "reversal"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Optimum:
    """The best speed gains found, and those the search started from.

    Attributes
    ----------
    design : Design
        With the gains set.
    cost, cost_before : float
        Mean absolute speed error over the test motion, rad/s.
    margins : Margins
        Of the optimised speed loop.
    """

    design: Design
    cost: float
    cost_before: float
    margins: Margins


def reversal(design: Design, speed: float, duration: float = 0.6) -> Scenario:
    """Return a slow reversal through standstill and a load step at rest, where friction matters most.

    A triangle of this amplitude (rad/s) for two thirds of the duration (s), then rest, with a quarter of the drive's
    largest torque as load.
    """
    third = duration / 3.0
    load = 0.25 * design.K_t * min(design.drive.i_max, 1e3)

    def inputs(t: Array) -> dict[str, Array]:
        triangle = speed * (1.0 - 2.0 * np.abs((t / third) % 2.0 - 1.0))
        return {
            "omega_ref": np.asarray(np.where(t < 2.0 * third, triangle, 0.0), dtype=np.float64),
            "T_load": np.asarray(load * (t >= 2.5 * third), dtype=np.float64),
        }

    return Scenario("reversal", duration, inputs, omega_0=-speed)


def optimise(
    design: Design,
    motion: Scenario,
    *,
    requirements: Requirements | None = None,
    iterations: int = 40,
    progress: Callable[[float], None] | None = None,
) -> Optimum:
    """Search K_p and T_n of the speed loop on the simulated drive, within the margins.

    Parameters
    ----------
    design : Design
        With its loops set (by `tune`): the start of the search.
    motion : Scenario
        Over which the speed error is averaged, such as `reversal`.
    requirements : Requirements, optional
        Gains that miss them are rejected.
    iterations : int
        Largest number of simulations of the Nelder-Mead search.
    progress : function, optional
        Called with the share done, 0 to 1.

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
    cascade = Cascade.of(design, loops.current, at=max(abs(motion.omega_0), 1e-3))
    runs, start = 0, math.inf

    def gains(x: Array) -> SpeedLoop:
        K_p, T_n = loops.speed.K_p * math.exp(x[0]), loops.speed.T_n * math.exp(x[1])
        return loops.speed.model_copy(update={"K_p": K_p, "T_n": T_n})

    def cost(x: Array) -> float:
        nonlocal runs
        runs += 1
        if progress is not None:
            progress(min(1.0, runs / iterations))
        candidate = gains(x)
        shortfall = requirements.shortfall(margins(open_loop(cascade, candidate)))
        if shortfall > 0.0:
            # A sloping penalty leads the search back; its height is the cost of the start.
            return start * (1.5 + min(shortfall, 10.0)) if runs > 1 else math.inf
        return _error(design, candidate, motion)

    start = cost(np.zeros(2))
    if not math.isfinite(start):
        raise RequestError("the gains to start from miss the requirements; tune them first, or lower the requirements")
    found = minimize(
        cost, np.zeros(2), method="Nelder-Mead",
        options={"maxfev": iterations, "initial_simplex": [[0.0, 0.0], [0.2, 0.0], [0.0, -0.3]], "xatol": 0.01},
    )  # fmt: skip
    best = gains(found.x if found.fun < start else np.zeros(2))
    cost_found = float(min(found.fun, start))
    return Optimum(_with_speed_loop(design, best), cost_found, start, margins(open_loop(cascade, best)))


def _with_speed_loop(design: Design, gains: SpeedLoop) -> Design:
    return design.model_copy(update={"loops": design.require_loops().model_copy(update={"speed": gains})})


def _error(design: Design, candidate: SpeedLoop, motion: Scenario) -> float:
    """Mean absolute speed error on the simulated drive, rad/s; infinite when the simulation diverges."""
    try:
        log = simulate(_with_speed_loop(design, candidate), motion, keep_truth=True)
    except SimulationError:
        return math.inf
    return float(np.abs(log["omega_ref"] - log["omega_true"]).mean())

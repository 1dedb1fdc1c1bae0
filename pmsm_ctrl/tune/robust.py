"""Margins at the corners of the datasheet's tolerances, the worst one named, and gains that keep it.

At a corner every parameter is at one end of its tolerance. The controller keeps assuming the datasheet. On an axis with
two masses the inertias of motor and load and the stiffness between them vary apart.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from pmsm_ctrl.design import CurrentLoop, Design, SpeedLoop
from pmsm_ctrl.effects import bound_effects
from pmsm_ctrl.effects.structures import SecondMass
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.tune.linearise import second_mass
from pmsm_ctrl.tune.margins import Margins, margins
from pmsm_ctrl.tune.requirements import Missed, Requirements
from pmsm_ctrl.tune.sampled import Cascade, current_loop, frequencies
from pmsm_ctrl.tune.speed import open_loop

__all__ = ["Corner", "Robustness", "corners", "robust_gains", "robustness", "varied", "varied_load"]

VARIED = ("J", "psi_f", "R", "L_q")
LOAD = ("J_load", "k")  # of two masses: inertia of the load, and stiffness
STIFFNESS = 0.2  # relative tolerance of the stiffness where the motor's table states none
INSIDE = 4  # random points inside the tolerances, judged as a check that the worst point is a corner
RATIO, STEPS = 1.1, 40  # of the search for slower gains


@dataclass(frozen=True)
class Corner:
    """One combination of parameters and the margins there.

    Attributes
    ----------
    deviations : mapping of str to float
        Relative, by symbol.
    current, speed : Margins
    """

    deviations: Mapping[str, float]
    current: Margins
    speed: Margins

    @property
    def name(self) -> str:
        """The deviations: ``J -15 %, psi_f +7 %``."""
        return ", ".join(f"{symbol} {100.0 * d:+.3g} %" for symbol, d in self.deviations.items()) or "nominal"


@dataclass(frozen=True)
class Robustness:
    """Margins over the tolerances.

    Attributes
    ----------
    nominal : Corner
    worst_current, worst_speed : Corner
        With the smallest margins of the loop, by the requirement that is closest to being missed.
    corners : int
        How many points were judged.
    requirements : Requirements
    slowed : float
        Factor by which the speed loop was slowed down to keep them; 1 when it was not.
    """

    nominal: Corner
    worst_current: Corner
    worst_speed: Corner
    corners: int
    requirements: Requirements
    slowed: float = 1.0

    @property
    def missed(self) -> tuple[tuple[str, Corner, Missed], ...]:
        """Loop, corner and requirement for each that is missed."""
        return tuple(
            (loop, corner, item)
            for loop, corner, found in (
                ("current", self.worst_current, self.worst_current.current),
                ("speed", self.worst_speed, self.worst_speed.speed),
            )
            for item in self.requirements.missed(found)
        )


def varied(design: Design, deviations: Mapping[str, float]) -> Design:
    """Return the plant with relative deviations of `J` (all inertias), `psi_f`, `R` and `L_q` (`L_d` alike).

    Where the deviation of the load's inertia `J_load` is given too, `J` is the motor's alone.
    """
    factor = {symbol: 1.0 + value for symbol, value in deviations.items() if symbol not in LOAD}
    motor: dict[str, float] = {symbol: getattr(design.motor, symbol) * factor[symbol] for symbol in factor}
    if "L_q" in factor and design.motor.L_d is not None:
        motor["L_d"] = design.motor.L_d * factor["L_q"]
    f = factor.get("J", 1.0)
    changed = design.replace(motor=motor, load={"J": design.load.J * f, "gear": design.load.gear})
    for effect, values in bound_effects(design):
        scaled = effect.structure.with_inertia_scaled(values, f)
        if scaled != values:
            changed = changed.with_effect(effect.id, scaled)
    mass = varied_load(design, deviations)
    if mass is None:
        return changed
    nominal = second_mass(design)
    assert nominal is not None
    return changed.replace(motor={"J": (design.J - nominal.J_load) * f + mass.J_load}, load={"J": 0.0})


def varied_load(design: Design, deviations: Mapping[str, float]) -> SecondMass | None:
    """Return the load behind the spring with the deviations of `J_load` and `k`; None where neither is given."""
    mass = second_mass(design)
    if mass is None or not set(LOAD) & set(deviations):
        return None
    load = deviations.get("J_load", deviations.get("J", 0.0))
    return replace(mass, J_load=mass.J_load * (1.0 + load), k=mass.k * (1.0 + deviations.get("k", 0.0)))


def corners(design: Design) -> list[dict[str, float]]:
    """Return the relative deviations at every corner of the motor's tolerances."""
    stated = design.motor.tolerance
    spans = {symbol: stated.get(symbol, 0.0) for symbol in VARIED}
    if second_mass(design) is not None:
        spans |= {"J_load": stated.get("J_load", spans["J"]), "k": stated.get("k", STIFFNESS)}
    spans = {symbol: tolerance for symbol, tolerance in spans.items() if tolerance > 0.0}
    signs = itertools.product((-1.0, 1.0), repeat=len(spans))
    return [dict(zip(spans, (s * t for s, t in zip(sign, spans.values(), strict=True)), strict=True)) for sign in signs]


@dataclass(frozen=True, eq=False)
class _Judge:
    """Margins of one pair of controllers on plants with other parameters."""

    design: Design
    current: CurrentLoop
    speed: SpeedLoop
    requirements: Requirements
    at: float
    seen: dict[tuple[float, ...], Margins] = field(default_factory=dict)

    def corner(self, deviations: Mapping[str, float]) -> Corner:
        truth = varied(self.design, deviations) if deviations else self.design
        mass = varied_load(self.design, deviations)
        cascade = Cascade.of(self.design, self.current, truth=truth, at=self.at, mass=mass)
        # The current loop depends on the winding alone: corners that share it share its margins.
        winding = tuple(deviations.get(symbol, 0.0) for symbol in ("R", "L_q"))
        if winding not in self.seen:
            loop = current_loop(self.design, self.current, truth=truth)
            self.seen[winding] = margins(loop, frequencies(loop.dt, 1e-3, 500))
        grid = frequencies(cascade.period, 1e-3, 600)
        return Corner(deviations, self.seen[winding], margins(open_loop(cascade, self.speed), grid))

    def worst(self, points: Iterable[Mapping[str, float]]) -> Robustness:
        judged = [self.corner(deviations) for deviations in points]
        by_current = max(judged, key=lambda c: self.requirements.shortfall(c.current))
        by_speed = max(judged, key=lambda c: self.requirements.shortfall(c.speed))
        return Robustness(judged[0], by_current, by_speed, len(judged), self.requirements)


def robustness(
    design: Design, *, requirements: Requirements | None = None, at: float = 1e-3, inside: int = INSIDE, seed: int = 0
) -> Robustness:
    """Judge the gains of a design over the tolerances of the motor's parameters, linearised at a speed (rad/s).

    `inside` random points inside the tolerances are judged as well, as a check that the worst point is a corner.
    """
    loops = design.require_loops()
    judge = _Judge(design, loops.current, loops.speed, requirements or Requirements(), at)
    all_corners = corners(design)
    rng = np.random.default_rng(seed)
    points = [{s: float(v * rng.uniform(-1.0, 1.0)) for s, v in all_corners[-1].items()} for _ in range(inside)]
    return replace(judge.worst([*all_corners, *points]), nominal=judge.corner({}))


def robust_gains(
    design: Design,
    current: CurrentLoop,
    make: Callable[[float, CurrentLoop], SpeedLoop],
    requirements: Requirements,
    at: float,
) -> tuple[CurrentLoop, SpeedLoop, float]:
    """Slow both loops down until the worst corner meets the requirements.

    Parameters
    ----------
    design : Design
    current : CurrentLoop
        Nominal; its gains are divided by the factor needed.
    make : callable
        Returns the speed loop for a factor >= 1, by which it is slower than asked, and the current controllers.
    requirements : Requirements
    at : float
        Speed at which the plant is linearised, rad/s.

    Returns
    -------
    current : CurrentLoop
    speed : SpeedLoop
    slowed : float
        The factor for the speed loop.

    Raises
    ------
    RequestError
        When the slowest loops still miss something at some corner; the message names it.
    """
    factor = 1.0
    # The corner that was worst is judged alone until it meets the requirements; then all of them once more.
    every: list[Mapping[str, float]] = [*corners(design)]
    suspects = every
    for _ in range(STEPS):
        speed = make(factor, current)
        found = _Judge(design, current, speed, requirements, at).worst(suspects)
        slow = {loop for loop, *_ in found.missed}
        if not slow:
            if suspects is every:
                return current, speed, factor
            suspects = every
            continue
        suspects = [found.worst_current.deviations, found.worst_speed.deviations]
        if "current" in slow:
            K_p_d = current.K_p_d / RATIO if current.K_p_d else None
            current = current.model_copy(update={"K_p": current.K_p / RATIO, "K_p_d": K_p_d})
        if "speed" in slow:
            factor *= RATIO
    words = [f"{loop} loop at {corner.name}: {item}" for loop, corner, item in found.missed]
    raise RequestError(f"no gains keep the margins over the tolerances: {(words or ['search not finished'])[0]}")

"""Margins at the corners of the datasheet's tolerances, the worst one named, and gains that keep it.

At a corner every parameter is at one end of its tolerance. The controller keeps believing the datasheet.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from pmsm_ctrl.design import CurrentLoop, Design, SpeedLoop
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.tune.linearise import TWO_MASS
from pmsm_ctrl.tune.margins import Margins, margins
from pmsm_ctrl.tune.requirements import Requirements
from pmsm_ctrl.tune.sampled import Cascade, current_loop, frequencies
from pmsm_ctrl.tune.speed import open_loop

__all__ = ["Corner", "Robustness", "corners", "robust_gains", "robustness", "varied"]

VARIED = ("J", "psi_f", "R", "L_q")


@dataclass(frozen=True)
class Corner:
    """One combination of parameters and the margins there."""

    deviations: Mapping[str, float]
    current: Margins
    speed: Margins

    @property
    def name(self) -> str:
        """The corner in words: ``J -15 %, psi_f +7 %``."""
        return ", ".join(f"{symbol} {100.0 * d:+.3g} %" for symbol, d in self.deviations.items()) or "nominal"


@dataclass(frozen=True)
class Robustness:
    """Margins over the tolerances.

    Attributes
    ----------
    nominal : Corner
    worst_current, worst_speed : Corner with the least margins, by the requirement that is closest to being missed
    corners : how many were judged, with random points inside as a check that the worst is a corner
    missed : what the worst corner misses; empty when everything is kept
    slowed : by which factor the speed loop was slowed down to keep it (1 = not at all)
    """

    nominal: Corner
    worst_current: Corner
    worst_speed: Corner
    corners: int
    missed: tuple[str, ...]
    slowed: float = 1.0


def varied(design: Design, deviations: Mapping[str, float]) -> Design:
    """Return the plant with relative deviations of `J` (all inertias), `psi_f`, `R` and `L_q` (`L_d` alike)."""
    factor = {symbol: 1.0 + value for symbol, value in deviations.items()}
    motor: dict[str, float] = {}
    for symbol in ("J", "psi_f", "R", "L_q"):
        if symbol in factor:
            motor[symbol] = getattr(design.motor, symbol) * factor[symbol]
    if "L_q" in factor and design.motor.L_d is not None:
        motor["L_d"] = design.motor.L_d * factor["L_q"]
    f = factor.get("J", 1.0)
    changed = design.replace(motor=motor, load={"J": design.load.J * f, "gear": design.load.gear})
    for name in TWO_MASS:
        spring = design.parameters(name)
        if "J_load" in spring:
            changed = changed.with_effect(name, spring | {"J_load": spring["J_load"] * f})
    return changed


def corners(design: Design) -> list[dict[str, float]]:
    """Return the deviations at every corner of the motor's tolerances."""
    spans = {symbol: design.motor.tolerance.get(symbol, 0.0) for symbol in VARIED}
    spans = {symbol: tolerance for symbol, tolerance in spans.items() if tolerance > 0.0}
    signs = itertools.product((-1.0, 1.0), repeat=len(spans))
    return [dict(zip(spans, (s * t for s, t in zip(sign, spans.values(), strict=True)), strict=True)) for sign in signs]


def _judge(
    design: Design,
    deviations: Mapping[str, float],
    current: CurrentLoop,
    speed: SpeedLoop,
    at: float,
    seen: dict[tuple[float, ...], Margins],
) -> Corner:
    truth = varied(design, deviations) if deviations else design
    cascade = Cascade.of(design, current, truth=truth, at=at)
    # The current loop knows only the winding: corners that share it share its margins.
    winding = tuple(deviations.get(symbol, 0.0) for symbol in ("R", "L_q"))
    if winding not in seen:
        loop = current_loop(design, current, truth=truth)
        seen[winding] = margins(loop, frequencies(loop.dt, 1e-3, 500), brief=True)
    grid = frequencies(cascade.period, 1e-3, 600)
    return Corner(deviations, seen[winding], margins(open_loop(cascade, speed), grid, brief=True))


def robustness(
    design: Design,
    current: CurrentLoop,
    speed: SpeedLoop,
    *,
    requirements: Requirements | None = None,
    at: float = 1e-3,
    inside: int = 4,
    seed: int = 0,
) -> Robustness:
    """Judge the gains over the tolerances of the motor's parameters.

    Parameters
    ----------
    design : Design
        Its ``motor.tolerance`` is used.
    current, speed : the gains
    requirements : Requirements, optional
    at : speed in rad/s at which the plant is linearised
    inside : random points inside the tolerances, judged as well
    """
    requirements = requirements or Requirements()
    all_corners = corners(design)
    rng = np.random.default_rng(seed)
    points = [{s: float(v * rng.uniform(-1.0, 1.0)) for s, v in all_corners[-1].items()} for _ in range(inside)]
    seen: dict[tuple[float, ...], Margins] = {}
    nominal = _judge(design, {}, current, speed, at, seen)
    judged = [_judge(design, deviations, current, speed, at, seen) for deviations in (*all_corners, *points)]
    by_current = max(judged, key=lambda c: requirements.shortfall(c.current))
    by_speed = max(judged, key=lambda c: requirements.shortfall(c.speed))
    missed = [f"current loop at {by_current.name}: {m}" for m in requirements.missed(by_current.current)]
    missed += [f"speed loop at {by_speed.name}: {m}" for m in requirements.missed(by_speed.speed)]
    return Robustness(nominal, by_current, by_speed, len(judged), tuple(missed))


def robust_gains(
    design: Design,
    current: CurrentLoop,
    make: Callable[[float, CurrentLoop], SpeedLoop],
    *,
    requirements: Requirements | None = None,
    at: float = 1e-3,
    ratio: float = 1.1,
    steps: int = 40,
) -> tuple[CurrentLoop, SpeedLoop, Robustness]:
    """Slow both loops down until the worst corner keeps the requirements.

    Parameters
    ----------
    current : the nominal current controllers; their gains are divided by the factor needed
    make : function of a factor >= 1, by which the speed loop is slower than asked, and of the current controllers

    Raises
    ------
    RequestError
        When the slowest loops still miss something at some corner; the message names it.
    """
    requirements = requirements or Requirements()
    factor = 1.0
    # The corner that was worst is looked at alone until it is kept; then all of them once more.
    suspects: list[Mapping[str, float]] = [*corners(design)]
    every = len(suspects)
    for _ in range(steps):
        speed = make(factor, current)
        seen: dict[tuple[float, ...], Margins] = {}
        judged = [_judge(design, deviations, current, speed, at, seen) for deviations in suspects]
        by_current = max(judged, key=lambda c: requirements.shortfall(c.current))
        by_speed = max(judged, key=lambda c: requirements.shortfall(c.speed))
        slow_current = bool(requirements.missed(by_current.current))
        slow_speed = bool(requirements.missed(by_speed.speed))
        if not slow_current and not slow_speed:
            if len(suspects) == every:
                found = robustness(design, current, speed, requirements=requirements, at=at)
                return current, speed, replace(found, slowed=factor)
            suspects = [*corners(design)]
            continue
        suspects = [by_current.deviations, by_speed.deviations]
        if slow_current:
            current = current.model_copy(
                update={"K_p": current.K_p / ratio, "K_p_d": current.K_p_d / ratio if current.K_p_d else None}
            )
        if slow_speed:
            factor *= ratio
    missed = [f"current loop at {by_current.name}: {m}" for m in requirements.missed(by_current.current)]
    missed += [f"speed loop at {by_speed.name}: {m}" for m in requirements.missed(by_speed.speed)]
    raise RequestError(f"no gains keep the margins over the tolerances: {(missed or ['search not finished'])[0]}")

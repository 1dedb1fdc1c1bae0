"""Margins at the corners of the datasheet's tolerances, the worst one named, and gains that keep it.

At a corner every parameter is at one end of its tolerance. The controller keeps believing the datasheet.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from pmsm_ctrl.design import CurrentLoop, Design, SpeedLoop
from pmsm_ctrl.effects import Effect
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
    own: tuple[Effect, ...],
) -> Corner:
    truth = varied(design, deviations) if deviations else design
    cascade = Cascade.of(design, current, truth=truth, at=at, own=own)
    coarse = frequencies(cascade.period, 1e-3, 500)
    loop = current_loop(design, current, truth=truth)
    return Corner(
        deviations, margins(loop, frequencies(loop.dt, 1e-3, 500)), margins(open_loop(cascade, speed), coarse)
    )


def robustness(
    design: Design,
    current: CurrentLoop,
    speed: SpeedLoop,
    *,
    requirements: Requirements | None = None,
    at: float = 1e-3,
    own: Iterable[Effect] = (),
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
    requirements, own = requirements or Requirements(), tuple(own)
    all_corners = corners(design)
    rng = np.random.default_rng(seed)
    points = [{s: float(v * rng.uniform(-1.0, 1.0)) for s, v in all_corners[-1].items()} for _ in range(inside)]
    nominal = _judge(design, {}, current, speed, at, own)
    judged = [_judge(design, deviations, current, speed, at, own) for deviations in (*all_corners, *points)]
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
    own: Iterable[Effect] = (),
    ratio: float = 1.1,
    steps: int = 30,
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
    found: Robustness | None = None
    for _ in range(steps):
        speed = make(factor, current)
        found = robustness(design, current, speed, requirements=requirements, at=at, own=own, inside=0)
        if not found.missed:
            final = robustness(design, current, speed, requirements=requirements, at=at, own=own)
            return (
                current,
                speed,
                Robustness(final.nominal, final.worst_current, final.worst_speed, final.corners, final.missed, factor),
            )
        if any(item.startswith("current") for item in found.missed):
            current = current.model_copy(
                update={"K_p": current.K_p / ratio, "K_p_d": current.K_p_d / ratio if current.K_p_d else None}
            )
        if any(item.startswith("speed") for item in found.missed):
            factor *= ratio
    assert found is not None
    raise RequestError(f"no gains keep the margins over the tolerances: {found.missed[0]}")

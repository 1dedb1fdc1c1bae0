"""Drives that apply a downloaded compensator in one way or another."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.compensate.motions import named_trial
from pmsm_ctrl.compensate.runs import baseline
from pmsm_ctrl.design import Design
from pmsm_ctrl.log import Log
from pmsm_ctrl.simulate import Scenario, simulate
from pmsm_ctrl.simulate.fed_forward import fed_currents

__all__ = ["WAYS", "applied", "logs_of", "verified_design"]

Array = NDArray[np.float64]

# name -> gain by effect ("all" for those that are not named), and delay in s
WAYS: dict[str, tuple[Mapping[str, float], float]] = {
    "nothing": ({"all": 0.0}, 0.0),
    "half": ({"all": 0.5}, 0.0),
    "as designed": ({"all": 1.0}, 0.0),
    "reversed": ({"all": -1.0}, 0.0),
    "one and a half": ({"all": 1.5}, 0.0),
    "3 ms late": ({"all": 1.0}, 0.003),
    "Coulomb alone": ({"coulomb": 1.0, "all": 0.0}, 0.0),
    "viscous alone": ({"viscous": 1.0, "all": 0.0}, 0.0),
}


def verified_design(design: Design) -> Design:
    """Return the design with inertia and delay fed forward, and its compensation at a gain of 1."""
    return baseline(design).model_copy(
        update={"compensation": design.compensation.model_copy(update={"gain": 1.0, "source": "reference"})}
    )


def applied(
    design: Design, motion: Scenario, gains: Mapping[str, float], late: float = 0.0,
    sign: Callable[[Array], Array] | None = None,
) -> Scenario:  # fmt: skip
    """Return a motion whose drive adds each part of the compensator with a gain of its own, `late` s behind.

    `sign` is what the drive takes for the sign of the speed; dry friction turns with it.
    """

    def references(t: Array) -> Mapping[str, Array]:
        earlier = motion.references(np.maximum(t - late, 0.0))
        speed = np.asarray(earlier["omega_ref"])
        channels = {"theta": np.asarray(earlier.get("theta_ref", np.zeros_like(speed))), "i_q": np.zeros_like(speed)}
        parts = fed_currents(design, channels, speed, design.drive.speed_period)
        if sign is not None:
            dry = {name: np.abs(one) * sign(speed) for name, one in parts.items() if name in ("coulomb", "stribeck")}
            parts = {**parts, **dry}
        current = np.sum([gains.get(name, gains.get("all", 0.0)) * one for name, one in parts.items()], axis=0)
        return {**motion.references(t), "i_q_add": current}

    return replace(motion, references=references)


def logs_of(
    design: Design, trial: str | Scenario, way: tuple[Mapping[str, float], float], seed: int, *,
    plant: Design | None = None,
) -> tuple[Log, Log]:  # fmt: skip
    """Return the logs of a motion before and after a download; `plant` is the axis of the second one."""
    off = design.model_copy(update={"compensation": design.compensation.model_copy(update={"gain": 0.0})})
    motion = named_trial(off, trial).motions[0] if isinstance(trial, str) else trial
    after = applied(design, motion, *way)
    return simulate(off, motion, seed=seed), simulate(off, after, truth=plant or off, seed=seed + 5000)

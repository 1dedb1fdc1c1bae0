"""Named motions. A scenario knows its duration and gives the references at any times asked for."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import RequestError, nearest

__all__ = ["INPUTS", "SCENARIOS", "Scenario", "scenario"]

Array = NDArray[Any]

# What a scenario may prescribe, in the kernel's order; what it leaves out is zero.
INPUTS: tuple[str, ...] = ("theta_ref", "omega_ref", "alpha_ref", "i_q_add", "i_d_ref", "T_load")


@dataclass(frozen=True)
class Scenario:
    """A motion to simulate.

    Attributes
    ----------
    name, duration
        Name and length in s.
    references : function of time
        ``references(t)`` with t in s, shape (n,), returns any of `INPUTS` as arrays of shape (n,), SI units.
        `i_q_add` is added to the speed controller's output (feedforward, or the injected test signal).
    control : {"speed", "position", "current"}
        The outermost loop that is closed.
    omega_0, theta_0 : initial speed and angle
    segments : (name, start, stop) in s
    """

    name: str
    duration: float
    references: Callable[[Array], Mapping[str, Array]]
    control: Literal["speed", "position", "current"] = "speed"
    omega_0: float = 0.0
    theta_0: float = 0.0
    segments: tuple[tuple[str, float, float], ...] = field(default=())

    def inputs(self, t: Array) -> Array:
        """Return the references at times `t`, shape (n, 6), in the order of `INPUTS`."""
        given = self.references(t)
        for name in given:
            if name not in INPUTS:
                raise RequestError(f"scenario '{self.name}': unknown input '{name}'{nearest(name, INPUTS)}")
        out = np.zeros((len(t), len(INPUTS)))
        for column, name in enumerate(INPUTS):
            if name in given:
                out[:, column] = given[name]
        return out


def sweep(
    *,
    speed_max: float = 200.0,
    speed_step: float = 10.0,
    dwell: float = 1.0,
) -> Scenario:
    """Speed staircase from -speed_max to speed_max (rad/s), `dwell` s each: the reference paper's experiment."""
    count = round(2.0 * speed_max / speed_step)
    levels = -speed_max + speed_step * np.arange(count + 1)

    def references(t: Array) -> Mapping[str, Array]:
        index = np.clip((t / dwell).astype(np.intp), 0, count)
        return {"omega_ref": levels[index]}

    segments = tuple((f"{level:g} rad/s", k * dwell, (k + 1) * dwell) for k, level in enumerate(levels.tolist()))
    return Scenario("sweep", dwell * (count + 1), references, segments=segments)


SCENARIOS: Mapping[str, Callable[..., Scenario]] = {
    "sweep": sweep,
}


def scenario(name: str, design: Design | None = None, **parameters: float) -> Scenario:
    """Return a named scenario; parameters come from the call, then from the design's ``[scenarios.NAME]``.

    Raises
    ------
    RequestError
        For an unknown scenario or parameter, or a duration that is not positive.
    """
    if name not in SCENARIOS:
        raise RequestError(f"unknown scenario '{name}'{nearest(name, SCENARIOS)} (known: {', '.join(SCENARIOS)})")
    maker = SCENARIOS[name]
    known = list(inspect.signature(maker).parameters)
    values = dict(design.scenarios.get(name, {})) if design is not None else {}
    values |= parameters
    for key in values:
        if key not in known:
            raise RequestError(
                f"scenario '{name}': unknown parameter '{key}'{nearest(key, known)} (known: {', '.join(known)})"
            )
    made = maker(**values)
    if not (made.duration > 0.0 and math.isfinite(made.duration)):
        raise RequestError(f"scenario '{name}': its duration is {made.duration:g} s; it should be positive")
    return made

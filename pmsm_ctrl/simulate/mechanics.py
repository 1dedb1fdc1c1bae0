"""The axis driven by a logged torque: forward dynamics with every torque effect of a design.

The torque balance, the step through standstill, springs, gaps and bristles are those of the simulated drive.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects import Effect, bound_effects
from pmsm_ctrl.effects.catalogue import CATALOGUE
from pmsm_ctrl.effects.signals import INTERNAL
from pmsm_ctrl.simulate.compose import BARE_STATES, completed, lines_of, module_of, source, structures
from pmsm_ctrl.simulate.resolution import RESOLVED, second_mass

__all__ = ["INPUTS", "Mechanics"]

Array = NDArray[np.float64]
Bound = tuple[Effect, dict[str, float]]

# What drives the axis, in the kernel's order.
INPUTS = ("torque", "T_load", "i_d", "i_q")
# Longest integration step, s; and what a step may be of a wave's angle, rad.
LONGEST, WAVE = 1e-3, 0.5
# Most integration steps per sample: what is faster still is simulated slower than it is.
MOST = 64
CHUNK = 1 << 20  # integration steps between two progress reports: a fraction of a second
WAVES = 3  # waves of a turn of one kind that the usual kernel has room for
# What follows from the states.
_OWN = {"omega", "theta", "direction", "t", *INTERNAL}
_TEMPLATE = Path(__file__).resolve().parent.parent / "kernels" / "mechanics_template.py"
# Marks of the drive's text, replaced so that the drive's torque is the logged one and no current has dynamics.
_DRIVEN = {
    "drive torque": ["return machine[0]"],
    "direct current": ["di_d = 0.0"],
    "incremental inductance": ["di_q = 0.0"],
}


@dataclass(frozen=True, eq=False)
class Mechanics:
    """The mechanics of a design, ready to be driven by sampled torques.

    Attributes
    ----------
    bound : tuple of (Effect, dict)
        The active torque effects with their values.
    J : float
        Total inertia, kg m^2 (kg).
    period : float
        Of the samples, s.
    steps : int
        Integration steps per sample.
    p : float
        Pole pairs; 0 where they are not known.
    left_out : dict of effect id to str
        Active torque effects that need a signal the log does not have, and which.
    """

    bound: tuple[Bound, ...]
    J: float
    period: float
    steps: int
    p: float
    left_out: Mapping[str, str]

    @classmethod
    def of(cls, design: Design, period: float, top_speed: float, known: Iterable[str] = INPUTS) -> Mechanics:
        """Read the mechanics from a design.

        Parameters
        ----------
        design : Design
        period : float
            Of the samples, s.
        top_speed : float
            Of the motion, rad/s (m/s).
        known : iterable of str
            The signals of `INPUTS` that are there.

        Raises
        ------
        DesignError
            For an unknown effect, or a parameter outside its bounds.
        """
        there = {*_OWN, *known}
        there = there if design.motor.p is not None else there - {"p"}
        bound, left_out = [], {}
        for effect, values in bound_effects(design):
            if effect.enters != "torque" or not effect.active(values):
                continue
            missing = [name for name in effect.signals if name not in there]
            if missing:
                left_out[effect.id] = f"the log has no {', '.join(missing)}"
            else:
                bound.append((effect, values))
        p = float(design.motor.p or 0)
        made = cls(tuple(bound), design.J, period, _steps(bound, design.J, period, top_speed, p), p, left_out)
        while made.steps < MOST and any(kept != v for kept, (_, v) in zip(made.simulated(), bound, strict=True)):
            made = replace(made, steps=2 * made.steps)  # a structure limits what a step does not resolve
        return made

    def with_values(self, J: float, values: Sequence[Mapping[str, float]]) -> Mechanics:
        """Return the same effects with other parameters, one mapping an effect; the integration step stays.

        Parameters
        ----------
        J : float
        values : sequence of mapping
        """
        pairs = zip((effect for effect, _ in self.bound), values, strict=True)
        return replace(self, J=J, bound=tuple((effect, dict(v)) for effect, v in pairs))

    def simulated(self) -> list[dict[str, float]]:
        """Return the parameters of the effects as one integration step resolves them.

        Raises
        ------
        DesignError
            When a load is heavier than the whole axis.
        """
        dry = sum(abs(e.standing(v, p=self.p)) for e, v in self.bound if e.dry)
        mass = second_mass(self.bound)
        shaft = self if mass is None else replace(self, J=self.J - mass.J_load)  # a bristle acts on the motor alone
        return [
            e.structure.simulated(e, v, self if e.structure.splits_inertia else shaft, dry, f"effects.{e.id}")
            for e, v in self.bound
        ]

    def run(
        self,
        inputs: Mapping[str, Array],
        starts: NDArray[np.int64],
        motion: tuple[Array, Array],
        length: int,
        progress: Callable[[float], None] | None = None,
        gains: tuple[float, float] = (0.0, 0.0),
    ) -> Array:
        """Simulate stretches of a log.

        Parameters
        ----------
        inputs : mapping of str to array, shape (n,)
            Signals of `INPUTS`; what is left out is zero.
        starts : int array, shape (w,)
            First samples of the stretches.
        motion : (array, array), shape (n,)
            Speed and position as they were measured: the states at the starts. Springs are relaxed there, bristles bent
            by the motion before.
        length : int
            Samples of a stretch.
        progress : function, optional
            Called with the share done, 0 to 1.
        gains : (float, float)
            1/s, and a number: behind every sample the simulated speed and position are corrected by so much of what the
            measured position is beside the simulated one, as an observer does. Not at all when left out.

        Returns
        -------
        array, shape (w, length, 2)
            Speed, rad/s (m/s), and position, rad (m), not yet corrected. Not finite where the model is unstable.
        """
        n = len(inputs["torque"])
        table = np.stack([np.asarray(inputs.get(name, np.zeros(n)), dtype=np.float64) for name in INPUTS])
        carried, effects = _carried(self.bound, self.simulated())
        kinds = structures(carried)
        omega, theta = (np.asarray(values, dtype=np.float64) for values in motion)
        memory = np.zeros((len(starts), BARE_STATES + sum(kind.memory for kind, _ in kinds)))
        memory[:, 2], memory[:, 3] = omega[starts], theta[starts]
        for kind, offset in ((kind, offset) for kind, offset in kinds if kind.memory):
            effect, values = next((e, v) for e, v in self.bound if isinstance(e.structure, kind))
            along = effect.structure.memory_along(effect, values, omega, theta)
            memory[:, offset : offset + kind.memory] = along[starts]
        out = np.empty((len(starts), length, 2))
        first, module = np.ascontiguousarray(starts, dtype=np.int64), _load(carried)
        piece = max(2, CHUNK // (len(starts) * self.steps))
        for k in range(0, max(length - 1, 1), piece):
            part = np.empty((len(starts), min(piece, length - 1 - k) + 1, 2))
            module.run(table, first + k, memory, self.period, self.steps, self.p, self.J, effects, theta, gains, part)
            out[:, k : k + part.shape[1]] = part
            if progress is not None:
                progress((k + part.shape[1]) / length)
        return out


def _steps(bound: Sequence[Bound], J: float, period: float, top_speed: float, p: float) -> int:
    """Return the integration steps per sample that the fastest part of the mechanics needs."""
    needed = period / LONGEST
    for effect, values in bound:
        if effect.order or effect.period:
            needed = max(needed, effect.waves(values, p) * top_speed * period / WAVE)
    load = second_mass(bound)
    if load is not None and 0.0 < load.J_load < J:
        inverse = 1.0 / load.J_load + 1.0 / (J - load.J_load)
        needed = max(needed, period * math.sqrt(load.k * inverse) / RESOLVED, period * load.d * inverse / RESOLVED)
    return min(MOST, max(1, math.ceil(needed * (1.0 - 1e-3))))


@lru_cache
def _usual() -> tuple[Effect, ...]:
    """Return the effects that every kernel holds: with what is zero skipped, one kernel serves nearly all designs."""
    plain = [e for e in CATALOGUE.values() if e.enters == "torque" and not e.has_state]
    return tuple(effect for effect in plain for _ in range(WAVES if effect.order and effect.repeated else 1))


def _carried(
    bound: Sequence[Bound], simulated: Sequence[Mapping[str, float]]
) -> tuple[tuple[Effect, ...], tuple[float, ...]]:
    """Return the effects of the kernel for these, and all their parameters in its order."""
    left = [(effect, values) for (effect, _), values in zip(bound, simulated, strict=True)]
    if not any(effect.dry for effect, _ in left):  # a bristle carries dry friction
        left = [(effect, values) for effect, values in left if not effect.structure.replaces_direction]
    pairs: list[Bound] = []
    for effect in _usual():
        at = next((n for n, (one, _) in enumerate(left) if one is effect), None)
        off = {p.symbol: p.start for p in effect.parameters} | dict.fromkeys(effect.amplitudes, 0.0)
        pairs.append((effect, off) if at is None else (effect, dict(left.pop(at)[1])))
    pairs += [(effect, dict(values)) for effect, values in left]
    return tuple(effect for effect, _ in pairs), tuple(v for _, values in pairs for v in values.values())


@lru_cache(maxsize=64)
def _load(carried: tuple[Effect, ...]) -> ModuleType:
    lines = lines_of(carried)
    lines["torque"] = [part for line in lines["torque"] for part in _where_active(line, carried)]
    drive, _, _ = source(carried, driven={**lines, **_DRIVEN}).partition("@inlined\ndef measure(")
    # called and not inlined seven times: it is long, and a call costs a nanosecond
    drive = drive.replace("@inlined\ndef shaft_torque", "@kernel\ndef shaft_torque")
    return module_of(completed(_TEMPLATE, {**lines, "drive": drive.splitlines()}), carried, ())


def _where_active(line: str, carried: Sequence[Effect]) -> tuple[str, str]:
    """Return a line that adds a term, behind the condition that the effect is on."""
    number = int(line.partition("_term(")[0].rpartition("e")[2])
    on = " or ".join(f"e{number}_{symbol} != 0.0" for symbol in carried[number].amplitudes)
    return f"if {on}:", f"    {line}"

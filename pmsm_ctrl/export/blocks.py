"""What is exported, before it has a language: inputs, outputs, memory, constants and the flat program."""

from __future__ import annotations

import ast
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from pmsm_ctrl.design import Design
from pmsm_ctrl.export.program import Program
from pmsm_ctrl.export.writers import plain
from pmsm_ctrl.units import axis_unit

__all__ = ["Block", "Value", "identifier", "loop_gains"]


@dataclass(frozen=True)
class Value:
    """An input, an output or a constant: its name, what it is (with its unit), and a constant's number."""

    name: str
    meaning: str
    number: float = 0.0
    kind: str = "real"

    def __post_init__(self) -> None:
        object.__setattr__(self, "meaning", plain(self.meaning))


@dataclass(frozen=True, eq=False)
class Block:
    """A function block.

    Attributes
    ----------
    axis, part : the design's name as an identifier, and "compensation" or "tracker"
    title : one line of what it does
    inputs, outputs, constants : what it reads, gives and is set to
    arrays : name -> shape; memory from call to call
    start : statements that set the memory before the first call
    program : what every call does
    gains : the loops' gains, which go along as constants for whoever sets up the drive
    linear : the axis moves along a line, so that every torque is a force; the meanings are told in its units
    """

    axis: str
    part: str
    title: str
    inputs: tuple[Value, ...]
    outputs: tuple[Value, ...]
    program: Program
    constants: tuple[Value, ...] = ()
    arrays: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    start: tuple[ast.stmt, ...] = ()
    gains: tuple[Value, ...] = ()
    linear: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "title", plain(self.title))
        if self.linear:
            for part in ("inputs", "outputs", "constants", "gains"):
                values = tuple(replace(v, meaning=axis_unit(v.meaning, "linear")) for v in getattr(self, part))
                object.__setattr__(self, part, values)

    @property
    def name(self) -> str:
        """Name of the block."""
        return f"{self.axis}_{self.part}"

    @property
    def scalars(self) -> dict[str, str]:
        """Scalars of the program that are neither inputs nor outputs, with their kinds, in alphabetical order."""
        known = {value.name for value in (*self.inputs, *self.outputs)}
        return {text: kind for text, kind in sorted(self.program.variables.items()) if text not in known}


def identifier(text: str) -> str:
    """Return a name that C and IEC 61131-3 both take: letters, digits, single underscores, no digit first."""
    parts = "".join(c if c.isascii() and c.isalnum() else " " for c in text).split()
    found = "_".join(parts)
    return found if found and not found[0].isdigit() else f"axis_{found}".rstrip("_")


def loop_gains(design: Design) -> tuple[Value, ...]:
    """Return the loops' gains."""
    if design.loops is None:
        return ()
    current, speed, position = design.loops.current, design.loops.speed, design.loops.position
    inertia = position.acceleration_feedforward * design.J / design.K_t_assumed
    return (
        Value("CURRENT_KP", "V/A", current.K_p),
        Value("CURRENT_TN", "s", current.T_n),
        Value("SPEED_KP", "A/(rad/s)", speed.K_p),
        Value("SPEED_TN", "s", speed.T_n),
        Value("SPEED_REFERENCE_FILTER", "s", speed.reference_filter),
        Value("POSITION_KV", "1/s", position.K_v),
        Value("INERTIA_FEEDFORWARD", "A/(rad/s^2)", inertia),
    )

"""A function block before it is printed in a language: inputs, outputs, memory, constants and the flat program."""

from __future__ import annotations

import ast
import hashlib
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace

from pmsm_ctrl.design import Design
from pmsm_ctrl.export.program import Program
from pmsm_ctrl.export.trees import kinds
from pmsm_ctrl.export.writers import plain
from pmsm_ctrl.units import axis_words

__all__ = ["Block", "Value", "identifier", "loop_gains"]


@dataclass(frozen=True)
class Value:
    """An input, an output or a constant.

    Attributes
    ----------
    name : str
    meaning : str
        What it is, with its unit.
    number : float
        The value of a constant.
    kind : {"real", "integer", "flag"}
    """

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
    axis : str
        The design's name as an identifier.
    part : {"compensation", "tracker"}
    title : str
        One line of what it does.
    inputs, outputs, constants : tuple of Value
    program : Program
        What every call does.
    arrays : mapping of name to shape
        Memory from call to call; a single number has the shape ().
    start : tuple of ast.stmt
        Statements that set the memory before the first call.
    gains : tuple of Value
        The loops' gains, as constants for whoever sets up the drive.
    linear : bool
        Whether the axis is linear: every torque is a force, and the meanings are given in its units.
    single : bool
        Whether all real numbers have single precision.
    notes : mapping of name to str
        What the arrays and the scalars of the program are, with their units.
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
    single: bool = False
    notes: Mapping[str, str] = field(default_factory=dict)

    def note(self, text: str) -> str:
        """Return what a variable is, with its unit; empty where that is not known."""
        bare = re.sub(r"_\d+$", "", text)  # variables without a name in the source are numbered
        for key in (text, bare):
            if key in self.notes:
                return self.notes[key]
        kind = self.scalars.get(text, "integer" if text in self.counters else "")
        return {"integer": "1, counter", "flag": "whether the next part applies", "real": ""}.get(kind, "")

    def __post_init__(self) -> None:
        object.__setattr__(self, "title", plain(self.title))
        motion = "linear" if self.linear else "rotary"
        object.__setattr__(self, "notes", {k: plain(_along(text, motion)) for k, text in self.notes.items()})
        if self.linear:
            for comment in _comments((*self.program.statements, *self.start)):
                comment.value = _along(str(comment.value), motion)
            for part in ("inputs", "outputs", "constants", "gains"):
                values = tuple(replace(v, meaning=_along(v.meaning, motion)) for v in getattr(self, part))
                object.__setattr__(self, part, values)

    @property
    def name(self) -> str:
        """Name of the block."""
        return f"{self.axis}_{self.part}"

    @property
    def counters(self) -> list[str]:
        """Counters of the loops that set the memory, in alphabetical order."""
        return sorted(set(kinds(list(self.start))) - set(self.arrays))

    @property
    def structured(self) -> bool:
        """Whether a call needs a structure in C: for its memory, or for more than one output."""
        return bool(self.arrays) or len(self.outputs) > 1

    @property
    def scalars(self) -> dict[str, str]:
        """Scalars of the program that hold nothing from call to call, with their kinds, in alphabetical order."""
        known = {value.name for value in (*self.inputs, *self.outputs)} | set(self.arrays)
        return {text: kind for text, kind in sorted(self.program.variables.items()) if text not in known}


def _along(text: str, motion: str) -> str:
    """Return a text with the units and words of this kind of axis: a linear one has a position in place of an angle."""
    if motion != "linear":
        return text
    return axis_words(text, motion).replace("angle turned", "travel").replace("angle", "position")


def _comments(statements: Iterable[ast.stmt]) -> Iterator[ast.Constant]:
    """Yield the comments among statements and in them."""
    for node in (inner for one in statements for inner in ast.walk(one)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            yield node.value


LONGEST_AXIS = 12  # characters: with the longest of what is added, _compensation_update, 32 in all


def identifier(text: str) -> str:
    """Return an identifier of C and IEC 61131-3: ASCII letters, digits, single underscores, no digit first.

    Of a long text the first letters and three digits of its hash are taken, so that two long names stay two.
    """
    parts = "".join(c if c.isascii() and c.isalnum() else " " for c in text).split()
    found = "_".join(parts)
    found = found if found and not found[0].isdigit() else f"axis_{found}".rstrip("_")
    if len(found) <= LONGEST_AXIS:
        return found
    mark = hashlib.sha256(text.encode()).hexdigest()[:3]
    return f"{found[: LONGEST_AXIS - 4].rstrip('_')}_{mark}"


def loop_gains(design: Design) -> tuple[Value, ...]:
    """Return the loops' gains as constants; those of the d axis and of the reference speed where they differ."""
    if design.loops is None:
        return ()
    current, speed, position = design.loops.current, design.loops.speed, design.loops.position
    inertia = position.acceleration_feedforward * (design.assumed.J or design.J) / design.K_t_assumed
    others = (
        Value("CURRENT_KP_D", "V/A, of the d axis", current.K_p_d or current.K_p),
        Value("CURRENT_TN_D", "s, of the d axis", current.T_n_d or current.T_n),
        Value(
            "VELOCITY_FEEDFORWARD", "share of the reference speed that is fed forward", position.velocity_feedforward
        ),
    )
    usual = (current.K_p, current.T_n, 1.0)
    return (
        Value("CURRENT_KP", "V/A", current.K_p),
        Value("CURRENT_TN", "s", current.T_n),
        *(value for value, same in zip(others, usual, strict=True) if value.number != same),
        Value("SPEED_KP", "A/(rad/s)", speed.K_p),
        Value("SPEED_TN", "s", speed.T_n),
        Value("REFERENCE_FILTER", "s, of the reference speed in speed control", speed.reference_filter),
        Value("POSITION_KV", "1/s", position.K_v),
        Value(
            "VELOCITY_FILTER",
            "s, of the reference speed in position control",
            design.loops.reference_filter(in_position=True),
        ),
        Value("INERTIA_FEEDFORWARD", "A/(rad/s^2)", inertia),
    )

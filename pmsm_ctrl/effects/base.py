"""The interface of an effect: its physics once, and what everything else needs to know about it."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal

from pmsm_ctrl.design import EffectEntry
from pmsm_ctrl.errors import DesignError, RequestError, nearest

__all__ = ["SIGNALS", "Effect", "Parameter"]

# The names a term may use for its arguments besides its own parameters.
SIGNALS: dict[str, str] = {
    "omega": "mechanical speed, rad/s",
    "theta": "mechanical angle, rad",
    "direction": "direction of motion or of impending motion, -1, 0 or 1",
    "i_d": "direct-axis current, A",
    "i_q": "quadrature-axis current, A",
    "torque": "electromagnetic torque, N m",
    "t": "time, s",
    "p": "pole pairs",
    "di_d": "time derivative of i_d, A/s",
    "di_q": "time derivative of i_q, A/s",
    "twist": "motor angle less load angle, rad",
    "twist_rate": "motor speed less load speed, rad/s",
    "zeta": "bristle deflection at the start of a step, as a share of the breakaway deflection",
    "travel": "angle turned since then, rad",
    "limit": "dry friction at this speed as a share of that at rest",
}


@dataclass(frozen=True)
class Parameter:
    """One number of an effect.

    `linear` parameters multiply a column of the regression; the others are searched.
    """

    symbol: str
    unit: str
    start: float
    lower: float
    upper: float
    description: str
    linear: bool = False


@dataclass(frozen=True, eq=False)
class Effect:
    """One physical effect.

    Attributes
    ----------
    id, title, equation, source
        Name in designs, title, LaTeX, and where the equation comes from.
    enters : {"torque", "voltage", "measurement"}
        A torque term is the torque that opposes motion (friction positive for positive speed):
        ``T_em = J alpha + sum of terms + T_load``. A voltage term stands on the side of the drop:
        ``u = R i + ... + term``, returning (d, q). A measurement term is measured minus true.
    term : compiled scalar function
        Its argument names are signals of `SIGNALS` and symbols of `parameters`, in any order.
        Simulation and regression both call this one function.
    channels : names of what the term returns, in order
    structure : {"term", "transmission", "bristle", "delay"}
        How the simulation wires the term: added to its balance, as the torque between two masses,
        as the deflection that replaces the sign in every dry friction, or as a delay of the logged currents.
    amplitudes : symbols that are all zero when the effect is off; the linear parameters unless said otherwise
    needs : what excitation makes it visible
    look_alikes : effect id -> why some logs cannot tell the two apart
    validated : what it has been held against so far
    example : parameter values that are plausible on the reference motor, for plots, docs and blind tests
    """

    id: str
    title: str
    equation: str
    source: str
    enters: Literal["torque", "voltage", "measurement"]
    parameters: tuple[Parameter, ...]
    term: Any
    needs: str
    look_alikes: Mapping[str, str] = field(default_factory=dict)
    validated: str = "simulated logs"
    example: Mapping[str, float] = field(default_factory=dict)
    channels: tuple[str, ...] = ()
    structure: Literal["term", "transmission", "bristle", "delay"] = "term"
    amplitudes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not self.channels:
            returned = {"torque": ("torque",), "voltage": ("u_d", "u_q"), "measurement": ("i_d", "i_q")}
            object.__setattr__(self, "channels", returned[self.enters])
        if not self.amplitudes:
            object.__setattr__(self, "amplitudes", tuple(p.symbol for p in self.parameters if p.linear))
        known = {*SIGNALS, *(p.symbol for p in self.parameters)}
        for name in self.arguments:
            if name not in known:
                raise DesignError(
                    f"effect '{self.id}': its term takes '{name}', which is neither a signal "
                    f"({', '.join(SIGNALS)}) nor one of its parameters"
                )

    @property
    def py_term(self) -> Callable[..., Any]:
        """The term as plain Python, for reading and for checking the compiled one."""
        return getattr(self.term, "py_func", self.term)

    # Read at every sample of a live stream, where asking for the signature anew takes longer than the term.
    @cached_property
    def arguments(self) -> tuple[str, ...]:
        """Argument names of the term, in order."""
        return tuple(inspect.signature(self.py_term).parameters)

    @cached_property
    def signals(self) -> tuple[str, ...]:
        """Signals the term reads."""
        return tuple(name for name in self.arguments if name in SIGNALS)

    @property
    def dry(self) -> bool:
        """Whether the term is set-valued at standstill, i.e. depends on the direction."""
        return "direction" in self.signals

    @property
    def linear(self) -> tuple[Parameter, ...]:
        """Parameters that multiply a regression column."""
        return tuple(p for p in self.parameters if p.linear)

    @property
    def searched(self) -> tuple[Parameter, ...]:
        """Parameters the term is not linear in."""
        return tuple(p for p in self.parameters if not p.linear)

    def active(self, values: Mapping[str, float]) -> bool:
        """Whether these parameter values do anything at all."""
        return any(values[symbol] != 0.0 for symbol in self.amplitudes)

    def parameter(self, symbol: str) -> Parameter:
        """Return the parameter with this symbol.

        Raises
        ------
        RequestError
            When the effect has no such parameter.
        """
        for parameter in self.parameters:
            if parameter.symbol == symbol:
                return parameter
        known = [p.symbol for p in self.parameters]
        raise RequestError(
            f"effect '{self.id}' has no parameter '{symbol}'{nearest(symbol, known)} (known: {', '.join(known)})"
        )

    def values(self, entry: EffectEntry, where: str = "") -> dict[str, float]:
        """Return all parameter values of a design's entry; what is left out takes its start value.

        Raises
        ------
        DesignError
            For an unknown parameter or a value outside its bounds.
        """
        label = f"{where}effects.{self.id}"
        known = {p.symbol: p for p in self.parameters}
        for symbol in entry.parameters:
            if symbol not in known:
                raise DesignError(
                    f"{label}.{symbol}: unknown parameter{nearest(symbol, known)} (known: {', '.join(known)})"
                )
        out = {}
        for symbol, parameter in known.items():
            value = entry.parameters.get(symbol, parameter.start)
            if not (parameter.lower <= value <= parameter.upper) or math.isnan(value):
                raise DesignError(
                    f"{label}.{symbol}: found {value:g}, but it should lie between {parameter.lower:g} "
                    f"and {parameter.upper:g} {parameter.unit}"
                )
            out[symbol] = float(value)
        return out

"""The interface of an effect: its physics once, and what everything else needs to know about it."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal

import numpy as np

from pmsm_ctrl.design import EffectEntry
from pmsm_ctrl.effects.signals import CURRENTS, SIGNALS
from pmsm_ctrl.effects.soundness import repeats, value_at
from pmsm_ctrl.effects.structures import LogView, Search, Structure, Term
from pmsm_ctrl.errors import DesignError, RequestError, nearest
from pmsm_ctrl.units import axis_words

__all__ = ["SIGNALS", "Effect", "Parameter"]

# What a term enters -> what it returns there, unless the effect says otherwise.
_RETURNED = {"torque": ("torque",), "voltage": ("u_d", "u_q"), "measurement": ("i_d", "i_q")}


@dataclass(frozen=True)
class Parameter:
    """One number of an effect.

    Attributes
    ----------
    symbol, unit, description : str
    start : float
        The value of a design that does not give one.
    lower, upper : float
        Bounds, which a design has to keep.
    linear : bool
        Whether it multiplies a column of the regression; the others are searched.
    soft : bool
        Whether a value at its bound is as good as any other: the shape does not want to be another one there.
    avoid : (float, float), optional
        An interval in which the effect is the same as another one, and where no value is searched.
    within_grid : bool
        Whether no value beyond the ends of the searched grid is tried: they are those of what a log can tell.
    shares_of_F_c : (float, float), optional
        Narrower bounds as shares of the Coulomb friction, where that is known.
    """

    symbol: str
    unit: str
    start: float
    lower: float
    upper: float
    description: str
    linear: bool = False
    soft: bool = False
    avoid: tuple[float, float] | None = None
    within_grid: bool = False
    shares_of_F_c: tuple[float, float] | None = None


@dataclass(frozen=True, eq=False)
class Effect:
    """One physical effect.

    Attributes
    ----------
    id, title, equation, source
        Name in designs, title, LaTeX, and where the equation comes from.
    parameters : tuple of Parameter
    enters : {"torque", "voltage", "measurement"}
        A torque term is the torque that opposes motion (friction positive for positive speed):
        ``T_em = J alpha + sum of terms + T_load``. A voltage term stands on the side of the drop:
        ``u = R i + ... + term``, returning (d, q). A measurement term is measured minus true.
    term : compiled scalar function
        Its argument names are signals of `SIGNALS` and symbols of `parameters`, in any order.
        Simulation and regression both call this one function.
    channels : names of what the term returns, in order
    structure : Structure
        How the simulation wires the term, and which parameters play a role in that: added to its balance (`Term`), as
        the torque between two masses, as the deflection that replaces the sign in every dry friction, or as a delay
        of the logged currents.
    amplitudes : symbols that are all zero when the effect is off; the linear parameters unless said otherwise
    order : symbol of the parameter that counts the periods in a turn of the angle the term reads; empty without one
    period : symbol of the parameter that is a period of the position the term reads; empty without one
    electrical_order : its whole order in a turn of the electrical angle, where it has one that never changes
    repeated : whether an axis can have several, told apart by their order or period
    lowest_order : the lowest order that is usual for the effect; 0 where it has no such limit
    search : function of a `LogView`, optional
        Returns the shapes over which the searched parameters are tried; multiples of their start values otherwise.
    bends_over : symbol of the speed over which a friction fades; empty for one that does not
    both_ways : whether only an axis that runs both ways tells it from dry and viscous friction
    rounds : whether it only rounds off the step of dry friction, as much else does where that speed is passed quickly
    common_scale : linear parameters that scale the whole torque: no column can tell them from the torque constant
    same_as : linear parameters whose column is that of another effect up to a factor -> the id of that effect
    as_sensor : the error of a sensor that is the same in every log; empty where there is none
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
    structure: Structure = field(default_factory=Term)
    amplitudes: tuple[str, ...] = ()
    order: str = ""
    period: str = ""
    electrical_order: int = 0
    repeated: bool = False
    lowest_order: int = 0
    search: Callable[[LogView], Search | Iterable[Mapping[str, float]]] | None = None
    bends_over: str = ""
    both_ways: bool = False
    rounds: bool = False
    as_sensor: str = ""
    common_scale: tuple[str, ...] = ()
    same_as: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.enters not in tuple(_RETURNED):
            close = nearest(str(self.enters), _RETURNED)
            raise DesignError(f"effect '{self.id}': enters = {self.enters!r}{close} (accepted: {', '.join(_RETURNED)})")
        if not self.channels:
            object.__setattr__(self, "channels", _RETURNED[self.enters])
        for one in self.parameters:
            if not one.lower <= one.start <= one.upper:
                raise DesignError(
                    f"effect '{self.id}': parameter '{one.symbol}' starts at {one.start:g}, but a start value should "
                    f"lie between its bounds, {one.lower:g} and {one.upper:g} {one.unit}"
                )
        if not self.amplitudes:
            object.__setattr__(self, "amplitudes", tuple(p.symbol for p in self.parameters if p.linear))
        if self.rounds and not self.bends_over:
            raise DesignError(f"effect '{self.id}': `rounds` without `bends_over`, the speed over which it rises")
        known = {*SIGNALS, *(p.symbol for p in self.parameters)}
        for name in self.arguments:
            if name not in known:
                raise DesignError(
                    f"effect '{self.id}': its term takes '{name}', which is neither a signal "
                    f"({', '.join(SIGNALS)}) nor one of its parameters"
                )
        roles = [v for v in vars(self.structure).values() if isinstance(v, str)]
        waves = (self.order, self.period)
        for name in (*roles, *self.amplitudes, *waves, self.bends_over, *self.common_scale, *self.same_as):
            if name and name not in {p.symbol for p in self.parameters}:
                raise DesignError(f"effect '{self.id}': '{name}' is none of its parameters")

    @property
    def py_term(self) -> Callable[..., Any]:
        """The term as plain Python, for reading and for checking the compiled one."""
        plain: Callable[..., Any] = getattr(self.term, "py_func", self.term)
        return plain

    # Read at every sample of a live stream, where asking for the signature anew takes longer than the term.
    @cached_property
    def arguments(self) -> tuple[str, ...]:
        """Argument names of the term, in order."""
        return tuple(inspect.signature(self.py_term).parameters)

    @cached_property
    def signals(self) -> tuple[str, ...]:
        """Signals the term reads."""
        return tuple(name for name in self.arguments if name in SIGNALS)

    @cached_property
    def repeats_with_turn(self) -> bool:
        """Whether the term is a wave over the turn of the motor: it has an order, or is the same a turn further on.

        One over the electrical angle is none, nor one with a period of its own, nor a function of the whole position.
        """
        if "theta" not in self.signals or "p" in self.signals or self.period:
            return False
        return bool(self.order) or repeats(self, "theta", 2.0 * math.pi)

    @property
    def dry(self) -> bool:
        """Whether the term is set-valued at standstill, i.e. depends on the direction."""
        return "direction" in self.signals

    @property
    def has_state(self) -> bool:
        """Whether the term needs more than the signals of one instant: a second mass, a bristle, a delay line."""
        return self.structure.memory > 0

    @property
    def falsifies_current(self) -> bool:
        """Whether currents are measured wrongly, so that what it adds to the torque balance does not act."""
        return self.enters == "measurement" and self.channels == CURRENTS

    def title_on(self, motion: str) -> str:
        """Return the title on this kind of axis: a force in place of a torque on a linear one.

        Parameters
        ----------
        motion : {"rotary", "linear"}

        Returns
        -------
        str
        """
        return axis_words(self.title, motion)

    @property
    def linear(self) -> tuple[Parameter, ...]:
        """Parameters that multiply a regression column."""
        return tuple(p for p in self.parameters if p.linear)

    @property
    def searched(self) -> tuple[Parameter, ...]:
        """Parameters the term is not linear in."""
        return tuple(p for p in self.parameters if not p.linear)

    def active(self, values: Mapping[str, float]) -> bool:
        """Whether these parameter values do anything at all.

        Parameters
        ----------
        values : mapping of str to float
            A value for every parameter.
        """
        return any(values[symbol] != 0.0 for symbol in self.amplitudes)

    def label(self, values: Mapping[str, float]) -> str:
        """Return the id, with the order or the period where the values have one: ``cogging 24``.

        Parameters
        ----------
        values : mapping of str to float
            Parameters or a shape.
        """
        known = values.get(self.order) or values.get(self.period)
        return f"{self.id} {known:.4g}" if known else self.id

    def waves(self, values: Mapping[str, float], p: float) -> float:
        """Return by how much the phase of the term's wave grows with the position it reads, rad/rad (rad/m).

        That is 1 where it has neither order nor period.

        Parameters
        ----------
        values : mapping of str to float
            Parameters or a shape.
        p : float
            Pole pairs.
        """
        if self.period:
            return 2.0 * math.pi / values[self.period]
        return values.get(self.order, 1.0) * (p if "p" in self.signals else 1.0)

    def standing(self, values: Mapping[str, float], **signals: float) -> float:
        """Return the term of an axis that rests and is about to turn forwards, in the unit of its first channel.

        Parameters
        ----------
        values : mapping of str to float
            A value for every parameter.
        **signals : float
            Signals other than zero: the pole pairs, an angle.
        """
        at_rest = dict.fromkeys(SIGNALS, 0.0) | {"direction": 1.0} | signals | dict(values)
        return float(np.atleast_1d(value_at(self, at_rest))[0])

    def standing_level(self, values: Mapping[str, float], p: float) -> float:
        """Return the largest magnitude of the term of an axis at rest, over a wave of the angle where it is one.

        Parameters
        ----------
        values : mapping of str to float
            A value for every parameter.
        p : float
            Pole pairs.
        """
        if "theta" not in self.signals:
            return abs(self.standing(values, p=p))
        quarter = 0.5 * math.pi / max(self.waves(values, p), 1.0)
        return math.hypot(*(self.standing(values, p=p, theta=theta) for theta in (0.0, quarter)))

    def parameter(self, symbol: str) -> Parameter:
        """Return the parameter with this symbol.

        Parameters
        ----------
        symbol : str

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

        Parameters
        ----------
        entry : EffectEntry
        where : str
            What an error begins with.

        Raises
        ------
        DesignError
            For an unknown parameter, in the values or in their standard errors, or a value outside its bounds.
        """
        self.require_names(entry, where)
        out = {}
        for parameter in self.parameters:
            symbol = parameter.symbol
            value = entry.parameters.get(symbol, parameter.start)
            if not (parameter.lower <= value <= parameter.upper) or math.isnan(value):
                raise DesignError(
                    f"{where}effects.{self.id}.{symbol}: found {value:g}, but it should lie between "
                    f"{parameter.lower:g} and {parameter.upper:g} {parameter.unit}"
                )
            out[symbol] = float(value)
        return out

    def require_names(self, entry: EffectEntry, where: str = "") -> None:
        """Refuse a design's entry that names a parameter which the effect does not have.

        Parameters
        ----------
        entry : EffectEntry
        where : str
            What an error begins with.

        Raises
        ------
        DesignError
            In the values or in their standard errors.
        """
        label = f"{where}effects.{self.id}"
        known = {p.symbol: p for p in self.parameters}
        named = {symbol: symbol for symbol in entry.parameters}
        named |= {f"stderr.{symbol}": symbol for symbol in entry.stderr}
        for place, symbol in named.items():
            if symbol not in known:
                raise DesignError(
                    f"{label}.{place}: unknown parameter{nearest(symbol, known)} (known: {', '.join(known)})"
                )

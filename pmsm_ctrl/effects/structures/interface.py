"""What a structure answers for an effect: everything that depends on how its term is wired.

An effect states what its term is; its structure knows what the simulation, the regression, the search and the tuning
make of it. Nothing outside `pmsm_ctrl.effects` asks which structure an effect has.
"""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.effects.signals import INTERNAL
from pmsm_ctrl.effects.structures.paths import bent_torque, drive_path, swings_of_angle
from pmsm_ctrl.effects.structures.second_mass import SecondMass
from pmsm_ctrl.effects.structures.views import Balances, Machine

if TYPE_CHECKING:
    from pmsm_ctrl.effects.base import Effect

__all__ = ["Balances", "Known", "Lines", "LogView", "Machine", "Search", "SecondMass", "Structure", "UnavailableError"]
__all__ += ["kernel_call"]

Array = NDArray[np.float64]
Lines = dict[str, list[str]]
MULTIPLES = (0.25, 0.5, 1.0, 2.0, 4.0)  # of the start value, at which a parameter is searched unless told otherwise
FEWEST_LINES, LINE_ERROR = 32.0, 0.02  # of an encoder that interpolates, and the error of that at most, in lines
STRAIGHT_OVER = 0.02  # step of a shape's logarithm, over which a smooth prediction is a straight line


class UnavailableError(Exception):
    """This log or design cannot tell anything about an effect; the message says why."""


@dataclass(frozen=True)
class Known:
    """What a fit knows when it asks for the bounds of a parameter.

    Attributes
    ----------
    J : float
        Total inertia, kg m^2 (kg).
    F_c : float
        Coulomb friction, N m (N); 0 where there is none.
    dry : float
        Dry friction at rest of all effects, N m (N).
    """

    J: float
    F_c: float = 0.0
    dry: float = 0.0


@dataclass(frozen=True, eq=False)
class LogView:
    """What a search may know of a log.

    Attributes
    ----------
    balances : Balances
    residual : array, shape (m,)
        Of the torque balance, on the thinned grid.
    orders : function of int
        Returns how much each mechanical order up to this one stands out of the residual, shape (highest,); 0 where no
        turn is slow enough to see it.
    periods : function of int
        Returns this many periods of the position that stand out of the residual, rad (m), and how many could.
    """

    balances: Balances
    residual: Array
    orders: Callable[[int], Array]
    periods: Callable[[int], tuple[Array, int]]

    # Read by the search of every effect that hangs on it.
    @cached_property
    def top_speed(self) -> float:
        """Highest speed but for the fastest hundredth of the log, rad/s (m/s)."""
        return float(np.quantile(np.abs(self.balances.signals["omega"]), 0.99))

    @cached_property
    def current(self) -> float:
        """Current that is exceeded in a tenth of the log, A peak."""
        s = self.balances.signals
        return float(np.quantile(np.hypot(s.get("i_d", 0.0), s["i_q"]), 0.9))

    @property
    def duration(self) -> float:
        """Length of the log, s."""
        return self.balances.duration

    @property
    def unseen(self) -> float:
        """Time in gaps of the log, s."""
        return self.balances.unseen

    @property
    def travel(self) -> float:
        """Distance between the outermost positions, rad (m)."""
        return float(np.ptp(self.balances.signals["theta"]))


@dataclass(frozen=True)
class Search:
    """The shapes over which an effect is searched on a log.

    Attributes
    ----------
    shapes : tuple of mapping
        Values of the parameters that the columns are not linear in.
    searched : int
        Independent shapes tried, paid for in the significance; as many as there are shapes when left out.
    why_not : str
        Why it cannot be tried on this log; there are no shapes then.
    """

    shapes: tuple[Mapping[str, float], ...]
    searched: int = 0
    why_not: str = ""

    @property
    def tried(self) -> int:
        """Number of shapes that the significance pays for, at least 1."""
        return max(1, self.searched or len(self.shapes))


@dataclass(frozen=True)
class Structure(ABC):
    """How the simulation wires a term, and what follows from that everywhere else.

    Its fields name the parameters that play a role in it, so that an effect is free to call them what it likes. The
    answers here are those for a term that follows from the signals of one instant; a structure overrides what it
    changes.

    Attributes
    ----------
    memory : int
        Numbers that the simulation carries from one control period to the next.
    splits_inertia : bool
        Whether it puts a second mass behind the shaft. An axis has one such effect.
    delays : bool
        Whether it is a delay of the logged currents.
    replaces_direction : bool
        Whether it stands for the direction in every dry friction, and so has no column of its own in a model.
    amounts_are_linear : bool
        Whether the size of a column is the amount of the effect.
    offered_apart : bool
        Whether the columns of the model of all candidates are others than those by which the effect is judged.
    unlike_rivals : bool
        Whether no rival can resemble the effect's column: most of what it explains must be left beside them. Not that
        of a spring: far below its resonance its response is as smooth in the frequency as theirs.
    judged_in_part : bool
        Whether the effect is judged by the samples alone in which noise cannot be it. In a model it acts on all.
    refined_when_taken : bool
        Whether the shape is refined as soon as the effect is in: its candidate left out what is noise.
    """

    memory: ClassVar[int] = 0
    splits_inertia: ClassVar[bool] = False
    replaces_direction: ClassVar[bool] = False
    delays: ClassVar[bool] = False
    amounts_are_linear: ClassVar[bool] = True
    offered_apart: ClassVar[bool] = False
    unlike_rivals: ClassVar[bool] = False
    judged_in_part: ClassVar[bool] = False
    refined_when_taken: ClassVar[bool] = False

    @property
    def has_memory(self) -> bool:
        """Whether the torque hangs on the motion before, as it does behind a filter, a sampling or a current loop."""
        return self.splits_inertia or self.replaces_direction or self.delays

    # -- simulation

    @staticmethod
    @abstractmethod
    def lines(wired: Sequence[tuple[int, Effect]], offset: int, dry: Sequence[tuple[int, Effect]]) -> Lines:
        """Return the lines for the marks of the kernels' templates.

        Parameters
        ----------
        wired : sequence of (int, Effect)
            All active effects of this structure, with their numbers in the kernel.
        offset : int
            Where its memory begins in the states.
        dry : sequence of (int, Effect)
            The active dry frictions.
        """

    @staticmethod
    def start(omega: float, theta: float) -> tuple[float, ...] | float:
        """Return the structure's memory for an axis that turns at `omega` and nothing is deflected."""
        return 0.0

    def memory_along(self, effect: Effect, values: Mapping[str, float], omega: Array, theta: Array) -> Array:
        """Return the structure's memory along a measured motion of shape (n,), shape (n, memory)."""
        return np.tile(np.atleast_1d(self.start(0.0, 0.0)), (len(omega), 1))[:, : self.memory]

    def simulated(
        self, effect: Effect, values: Mapping[str, float], machine: Machine, dry: float, label: str
    ) -> dict[str, float]:
        """Return the parameter values as the simulation can carry them.

        Parameters
        ----------
        effect : Effect
        values : mapping of str to float
            A value for every parameter.
        machine : Machine
        dry : float
            Dry friction at rest of all effects, N m.
        label : str
            What an error begins with.

        Raises
        ------
        DesignError
            When it cannot.
        """
        return dict(values)

    # -- regression

    def available(self, balances: Balances, effect: Effect) -> str:
        """Why the effect cannot be evaluated on this log; empty when it can."""
        motor = balances.design.motor
        if effect.enters == "voltage" and "u_d" not in balances.channels:
            return "it shows in the voltages alone, and this log has no u_d and u_q"
        if "p" in effect.signals and motor.p is None:
            return "the design does not know the pole pairs"
        if balances.linear and effect.repeats_with_turn:
            return "a linear axis has no turn, with which it repeats"
        absent = [s for s in effect.signals if s not in balances.signals and s not in INTERNAL]
        return f"the log has no {', '.join(absent)}" if absent else ""

    def symbols(self, effect: Effect) -> tuple[str, ...]:
        """Names of the parameters that multiply the columns."""
        return tuple(p.symbol for p in effect.linear if p.symbol not in effect.common_scale)

    def reads(self, effect: Effect) -> frozenset[str]:
        """Signals from which the columns follow."""
        return frozenset(effect.signals)

    @abstractmethod
    def columns(self, balances: Balances, effect: Effect, shape: Mapping[str, float]) -> list[dict[str, Array]]:
        """Return what the effect adds to each balance per unit of each of its `symbols`, shape (n,), at the log's rate.

        `UnavailableError` where the log or the design lacks what the effect needs.
        """

    def columns_each(
        self, balances: Balances, effect: Effect, shapes: Sequence[Mapping[str, float]]
    ) -> Iterator[list[dict[str, Array]]]:
        """Yield the columns of several shapes, one after the other."""
        return (self.columns(balances, effect, shape) for shape in shapes)

    def filtered(self, balances: Balances) -> bool:
        """Whether the columns follow from signals that are filtered already, and need not be filtered again."""
        return False

    def judges(self, effect: Effect) -> bool:
        """Whether a candidate is judged by other columns than those that are fitted; see `judged`."""
        return type(self).judged is not Structure.judged

    def resolved(self, balances: Balances, shape: Mapping[str, float]) -> bool:
        """Whether the steps of the log's angle show an effect of this shape.

        Parameters
        ----------
        balances : Balances
        shape : dict of symbol to float
        """
        return True

    def judged(self, balances: Balances, effect: Effect, values: Array, shape: Mapping[str, float]) -> Array:
        """Return the columns by which an effect not in the model yet is judged: `values`, shape (channels, m, k).

        What is made of noise, or of errors of the filters, is zero. Balances behind the last that the columns enter are
        left out.
        """
        return values

    def offered(self, balances: Balances, effect: Effect, values: Array, shape: Mapping[str, float]) -> Array:
        """Return the columns for the model of all candidates, whose residual is the noise; as in `judged`."""
        return self.judged(balances, effect, values, shape)

    def direction(self, balances: Balances, effect: Effect, shape: Mapping[str, float]) -> Array:
        """Return what stands for the direction along the measured motion, shape (n,)."""
        return balances.signals["direction"]

    def delay(self, effect: Effect, values: Sequence[float]) -> float:
        """Delay of the currents, s, from the values of its `symbols`, inside the bounds; 0 for most effects."""
        return 0.0

    def corrected(
        self, effect: Effect, values: Mapping[str, float], t: Array, channels: Mapping[str, Array], p: float | None
    ) -> dict[str, Array] | None:
        """Return the channels that a measurement effect spoils as they would be without it.

        None where the log lacks a channel that would tell how large the effect is.
        """
        return None

    def rivals(self, effect: Effect, shape: Mapping[str, float], balances: Balances) -> list[dict[str, Array]]:
        """Return what must not be taken for the effect, shape (n,) each, at the log's rate, as large as it may be.

        The effect is only named if it explains something beside all of these. Of a wave of a high order that is the
        error of the encoder's lines: it swings the measured acceleration with the square of the speed. Of one that is
        longer than a turn it is a saturation as well.
        """
        if effect.enters != "torque":
            return []
        if not effect.order:
            turned = effect.period and not balances.linear
            return [*drive_path(balances), *(bent_torque(balances) if turned else ())]
        order = float(shape.get(effect.order, 0.0))
        if order < FEWEST_LINES or balances.linear or not float(np.log2(order)).is_integer():
            return []  # encoders whose signals are interpolated have a power of two of lines
        return [{"torque": swing} for swing in swings_of_angle(balances, order, LINE_ERROR * 2.0 * np.pi / order)]

    # -- search

    def search(self, effect: Effect, log: LogView) -> Search:
        """Return the shapes over which the effect is searched on a log."""
        return Search(tuple(default_shapes(effect)))

    def starting_from(self, mass: SecondMass) -> Structure:
        """Return the structure whose search also starts from a second mass that was measured otherwise."""
        return self

    def fixed(self, effect: Effect) -> frozenset[str]:
        """Names in a shape that the refinement leaves alone."""
        return frozenset((effect.order,)) if effect.order else frozenset()

    def absent(self, effect: Effect, values: Mapping[str, float]) -> frozenset[str]:
        """Parameters of what an effect may have and at these values has not: no fit by simulation begins there."""
        return frozenset()

    def beside_the_search(self, effect: Effect) -> tuple[str, ...]:
        """Names in a shape that no search varies, and that are fitted with all others once the effect is in."""
        return ()

    def halvings(self, effect: Effect, free: Iterable[str]) -> int:
        """How often the steps of the refinement are halved."""
        return 3

    def ranges(self, effect: Effect) -> dict[str, tuple[float, float]]:
        """Ends of the names of a shape between which all shapes can be looked at; none where they are too many."""
        return {}

    def straight_over(self, effect: Effect, shape: Mapping[str, float], name: str) -> float:
        """Step of a shape's logarithm over which a smooth prediction is a straight line."""
        return STRAIGHT_OVER

    def inside(self, effect: Effect, shape: Mapping[str, float], name: str, value: float) -> float:
        """Return a value of the refinement, moved to where this name may lie; `shape` is where it comes from."""
        for p in effect.parameters:
            if p.symbol != name:
                continue
            if p.avoid is not None and p.avoid[0] < value < p.avoid[1]:
                return p.avoid[0] if shape[name] <= p.avoid[0] else p.avoid[1]
            return float(min(max(value, p.lower), p.upper))
        return value

    def at_bound(self, effect: Effect, shape: Mapping[str, float]) -> bool:
        """Whether a parameter of the shape ran into its bound: the shape wants to be another one.

        The edges of what it avoids are bounds: a drag of exponent 1.18 wants to be more of the viscous friction.
        """
        searched = (p for p in effect.searched if p.symbol in shape and not p.soft)
        return any(shape[p.symbol] in (p.lower, p.upper, *(p.avoid or ())) for p in searched)

    def slight(self, known: Known, values: Mapping[str, float]) -> bool:
        """Whether an effect of these amounts is so small that errors of the model are as large."""
        return False

    def beside_shape(self, balances: Balances, shape: Mapping[str, float]) -> list[dict[str, Array]]:
        """Return what an axis with the effect may have of it beside this shape, shape (n,) each, as large as may be.

        Another effect on the torque is only named beside this one if it explains something beside all of these.
        """
        return []

    def never_minor(self, shape: Mapping[str, float]) -> bool:
        """Whether a shape is so flexible that a part of the residual is no evidence of it."""
        return False

    def refined_later(self, effect: Effect, shape: Mapping[str, float]) -> bool:
        """Whether the shape is refined again once further effects are in the model."""
        return bool(set(shape) - self.fixed(effect))

    # -- parameters

    def shape(self, effect: Effect, values: Mapping[str, float]) -> dict[str, float]:
        """Return the nonlinear parameters of a design's entry as the columns want them."""
        return {p.symbol: values[p.symbol] for p in effect.searched}

    def parameters(self, effect: Effect, found: Mapping[str, float]) -> dict[str, float]:
        """Return the effect's own parameters from a shape and the values of its `symbols`, inside their bounds.

        A fit keeps the bounds by itself; what is moved here is rounding.
        """
        return {
            p.symbol: float(min(max(found[p.symbol], p.lower), p.upper)) for p in effect.parameters if p.symbol in found
        }

    def bounds(self, effect: Effect, known: Known, shape: Mapping[str, float]) -> dict[str, tuple[float, float]]:
        """Return where each of its `symbols` may lie, some of which hang on what else is known, or on the shape."""
        out = {}
        for symbol in self.symbols(effect):
            p = effect.parameter(symbol)
            out[symbol] = (p.lower, p.upper)
            if p.shares_of_F_c is not None and known.F_c > 0.0:
                out[symbol] = (p.shares_of_F_c[0] * known.F_c, p.shares_of_F_c[1] * known.F_c)
        return out

    # -- what a result or the tuning asks

    def resonance(self, shape: Mapping[str, float]) -> float | None:
        """Frequency at which a load rings on its spring, Hz; None where there is none."""
        return None

    def commutation_apart(self, shape: Mapping[str, float]) -> bool:
        """Whether the drive turns its frame by another angle than the one that is measured wrongly."""
        return False

    def second_mass(self, values: Mapping[str, float]) -> SecondMass | None:
        """Return the mass behind the shaft; None where there is none."""
        return None

    def values_of(self, mass: SecondMass) -> dict[str, float]:
        """Return the parameters that make this mass; none where the structure cannot."""
        return {}

    def with_inertia_scaled(self, values: Mapping[str, float], factor: float) -> dict[str, float]:
        """Return the values for an axis whose inertias are all this factor larger."""
        return dict(values)


def default_shapes(effect: Effect) -> Iterable[dict[str, float]]:
    """Yield multiples of the start values inside the bounds, every combination."""
    axes = [sorted({float(min(max(p.start * f, p.lower), p.upper)) for f in MULTIPLES}) for p in effect.searched]
    names = [p.symbol for p in effect.searched]
    yield from (dict(zip(names, each, strict=True)) for each in itertools.product(*axes))


def kernel_call(number: int, effect: Effect, /, **given: Any) -> str:
    """Return the call of an effect's term in the drive kernel; `given` says what stands for an argument instead."""
    own = {p.symbol for p in effect.parameters}
    arguments = (given.get(name, f"e{number}_{name}" if name in own else name) for name in effect.arguments)
    return f"e{number}_term({', '.join(arguments)})"

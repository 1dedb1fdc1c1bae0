"""A delay of the logged currents: the simulation delays exactly, the regression by a slope over the delay."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.effects.evaluate import columns
from pmsm_ctrl.effects.signals import CURRENTS
from pmsm_ctrl.effects.structures.interface import Balances, Lines, Machine, Structure
from pmsm_ctrl.effects.structures.term import current_balances, readable
from pmsm_ctrl.errors import DesignError

if TYPE_CHECKING:
    from pmsm_ctrl.effects.base import Effect

__all__ = ["Delay"]

Array = NDArray[np.float64]

LINE = 256  # control periods that the delay line holds, of two currents each
ABOVE_NOISE = 4.0


@dataclass(frozen=True)
class Delay(Structure):
    """A delay of the logged currents.

    Attributes
    ----------
    age : str
        The parameter that says by how much they are late, s; the term is linear in it.
    """

    age: str
    memory: ClassVar[int] = 2 * LINE
    delays: ClassVar[bool] = True

    @staticmethod
    def lines(wired: Sequence[tuple[int, Effect]], offset: int, dry: Sequence[tuple[int, Effect]]) -> Lines:
        """The logged currents pass through a delay line of control periods, interpolated in between."""
        k, effect = wired[0]
        assert isinstance(effect.structure, Delay)
        return {
            "load memory": [f"line = states[{offset}:{offset + 2 * LINE}]"],
            "delay line": [
                f"line[2 * (k % {LINE})], line[2 * (k % {LINE}) + 1] = i_m",
                f"age = e{k}_{effect.structure.age} / T",
                "part = age - int(age)",
                f"newer, older = 2 * ((k - int(age)) % {LINE}), 2 * ((k - int(age) - 1) % {LINE})",
                "i_d_late = (1.0 - part) * line[newer] + part * line[older]",
                "i_q_late = (1.0 - part) * line[newer + 1] + part * line[older + 1]",
            ],
            "log current": ["out[row, 3], out[row, 4] = i_d_late, i_q_late"],
        }

    def simulated(
        self, effect: Effect, values: Mapping[str, float], machine: Machine, dry: float, label: str
    ) -> dict[str, float]:
        """Return the values where the delay line is long enough for them.

        Raises
        ------
        DesignError
            When it is not.
        """
        longest = machine.period * (LINE - 2)
        if not 0.0 <= values[self.age] <= longest:
            raise DesignError(f"{label}.{self.age}: found {values[self.age]:g} s; 0 to {longest:g} s can be simulated")
        return dict(values)

    def available(self, balances: Balances, effect: Effect) -> str:
        """Why the effect cannot be evaluated: never, since a torque can be late as well as the currents."""
        return ""

    def reads(self, effect: Effect) -> frozenset[str]:
        """Return the currents as they are now and a while ago."""
        return frozenset((*effect.signals, *CURRENTS))

    def columns(self, balances: Balances, effect: Effect, shape: Mapping[str, float]) -> list[dict[str, Array]]:
        """Return the term with the slopes over the delay; of a log without currents, the slope of the torque."""
        if balances.design.motor.p is None:
            return [{"torque": -balances.slope_behind(balances.signals["torque"])}]
        signals = readable(balances)
        signals |= {f"d{i}": balances.slope_behind(balances.signals[i]) for i in CURRENTS if i in balances.signals}
        terms, _ = columns(effect, signals, {p.symbol: p.start for p in effect.parameters} | dict(shape))
        return [current_balances(balances, terms[symbol]) for symbol in self.symbols(effect)]

    def filtered(self, balances: Balances) -> bool:
        """Whether the currents are modelled ones: those follow from filtered balances."""
        return balances.late is not None

    def judged(self, balances: Balances, effect: Effect, values: Array, shape: Mapping[str, float]) -> Array:
        """Return the columns; of a torque that is early where it changes faster than its noise does.

        The speed controller answers noise at once, so that noise and the slope of the torque go together, and look
        like a torque that comes too early. They never look like one that comes too late.
        """
        if balances.late is None or balances.late >= 0.0:
            return values
        out = values.copy()
        for part in out[0].T:
            part[np.abs(part) <= ABOVE_NOISE * balances.noise_of(part)] = 0.0
        return out

    def delay(self, effect: Effect, values: Sequence[float]) -> float:
        """Return the delay inside its bounds, s."""
        p = effect.parameter(self.age)
        return float(np.clip(values[self.symbols(effect).index(self.age)], p.lower, p.upper))

    def corrected(
        self, effect: Effect, values: Mapping[str, float], t: Array, channels: Mapping[str, Array], p: float | None
    ) -> dict[str, Array]:
        """Move the currents, or the torque that was made of them, back to when they flowed."""
        from scipy.interpolate import CubicSpline

        then = np.clip(t + values[self.age], t[0], t[-1])
        late = [name for name in (*CURRENTS, "torque") if name in channels]
        return {**channels, **{name: CubicSpline(t, channels[name])(then) for name in late}}

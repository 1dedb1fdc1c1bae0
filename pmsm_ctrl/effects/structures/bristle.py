"""A bristle: its deflection stands for the direction of motion in every dry friction of the axis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.effects.evaluate import called, compiled_loop
from pmsm_ctrl.effects.structures.interface import (
    Balances,
    Known,
    Lines,
    LogView,
    Machine,
    Search,
    Structure,
    kernel_call,
)
from pmsm_ctrl.effects.structures.rubbing import bristle_column
from pmsm_ctrl.effects.structures.term import SMOOTHED

if TYPE_CHECKING:
    from pmsm_ctrl.effects.base import Effect

__all__ = ["Bristle"]

Array = NDArray[np.float64]

LEVEL = "(level)"  # the column's factor: how much of the dry friction the bristle carries
SHARES_OF_REACH = (0.3, 3.0)  # of the deflection of one bristle, that of others of the same surface
# Deflections that are searched, rad, or times a hundredth of the travel: of a bearing that rolls, of a stiff one and of
# a soft belt; how many encoder steps the least one is, and how many there are in a decade.
ROLLING, STIFF, SOFT, STEPS, PER_DECADE = 1e-5, 2e-4, 0.2, 4.0, 9
SEEN = 2.0  # steps of the angle that a deflection has to exceed: each end of it is known to within one
LAGS = 3.0  # times its scale: the travel after which 95 % of a bristle's lag are over


@dataclass(frozen=True)
class Bristle(Structure):
    """A bristle that bends with the shaft's travel.

    Attributes
    ----------
    deflection : str
        The parameter of the breakaway deflection, rad (m); 0 for an axis without the effect.
    damping : str
        The parameter of the bristle's damping over its stiffness, s.
    amounts_are_linear : bool
        The size of the column is the amount of the dry friction.
    """

    deflection: str
    damping: str
    memory: ClassVar[int] = 1
    replaces_direction: ClassVar[bool] = True
    amounts_are_linear: ClassVar[bool] = False

    def beside_the_search(self, effect: Effect) -> tuple[str, ...]:
        """Return all but the deflection: what they do to the torque is small beside it."""
        return tuple(p.symbol for p in effect.parameters if p.symbol != self.deflection)

    @staticmethod
    def lines(wired: Sequence[tuple[int, Effect]], offset: int, dry: Sequence[tuple[int, Effect]]) -> Lines:
        """The bristle's deflection stands for the direction in every dry friction; it moves with the shaft's travel."""
        if not dry:
            return {}
        k, effect = wired[0]

        def level(speed: str) -> str:
            return " + ".join(kernel_call(n, friction, omega=speed, direction="1.0") for n, friction in dry)

        force = kernel_call(k, effect, zeta="held[4]", travel="theta - held[5]", limit="level / rest")
        return {
            "hold": [],  # a bristle gives way: nothing is ever locked
            "bristle": [
                f"level, rest = {level('omega')}, {level('0.0')}",
                f"direction = {force}[1]",
                "direction *= rest / level",
            ],
            "step": [
                "start = (held[0], held[1], held[2], held[3], zeta, y[3])",
                "y = runge_kutta(y, t + m * h, h, 1.0, start, machine, effects)",
                "i_d, i_q, omega, theta = y[0], y[1], y[2], y[3]",
                "torque = drive_torque(y, machine)",
                f"level, rest = {level('omega')}, {level('0.0')}",
                f"zeta = {kernel_call(k, effect, travel='theta - start[5]', limit='level / rest')}[0]",
            ],
            "load memory": [f"zeta = states[{offset}]"],
            "store memory": [f"states[{offset}] = zeta"],
        }

    def simulated(
        self, effect: Effect, values: Mapping[str, float], machine: Machine, dry: float, label: str
    ) -> dict[str, float]:
        """Limit the stiffness and the damping to what one integration step resolves.

        A mass J on a spring F/z_s is stable under Runge-Kutta for sqrt(F / (z_s J)) h < 2.8; 1 is kept. At 16 kHz
        and the reference motor that is a deflection of a millionth of a radian, a fiftieth of an encoder count.
        """
        h = machine.period / machine.steps
        out = dict(values)
        out[self.deflection] = max(values[self.deflection], dry * h * h / machine.J)
        if dry > 0.0:
            out[self.damping] = min(values[self.damping], machine.J * out[self.deflection] / (dry * h))
        return out

    def symbols(self, effect: Effect) -> tuple[str, ...]:
        """Return the one factor of the column."""
        return (LEVEL,)

    def columns(self, balances: Balances, effect: Effect, shape: Mapping[str, float]) -> list[dict[str, Array]]:
        """Return by what share of the dry friction the bristle lags behind the direction."""
        return [{"torque": self.direction(balances, effect, shape) - balances.signals["direction"]}]

    def resolved(self, balances: Balances, shape: Mapping[str, float]) -> bool:
        """Whether the deflection is more than a step of the angle or two: the axis turns round somewhere within one."""
        return shape[self.deflection] >= SEEN * balances.step

    def judged(self, balances: Balances, effect: Effect, values: Array, shape: Mapping[str, float]) -> Array:
        """Return the column without the moments at which the lag is over before the filters show it."""
        if not self.resolved(balances, shape):
            return np.zeros_like(values)
        smoothed = SMOOTHED / balances.cutoff
        over = 0.5 * np.abs(balances.acceleration()) * smoothed**2 > LAGS * shape[self.deflection]
        return np.where(over[:, None], 0.0, values)

    def direction(self, balances: Balances, effect: Effect, shape: Mapping[str, float]) -> Array:
        """Return the friction of the bristle as a share of the dry friction along the measured motion, shape (n,)."""
        loop, symbols = compiled_loop(effect, "bristle", _loop)
        values = {p.symbol: p.start for p in effect.parameters} | dict(shape)
        s = balances.signals
        out = np.empty(len(s["theta"]))
        loop(out, s["theta"], s["omega"], *(values[symbol] for symbol in symbols))
        return out

    def beside_shape(self, balances: Balances, shape: Mapping[str, float]) -> list[dict[str, Array]]:
        """Return bristles that bend less and more: no surface has a single one."""
        return [{"torque": bristle_column(balances, part * shape[self.deflection])} for part in SHARES_OF_REACH]

    def memory_along(self, effect: Effect, values: Mapping[str, float], omega: Array, theta: Array) -> Array:
        """Return the deflection along a measured motion that begins with a straight bristle, shape (n, 1)."""
        loop, symbols = compiled_loop(effect, "deflection", _deflection)
        out = np.empty(len(theta))
        loop(out, np.ascontiguousarray(theta), np.ascontiguousarray(omega), *(values[symbol] for symbol in symbols))
        return out[:, None]

    def search(self, effect: Effect, log: LogView) -> Search:
        """Return deflections from those of a stiff bearing to those of a soft belt, the rest at the start values.

        Those of a bearing that rolls without a seal are told by a fine encoder alone.
        None in a log without an angle: a speed that the drive has filtered or observed tells no travel of a bristle.
        """
        if not log.balances.angle:
            return Search((), why_not="it shows in the travel around reversals, and this log has no angle")
        scale = log.travel / 100.0 if log.balances.linear else 1.0
        rest = {p.symbol: p.start for p in effect.parameters}
        finest = float(np.clip(STEPS * log.balances.step / scale, ROLLING, STIFF))
        count = round(PER_DECADE * float(np.log10(SOFT / finest))) + 1
        deflections = np.geomspace(finest, SOFT, count) * scale
        return Search(tuple({**rest, self.deflection: float(z)} for z in deflections))

    def refined_later(self, effect: Effect, shape: Mapping[str, float]) -> bool:
        """Whether the shape is refined again: no, the bristle has no column in the model."""
        return False

    def shape(self, effect: Effect, values: Mapping[str, float]) -> dict[str, float]:
        """Return all parameters: none multiplies a column."""
        return dict(values)

    def bounds(self, effect: Effect, known: Known, shape: Mapping[str, float]) -> dict[str, tuple[float, float]]:
        """Return the bounds of the factor: a bristle carries the dry friction and nothing else.

        Without it the fit finds too little dry friction, by any amount, and not too much.
        """
        return {LEVEL: (0.5 * known.dry, np.inf)}


def _deflection(effect: Effect) -> tuple[str, tuple[str, ...]]:
    """Source of the loop that notes the deflection, and the parameters it takes."""
    text, symbols = _loop(effect)
    return text.replace("_zeta, _out[_n] =", "_zeta, _ =") + "        _out[_n] = _zeta\n", symbols


def _loop(effect: Effect) -> tuple[str, tuple[str, ...]]:
    """Source of the loop along the motion, and the parameters it takes."""
    symbols = tuple(p.symbol for p in effect.parameters)
    call = called(effect, zeta="_zeta", travel="_travel", omega="_omega[_n]", limit="1.0")
    return (
        f"def loop(_out, _theta, _omega, {', '.join(symbols)}):\n"
        "    _zeta = 0.0\n"
        "    for _n in range(len(_theta)):\n"
        "        _travel = _theta[_n] - _theta[_n - 1] if _n > 0 else 0.0\n"
        f"        _zeta, _out[_n] = {call}\n"
    ), symbols

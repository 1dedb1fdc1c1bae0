"""A gap between motor and load: the load is followed by the effect's own contact law, searched over gap and contact.

A load that rubs is slowed down by its own friction while it crosses the gap, and stands still in it: the motor then has
neither its inertia nor its friction to move.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.effects.evaluate import called, compiled_loop
from pmsm_ctrl.effects.structures.interface import Balances, LogView, Search, SecondMass
from pmsm_ctrl.effects.structures.load_table import LoadTable, made_table, peaks, rigid_axis
from pmsm_ctrl.effects.structures.rubbing import bristle_column
from pmsm_ctrl.effects.structures.transmission import (
    DAMPING,
    FREQUENCY,
    RUBBING,
    UNBOUNDED,
    Transmission,
    after_hard_start,
    beyond_noise,
    mean_acceleration,
)

if TYPE_CHECKING:
    from pmsm_ctrl.effects.base import Effect

__all__ = ["Gap"]

Array = NDArray[np.float64]

# A contact damped more than this does not bounce at all.
STUCK = 2.0
AT_ONCE, FEWEST_LANES = 4e6, 8  # bytes of columns that are made side by side, and the fewest of them
# Times in which the mean acceleration of a log carries the shaft across a gap, s, and how many gaps are searched: one
# that is crossed faster looks like an error of the moment of reversal, one that is crossed slower like a free load.
SHORTEST, LONGEST, GAPS = 0.003, 0.08, 15
# Contact of a load that rubs, Hz and damping, where the search begins; its deceleration in ratios to that of the whole
# axis by its friction; and samples of the log that its gap takes at least: in less, an edge of the torque that no
# sample caught looks the same.
RUBS, RATIOS = (150.0, 1.2), np.geomspace(0.4, 4.0, 7)
CROSSED = 3.0
# Gap over what the contact gives way under the mean acceleration: behind less, a load hangs on a damper, not on flanks.
FIRM = 2.0
# The stiffest contact that is followed, Hz, ten times the stiffest that is searched. Its stroke lasts a sixth of a
# sample of 1 kHz; what is stiffer no log tells, and takes any number of steps a sample.
STIFFEST = 3000.0
# By how much a heavily damped contact is followed in finer steps, at most: a coarser step makes it unstable.
FINEST = 100.0


@dataclass(frozen=True, kw_only=True)
class Gap(Transmission):
    """Flanks with a gap between motor and load, and a spring and a damper where they touch.

    The sum of squares is rough over the frequency and the damping of a load that bounces between the flanks: there are
    no ranges in which all shapes could be looked at. A frequency response tells nothing of a gap.

    Attributes
    ----------
    gap : str
        The parameter of the gap between the flanks, rad.
    unlike_rivals : bool
        No rival opens and closes, nor lets go at once of a load that rubs.
    offered_apart : bool
        The residual of the model of all candidates is the noise: gaps take no more of it than what is fast allows.
    judged_in_part : bool
        A load that has struck a flank follows the shaft nearly as noise would have it.
    amounts_are_linear : bool
        The size of the column is that of the load, not that of the gap.
    """

    gap: str
    has_gap: ClassVar[bool] = True
    most_damped: ClassVar[float] = STUCK
    unlike_rivals: ClassVar[bool] = True
    offered_apart: ClassVar[bool] = True
    judged_in_part: ClassVar[bool] = True
    amounts_are_linear: ClassVar[bool] = False

    def columns(self, balances: Balances, effect: Effect, shape: Mapping[str, float]) -> list[dict[str, Array]]:
        """T = J alpha + F_c s + T_s - J_load alpha - F_load s: what the contact passes on less the load's share.

        Of a load that does not rub that is ``J_load (alpha_load - alpha)``; shape (n,), per unit of its inertia.
        """
        return next(self.columns_each(balances, effect, [shape]))

    def columns_each(
        self, balances: Balances, effect: Effect, shapes: Sequence[Mapping[str, float]]
    ) -> Iterator[list[dict[str, Array]]]:
        """Yield the columns of several gaps, which are followed side by side, as many as the memory allows."""
        lanes = max(FEWEST_LANES, int(AT_ONCE / (8 * len(balances.signals["theta"]))))
        for start in range(0, len(shapes), lanes):
            for column in self._followed(balances, effect, shapes[start : start + lanes]):
                yield [{"torque": column}]

    def judged(self, balances: Balances, effect: Effect, values: Array, shape: Mapping[str, float]) -> Array:
        """Return the columns where the load would accelerate otherwise than the shaft by more than noise.

        Nothing is left of a gap whose contact gives way further than the gap is wide. A load in contact follows the
        shaft nearly always, so it takes part in all of the noise: what the acceleration holds in the upper half of the
        band, and no more than the torque allows that is left beside the load.
        """
        if not self._firm(balances, shape):
            return np.zeros_like(values)
        return beyond_noise(values, min(balances.shaft_noise(), balances.noise_beside(values[0][:, 0])))

    def offered(self, balances: Balances, effect: Effect, values: Array, shape: Mapping[str, float]) -> Array:
        """Return the columns where the load would accelerate otherwise than the shaft by more than all that is fast.

        Nothing of a load that rubs: beside all other candidates it would take up a part of any torque at reversals,
        and the noise by which they are judged would be too small.
        """
        offered = self._firm(balances, shape) and RUBBING not in shape
        return beyond_noise(values, balances.shaft_noise()) if offered else np.zeros_like(values)

    def never_minor(self, shape: Mapping[str, float]) -> bool:
        """Whether the load rubs: gap, contact and friction together fit what any reversal leaves, in part."""
        return RUBBING in shape

    def rivals(self, effect: Effect, shape: Mapping[str, float], balances: Balances) -> list[dict[str, Array]]:
        """Return the rivals of a transmission; of a load that rubs also bristles that bend over it or half of it."""
        found = super().rivals(effect, shape, balances)
        bristles = (bristle_column(balances, reach * shape[self.gap]) for reach in (0.5, 1.0))
        return [*found, *({"torque": UNBOUNDED * one} for one in bristles)] if RUBBING in shape else found

    def _firm(self, balances: Balances, shape: Mapping[str, float]) -> bool:
        """Whether the contact gives way less than the gap is wide."""
        return shape[self.gap] * shape[FREQUENCY] ** 2 >= FIRM * mean_acceleration(balances)

    def inside(self, effect: Effect, shape: Mapping[str, float], name: str, value: float) -> float:
        """Return the value inside the bounds; the contact's frequency has an upper one."""
        most = 2.0 * np.pi * STIFFEST if name == FREQUENCY else np.inf
        return min(super().inside(effect, shape, name, value), most)

    def search(self, effect: Effect, log: LogView) -> Search:
        """Return gaps with stiff and soft contacts.

        A load that bounces off its flanks cannot be followed: small errors of the motion grow with each bounce. One
        that stays where it struck explains most of the same torque, so contacts are searched as well damped ones.
        """
        shapes = [
            {self.gap: gap, FREQUENCY: 2.0 * np.pi * f, DAMPING: zeta}
            for gap in _gaps(log.balances).tolist()
            for f in (80.0, 300.0)
            for zeta in (0.4, 1.2)
        ]
        rubbing, looked = self._rubbing(effect, log)
        return Search((*shapes, *rubbing), len(shapes) + looked)

    def _rubbing(self, effect: Effect, log: LogView) -> tuple[list[dict[str, float]], int]:
        """Return the gaps with a load that rubs which lower the error most, and how many were looked at."""
        balances, key = log.balances, ("seen", effect.id, id(effect.term), RUBBING)
        if key not in balances.kept:
            balances.kept[key] = self._table(balances, effect) if self.dry else None
        table: LoadTable | None = balances.kept[key]
        if table is None:
            return [], 0
        gains = table.gains(log.residual).reshape(-1, len(RATIOS))
        best = peaks(gains)
        beside = np.where(best % len(RATIOS) > 0, best - 1, best + 1)  # how far apart the searched ones are
        found = table.loads[np.unique([*best, *beside])].tolist() if len(best) else []
        return [self._rubs(gap, f) for gap, f in found], len(table.loads)

    def _rubs(self, gap: float, f: float) -> dict[str, float]:
        """Return the shape of a load that rubs where its search begins."""
        return {self.gap: gap, FREQUENCY: 2.0 * np.pi * RUBS[0], DAMPING: RUBS[1], RUBBING: f}

    def _table(self, balances: Balances, effect: Effect) -> LoadTable | None:
        """Return the gaps with a load that rubs; None where the axis has no dry friction, or crosses all too fast."""
        axis, gaps = rigid_axis(balances), _gaps(balances)
        gaps = gaps[gaps >= 0.5 * mean_acceleration(balances) * (CROSSED * balances.period) ** 2]
        if axis is None or not len(gaps):
            return None
        loads = np.array([(gap, ratio * axis.deceleration) for gap in gaps.tolist() for ratio in RATIOS])

        def followed(some: slice, theta: Array, omega: Array, period: float) -> Array:
            return self._passed_on(effect, theta, omega, period, [self._rubs(*load) for load in loads[some].tolist()])

        most = np.minimum(axis.inertia, axis.dry / loads[:, 1])
        return made_table(balances, axis, loads, most, followed)

    def shape(self, effect: Effect, values: Mapping[str, float]) -> dict[str, float]:
        """Return the gap, and the load's own frequency and damping in contact."""
        return {self.gap: values[self.gap], **super().shape(effect, values)}

    def second_mass(self, values: Mapping[str, float]) -> SecondMass | None:
        """Return the load behind the gap; None where it has no inertia."""
        mass = super().second_mass(values)
        return None if mass is None else replace(mass, gap=values[self.gap])

    def _followed(self, balances: Balances, effect: Effect, shapes: Sequence[Mapping[str, float]]) -> Iterator[Array]:
        """Yield what each of several contacts passes on less what the load would need on a rigid axis, shape (n,)."""
        s = balances.signals
        passed = self._passed_on(effect, s["theta"], s["omega"], balances.period, shapes)
        for row, shape in zip(passed, shapes, strict=True):
            rigid = s["alpha"] + shape[RUBBING] * s["direction"] if RUBBING in shape else s["alpha"]
            yield after_hard_start(balances, row - rigid, shape, LONGEST)

    def _passed_on(
        self, effect: Effect, theta: Array, omega: Array, period: float, shapes: Sequence[Mapping[str, float]]
    ) -> Array:
        """Return what contacts pass on over the inertia of their loads, shape (k, n).

        The effect's own contact law is used with stiffness, damping and friction per inertia.
        """
        loop, symbols = compiled_loop(effect, "load", _loop)
        values = {p.symbol: np.full(len(shapes), p.start) for p in effect.parameters}
        w, zeta = (np.array([shape[name] for shape in shapes]) for name in (FREQUENCY, DAMPING))
        w = np.minimum(w, 2.0 * np.pi * STIFFEST)
        values[self.gap] = np.array([shape[self.gap] for shape in shapes])
        values[self.stiffness], values[self.damping] = w * w, 2.0 * zeta * w
        if self.dry:
            values[self.dry] = np.array([shape.get(RUBBING, 0.0) for shape in shapes])
        steps = np.ceil(period * w * 4.0 * np.clip(zeta / STUCK, 1.0, FINEST)).astype(int)
        steps = np.maximum(4, steps)
        out = np.empty((len(shapes), len(theta)))
        for substeps in np.unique(steps).tolist():
            lanes = np.flatnonzero(steps == substeps)
            own = (np.ascontiguousarray(values[symbol][lanes]) for symbol in symbols)
            loop(out, lanes, theta, omega, period, substeps, *own)
        return out


def _gaps(balances: Balances) -> Array:
    """Return the gaps that a log can show, rad (m): what is crossed in a given time grows with the acceleration."""
    return 0.5 * mean_acceleration(balances) * np.geomspace(SHORTEST, LONGEST, GAPS) ** 2


def _loop(effect: Effect) -> tuple[str, tuple[str, ...]]:
    """Source of the loop that follows loads along the motion, side by side, and the parameters it takes.

    Dry friction is set-valued: a step in which it would turn the load ends at rest.
    """
    assert isinstance(effect.structure, Gap)
    symbols, dry = tuple(p.symbol for p in effect.parameters), effect.structure.dry
    own = {symbol: f"{symbol}[_c]" for symbol in symbols}
    call = called(effect, twist="_position - _load[_c]", twist_rate="_rate - _speed[_c]", **own)
    rubs = (
        f"                _held = _h * {dry}[_c]\n"
        "                if _held > 0.0:\n"
        "                    if abs(_speed[_c]) <= _held:\n"
        "                        _speed[_c] = 0.0\n"
        "                    else:\n"
        "                        _speed[_c] -= _held if _speed[_c] > 0.0 else -_held\n"
    )
    return (
        "import numpy as np\n\n\n"
        f"def loop(_out, _rows, _theta, _omega, _period, _substeps, {', '.join(symbols)}):\n"
        "    _h, _lanes = _period / _substeps, len(_rows)\n"
        "    _load, _speed, _passed = np.empty(_lanes), np.empty(_lanes), np.empty(_lanes)\n"
        "    for _c in range(_lanes):\n"
        "        _load[_c], _speed[_c] = _theta[0], _omega[0]\n"
        "    for _n in range(len(_theta)):\n"
        "        _last = min(_n + 1, len(_theta) - 1)\n"
        "        for _c in range(_lanes):\n"
        "            _passed[_c] = 0.0\n"
        "        for _m in range(_substeps):\n"
        "            _x = _m / _substeps\n"
        "            _position = (1.0 - _x) * _theta[_n] + _x * _theta[_last]\n"
        "            _rate = (1.0 - _x) * _omega[_n] + _x * _omega[_last]\n"
        "            for _c in range(_lanes):\n"
        f"                _gained = _h * {call}\n"
        "                _passed[_c] += _gained\n"
        "                _speed[_c] += _gained\n"
        f"{rubs if dry else ''}"
        "                _load[_c] += _h * _speed[_c]\n"
        "        for _c in range(_lanes):\n"
        "            _out[_rows[_c], _n] = _passed[_c] / _period\n"
    ), symbols

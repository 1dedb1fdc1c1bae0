"""Which effects could be missing, with the shapes over which each one is searched."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.compare.orders import order_spectrum
from pmsm_ctrl.design import Design
from pmsm_ctrl.effects.base import Effect
from pmsm_ctrl.effects.structures import LogView, Search
from pmsm_ctrl.regression.balances import Record

__all__ = ["Candidate", "candidates_for"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Candidate:
    """One effect that might be missing.

    Attributes
    ----------
    effect : Effect
    grid : tuple of shapes (values of the nonlinear parameters)
    searched : int
        Independent shapes tried, paid for in the significance.
    why_not : str
        Why it cannot be tried on this log; the grid is empty then.
    """

    effect: Effect
    grid: tuple[Mapping[str, float], ...]
    searched: int = 1
    why_not: str = ""

    @property
    def free(self) -> int:
        """Number of nonlinear parameters that the search settles."""
        return sum(len({s[name] for s in self.grid}) > 1 for name in (self.grid[0] if self.grid else {}))


def candidates_for(
    record: Record, design: Design, effects: Mapping[str, Effect], residual: Array, present: Iterable[str]
) -> list[Candidate]:
    """Return every candidate that is not in the model yet. `residual` is that of the torque, shape (m,)."""

    def orders(highest: int) -> Array:
        return order_spectrum(record.prepared, residual, record.mask, record.weight[0], highest, friction=False)[1]

    view = LogView(record, residual, orders)
    present = set(present)
    split = any(effects[name].structure.splits_inertia for name in present if name in effects)
    out = []
    for effect in effects.values():
        if effect.id in present and not effect.repeated:
            continue
        if split and effect.structure.splits_inertia:
            continue  # an axis has one: `swap` tries the other in its place
        why = effect.structure.available(record, effect)
        found = Search((), why_not=why) if why else effect.structure.search(effect, view)
        out.append(Candidate(effect, found.shapes, found.tried, found.why_not))
    return out

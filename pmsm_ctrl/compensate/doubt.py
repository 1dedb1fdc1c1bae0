"""How wrong the compensated parameters are assumed to be where the error that is left is judged."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from pmsm_ctrl.compensate.window import FACTORS, WRONG
from pmsm_ctrl.design import Design
from pmsm_ctrl.effects import bound_effects

__all__ = ["DRIFT", "Doubt", "doubt_of"]

# Share by which friction changes from one day to the next at least, however well one log tells it: the dry friction of
# EMPS differs by 6 % between its two records of the same motion (docs/emps_history.md).
DRIFT = 0.06
ERRORS = 2.0  # standard errors: of 20 logs one is further off


@dataclass(frozen=True)
class Doubt:
    """By which share the compensated parameters may be off.

    Attributes
    ----------
    share : float
    stated : bool
        Whether it follows from standard errors that the design states.
    """

    share: float = WRONG
    stated: bool = False

    def factors(self, source: str = "reference") -> tuple[float, ...]:
        """Return the factors on the compensated parameters: wrong to either side, and right.

        Parameters
        ----------
        source : str
            Those of an observer are off by 20 %: its inertia has no standard error here.
        """
        if source == "observer" or self.share == WRONG:
            return FACTORS
        return (1.0 - self.share, 1.0, 1.0 + self.share)


def doubt_of(design: Design, effects: Iterable[str]) -> Doubt:
    """Return by how much the parameters of effects may be off: two standard errors of the one known worst.

    They are off by 6 % at least, since friction drifts, and by 20 % at most, as without standard errors.

    Parameters
    ----------
    design : Design
    effects : iterable of str
        Those that are compensated.
    """
    chosen, found = set(effects), []
    for entry, (effect, values) in zip(design.effects, bound_effects(design), strict=True):
        named = [p.symbol for p in effect.linear if values[p.symbol] != 0.0]
        if effect.id not in chosen or not named:
            continue
        if any(symbol not in entry.stderr for symbol in named):
            return Doubt()
        size = math.hypot(*(values[symbol] for symbol in named))  # of a wave: its amplitude
        found.append(math.hypot(*(entry.stderr[symbol] for symbol in named)) / size)
    if not found:
        return Doubt()
    return Doubt(min(max(ERRORS * max(found), DRIFT), WRONG), stated=True)

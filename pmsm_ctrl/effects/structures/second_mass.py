"""The load behind a spring, as every structure, the tuning and the frequency response speak of it."""

from __future__ import annotations

import math
from dataclasses import dataclass

__all__ = ["SecondMass"]


@dataclass(frozen=True)
class SecondMass:
    """The load behind a spring: its inertia is part of the total. A gap counts as closed.

    Attributes
    ----------
    J_load : float
        kg m^2.
    k : float
        N m/rad.
    d : float
        N m s/rad.
    gap : float
        rad.
    """

    J_load: float
    k: float
    d: float
    gap: float = 0.0

    @property
    def antiresonance(self) -> float:
        """Frequency of the load on its spring with the motor held, Hz."""
        return math.sqrt(self.k / self.J_load) / (2.0 * math.pi)

    @property
    def damping_ratio(self) -> float:
        """Damping of that mode."""
        return self.d / (2.0 * math.sqrt(self.k * self.J_load))

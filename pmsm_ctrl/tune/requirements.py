"""What is asked of the loops: how they are tuned, and the margins they must keep."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from numbers import Real
from typing import TYPE_CHECKING

from pmsm_ctrl.errors import RequestError, nearest

if TYPE_CHECKING:
    from pmsm_ctrl.tune.margins import Margins

__all__ = ["Criterion", "Missed", "Requirements", "Specification"]


class Criterion(StrEnum):
    """What a loop can fail."""

    STABILITY = "stability"
    PHASE_MARGIN = "phase_margin"
    GAIN_MARGIN = "gain_margin"
    SENSITIVITY_PEAK = "sensitivity_peak"


@dataclass(frozen=True)
class Missed:
    """A requirement that a loop misses: the criterion, the number found and the limit; as text, the three in words."""

    criterion: Criterion
    found: float = math.nan
    limit: float = math.nan

    def __str__(self) -> str:
        match self.criterion:
            case Criterion.STABILITY:
                return "unstable"
            case Criterion.PHASE_MARGIN:
                return f"phase margin {self.found:.1f} deg < {self.limit:g} deg"
            case Criterion.GAIN_MARGIN:
                return f"gain margin {self.found:.1f} dB < {self.limit:g} dB"
        return f"sensitivity peak {self.found:.2f} > {self.limit:g}"


# What a loop can be asked to keep: a stable one has a phase margin below 180 deg, and a sensitivity that somewhere
# is above 1 (Bode's integral). 0 deg, 0 dB and inf ask for nothing.
REQUIRED = {
    "phase_margin": (0.0, 180.0, " deg"), "gain_margin_db": (0.0, math.inf, " dB"),
    "sensitivity_peak": (1.0, math.inf, ""),
}  # fmt: skip


@dataclass(frozen=True)
class Requirements:
    """Smallest margins accepted, nominally and at the worst corner of the tolerances.

    Attributes
    ----------
    phase_margin : float
        deg.
    gain_margin_db : float
        dB.
    sensitivity_peak : float
        Largest abs(S) accepted; 2 is 6 dB, a distance of 0.5 from the critical point.
    """

    phase_margin: float = 30.0
    gain_margin_db: float = 6.0
    sensitivity_peak: float = 2.0

    def __post_init__(self) -> None:
        for name, (low, high, unit) in REQUIRED.items():
            value = _number(name, getattr(self, name))
            if not low <= value <= high:
                raise RequestError(f"{name}: {value:g}; {low:g} to {high:g}{unit} was expected")

    def missed(self, found: Margins) -> tuple[Missed, ...]:
        """Return the requirements that a loop misses.

        Parameters
        ----------
        found : Margins
        """
        if found.stable is False:
            return (Missed(Criterion.STABILITY),)
        out = []
        if found.phase_margin < self.phase_margin:
            out.append(Missed(Criterion.PHASE_MARGIN, found.phase_margin, self.phase_margin))
        if found.gain_margin_db < self.gain_margin_db:
            out.append(Missed(Criterion.GAIN_MARGIN, found.gain_margin_db, self.gain_margin_db))
        if found.sensitivity_peak > self.sensitivity_peak:
            out.append(Missed(Criterion.SENSITIVITY_PEAK, found.sensitivity_peak, self.sensitivity_peak))
        return tuple(out)

    def shortfall(self, found: Margins) -> float:
        """Return the distance of a loop from its worst requirement, for ranking; positive when one is missed.

        Parameters
        ----------
        found : Margins
        """
        if found.stable is False:
            return math.inf
        return max(
            (self.phase_margin - found.phase_margin) / 30.0,
            (self.gain_margin_db - found.gain_margin_db) / 6.0,
            found.sensitivity_peak / self.sensitivity_peak - 1.0,
        )


USUAL_MARGIN = 60.0  # deg
METHODS: Mapping[str, tuple[str, ...]] = {
    "current": ("modulus_optimum", "pole_cancellation", "bandwidth"),
    "speed": ("symmetrical_optimum", "pole_placement", "bandwidth"),
}
NUMBERS, OPTIONAL = ("phase_margin", "damping", "a"), ("current_bandwidth", "speed_bandwidth", "position_gain", "at")


@dataclass(frozen=True)
class Specification:
    """How the loops are tuned.

    Attributes
    ----------
    current : {"modulus_optimum", "pole_cancellation", "bandwidth"}
        Method of the current loop. "bandwidth" meets crossover and phase margin; the others cancel the winding's pole.
    speed : {"symmetrical_optimum", "pole_placement", "bandwidth"}
        Method of the speed loop. "bandwidth" meets crossover and phase margin on the sampled loop.
    current_bandwidth : float, optional
        Crossover, Hz; required by "bandwidth". By default pole cancellation takes the highest with `phase_margin`.
    speed_bandwidth : float, optional
        Crossover for "bandwidth" (required), natural frequency for "pole_placement", Hz.
    phase_margin : float
        For "bandwidth", and the smallest accepted for "pole_cancellation" and "pole_placement" (there 45 at most), deg.
    damping : float
        For "pole_placement".
    a : float
        For "symmetrical_optimum": 2 is the textbook's (37 deg of phase margin), 1 + sqrt(2) has 45 deg.
    position_gain : float, optional
        K_v, 1/s; by default the largest without resonance.
    robust : bool
        Reduce the bandwidths until the worst corner of ``motor.tolerance`` meets the requirements.
    filters : bool
        Whether a filter of the current reference may be taken against a resonance, where it pays.
    at : float, optional
        Speed of the operating point, rad/s; by default a tenth of the no-load speed.
    requirements : Requirements
    """

    current: str = "modulus_optimum"
    speed: str = "symmetrical_optimum"
    current_bandwidth: float | None = None
    speed_bandwidth: float | None = None
    phase_margin: float = USUAL_MARGIN
    damping: float = 0.8
    a: float = 1.0 + math.sqrt(2.0)
    position_gain: float | None = None
    robust: bool = False
    filters: bool = True
    at: float | None = None
    requirements: Requirements = field(default_factory=Requirements)

    def __post_init__(self) -> None:
        for loop, known in METHODS.items():
            method = getattr(self, loop)
            if method not in known:
                close = nearest(str(method), known)
                raise RequestError(f"{loop} loop: unknown method {method!r}{close} (known: {', '.join(known)})")
        for name in NUMBERS + OPTIONAL:
            if name in NUMBERS or getattr(self, name) is not None:
                _number(name, getattr(self, name))
        for name in ("current_bandwidth", "speed_bandwidth", "phase_margin"):
            value = getattr(self, name)
            if value is not None and not 0.0 < value < math.inf:
                raise RequestError(f"{name}: {value:g}; a positive number was expected")
        by_rule = self.current == "modulus_optimum" and self.speed == "symmetrical_optimum"
        if by_rule and self.phase_margin != USUAL_MARGIN:
            raise RequestError(
                f"phase_margin: {self.phase_margin:g}; it follows from the modulus and the symmetrical optimum; the "
                "methods 'bandwidth' of both loops, 'pole_cancellation' of the current and 'pole_placement' of the "
                "speed loop take one"
            )


def _number(name: str, value: object) -> float:
    """Return a number as it is; a text is none, also where it reads like one."""
    if isinstance(value, bool) or not isinstance(value, Real):
        raise RequestError(f"{name}: {value!r}; a number was expected")
    return float(value)

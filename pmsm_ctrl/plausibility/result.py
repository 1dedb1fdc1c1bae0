"""What an examination found: contradictions, doubts, and stretches of time to leave out."""

from __future__ import annotations

from dataclasses import dataclass, replace

from pmsm_ctrl.log import Log
from pmsm_ctrl.section import Notice

__all__ = ["Plausibility", "Stretch"]


@dataclass(frozen=True)
class Stretch:
    """A stretch of a log that no model of the axis can explain.

    Attributes
    ----------
    start, stop : float
        s, as in the log's ``t``.
    reason : Notice
        Why it is to be left out.
    """

    start: float
    stop: float
    reason: Notice


@dataclass(frozen=True, eq=False)
class Plausibility:
    """Whether a log and a design belong together.

    Attributes
    ----------
    log : Log
        The log to evaluate: what is to be left out is a gap in time, an angle that wraps is unwrapped.
    contradictions : tuple of Notice
        They do not: each with the likeliest reason, the factor, and what to map instead.
    doubts : tuple of Notice
        Something is odd; a model of this log cannot be called consistent.
    excluded : tuple of Stretch
        Stretches of time that `log` leaves out.
    repairs : tuple of Notice
        What was put right in `log`, without a doubt of it.
    lag : float
        By how much torque and currents lag the motion as behind a delay, by more than any sampling, s; else 0.
    logged : Log or None
        What `log` was before torque and currents were moved by that; None where they were not.
    """

    log: Log
    contradictions: tuple[Notice, ...] = ()
    doubts: tuple[Notice, ...] = ()
    excluded: tuple[Stretch, ...] = ()
    repairs: tuple[Notice, ...] = ()
    lag: float = 0.0
    logged: Log | None = None

    @property
    def as_logged(self) -> Plausibility:
        """The same of the log whose torque and currents were not moved."""
        return self if self.logged is None else replace(self, log=self.logged, logged=None)

    @property
    def plausible(self) -> bool:
        """Whether log and design may belong together."""
        return not self.contradictions

    @property
    def notices(self) -> tuple[Notice, ...]:
        """Contradictions first, then doubts, why stretches are left out, each reason once, and repairs."""
        reasons = (stretch.reason for stretch in self.excluded)
        return tuple(dict.fromkeys((*self.contradictions, *self.doubts, *reasons, *self.repairs)))

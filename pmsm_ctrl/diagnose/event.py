"""An event: a stretch or a step that occurs once in a log."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pmsm_ctrl.section import Notice

__all__ = ["Event"]


@dataclass(frozen=True)
class Event:
    """A stretch of time, s, with a disturbance that no effect explains, or a time after which friction is different.

    Attributes
    ----------
    start, stop : float
        s, as in the log; of a step both are its time.
    size : float
        Torque of the disturbance, N m (N); of a step the change of the dry friction.
    notice : Notice
        In words.
    """

    start: float
    stop: float
    size: float
    notice: Notice

    @property
    def lasting(self) -> bool:
        """Whether it is a step that stays."""
        return self.stop <= self.start

    def to_dict(self) -> dict[str, Any]:
        """Return plain values."""
        return {"code": self.notice.code, "start": self.start, "stop": self.stop, "size": self.size}

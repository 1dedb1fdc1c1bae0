"""What a run did: frozen numbers, no words."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pmsm_ctrl.result import Result, jsonable
from pmsm_ctrl.section import Notice

__all__ = ["FleetResult", "Lost"]


@dataclass(frozen=True)
class Lost:
    """A log without an answer.

    Attributes
    ----------
    record, axis : str
    reason : str
    set_aside : bool
        Whether it ended its workers.
    """

    record: str
    axis: str
    reason: str
    set_aside: bool = False


@dataclass(frozen=True)
class FleetResult(Result):
    """A run over a fleet's logs.

    Attributes
    ----------
    results : str
        Folder of the results.
    axes, logs : int
        How many there are.
    evaluated, reused : int
        How many were evaluated in this run, and how many before.
    verdicts : dict of str to int
        Verdicts of the diagnosis, of all logs.
    lost : tuple of Lost
        Logs without an answer.
    seconds, processor_seconds : float
        What this run took, and what its evaluations took of the processors.
    notices : tuple of Notice
    """

    results: str
    axes: int
    logs: int
    evaluated: int
    reused: int
    verdicts: dict[str, int]
    lost: tuple[Lost, ...]
    seconds: float
    processor_seconds: float
    notices: tuple[Notice, ...] = ()

    @property
    def verdict(self) -> str:
        """``set_aside`` where a log was, and ``evaluated``."""
        return "set_aside" if any(one.set_aside for one in self.lost) else "evaluated"

    @property
    def failed(self) -> bool:
        """Whether no log could be evaluated, and none was set aside to be tried again."""
        return len(self.lost) == self.evaluated + self.reused and self.verdict != "set_aside"

    def to_dict(self) -> dict[str, Any]:
        """Return the schema ``pmsm-ctrl/fleet/1``."""
        plain: dict[str, Any] = jsonable({
            "schema": "pmsm-ctrl/fleet/1",
            "results": self.results, "axes": self.axes, "logs": self.logs, "evaluated": self.evaluated,
            "reused": self.reused, "verdicts": self.verdicts, "lost": [vars(one) for one in self.lost],
            "seconds": self.seconds, "processor_seconds": self.processor_seconds, **self.doubts(),
        })  # fmt: skip
        return plain

"""Records that were made of one log, each of them once: a search that begins again asks for the same ones."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects.catalogue import catalogue_of
from pmsm_ctrl.importers.timebase import growing_steps
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.balances import Memo, Record, make_record
from pmsm_ctrl.regression.base_fit import SETTLED
from pmsm_ctrl.regression.conditioning import Processing
from pmsm_ctrl.regression.drive_timing import UNDELAYED, DriveTiming

__all__ = ["Made", "for_design"]

MOST_KEPT = 200_000  # samples of a log whose records are kept: about 150 bytes each


@dataclass(frozen=True, eq=False)
class Made:
    """What was made of a log, for designs that differ in nothing but their effects and their inertia.

    Attributes
    ----------
    log : Log
    records : dict or None
        By how they were made; None where none is kept.
    zeros : list of (float, float)
        What is added to the angle of each of several records, and its standard error, rad; empty as long as nothing is.
    commanded : list of bool
        Whether the drive signal showed itself as a command in the usual band; empty as long as nobody looked.
    ahead : float
        By how much the drive signal is known to be ahead of what acts, s; 0 where nothing is.
    """

    log: Log
    records: Memo | None = field(default=None, repr=False)
    zeros: list[tuple[float, float]] = field(default_factory=list)
    commanded: list[bool] = field(default_factory=list)
    ahead: float = 0.0

    @classmethod
    def kept(cls, log: Log) -> Made:
        """Return one for a search that may begin again: it keeps the records.

        Not those of a long log, and of one of whose angle the inertia decides whether its digits suffice.

        Parameters
        ----------
        log : Log
        """
        coarse = "theta" in log and growing_steps(log["theta"]) > 0.0
        return cls(log, None if coarse or len(log) > MOST_KEPT else {})

    def record(
        self,
        design: Design,
        processing: Processing | None = None,
        age: DriveTiming | None = UNDELAYED,
        timing: DriveTiming | None = None,
    ) -> Record:
        """Do what `make_record` does, once.

        Columns of the measured motion alone are the same for all of these designs, and stay remembered. What is
        measured wrongly, and when, moves the reversals of the friction: designs that differ in that share no record.

        Parameters
        ----------
        design : Design
        processing, age, timing
            As there.
        """
        key = (processing, age, timing, _misread(design))
        if self.records is None or key not in self.records:
            record = make_record(design, self.log, processing, age, timing)
            if self.records is not None:
                self.records[key] = record
            return record
        found: Record = self.records[key]
        return for_design(found, design)

    def forget_models(self, but: Record) -> None:
        """Forget the models of the design alone on all records but one: no other design has them.

        Parameters
        ----------
        but : Record
        """
        for record in (self.records or {}).values():
            for key in [key for key in record.kept if key[0] == SETTLED and record.kept is not but.kept]:
                del record.kept[key]


def _misread(design: Design) -> tuple[object, ...]:
    """Return the effects of measurement that a design states, with their parameters."""
    effects = catalogue_of(design)
    wrong = (entry for entry in design.effects if entry.id in effects and effects[entry.id].enters == "measurement")
    return tuple((entry.id, *sorted(entry.parameters.items())) for entry in wrong)


def for_design(record: Record, design: Design) -> Record:
    """Return a record for a design that differs in nothing but its effects and its inertia.

    Parameters
    ----------
    record : Record
    design : Design
    """
    columns = {key: value for key, value in record.kept.items() if key[0] != SETTLED}
    return replace(record, design=design, memo={}, kept=columns)

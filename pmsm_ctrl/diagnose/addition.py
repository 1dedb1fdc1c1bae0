"""The result of `add`: the design with one more effect, the change of the errors, and what speaks against it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from pmsm_ctrl.design import Design
from pmsm_ctrl.regression.record_result import Errors, RecordResult, RecordSpread
from pmsm_ctrl.result import Estimate, Result, jsonable
from pmsm_ctrl.section import Notice

__all__ = ["Addition"]


@dataclass(frozen=True, eq=False)
class Addition(Result):
    """A design with one effect more, fitted to a log.

    Attributes
    ----------
    effect, title : str
    design : Design
        With the effect, all parameters fitted, standard errors included; the given one where that would be worse.
    parameters : dict of symbol to Estimate
        Of the effect.
    base : dict of symbol to Estimate
        Inertia and friction beside it; `nominal` is what the given design states, None where it states nothing.
    errors : dict of {"nominal", "base", "final"} to balance to rms, unit, relative
        Of the design as given, of its parameters refitted, and of these with the effect.
    holdout : dict of {"base", "final"} to the same
        Empty without a held-out record.
    against : tuple of str
        What speaks against the effect, by the criteria of `diagnose`; empty where the log supports it.
    notices : tuple of Notice
    improved : bool
        False where the new design would be worse on its own log than the given one.
    remarks : tuple of Notice
        Whether the parameters were refined by simulation, where that was asked for.
    log_name, holdout_name : str
    records : tuple of RecordResult
        A row for every record, those that were held out last.
    spreads : tuple of RecordSpread
        By how much friction and a constant torque differ between records; empty for a log that is one record.
    level_refitted : bool
        Whether held-out records are judged with the level of their friction refitted: where several are fitted.
    """

    effect: str
    title: str
    design: Design
    parameters: Mapping[str, Estimate]
    base: Mapping[str, Estimate]
    errors: Mapping[str, Errors]
    holdout: Mapping[str, Errors]
    against: tuple[str, ...]
    notices: tuple[Notice, ...]
    improved: bool = True
    remarks: tuple[Notice, ...] = field(default=())
    log_name: str = "the given log"
    holdout_name: str = ""
    records: tuple[RecordResult, ...] = ()
    spreads: tuple[RecordSpread, ...] = ()
    level_refitted: bool = False

    @property
    def supported(self) -> bool:
        """Whether nothing speaks against the effect."""
        return not self.against

    def to_dict(self) -> dict[str, Any]:
        """Return the schema ``pmsm-ctrl/add/1``."""
        out: dict[str, Any] = jsonable({
            "effect": self.effect,
            "supported": self.supported,
            "against": list(self.against),
            "improved": self.improved,
            "log": self.log_name,
            "holdout_log": self.holdout_name or None,
            "parameters": self.parameters,
            "base": {"parameters": self.base},
            "errors": self.errors,
            "holdout": self.holdout,
            "records": [row.to_dict() for row in self.records],
            "spread_between_records": [vars(one) for one in self.spreads],
            "notes": [note.text for note in self.remarks],
            **self.doubts(),
            "design": self.design.to_dict(),
        })  # fmt: skip
        return out

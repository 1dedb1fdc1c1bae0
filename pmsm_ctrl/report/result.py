"""What a study found, and one effect of the catalogue in full: values alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects import Effect
from pmsm_ctrl.report.history import Entry
from pmsm_ctrl.report.notices import NO_SIGNATURE, NOT_VALIDATED
from pmsm_ctrl.result import Result, jsonable
from pmsm_ctrl.section import Notice, Picture
from pmsm_ctrl.units import axis_unit

__all__ = ["CatalogueEntry", "Headline", "Study"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Headline:
    """The first screen: what was done, the verdict, and the numbers that matter most.

    Attributes
    ----------
    done : str
        One or two sentences.
    verdict : str
        One sentence.
    good : bool or None
        Colour of the verdict, and a word beside it; None is neutral.
    numbers : tuple of (value, label)
        Three are best; a label defines its number.
    pictures : tuple of Picture
        Side by side below the numbers; two are best.
    """

    done: str
    verdict: str
    good: bool | None
    numbers: tuple[tuple[str, str], ...] = ()
    pictures: tuple[Picture, ...] = ()


@dataclass(frozen=True, eq=False)
class Study(Result):
    """What `study` did.

    Attributes
    ----------
    design : Design
        The given design with what was identified.
    path : Path
        The report.
    headline : Headline
        What the first screen says.
    results : mapping of verb to Result
        In the order in which they ran.
    doubts_of_input : tuple of Notice
        What could not be done, and what is doubtful in the logs.
    history : tuple of Entry
        What this and earlier studies of the axis identified; empty without a history file.
    complete : bool
        Whether compensation, tracking and export were asked for.
    """

    design: Design
    path: Path
    headline: Headline
    results: Mapping[str, Result]
    doubts_of_input: tuple[Notice, ...] = ()
    history: tuple[Entry, ...] = field(default=(), repr=False)
    complete: bool = False

    @property
    def notices(self) -> tuple[Notice, ...]:
        """Reasons to doubt the numbers, of the input and of every part, each once."""
        parts = (notice for result in self.results.values() for notice in result.notices)
        return tuple(dict.fromkeys((*self.doubts_of_input, *parts)))

    @property
    def diagnosed(self) -> Design | None:
        """The design of the diagnosis, where it lowers the error and the verdict supports it; else None."""
        from pmsm_ctrl.diagnose import Diagnosis, Verdict

        found = self.results.get("diagnose")
        if not isinstance(found, Diagnosis) or not found.improved:
            return None
        return found.design if found.verdict in (Verdict.EFFECTS_MISSING, Verdict.CONSISTENT) else None

    @property
    def completed(self) -> Design:
        """The design with what the log says, which is compensated, tracked and exported.

        That of the diagnosis where there is one, with the missing effects; else the one with the identified parameters.
        """
        return self.diagnosed or self.design

    @property
    def found(self) -> Design | None:
        """The completed design where a log led to one; None without a log, or where the given design is better."""
        from pmsm_ctrl.identify import Identification

        identified = self.results.get("identify")
        fitted = "diagnose" in self.results and isinstance(identified, Identification) and identified.improved
        return self.completed if self.diagnosed is not None or fitted else None

    def to_dict(self) -> dict[str, Any]:
        """Return plain values fit for JSON.

        Returns
        -------
        dict
            The headline, the notices, the design that a log led to, and the results by verb.
        """
        design = {} if self.found is None else {"design": self.found.to_dict()}
        return {
            "verdict": self.headline.verdict,
            "numbers": {label: value for value, label in self.headline.numbers},
            "report": str(self.path),
            **self.doubts(),
            **design,
            **{verb: jsonable(result.to_dict()) for verb, result in self.results.items()},
        }


@dataclass(frozen=True, eq=False)
class CatalogueEntry(Result):
    """One effect in full.

    Attributes
    ----------
    effect : Effect
    omega, theta, residual : arrays, shape (n,), or None
        Speed, angle and what the effect adds to the drive's signal in a simulated run of the
        `identification` motion; None when no design was given to simulate with.
    channel, unit : which signal, and its unit
    motion : {"rotary", "linear"}
        Kind of the axis in whose units the parameters are stated.
    unlooped : bool
        Whether a design was given that has no loops to simulate with.
    """

    effect: Effect
    omega: Array | None = None
    theta: Array | None = None
    residual: Array | None = None
    channel: str = "torque"
    unit: str = "N m"
    motion: str = "rotary"
    unlooped: bool = False

    @property
    def notices(self) -> tuple[Notice, ...]:
        """A notice when the effect has not been validated, and one when it could not be simulated."""
        found = (NOT_VALIDATED(),) if self.effect.validated == "not at all" else ()
        return (*found, NO_SIGNATURE()) if self.unlooped else found

    def to_dict(self) -> dict[str, Any]:
        """Return plain values fit for JSON.

        Returns
        -------
        dict
            The properties of the effect.
        """
        effect = self.effect
        names = ("id", "title", "enters", "equation", "source", "needs", "validated")
        columns = ("symbol", "unit", "lower", "upper", "description", "linear")
        return {
            **{name: getattr(effect, name) for name in names},
            "look_alikes": dict(effect.look_alikes),
            "parameters": [
                {name: getattr(p, name) for name in columns} | {"unit": axis_unit(p.unit, self.motion)}
                for p in effect.parameters
            ],
        }

"""A mapping proposed from names, units and physics, with its reasons: shown and confirmed before it is used.

The physics: which column is the derivative of which and by what factor, which is proportional to acceleration plus
friction, which is a smooth reference, a constant or a time. Nothing here reads a file or changes a log.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import LogError
from pmsm_ctrl.importers import notices as say
from pmsm_ctrl.importers.clock import with_clock
from pmsm_ctrl.importers.guessing import Guess, guesses
from pmsm_ctrl.importers.mapping import REQUIRED, find_column
from pmsm_ctrl.importers.reading import log_of
from pmsm_ctrl.importers.report import log_toml
from pmsm_ctrl.importers.table import Table
from pmsm_ctrl.log import CHANNELS
from pmsm_ctrl.result import Result, jsonable
from pmsm_ctrl.section import Notice

__all__ = ["Proposal", "propose"]


@dataclass(frozen=True, eq=False)
class Proposal(Result):
    """How a file may be read, to be confirmed.

    Attributes
    ----------
    file, format : str
    guesses : tuple of Guess
        One for each channel, in the order of `CHANNELS`.
    found : tuple of Notice
        What may be wrong, the log's own doubts under this mapping included.
    missing : tuple of str
        Channels without which there is no log; then the proposal cannot be taken.
    unused : tuple of (str, str)
        Columns left over, and what they seem to be.
    settings : dict
        What else the [log] table holds: separator and decimal mark of a text.
    """

    file: str
    format: str
    guesses: tuple[Guess, ...]
    found: tuple[Notice, ...]
    missing: tuple[str, ...]
    unused: tuple[tuple[str, str], ...] = ()
    settings: Mapping[str, str] = field(default_factory=dict)

    @property
    def notices(self) -> tuple[Notice, ...]:
        """Reasons to doubt the proposal."""
        return self.found

    @property
    def complete(self) -> bool:
        """Whether the proposal can be taken as it stands."""
        return not self.missing and not any(guess.open_question for guess in self.guesses)

    @property
    def mapping(self) -> dict[str, str]:
        """Channel to column, as `read_log` and ``--map`` take it."""
        return {guess.channel: guess.mapping for guess in self.guesses}

    @property
    def table(self) -> str:
        """The [log] table, as TOML, for a design."""
        return log_toml({**self.settings, "channels": self.mapping})

    def to_dict(self) -> dict[str, Any]:
        """Return plain values fit for JSON."""
        return jsonable({
            "schema": "pmsm-ctrl/proposal/1",
            **self.doubts(),
            "file": self.file,
            "format": self.format,
            "complete": self.complete,
            "missing": self.missing,
            "channels": {
                guess.channel: {"column": guess.label, "mapping": guess.mapping, "reasons": guess.reasons}
                for guess in self.guesses
            },
            "unused": dict(self.unused),
            "log_table": self.table,
        })  # fmt: skip


def propose(table: Table, design: Design | None = None, mapping: Mapping[str, str] | None = None) -> Proposal:
    """Propose which column of a file is which channel, in which unit.

    Parameters
    ----------
    table : Table
        From `open_table`; its numbers are read.
    design : Design, optional
        Its inertia, torque constant, encoder and [log] table narrow the choice.
    mapping : mapping of str to str, optional
        What is already known; it is taken as it is.

    Returns
    -------
    Proposal

    Raises
    ------
    LogError
        When the file's numbers cannot be read, or the known mapping does not fit it.
    """
    known = {**(design.log.channels if design is not None else {}), **(mapping or {})}
    timed, placed = with_clock(table, design, known)
    stated = {channel: find_column(timed, channel, _column_of(spec)) for channel, spec in (placed or {}).items()}
    named = {name: (known.get(name, ""), *at) for name, at in stated.items()}
    with np.errstate(all="ignore"):  # numbers of any size; what is not finite is no relation
        guessed, unused, doubts = guesses(timed, design, named)
    order = list(CHANNELS)
    guessed = sorted(guessed, key=lambda guess: order.index(guess.channel))
    present = {guess.channel for guess in guessed}
    missing = tuple(" or ".join(group) for group in REQUIRED if not present.intersection(group))
    words = {"semicolon": ";", "tab": "\t", "comma": ",", "bar": "|", "blanks": " "}
    settings = {}
    if table.facts.get("separator") in words:
        settings["separator"] = words[table.facts["separator"]]
        settings["decimal"] = "," if table.facts["decimal mark"] == "comma" else "."
    proposal = Proposal(table.file, table.format, tuple(guessed), tuple(doubts), missing, tuple(unused), settings)
    return replace(proposal, found=(*doubts, *_of_the_log(table, design, proposal, known)))


def _column_of(spec: str) -> str:
    """Return a mapping without a factor before it."""
    from pmsm_ctrl.importers.mapping import FACTOR

    match = FACTOR.fullmatch(spec.strip())
    return match["column"] if match is not None else spec


def _of_the_log(table: Table, design: Design | None, proposal: Proposal, known: Mapping[str, str]) -> Sequence[Notice]:
    """Return the doubts of the log that this mapping makes; that it cannot be read is one of them."""
    if not proposal.complete:
        return ()
    try:
        return log_of(table, design, proposal.mapping, known).provenance.notices
    except LogError as error:
        return (say.NOT_READABLE(reason=str(error).removeprefix(f"{table.file}: ")),)

"""The result of every format reader: named columns with units, loaded on demand.

A reader knows the bytes of a file and no drives; `pmsm_ctrl.importers.mapping` knows channels and no bytes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

__all__ = ["Array", "Column", "Table", "left_out", "one_line"]

Array = NDArray[np.float64]


def one_line(text: str) -> str:
    """Return a text from a file fit to stand in a message: one line, single blanks, nothing unprintable."""
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())


def left_out(what: str, names: Sequence[str]) -> tuple[str, ...]:
    """Return the note on channels or columns that hold no numbers; none where there are none."""
    return (f"{what} that are not numbers, not used: {one_line(', '.join(names[:12]))}",) if names else ()


@dataclass(frozen=True)
class Column:
    """One column of a file.

    Parameters
    ----------
    name, unit : str
        As spelled in the file; the unit is empty where the file states none.
    header : str
        The whole header cell, which a mapping may quote.
    group : int
        Columns of one group share one time base.
    is_time : bool
        Whether the format marks this as the time of its group.
    is_date : bool
        Whether the column holds dates, which become seconds whatever unit a mapping names.
    is_text : bool
        Whether the file holds words here; never a channel.
    """

    name: str
    unit: str = ""
    header: str = ""
    group: int = 0
    is_time: bool = False
    is_date: bool = False
    is_text: bool = False

    @property
    def label(self) -> str:
        """The column as a message shows it."""
        text = self.header or self.name
        return text if len(text) <= 60 else f"{text[:57]}..."

    def __post_init__(self) -> None:
        for field_name in ("name", "unit", "header"):
            object.__setattr__(self, field_name, one_line(getattr(self, field_name)))


@dataclass(frozen=True)
class HeaderPeriod:
    """A sampling period above the numbers.

    Attributes
    ----------
    seconds : float
    text : str
        The line that states it.
    assumed : str
        The unit, where the line states none; else empty.
    """

    seconds: float
    text: str
    assumed: str = ""

    @property
    def mapping(self) -> str:
        """The mapping of `t`."""
        return f"every {1e3 * self.seconds:.12g} ms"


@dataclass(frozen=True)
class Table:
    """An opened file whose columns are known and whose numbers are not read yet.

    Parameters
    ----------
    file, format : str
        Name as given, and the format found.
    columns : tuple of Column
    load : callable
        Takes column indices and returns one array per index, shape (n,); columns of a group are equally long.
    locate : callable
        Takes (column index, sample) and returns the place in the file, for messages.
    notes : tuple of str
        What was guessed or left out.
    facts : dict
        The layout (separator, decimal mark, encoding, ...), for the import report.
    header_period : HeaderPeriod or None
        The sampling period that stands above the numbers.
    """

    file: str
    format: str
    columns: tuple[Column, ...]
    load: Callable[[Sequence[int]], list[Array]]
    locate: Callable[[int, int], str]
    notes: tuple[str, ...] = ()
    facts: dict[str, str] = field(default_factory=dict)
    header_period: HeaderPeriod | None = None

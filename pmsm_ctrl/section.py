"""The content of a result as blocks in reading order: written once, rendered as text, HTML and notebook.

How a room writes its ``present.py``:

1. ``@present.register`` on ``def _(result: Tuning) -> Section``; the room's ``__init__.py`` imports the module, which
   must load neither matplotlib nor numba, scipy or control.
2. First the verdict in one sentence, then ``*result.notices``, then the table that matters most, then the rest.
3. A notice is made where the doubt arises, from a `Template` of the room's ``notices.py``; `result.notices` keeps it.
   Its text is one sentence without a full stop and without "warning:".
4. Cells are text. ``rendering.numbers`` writes them: `number`, `percent`, `probability`, `with_error`, `with_prefix`.
   Columns of numbers are found and set to the right; units stand in the header, ``"rms [N m]"``.
5. A figure is ``Picture(lambda: my_figure(result), "What to see in it.")``, with matplotlib imported inside the
   function that draws. `Result.plot` draws the first one.
6. ``folded=True`` for what few readers want: left out of the text, shown on demand in HTML. A folded `Section` may
   hold text, tables and pictures.
7. A text with a line feed in it is set as it is, like code. Nothing is escaped by hand; renderers do that.
8. Then delete the room's summary, plot, section and text.py: `pmsm_ctrl.result.Result` has them. In a test,
   ``result.summary(width=1000)`` keeps a sentence on one line.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import singledispatch
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = [
    "Balance", "Block", "Notice", "Picture", "Section", "Sparkline", "Table", "Template", "Traces", "gaps_of",
    "present",
]  # fmt: skip

Array = NDArray[np.float64]
MOST_WARNINGS, MOST_ROWS = 3, 12  # of a brief section
GAP = 5.0  # sampling periods from which on a line over time is broken


@dataclass(frozen=True)
class Notice:
    """A reason to doubt a result: a code for programs, the facts, and a sentence for people.

    Attributes
    ----------
    code : str
        Stable, snake_case; what programs compare.
    text : str
        One sentence, no full stop.
    detail : mapping of str to value
        What the sentence was made from.
    """

    code: str
    text: str
    detail: Mapping[str, Any] = field(default_factory=dict, compare=False)

    def __str__(self) -> str:
        return self.text


@dataclass(frozen=True)
class Template:
    """The words of one kind of notice: a room keeps all of its own in one file.

    Attributes
    ----------
    code : str
    words : str
        A format string; its fields are the facts.
    """

    code: str
    words: str

    def __call__(self, **detail: Any) -> Notice:
        """Return the notice with these facts filled in."""
        return Notice(self.code, self.words.format(**detail), detail)


@dataclass(frozen=True, eq=False)
class Sparkline:
    """A curve as small as a cell of a table, with a band.

    Attributes
    ----------
    x, y, half : array, shape (n,)
        The band is y - half to y + half; NaN where it is not known.
    label : str
        The same in words, for those who do not see it.
    mark : float
        Abscissa of a vertical line; NaN for none.
    """

    x: Array
    y: Array
    half: Array
    label: str
    mark: float = float("nan")


@dataclass(frozen=True)
class Table:
    """Rows under a header, all cells text; `folded` ones are shown on demand in HTML and left out of the text.

    Attributes
    ----------
    header : tuple of str
    rows : tuple of tuple of str
        As long as the header, or shorter.
    caption : str
    folded : bool
    curves : dict of str to tuple of Sparkline or None
        Columns of curves behind the others by heading, one curve a row; in HTML alone.
    sortable : bool
        Whether a page lets the reader sort and filter the rows; such a table is shown whatever its length.
    links : dict of str to str
        Address by the text of a row's first cell, for HTML.
    whole : bool
        Whether a brief section keeps all its rows.
    """

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    caption: str = ""
    folded: bool = False
    curves: Mapping[str, tuple[Sparkline | None, ...]] = field(default_factory=dict, hash=False)
    sortable: bool = False
    links: Mapping[str, str] = field(default_factory=dict, hash=False)
    whole: bool = False


@dataclass(frozen=True)
class Picture:
    """A figure that is drawn when a page needs it, with the sentence that says what to see.

    Attributes
    ----------
    draw : function without arguments
        Returns a matplotlib figure.
    caption : str
    """

    draw: Callable[[], Figure]
    caption: str


@dataclass(frozen=True, eq=False)
class Balance:
    """One balance of a model over time: what was measured, and a prediction whose parts can be switched off.

    Attributes
    ----------
    name, unit : str
    measured, predicted : array, shape (m,)
    parts : dict of name to array, shape (m,)
        The parts of the prediction that can be switched off.
    products : array, shape (k + 1, k + 1)
        Mean products, over all samples that count, of the residual with all parts (first) and of the k parts: the rms
        of the residual without some parts follows from them.
    size : float
        Rms of the measured side over the same samples.
    floor : float
        Noise floor, as a share of `size`.
    count : int
        Samples that count; what several records share is weighed by it.
    """

    name: str
    unit: str
    measured: Array
    predicted: Array
    parts: Mapping[str, Array]
    products: Array
    size: float
    floor: float
    count: int = 1


@dataclass(frozen=True, eq=False)
class Traces:
    """Balances over time for a page on which one can zoom and switch parts off; left out of text, print and notebooks.

    Attributes
    ----------
    t : array, shape (m,)
        Time, s.
    coordinates : dict of label to array, shape (m,)
        What the residual can be drawn over; the first one, the speed, is drawn over time as well.
    balances : tuple of Balance
        The first one is shown first.
    stretches : tuple of (start, stop, words)
        Stretches of time worth looking at, s, and what is in them.
    name : str
        Of the record.
    held_out : tuple of Traces
        The same of records that nothing was fitted to; their balances and coordinates are among those of this one.
    used : bool array, shape (m,), or None
        The samples that count: neither at rest nor next to the begin or the end of a record, where the filters are not
        in. The others are not drawn, and do not set a scale. None: all of them.
    """

    t: Array
    coordinates: Mapping[str, Array]
    balances: tuple[Balance, ...]
    stretches: tuple[tuple[float, float, str], ...] = ()
    name: str = ""
    held_out: tuple[Traces, ...] = ()
    used: NDArray[np.bool_] | None = None

    @property
    def counting(self) -> NDArray[np.intp]:
        """The samples that count, ascending."""
        return np.arange(len(self.t)) if self.used is None else np.flatnonzero(self.used)


def gaps_of(t: Array) -> NDArray[np.intp]:
    """Return the samples before which a record has ended, or samples are missing; no line is drawn to them.

    Parameters
    ----------
    t : array, shape (n,)

    Returns
    -------
    array of int
    """
    step = np.diff(t)
    return np.flatnonzero(step > GAP * np.median(step)) + 1 if step.size else np.zeros(0, dtype=np.intp)


@dataclass(frozen=True)
class Section:
    """A heading and its blocks in reading order; trust comes before numbers.

    Attributes
    ----------
    title : str
    blocks : tuple of str, Notice, Table, Picture, Traces and Section
    folded : bool
        Left out of the text, shown on demand in HTML.
    essential : tuple of block
        Those of the blocks that `brief` keeps beside the verdict and the first table.
    """

    title: str
    blocks: tuple[Block, ...] = ()
    folded: bool = False
    essential: tuple[Block, ...] = ()

    def brief(self) -> Section:
        """Return the verdict, the first warnings and the table that matters most, for a terminal.

        Returns
        -------
        Section
            Its last sentence says what was left out.
        """
        kept: list[Block] = []
        warnings, tables = 0, 0
        for block in self.blocks:
            own = any(block is one for one in self.essential)
            if isinstance(block, Notice):
                warnings += 1
                own = warnings <= MOST_WARNINGS
            elif isinstance(block, Table) and not block.folded:
                tables += 1
                own = own or tables == 1
            elif isinstance(block, str):
                own = own or tables == 0
            if own:
                kept.append(_shortened(block))
        more = warnings - MOST_WARNINGS
        left = [f"{more} more warning{'s' if more > 1 else ''}"] if more > 0 else []
        left += ["everything else"] if len(kept) < len(self.blocks) else []
        said = [f"--verbose shows {' and '.join(left)}."] if left else []
        return replace(self, blocks=(*kept, *said))

    def without(self, elsewhere: Iterable[Notice | Picture]) -> Section:
        """Return a copy without some notices and pictures, which stand elsewhere on the page.

        Parameters
        ----------
        elsewhere : iterable of Notice and Picture
            Pictures are known by their captions.

        Returns
        -------
        Section
        """
        left_out = {one.caption if isinstance(one, Picture) else (one.code, one.text) for one in elsewhere}

        def kept(block: Block) -> bool:
            if isinstance(block, Notice):
                return (block.code, block.text) not in left_out
            return not (isinstance(block, Picture) and block.caption in left_out)

        return replace(self, blocks=tuple(filter(kept, self.blocks)))


def _shortened(block: Block) -> Block:
    if not isinstance(block, Table) or block.whole or len(block.rows) <= MOST_ROWS:
        return block
    rest = (f"... {len(block.rows) - MOST_ROWS + 1} more",)
    return replace(block, rows=(*block.rows[: MOST_ROWS - 1], rest))


Block: TypeAlias = str | Notice | Table | Picture | Traces | Section


@singledispatch
def present(result: Any) -> Section:
    """Return the content of a result. Rooms register their results in their ``present.py``.

    Parameters
    ----------
    result : Result

    Returns
    -------
    Section

    Raises
    ------
    TypeError
        When no room has registered this type.
    """
    raise TypeError(f"{type(result).__name__} has no presentation; its room registers one with `present`")

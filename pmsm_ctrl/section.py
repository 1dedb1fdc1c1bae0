"""What a result has to say, as blocks in reading order: written once, rendered as text, HTML and notebook.

A room describes its result in its own ``present.py`` and registers that with `present`. Nothing here draws: a picture
holds the function that makes its figure, and only the renderer calls it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import singledispatch
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Notice", "Picture", "Section", "Table", "Template", "present"]


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
    """The words of one kind of notice: a room keeps all of its own in one file."""

    code: str
    words: str

    def __call__(self, **detail: Any) -> Notice:
        """Return the notice with these facts filled in."""
        return Notice(self.code, self.words.format(**detail), detail)


@dataclass(frozen=True)
class Table:
    """Rows under a header, all cells text; `folded` ones are shown on demand in HTML and left out of the text."""

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    caption: str = ""
    folded: bool = False


@dataclass(frozen=True)
class Picture:
    """A figure that is drawn when a page needs it, with the sentence that says what to see."""

    draw: Callable[[], Figure]
    caption: str


@dataclass(frozen=True)
class Section:
    """A heading and its blocks in reading order; trust comes before numbers."""

    title: str
    blocks: tuple[Any, ...] = ()
    folded: bool = False


@singledispatch
def present(result: Any) -> Section:
    """Return what a result has to say. Rooms register their results in their ``present.py``."""
    raise TypeError(f"{type(result).__name__} has no presentation; its room registers one with `present`")

"""The result of every verb: frozen, with its warnings before its numbers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Any, overload

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.section import Block, Notice, Picture, Section, present

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Estimate", "Result", "Verdict", "jsonable"]


LONGEST_REPR = 160  # characters


class Verdict(StrEnum):
    """What a log says of a design, in one word; the value stands in the JSON."""

    CONSISTENT = "consistent"
    EFFECTS_MISSING = "effects_missing"
    UNEXPLAINED = "unexplained"
    NOT_EXCITED = "not_excited"
    IMPLAUSIBLE = "implausible"
    INCONCLUSIVE = "inconclusive"


@dataclass(frozen=True)
class Estimate:
    """One identified number with its unit and standard error.

    Attributes
    ----------
    value, stderr : float
        In `unit`; NaN where a standard error is not known.
    unit : str
    nominal : float or None
        What the design says.
    ends : (float, float) or None
        Of the 95 % interval, where the standard error does not tell them: the profile of the fit is no parabola.
    """

    value: float
    unit: str
    stderr: float = float("nan")
    nominal: float | None = None
    ends: tuple[float, float] | None = None

    def interval(self, coverage: float = 0.95) -> tuple[float, float]:
        """Return the two-sided normal interval of this coverage; the 95 % one is given by `ends` where these are known.

        Parameters
        ----------
        coverage : float
            0 to 1.

        Returns
        -------
        (float, float)
        """
        from statistics import NormalDist

        if self.ends is not None and coverage == 0.95:
            return self.ends
        half = NormalDist().inv_cdf(0.5 + coverage / 2.0) * self.stderr
        return self.value - half, self.value + half


class Result(ABC):
    """Interface of a verb's result. Leaves are frozen dataclasses whose room registers them with `present`.

    A leaf has `notices`, as a field or as a property, and `to_dict`; text, figure and report come from here.
    """

    if TYPE_CHECKING:  # nothing at run time: a dataclass would take a property for its field's default

        @property
        def notices(self) -> tuple[Notice, ...]:
            """Reasons to doubt the numbers, with their codes; empty when there are none."""
            raise NotImplementedError

    @property
    def warnings(self) -> tuple[str, ...]:
        """Reasons to doubt the numbers, as sentences; empty when there are none."""
        return tuple(notice.text for notice in self.notices)

    def doubts(self) -> dict[str, list[str]]:
        """Return the notices as `to_dict` lists them.

        Returns
        -------
        dict
            ``"warnings"`` (sentences) and ``"warning_codes"``, in the same order.
        """
        return {"warnings": list(self.warnings), "warning_codes": [notice.code for notice in self.notices]}

    @abstractmethod
    def to_dict(self) -> dict[str, Any]:
        """Return plain values fit for JSON."""

    def section(self) -> Section:
        """Return what the result has to say, as blocks."""
        return present(self)

    def summary(self, width: int | None = None, *, brief: bool = False) -> str:
        """Return the result as text, trust first.

        Parameters
        ----------
        width : int, optional
            Columns of the page; those of the terminal, and at least 80, if left out.
        brief : bool
            Whether to leave out what does not belong to the verdict and its most important numbers.
        """
        from pmsm_ctrl.rendering import to_text

        section = present(self)
        return to_text(section.brief() if brief else section, width)

    def plot(self) -> Figure:
        """Return the first figure of the section; a notebook shows it, with or without pyplot.

        Raises
        ------
        RequestError
            When the result has no figure.
        """
        from pmsm_ctrl.rendering.svg import shown_in_notebook

        picture = next(_pictures(present(self).blocks), None)
        if picture is None:
            raise RequestError(f"{type(self).__name__}: this result has no figure")
        return shown_in_notebook(picture.draw())

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if "__repr__" not in cls.__dict__:  # a dataclass would print every array
            cls.__repr__ = Result.__repr__  # type: ignore[method-assign]

    def __repr__(self) -> str:
        """One line: the type and the verdict."""
        try:
            section = present(self)
        except (AttributeError, KeyError, TypeError):  # in a debugger, half made
            return f"<{type(self).__name__}>"
        said = next((block for block in section.blocks if isinstance(block, str)), section.title)
        line = " ".join(said.split())
        return f"<{type(self).__name__}: {line if len(line) <= LONGEST_REPR else f'{line[: LONGEST_REPR - 3]}...'}>"

    def _repr_html_(self) -> str:
        from pmsm_ctrl.rendering import to_notebook

        return to_notebook(present(self))


def _pictures(blocks: Iterable[Block]) -> Iterator[Picture]:
    for block in blocks:
        if isinstance(block, Picture):
            yield block
        elif isinstance(block, Section):
            yield from _pictures(block.blocks)


@overload
def jsonable(value: Mapping[str, Any]) -> dict[str, Any]: ...
@overload
def jsonable(value: Sequence[Any] | NDArray[Any] | Estimate | float | str | None) -> Any: ...
def jsonable(value: object) -> Any:
    """Turn numpy values, estimates, tuples and NaN into what JSON can hold.

    Parameters
    ----------
    value : object

    Returns
    -------
    object
        Plain values; NaN and infinity become None.
    """
    if isinstance(value, Estimate):
        nominal = {} if value.nominal is None else {"nominal": jsonable(value.nominal)}
        ends = {} if value.ends is None else {"interval_95": jsonable(value.ends)}
        return (
            {
                "value": jsonable(value.value),
                "unit": value.unit,
                "stderr": jsonable(value.stderr),
            }
            | nominal
            | ends
        )
    if isinstance(value, Mapping):
        return {str(key): jsonable(item) for key, item in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [jsonable(item) for item in value]
    if isinstance(value, np.bool_):
        return bool(value)
    if isinstance(value, np.integer):
        return int(value)
    if isinstance(value, float | np.floating):
        return float(value) if np.isfinite(value) else None
    return value

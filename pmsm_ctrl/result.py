"""What every verb returns: a frozen result that says whether to trust it before it says its numbers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Estimate", "Result", "Section", "jsonable"]


@dataclass(frozen=True)
class Estimate:
    """One identified number with its unit and standard error."""

    value: float
    unit: str
    stderr: float = float("nan")
    nominal: float | None = None

    def interval(self, coverage: float = 0.95) -> tuple[float, float]:
        """Return the two-sided normal interval of this coverage."""
        from statistics import NormalDist

        half = NormalDist().inv_cdf(0.5 + coverage / 2.0) * self.stderr
        return self.value - half, self.value + half


@dataclass(frozen=True)
class Section:
    """One section of a report: text paragraphs, tables and figures, each figure with a sentence saying what to see.

    `captions` are the headings of the tables in their order; a table whose heading is left out has none.
    """

    title: str
    paragraphs: tuple[str, ...] = ()
    tables: tuple[tuple[tuple[str, ...], tuple[tuple[str, ...], ...]], ...] = ()  # (header, rows)
    figures: tuple[tuple[Figure, str], ...] = ()
    captions: tuple[str, ...] = ()


class Result(ABC):
    """Interface of a verb's result. Leaves are frozen dataclasses."""

    @property
    @abstractmethod
    def warnings(self) -> tuple[str, ...]:
        """Reasons to doubt the numbers; empty when there are none."""

    @abstractmethod
    def summary(self) -> str:
        """Return the result as text, trust first."""

    @abstractmethod
    def plot(self) -> Figure:
        """Return a matplotlib figure."""

    @abstractmethod
    def to_dict(self) -> dict[str, Any]:
        """Return plain values fit for JSON."""

    @abstractmethod
    def section(self) -> Section:
        """Return the section of the report."""


def jsonable(value: Any) -> Any:
    """Turn numpy values, estimates, tuples and NaN into what JSON can hold (NaN and infinity become None)."""
    if isinstance(value, Estimate):
        nominal = {} if value.nominal is None else {"nominal": jsonable(value.nominal)}
        return {
            "value": jsonable(value.value),
            "unit": value.unit,
            "stderr": jsonable(value.stderr),
        } | nominal
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

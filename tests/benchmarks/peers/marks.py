"""What counts of an answer: the right name first, among the names, and false names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from tests.benchmarks.worlds.judge import SAME

__all__ = ["TIMING", "Marks", "marks"]

OFFSET = "constant_load"  # a name where it is hidden, a base column elsewhere
TIMING = "delay"  # when a channel was sampled, rather than what the drive does


@dataclass(frozen=True)
class Marks:
    """Of one answer.

    Attributes
    ----------
    first : bool
        Whether the first name, or one declared equivalent to it, is right.
    first_but_timing : bool
        The same among the names other than `delay`.
    first_itself : bool
        Whether the first name other than `delay` is right, its equivalents not counted.
    contained : bool
        Whether any name is right.
    false : tuple of str
    """

    first: bool
    first_but_timing: bool
    first_itself: bool
    contained: bool
    false: tuple[str, ...]


def marks(row: Mapping[str, Any]) -> Marks:
    """Judge a row by its hidden effect, its names and what is declared equivalent to each."""
    good = {row["hidden"], *SAME.get(row["hidden"] or "", ())}
    pairs = [
        (name, {name, *equal})
        for name, equal in zip(row["named"], row["equivalents"], strict=True)
        if name != OFFSET or row["hidden"] == OFFSET
    ]
    timeless = [pair for pair in pairs if pair[0] != TIMING]
    return Marks(
        bool(pairs) and bool(good & pairs[0][1]),
        bool(timeless) and bool(good & timeless[0][1]),
        bool(timeless) and timeless[0][0] in good,
        any(good & equal for _, equal in pairs),
        tuple(name for name, equal in pairs if not good & equal),
    )

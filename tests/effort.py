"""How much the random and the statistical tests do: a short form every time, the whole with ``--slow``."""

from __future__ import annotations

from typing import TypeVar

import pytest

Amount = TypeVar("Amount", int, float)

WHOLE = False  # set by conftest.py from --slow, before any test module is read


def amount(short: Amount, whole: Amount) -> Amount:
    """Return how many examples, seeds, draws or seconds a test takes; its bounds hold for either."""
    return whole if WHOLE else short


def seeds(first: object, *more: object) -> list[object]:
    """Return parameters of a test: the first one every time, the others with ``--slow``."""
    return [first, *(slow(seed) for seed in more)]


def slow(*values: object) -> object:
    """Return a set of parameters that is tried with ``--slow`` alone."""
    return pytest.param(*values, marks=pytest.mark.slow)

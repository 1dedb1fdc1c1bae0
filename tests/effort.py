"""How much the random and the statistical tests do: a short form every time, the whole with ``--slow``."""

from __future__ import annotations

WHOLE = False  # set by conftest.py from --slow, before any test module is read


def amount(short: int, whole: int) -> int:
    """Return how many examples, seeds or draws a test takes; its bounds hold for either."""
    return whole if WHOLE else short

"""Alignment of the columns of a table, for both renderers."""

from __future__ import annotations

import re

from pmsm_ctrl.section import Table

__all__ = ["numeric_columns"]

_NUMBER = re.compile(
    r"[<>]?\s*+(?:[-+−±]\s*+)?(\d[\d.,]*+(e[-+]?\d++)?|nan|inf)\s*+(±\s*+\d[\d.,]*+(e[-+]?\d++)?)?\s*+%?"
)
_NOTHING = ("", "-", "nan")


def numeric_columns(table: Table) -> tuple[bool, ...]:
    """Return for each column whether it is set to the right: more than half of its filled cells are numbers."""
    right = []
    for k in range(len(table.header)):
        cells = [row[k].strip() for row in table.rows if k < len(row) and row[k].strip() not in _NOTHING]
        right.append(2 * sum(bool(_NUMBER.fullmatch(cell)) for cell in cells) > len(cells))
    return tuple(right)

"""The table of records, the same for every verb."""

from __future__ import annotations

import math
from collections.abc import Sequence

from pmsm_ctrl.regression.record_result import Errors, RecordResult, RecordSpread
from pmsm_ctrl.rendering.numbers import number, percent, probability, with_error, with_prefix
from pmsm_ctrl.section import Table

__all__ = ["records_table", "spread_sentence", "torque_error_name"]

SYMBOLS = {"dF_c": "dry friction", "dF_v": "viscous friction", "offset": "constant {drive}"}
CAPTION = "Records: {error}s; by how much friction deviates from the mean of the records"


def torque_error_name(drive: str, held_out: bool = False, level_refitted: bool = False) -> str:
    """Return what every verb calls the rms of measured less predicted torque (force), by the rms of the measured.

    Parameters
    ----------
    drive : str
        The word for what drives the axis.
    held_out : bool
        Of records to which nothing was fitted.
    level_refitted : bool
        Whether dry friction, viscous friction and a constant torque of these were, nevertheless.
    """
    return f"{'held-out ' if held_out else ''}{drive} error{', level refitted' if level_refitted else ''}"


def records_table(rows: Sequence[RecordResult], drive: str, before: str = "before", after: str = "after") -> Table:
    """Return a row for every record; columns that no record fills are left out.

    Parameters
    ----------
    rows : sequence of RecordResult
    drive : str
        The word for what drives the axis.
    before, after : str
        Heads of the two columns of errors.
    """
    error = torque_error_name(drive)
    head = ["record", "duration", "rate", f"{error} {before}", after]
    head += [f"{before}, level refitted", f"{after}, level refitted"]
    head += [*(words.format(drive=drive) for words in SYMBOLS.values()), "added to the angle", "p (agrees)"]
    cells = [_cells(row) for row in rows]
    shown = [k for k in range(len(head)) if any(row[k] for row in cells)]
    return Table(
        tuple(head[k] for k in shown), tuple(tuple(row[k] for k in shown) for row in cells),
        CAPTION.format(error=error),
    )  # fmt: skip


def _cells(row: RecordResult) -> list[str]:
    name = f"{row.name} (held out)" if row.held_out else row.name
    own, zero = [row.deviations.get(symbol) for symbol in SYMBOLS], row.angle
    return [
        name,
        f"{row.duration:.3g} s",
        f"{number(row.rate, 4)} Hz",
        *(_relative(errors) for errors in (row.before, row.after, row.level_before, row.level_after)),
        *(with_error(one.value, one.stderr, one.unit) if one is not None else "" for one in own),
        with_error(zero.value, zero.stderr, zero.unit) if zero is not None and zero.value else "",
        "" if math.isnan(row.p_value) else probability(row.p_value),
    ]


def _relative(errors: Errors) -> str:
    return percent(errors["torque"]["relative"]) if "torque" in errors else ""


def spread_sentence(spreads: Sequence[RecordSpread], drive: str) -> str | None:
    """Return by how much friction drifts between records, as a sentence; None for a single record.

    Where the records tell of no spread, that is a bound of what each deviates by, and no number that looks measured.

    Parameters
    ----------
    spreads : sequence of RecordSpread
    drive : str
        The word for what drives the axis.
    """
    if not spreads:
        return None
    told = ", ".join(_sized(one, one.value, drive) for one in spreads if one.below is None)
    within = ", ".join(_sized(one, one.below, drive, "below ") for one in spreads if one.below is not None)
    said = [f"Standard deviation between records: {told}"] if told else []
    said += [f"Deviation of each record from all: {within}"] if within else []
    first = spreads[0]
    assumed = f"{with_prefix(first.assumed, first.unit)} of {SYMBOLS[first.symbol].format(drive=drive)}"
    return f"{'. '.join(said)}. An assumed {assumed} counts as one more record."


def _sized(one: RecordSpread, value: float, drive: str, before: str = "") -> str:
    share = f" ({percent(one.relative * value / one.value)})" if one.relative is not None and one.value else ""
    return f"{SYMBOLS[one.symbol].format(drive=drive)} {before}{with_prefix(value, one.unit)}{share}"

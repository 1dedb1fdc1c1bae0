"""Groups of channels with different time bases, brought onto one."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pmsm_ctrl.errors import LogError
from pmsm_ctrl.importers.table import Array

__all__ = ["on_one_raster"]

# the raster of the first of these that is present becomes the time base, because motion is differentiated
_LEADS = ("theta", "omega", "i_q", "torque")
ROUNDING = 1e-6  # of a period: stamps that differ by less are the same, computed from another start


def on_one_raster(
    times: Mapping[int, Array], channels: Mapping[int, Mapping[str, Array]], file: str
) -> tuple[dict[str, Array], tuple[str, ...]]:
    """Return all channels on the raster of the motion channel, and notes on what was interpolated or dropped.

    Groups with the same time stamps are joined as they are, also where one begins later or ends earlier. Others are
    interpolated linearly. Only the time that all groups cover remains: nothing is extrapolated, and a note says of
    which channels samples were dropped, and when.

    Raises
    ------
    LogError
        When the groups do not overlap in time.
    """
    held = {group: named for group, named in channels.items() if named}
    base = next(group for lead in _LEADS for group, named in held.items() if lead in named)
    t = times[base]
    others = {g: times[g] for g in held if g != base and not _same(times[g], t)}
    start = max([t[0], *(other[0] for other in others.values())])
    stop = min([t[-1], *(other[-1] for other in others.values())])
    near = ROUNDING * _period(t)
    keep = slice(int(np.searchsorted(t, start - near)), int(np.searchsorted(t, stop + near, side="right")))
    if keep.stop <= keep.start:
        raise LogError(
            f"{file}: the channel groups do not overlap in time (latest start {start:g} s, earliest end {stop:g} s)"
        )
    whole = keep.stop - keep.start == t.size
    result = {"t": t if whole else t[keep].copy()}
    notes: list[str] = []
    dropped: list[str] = []
    for group, named in held.items():
        own = others.get(group)
        rows = keep if own is None else _rows(own, result["t"])
        for name, values in named.items():
            if rows is None:
                result[name] = np.interp(result["t"], times[group], values)
            else:
                result[name] = values if rows.stop - rows.start == values.size else values[rows].copy()
        if rows is None:
            change = f"from a raster of {_period(times[group]) * 1e3:.6g} ms to {_period(t) * 1e3:.6g} ms"
            notes.append(f"{', '.join(named)} interpolated linearly {change}")
        if said := _dropped(times[group], start - near, stop + near):
            dropped.append(f"{said}: {', '.join(named)}")
    return result, (*notes, *dropped)


def _rows(own: Array, t: Array) -> slice | None:
    """Return the rows of a group whose stamps are those of the result but for rounding, None where there are none."""
    first = int(np.searchsorted(own, t[0] - ROUNDING * _period(t)))
    part = own[first : first + t.size]
    if part.size == t.size and bool(np.all(np.abs(part - t) <= ROUNDING * _period(t))):
        return slice(first, first + t.size)
    return None


def _period(t: Array) -> float:
    return float(np.median(np.diff(t))) if t.size > 1 else 0.0


def _dropped(t: Array, start: float, stop: float) -> str:
    """Return how many samples of a group lie outside the common time, and when; empty where none does."""
    head, tail = t[t < start], t[t > stop]
    if not head.size + tail.size:
        return ""
    spans = " and ".join(f"{part[0]:.6g} to {part[-1]:.6g} s" for part in (head, tail) if part.size)
    return f"{head.size + tail.size} samples outside the time that all groups cover were dropped ({spans})"


def _same(a: Array, b: Array) -> bool:
    return a.size == b.size and bool(np.array_equal(a, b))

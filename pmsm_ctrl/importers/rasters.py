"""Groups of channels with different time bases, brought onto one."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pmsm_ctrl.errors import LogError
from pmsm_ctrl.importers.table import Array

__all__ = ["on_one_raster"]

# the raster of the first of these that is present becomes the time base, because motion is differentiated
_LEADS = ("theta", "omega", "i_q", "torque")


def on_one_raster(
    times: Mapping[int, Array], channels: Mapping[int, Mapping[str, Array]], file: str
) -> tuple[dict[str, Array], tuple[str, ...]]:
    """Return all channels on the raster of the motion channel, and a note on every interpolated group.

    Groups with the same time stamps are joined as they are. Others are interpolated linearly inside the time
    that all groups cover; nothing is extrapolated.

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
    keep = slice(int(np.searchsorted(t, start)), int(np.searchsorted(t, stop, side="right")))
    if keep.stop <= keep.start:
        raise LogError(
            f"{file}: the channel groups do not overlap in time (latest start {start:g} s, earliest end {stop:g} s)"
        )
    whole = keep.stop - keep.start == t.size
    result = {"t": t if whole else t[keep].copy()}
    notes = []
    for group, named in held.items():
        for name, values in named.items():
            if group in others:
                result[name] = np.interp(result["t"], others[group], values)
            else:
                result[name] = values if whole else values[keep].copy()
        if group in others:
            period, own = np.median(np.diff(t)) if t.size > 1 else 0.0, others[group]
            other = np.median(np.diff(own)) if own.size > 1 else 0.0
            change = f"from a raster of {other * 1e3:.6g} ms to {period * 1e3:.6g} ms"
            notes.append(f"{', '.join(named)} interpolated linearly {change}")
    if notes and (cut := t.size - result["t"].size):
        notes.append(f"{cut} samples outside the time that all groups cover were dropped")
    return result, tuple(notes)


def _same(a: Array, b: Array) -> bool:
    return a.size == b.size and bool(np.array_equal(a, b))

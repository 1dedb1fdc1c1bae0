"""From an opened table and an assignment to channels: loaded, converted, checked, on one time base."""

from __future__ import annotations

import math

import numpy as np

from pmsm_ctrl.errors import LogError
from pmsm_ctrl.importers.mapping import Assignment, Source
from pmsm_ctrl.importers.notices import ANGLE_UNWRAPPED
from pmsm_ctrl.importers.spare import with_time, without_gaps
from pmsm_ctrl.importers.table import Array, Table
from pmsm_ctrl.importers.wraps import unwrapped, wrap_period
from pmsm_ctrl.section import Notice

__all__ = ["channels_of"]

# Recordings that were appended to one file: fewest samples of each, how near it begins to where the first one did, as a
# share of that one's length, and the gap that is put between them, in s and in periods.
FEWEST, NEAR, APART, APART_PERIODS = 100, 0.01, 2.0, 60.0
COARSE = 1e-4  # share of the sampling period above which the resolution of absolute times is a jitter


def channels_of(
    table: Table, assignment: Assignment, wrap: float | None = None, window: tuple[float, float] | None = None
) -> tuple[dict[str, Array], tuple[str, ...], tuple[Notice, ...]]:
    """Load the assigned columns; return SI channels on one time base, notes on the conversions and reasons to doubt.

    `wrap` is the period at which a position wraps, where it is stated; `window` the first and last time that count.

    Raises
    ------
    LogError
        With the place for a value that is not finite and for time that does not increase.
    """
    from pmsm_ctrl.importers.rasters import on_one_raster

    times = _time_columns(table, assignment)
    sources, untimed = with_time(table, assignment, times)
    columns = [source.column for source in sources]
    loaded = dict(zip([*columns, *times.values()], table.load([*columns, *times.values()]), strict=True))
    rasters: dict[int, Array] = {}
    notes: list[str] = []
    for group, index in times.items():
        gain = _time_gain(table, assignment, index)
        t = loaded[index] * gain if gain != 1.0 else loaded[index]
        if len(times) == 1 and window is None and _too_coarse(t):
            t = (loaded[index] - loaded[index][0]) * gain
            notes.append("t is counted from its first row: the stamps have more digits than seconds since then hold")
        if len(times) == 1 and (count := _restarts(t)):
            t = _in_line(t)
            notes.append(
                f"time starts again {count} times: {count + 1} recordings were appended, and are records apart"
            )
        rasters[group] = _check_time(table, index, loaded[index], t)
    sources, gaps = without_gaps(table, assignment, sources, loaded)
    channels: dict[int, dict[str, Array]] = {group: {} for group in times}
    for source in sources:
        if source.channel == "t":
            continue
        group = table.columns[source.column].group
        channels[group][source.channel] = _convert(table, source, loaded[source.column])
    result, resampled = on_one_raster(rasters, channels, table.file)
    turned, doubts = _unwrap(result, wrap) if assignment.motion == "rotary" or wrap is not None else ([], [])
    if window is not None:
        result = _inside(result, window, table.file)
        resampled = (*resampled, f"only t = {window[0]:g} to {window[1]:g} s read")
    for values in result.values():
        values.setflags(write=False)  # a log shares read-only arrays and copies others
    return result, (*notes, *resampled, *turned), (*untimed, *gaps, *doubts)


def _too_coarse(t: Array) -> bool:
    """Whether what a double resolves at such times is no small share of the sampling period."""
    steps = np.diff(t[: min(len(t), 1000)])
    return bool(len(steps) and np.spacing(np.abs(t[0])) > COARSE * np.median(np.abs(steps)))


def _time_columns(table: Table, assignment: Assignment) -> dict[int, int]:
    """The time column of every group that carries a channel, and has one."""
    mapped = assignment.source("t")
    out: dict[int, int] = {}
    for source in assignment.sources:
        group = table.columns[source.column].group
        if group in out:
            continue
        if mapped is not None and table.columns[mapped.column].group == group:
            out[group] = mapped.column
            continue
        own = next((i for i, c in enumerate(table.columns) if c.group == group and c.is_time), None)
        if own is not None:
            out[group] = own
    return out


def _time_gain(table: Table, assignment: Assignment, index: int) -> float:
    from pmsm_ctrl.importers.names import unit_spelling
    from pmsm_ctrl.units import UNITS

    mapped = assignment.source("t")
    unit = table.columns[index].unit
    if mapped is not None and (mapped.column == index or not unit):
        return mapped.gain
    si, factor = UNITS.get(unit_spelling(unit), ("s", 1.0))
    if si != "s":
        column = table.columns[index]
        raise LogError(f"{table.file}: time column '{column.label}' has unit [{column.unit}]; s was expected")
    return factor


def _convert(table: Table, source: Source, values: Array) -> Array:
    """Return SI values; one that is not finite is an error with its place."""
    if not math.isfinite(source.gain) or source.gain == 0.0:
        what = f"channel '{source.channel}': factor {source.gain}"
        raise LogError(f"{table.file}: {what}; a finite number other than 0 was expected")
    with np.errstate(over="ignore"):
        result = values * source.gain if source.gain != 1.0 else values
    finite = np.isfinite(result)
    if not finite.all():
        row = int(np.argmin(finite))
        found = "empty or not a number" if np.isnan(values[row]) else f"{values[row]:g}"
        raise LogError(f"{table.file}: {table.locate(source.column, row)}: {found}; a finite number was expected")
    return result


def _restarts(t: Array) -> int:
    """Return how often time starts again, as where recordings were appended to one file; 0 where it is out of order.

    Every recording has to be one: so many samples, in the order of time, that begin near where the first one began.
    """
    back = np.flatnonzero(~(np.diff(t) > 0.0)) + 1
    if len(back) == 0 or not np.isfinite(t).all():
        return 0
    edges = np.concatenate([[0], back, [len(t)]])
    first, length = t[edges[:-1]], np.diff(edges)
    period = float(np.median(np.diff(t)))
    near = np.abs(first - t[0]) <= max(NEAR * float(t[edges[1] - 1] - t[0]), 2.0 * period)
    return len(back) if length.min() >= FEWEST and near.all() else 0


def _in_line(t: Array) -> Array:
    """Put recordings whose time starts again behind one another, with a gap between them."""
    back = np.flatnonzero(np.diff(t) <= 0.0)
    step = np.zeros(len(t))
    apart = max(APART, APART_PERIODS * float(np.median(np.diff(t))))
    step[back + 1] = t[back] + apart - t[back + 1]
    return np.asarray(t + np.cumsum(step))


def _check_time(table: Table, index: int, values: Array, t: Array) -> Array:
    """Return time in s, `values` as in the file; what is not finite or does not increase is an error with its place."""
    if values.size == 0:
        raise LogError(f"{table.file}: no rows of numbers; at least one was expected")
    finite = np.isfinite(t)
    if not finite.all():
        row = int(np.argmin(finite))
        raise LogError(f"{table.file}: {table.locate(index, row)}: {values[row]:g} found; a time was expected")
    step = np.diff(t)
    if t.size > 1 and not (step > 0).all():
        row = int(np.argmin(step > 0)) + 1
        what = "the same time stamp twice" if step[row - 1] == 0 else "time runs backwards"
        place = table.locate(index, row)
        raise LogError(f"{table.file}: {place}: {what} ({values[row]:.9g} after {values[row - 1]:.9g})")
    return t


def _inside(channels: dict[str, Array], window: tuple[float, float], file: str) -> dict[str, Array]:
    """Return the samples within a window of time.

    Raises
    ------
    LogError
        When there are none.
    """
    t = channels["t"]
    kept = slice(int(np.searchsorted(t, window[0])), int(np.searchsorted(t, window[1], side="right")))
    if kept.stop <= kept.start:
        what = f"no sample between {window[0]:g} and {window[1]:g} s"
        raise LogError(f"{file}: [log] window: {what}; the file has t = {t[0]:g} to {t[-1]:g} s")
    return {name: values[kept].copy() for name, values in channels.items()}


def _unwrap(channels: dict[str, Array], stated: float | None) -> tuple[list[str], list[Notice]]:
    """Unwrap angles by the period at which they wrap, be it a turn or another one; a stated one is no doubt."""
    notes: list[str] = []
    doubts: list[Notice] = []
    for name in ("theta", "theta_ref", "theta_load"):
        if name not in channels or channels[name].size < 2:
            continue
        theta = channels[name]
        if stated is not None:
            channels[name] = unwrapped(theta, stated)
            notes.append(f"{name} unwrapped at {stated:g}, as the design states")
            continue
        with np.errstate(all="ignore"):
            period = wrap_period(theta)
        if period > 0.0:
            count = int(np.count_nonzero(np.abs(np.diff(theta)) > 0.7 * period))
            channels[name] = unwrapped(theta, period)
            if abs(period / (2.0 * np.pi) - 1.0) < 1e-9:
                notes.append(f"{name} wraps at one turn ({count} times); unwrapped")
            else:
                doubts.append(ANGLE_UNWRAPPED(channel=name, period=period, unit="rad", count=count))
    return notes, doubts

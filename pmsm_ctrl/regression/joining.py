"""Several records as one log: one time axis with holes between them, the lowest rate, and the channels of all records.

The evaluations leave holes out, so that a joined log is evaluated like any other. Its `records` say which stretch
belongs to which record. A hole of more than `GAP` seconds in a file separates two records as well.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import LogError
from pmsm_ctrl.log import Log, Provenance, Span
from pmsm_ctrl.regression import notices as words
from pmsm_ctrl.regression.conditioning import default_cutoff
from pmsm_ctrl.regression.filters import derivative, low_pass
from pmsm_ctrl.regression.signals import drive_torque
from pmsm_ctrl.regression.timing import bridge_time, end_speeds, uniform, unwrapped
from pmsm_ctrl.section import Notice

__all__ = ["FAST", "joined", "name_of", "parts_of", "thinned", "thinning", "with_records"]

Array = NDArray[np.float64]

# A hole of so many seconds, and of so many periods, separates two records: what is shorter are lost samples.
GAP, GAP_PERIODS = 1.0, 50.0
FEWEST = 100  # samples of a record
# Time between two records, in periods of the default cutoff: the filters have forgotten the one before.
APART = 20.0
# Rates that differ by less are the same clock's; what a lower rate keeps of a faster record, as a share of that rate.
SAME_RATE, KEPT_BAND = 0.01, 0.4
# Logs of twice this rate and more are thinned to about it first, Hz; stamps that miss their turn by more than this
# share of a period jitter.
FAST, JITTER = 1000.0, 1e-3
# Samples beyond which a log is thinned further, but not below this rate, Hz: an evaluation needs about 1 kB of memory
# for each.
MOST, SLOWEST = 1_000_000, 250.0
ROUNDED = 1e-6  # share of a rate that its stamps may have lost
MOTION, DRIVE = ("theta", "omega"), ("torque", "i_q")
ANGLES = ("theta", "theta_ref", "theta_load", "theta_true")


@dataclass(frozen=True, eq=False)
class _Part:
    """A record at an even rate, its own time beginning at `begin`; samples that are no measurement are left out."""

    name: str
    begin: float
    rate: float
    t: Array
    channels: Mapping[str, Array]


def name_of(log: Log, number: int = 1) -> str:
    """Return what a record is called: its file, or its number.

    Parameters
    ----------
    log : Log
    number : int
        Its place among the given ones, from 1.
    """
    return log.provenance.file or f"record {number}"


def with_records(log: Log, number: int = 1) -> Log:
    """Return the log with its records named, where holes in its time separate several.

    Parameters
    ----------
    log : Log
    number : int
        Its place among the given ones, from 1.
    """
    if log.records or len(log) < 2 * FEWEST:
        return log
    least = max(GAP, GAP_PERIODS * log.period)
    holes = np.flatnonzero(np.diff(log.t) > least) + 1
    edges = [0, *holes.tolist(), len(log)]
    pieces: list[tuple[int, int]] = []
    for start, stop in itertools.pairwise(edges):
        if pieces and (stop - start < FEWEST or pieces[-1][1] - pieces[-1][0] < FEWEST):
            pieces[-1] = (pieces[-1][0], stop)  # too short to be a record of its own
        else:
            pieces.append((start, stop))
    if len(pieces) < 2:
        return log
    name, t = name_of(log, number), log.t
    spans = tuple(
        Span(
            f"{name}, part {k}", float(t[start]), float(t[stop - 1]), float(t[start] - t[0]),
            float(1.0 / np.median(np.diff(t[start:stop]))),
        )
        for k, (start, stop) in enumerate(pieces, start=1)
    )  # fmt: skip
    return replace(log, records=spans)


def parts_of(log: Log) -> list[Log]:
    """Return the records of a log as logs of their own.

    Parameters
    ----------
    log : Log
    """
    if len(log.records) < 2:
        return [log]
    out = []
    for span in log.records:
        first, stop = np.searchsorted(log.t, [span.start, span.stop + 0.5 * log.period])
        part = log.slice(int(first), int(stop))
        out.append(replace(part, records=(), provenance=replace(log.provenance, file=span.name)))
    return out


def thinning(rate: float, samples: int) -> int:
    """Return how many samples of a log become one: a fast log has about 1 kHz then, a long one a million samples.

    Parameters
    ----------
    rate : float
        Hz.
    samples : int
    """
    rate *= 1.0 + ROUNDED
    return max(1, int(rate / FAST), min(-(-samples // MOST), int(rate / SLOWEST)))


def thinned(log: Log) -> Log:
    """Bring a fast log to about 1 kHz, and a long one to about a million samples: what the evaluations use lies below.

    Parameters
    ----------
    log : Log
    """
    factor = thinning(log.rate, len(log))
    if factor < 2:
        return log
    if len(log.records) > 1:
        rows = [_thinned_part(part, factor, float(log.t[0])) for part in parts_of(log)]
        if any(row is None for row in rows):
            return log
        together = {name: np.concatenate([row[name] for row in rows if row]) for name in log}
        return replace(log, channels=together, segments=())
    made = _thinned_part(log, factor, float(log.t[0]))
    return log if made is None else replace(log, channels=made, segments=())


def _thinned_part(log: Log, factor: int, origin: float) -> dict[str, Array] | None:
    """Keep every so many samples of a record, on the grid that begins at `origin`; None where its stamps jitter."""
    if float(np.max(np.abs(np.diff(log.t) - log.period))) > JITTER * log.period:
        return None
    first = -round((float(log.t[0]) - origin) / log.period) % factor
    channels = {"t": log.t[first::factor]}
    for name, values in log.channels.items():
        if name != "t":
            wraps = name == "theta" and float(np.max(np.abs(np.diff(values)))) >= np.pi
            whole = np.unwrap(values)[first:] if wraps else values[first:]
            channels[name] = low_pass(whole, log.rate, KEPT_BAND * log.rate / factor, step=factor)
            channels[name].setflags(write=False)  # a log shares it then, and makes no copy
    return channels


def joined(design: Design, logs: Sequence[Log]) -> tuple[Log, tuple[Notice, ...]]:
    """Return one log that holds all records, and what was left out for it; a single log is returned as it is.

    Every record is brought to the lowest rate by a zero-phase filter, which delays no channel, and keeps the channels
    that all of them have. Where some have a position and others a speed alone, the speed remains; where some have a
    torque and others a current, the torque. Angles are shifted by whole turns.

    Parameters
    ----------
    design : Design
    logs : sequence of Log
        At least one; with `records` where one file holds several.

    Raises
    ------
    LogError
        When rotary and linear axes are mixed, or a record lacks what all need; the line names the file.
    """
    if len(logs) == 1:
        return logs[0], ()
    for number, log in enumerate(logs, start=1):
        if log.motion != logs[0].motion:
            raise LogError(
                f"{name_of(log, number)}: a {log.motion} axis, but {name_of(logs[0])} is a {logs[0].motion} one; "
                "records of one axis were expected"
            )
    parts, notices = [], []
    for number, log in enumerate(logs, start=1):
        begins = [span.begin for span in log.records] or [0.0]
        for part, begin in zip(parts_of(log), begins, strict=True):
            made, said = _part(part, part.provenance.file or name_of(log, number), begin)
            parts.append(made)
            notices += [notice for notice in said if notice not in notices]
    parts, left_out = _alike(design, parts)
    notices += left_out
    rate = min(part.rate for part in parts)
    parts = [_at_rate(part, rate) for part in parts]
    channels, spans = _in_line(parts, rate, logs[0].motion)
    files = ", ".join(dict.fromkeys(name_of(log, number) for number, log in enumerate(logs, start=1)))
    return Log(channels, logs[0].motion, provenance=Provenance(files), records=spans), tuple(notices)


def _part(log: Log, name: str, begin: float) -> tuple[_Part, tuple[Notice, ...]]:
    """Bring one record to even time steps; what bridges its holes is left out again."""
    if len(log) < FEWEST:
        raise LogError(f"{name}: {len(log)} samples; at least {FEWEST} were expected of a record")
    t, channels, good, notices = uniform(log)
    if "theta" in channels:
        channels["theta"] = unwrapped(channels["theta"])
    period = float(t[-1] - t[0]) / (len(t) - 1)
    holes = period * np.round((t - t[0]) / period)
    part = _Part(name, begin, 1.0 / period, holes[good], {n: np.asarray(c)[good] for n, c in channels.items()})
    return part, notices


def _alike(design: Design, parts: list[_Part]) -> tuple[list[_Part], list[Notice]]:
    """Give all records the same channels."""
    present = set().union(*(part.channels for part in parts))
    out = []
    for part in parts:
        channels = dict(part.channels)
        for names in (MOTION, DRIVE):
            if not any(name in channels for name in names):
                found = ", ".join(("t", *channels))
                raise LogError(f"{part.name}: neither {names[0]} nor {names[1]} (present: {found})")
        if "omega" not in channels and _lacking(parts, "theta"):
            channels["omega"] = derivative(channels["theta"], 1.0 / part.rate)
        if "torque" not in channels and _lacking(parts, "i_q"):
            channels["torque"] = drive_torque(design, channels.get("i_d", 0.0 * channels["i_q"]), channels["i_q"])
        if "T_load" in present:  # a record without it has no known load
            channels.setdefault("T_load", np.zeros(len(part.t)))
        out.append(replace(part, channels=channels))
    common = [name for name in out[0].channels if all(name in part.channels for part in out)]
    lost = [name for name in present if name not in common]
    notices = [
        words.CHANNEL_LEFT_OUT(channel=name, records=", ".join(_lacking(parts, name)))
        for name in sorted(lost)
        if not name.endswith(("_ref", "_true"))
    ]
    return [replace(part, channels={name: part.channels[name] for name in common}) for part in out], notices


def _lacking(parts: Sequence[_Part], channel: str) -> list[str]:
    return [part.name for part in parts if channel not in part.channels]


def _at_rate(part: _Part, rate: float) -> _Part:
    """Return a record at a lower rate, all channels through the same zero-phase low-pass."""
    from scipy.interpolate import CubicSpline

    if part.rate < (1.0 + SAME_RATE) * rate:
        return part
    t = np.arange(int(part.t[-1] * rate * (1.0 + 1e-12)) + 1) / rate
    holes = np.diff(part.t) > 1.5 / part.rate
    even = np.arange(round(part.t[-1] * part.rate) + 1) / part.rate
    channels = {}
    for name, values in part.channels.items():
        full = np.interp(even, part.t, values) if holes.any() else values
        smooth = low_pass(full, part.rate, KEPT_BAND * rate)
        channels[name] = CubicSpline(even, smooth)(t)
    good = np.ones(len(t), dtype=bool)
    for k in np.flatnonzero(holes):
        good &= (t <= part.t[k]) | (t >= part.t[k + 1])
    return replace(part, t=t[good], channels={name: values[good] for name, values in channels.items()})


def _in_line(parts: Sequence[_Part], rate: float, motion: str) -> tuple[dict[str, Array], tuple[Span, ...]]:
    """Put records behind one another on one grid, with holes in which the axis can get from one to the next."""
    step = thinning(rate, sum(len(part.t) for part in parts)) / rate  # thinned grids meet as well
    names = tuple(parts[0].channels)
    columns: dict[str, list[Array]] = {name: [] for name in ("t", *names)}
    spans, end = [], 0.0
    for number, part in enumerate(parts):
        channels = dict(part.channels)
        start = 0.0
        if number:
            apart = APART / default_cutoff(rate)
            before = {name: values[-1] for name, values in columns.items()}
            if "theta" in names:
                apart, turns = _across(before, part, apart, rate, motion)
                channels |= {name: channels[name] + turns for name in ANGLES if name in channels}
            start = step * math.ceil((end + apart) / step)
        columns["t"].append(np.round((start + part.t) * rate) / rate)
        for name in names:
            columns[name].append(channels[name])
        end = float(columns["t"][-1][-1])
        spans.append(Span(part.name, float(columns["t"][-1][0]), end, part.begin, part.rate))
    return {name: np.concatenate(values) for name, values in columns.items()}, tuple(spans)


def _across(
    before: Mapping[str, Array], part: _Part, apart: float, rate: float, motion: str
) -> tuple[float, float]:  # fmt: skip
    """Return the time between two records, and the whole turns to add to the second one's angles.

    Long enough that the way between them is covered no faster than the axis usually moves. Turns are added only where
    that takes longer than the second record: behind a gear the load does not repeat with them.
    """
    leaving = end_speeds(before["t"], before["theta"], rate)[1]
    arriving = end_speeds(part.t, part.channels["theta"], rate)[0]
    way = float(part.channels["theta"][0] - before["theta"][-1])
    usual = float(np.std(np.diff(part.channels["theta"]))) * rate
    speed, turns = max(usual, abs(leaving), abs(arriving)), 0.0
    if motion == "rotary" and bridge_time(way, apart, speed) > float(part.t[-1]):
        turn = 2.0 * np.pi
        turns = turn * round((0.5 * apart * (leaving + arriving) - way) / turn)
    return bridge_time(way + turns, apart, speed), turns

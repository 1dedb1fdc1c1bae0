"""TDMS files by npTDMS. Time comes from the waveform properties of a channel, or from a time channel of its group."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pmsm_ctrl.errors import LogError
from pmsm_ctrl.importers.guard import afford, guarded, not_installed
from pmsm_ctrl.importers.names import guess_channel, split_header
from pmsm_ctrl.importers.table import Array, Column, Table, left_out, one_line

__all__ = ["open_tdms"]


KINDS = "fiub"  # numbers, as numpy calls them
SECOND = np.timedelta64(1, "s")
# What LabVIEW writes where no start is known: the zero of its time, in whatever zone.
UNSET = np.datetime64("1904-01-02", "us")


@dataclass(frozen=True)
class _Waveform:
    """Equidistant time of a channel: start and step in s, number of samples."""

    start: float
    step: float
    samples: int


def open_tdms(path: Path, file: str) -> Table:
    """Open a TDMS file.

    Raises
    ------
    LogError
        When npTDMS is not installed, the file is damaged, or it holds no numeric channels.
    """
    columns: list[Column] = []
    sources: list[tuple[str, str] | _Waveform] = []
    groups: dict[object, int] = {}
    left: list[str] = []
    with _opened(path, file) as content:
        origin, notes = _origin(content)
        for group in content.groups():
            for channel in group.channels():
                if not _usable(group, channel):
                    left.append(channel.name)
                    continue
                wave = _waveform(channel, origin)
                key = wave or (group.name, len(channel))
                if key not in groups and wave is not None:
                    columns.append(Column("Time", "s", "Time", len(groups), True))
                    sources.append(wave)
                number = groups.setdefault(key, len(groups))
                name, unit = split_header(channel.name)
                unit = str(channel.properties.get("unit_string") or unit)
                is_date = _kind(channel) == "M"
                is_time = wave is None and (is_date or guess_channel(name) == "t")
                columns.append(Column(name, "s" if is_date else unit, channel.name, number, is_time, is_date))
                sources.append((group.name, channel.name))
    if not columns:
        raise LogError(f"{file}: no numeric channels in this TDMS file")

    def load(indices: Sequence[int]) -> list[Array]:
        with _opened(path, file) as content:
            sizes = (
                s.samples if isinstance(s, _Waveform) else len(content[s[0]][s[1]])
                for s in map(sources.__getitem__, indices)
            )
            afford(file, "TDMS", float(sum(sizes)), path)
            return [_values(content, sources[i], origin) for i in indices]

    def locate(column: int, sample: int) -> str:
        return f"channel '{columns[column].label}', sample {sample + 1}"

    return Table(file, "TDMS", tuple(columns), load, locate, (*notes, *left_out("channels", left)))


def _kind(channel: Any) -> str:
    """Return the kind of a channel's numbers as numpy calls it; empty for a channel without any."""
    return str(np.dtype(channel.dtype).kind) if channel.dtype is not None and len(channel) else ""


def _usable(group: Any, channel: Any) -> bool:
    """Whether a channel holds numbers, or the time stamps of channels beside it; those of events belong to none."""
    if _kind(channel) != "M":
        return _kind(channel) in KINDS
    beside = (other for other in group.channels() if _kind(other) in KINDS and _waveform(other, None) is None)
    return any(len(other) == len(channel) for other in beside)


def _start(channel: Any) -> np.datetime64 | None:
    """Return when a channel begins, by its properties or as the first of its time stamps; None where nothing says."""
    stated = channel[0] if _kind(channel) == "M" else channel.properties.get("wf_start_time")
    if not isinstance(stated, np.datetime64) or np.isnat(stated) or stated < UNSET:
        return None
    start: np.datetime64 = stated.astype("datetime64[us]")
    return start


def _origin(content: Any) -> tuple[np.datetime64 | None, tuple[str, ...]]:
    """Return the moment that is t = 0, the earliest start of a channel, and notes on starts that differ or lack."""
    waves = [
        (channel.name, _start(channel))
        for group in content.groups()
        for channel in group.channels()
        if _usable(group, channel) and (_kind(channel) == "M" or _waveform(channel, None) is not None)
    ]
    known = [start for _, start in waves if start is not None]
    if not known:
        return None, ()
    origin = min(known)
    late = {name: float((start - origin) / SECOND) for name, start in waves if start is not None and start > origin}
    notes = [f"{one_line(name)} begins {late[name]:.6g} s after the first channel, by its start time" for name in late]
    if late and (silent := [name for name, start in waves if start is None]):
        notes.append(f"no start time stated, taken as that of the first channel: {one_line(', '.join(silent))}")
    return origin, tuple(notes)


def _waveform(channel: Any, origin: np.datetime64 | None) -> _Waveform | None:
    step = channel.properties.get("wf_increment")
    if _kind(channel) == "M" or not isinstance(step, float) or not step > 0.0:
        return None
    start = _start(channel)
    late = float((start - origin) / SECOND) if origin is not None and start is not None else 0.0
    return _Waveform(late + float(channel.properties.get("wf_start_offset") or 0.0), step, len(channel))


def _values(content: Any, source: tuple[str, str] | _Waveform, origin: np.datetime64 | None) -> Array:
    if isinstance(source, _Waveform):
        return source.start + source.step * np.arange(source.samples, dtype=np.float64)
    channel = content[source[0]][source[1]]
    values = np.asarray(channel[:])
    if values.dtype.kind != "M":
        return values.astype(np.float64)
    # stamps without a date count from the zero of their time, beside others that have one as well
    zero = values[0] if origin is None or _start(channel) is None else origin
    return np.asarray((values - zero) / np.timedelta64(1, "us"), np.float64) * 1e-6


@contextmanager
def _opened(path: Path, file: str) -> Iterator[Any]:
    try:
        from nptdms import TdmsFile
    except ImportError:
        raise not_installed(file, "TDMS", "npTDMS", "tdms") from None
    # with a path, the library leaves the file open when it fails
    with guarded(file, "TDMS", "nptdms"), open(path, "rb") as stream, TdmsFile.open(stream) as content:
        yield content

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
from pmsm_ctrl.importers.table import Array, Column, Table, left_out

__all__ = ["open_tdms"]


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
        for group in content.groups():
            for channel in group.channels():
                if channel.dtype is None or np.dtype(channel.dtype).kind not in "fiub" or not len(channel):
                    left.append(channel.name)
                    continue
                wave = _waveform(channel)
                key = wave or group.name
                if key not in groups and wave is not None:
                    columns.append(Column("Time", "s", "Time", len(groups), True))
                    sources.append(wave)
                number = groups.setdefault(key, len(groups))
                name, unit = split_header(channel.name)
                unit = str(channel.properties.get("unit_string") or unit)
                is_time = wave is None and guess_channel(name) == "t"
                columns.append(Column(name, unit, channel.name, number, is_time))
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
            return [_values(content, sources[i]) for i in indices]

    def locate(column: int, sample: int) -> str:
        return f"channel '{columns[column].label}', sample {sample + 1}"

    return Table(file, "TDMS", tuple(columns), load, locate, left_out("channels", left))


def _waveform(channel: Any) -> _Waveform | None:
    step = channel.properties.get("wf_increment")
    if not isinstance(step, float) or not step > 0.0:
        return None
    return _Waveform(float(channel.properties.get("wf_start_offset") or 0.0), step, len(channel))


def _values(content: Any, source: tuple[str, str] | _Waveform) -> Array:
    if isinstance(source, _Waveform):
        return source.start + source.step * np.arange(source.samples, dtype=np.float64)
    return np.asarray(content[source[0]][source[1]][:], dtype=np.float64)


@contextmanager
def _opened(path: Path, file: str) -> Iterator[Any]:
    try:
        from nptdms import TdmsFile
    except ImportError:
        raise not_installed(file, "TDMS", "npTDMS", "tdms") from None
    # with a path, the library leaves the file open when it fails
    with guarded(file, "TDMS", "nptdms"), open(path, "rb") as stream, TdmsFile.open(stream) as content:
        yield content

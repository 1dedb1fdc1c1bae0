"""Log: measured or simulated channels with units on one time base."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pmsm_ctrl.errors import LogError, NextCommand, RequestError, nearest, require_kind
from pmsm_ctrl.files import atomic_path
from pmsm_ctrl.frames import UnchangeableDict, columns_of
from pmsm_ctrl.section import Notice

__all__ = ["CHANNELS", "Log", "Logs", "Provenance", "Segment", "Span", "as_logs", "names_of"]

Array = NDArray[np.float64]

# Limits of what can be evaluated, in SI units and s: powers and products of larger numbers overflow a double.
LARGEST = 1e12
SHORTEST_PERIOD, LONGEST_PERIOD = 1e-9, 1e5

# channel -> (unit on a rotary axis, unit on a linear axis, meaning)
CHANNELS: dict[str, tuple[str, str, str]] = {
    "t": ("s", "s", "time"),
    "theta_ref": ("rad", "m", "reference position"),
    "omega_ref": ("rad/s", "m/s", "reference speed"),
    "alpha_ref": ("rad/s^2", "m/s^2", "reference acceleration"),
    "theta": ("rad", "m", "position"),
    "omega": ("rad/s", "m/s", "speed"),
    "theta_load": ("rad", "m", "position behind the transmission, at the motor's scale"),
    "i_d": ("A", "A", "direct-axis current, peak scaling"),
    "i_q": ("A", "A", "quadrature-axis current, peak scaling"),
    "i_d_ref": ("A", "A", "reference of i_d"),
    "i_q_ref": ("A", "A", "reference of i_q"),
    "u_d": ("V", "V", "direct-axis voltage command"),
    "u_q": ("V", "V", "quadrature-axis voltage command"),
    "u_dc": ("V", "V", "dc-link voltage"),
    "torque": ("N m", "N", "drive torque (force), K_t i_q or measured"),
    "T_load": ("N m", "N", "external load torque (force)"),
    "temperature": ("degC", "degC", "temperature"),
    # true values, which only a simulation can log
    "omega_true": ("rad/s", "m/s", "true speed"),
    "theta_true": ("rad", "m", "true position"),
}


@dataclass(frozen=True)
class Segment:
    """A named stretch of a log, samples ``start <= k < stop``.

    Attributes
    ----------
    name : str
    start, stop : int
        Samples.
    """

    name: str
    start: int
    stop: int


@dataclass(frozen=True)
class Span:
    """One of several records in a log: a stretch of its time axis, with holes in time around it.

    Attributes
    ----------
    name : str
        The file, and its part where a file holds several records.
    start, stop : float
        Times of its first and last sample on the log's axis, s.
    begin : float
        The record's own time at `start`, s: what drifts counts from the begin of the record.
    rate : float
        At which it was logged, Hz.
    """

    name: str
    start: float
    stop: float
    begin: float = 0.0
    rate: float = float("nan")

    @property
    def duration(self) -> float:
        """Time from its first to its last sample, s."""
        return self.stop - self.start


@dataclass(frozen=True)
class Provenance:
    """Where a log comes from and what was understood of its file.

    Attributes
    ----------
    file, sha256 : str
        Path as given, and hash of the file's bytes; empty for a log that comes from no file.
    importer : str
        Format that was read.
    notes : tuple of str
        What was guessed or converted.
    notices : tuple of Notice
        Reasons to doubt the log.
    """

    file: str = ""
    sha256: str = ""
    importer: str = ""
    notes: tuple[str, ...] = ()
    notices: tuple[Notice, ...] = ()

    @property
    def warnings(self) -> tuple[str, ...]:
        """Reasons to doubt the log, as sentences; empty when there are none."""
        return tuple(notice.text for notice in self.notices)


@dataclass(frozen=True, eq=False)
class Log(UnchangeableDict):
    """Channels with SI units on one time base: a dictionary of arrays, whose length is that of the arrays.

    Parameters
    ----------
    channels : mapping of str to array, shape (n,)
        Must hold ``t`` in s, strictly increasing. Names and units are those of `CHANNELS`.
    motion : {"rotary", "linear"}
        Decides the units (rad and N m, or m and N).
    segments, provenance
        Named stretches; where the log comes from.
    records : tuple of Span
        Its records, in the order of time, where there are several.

    Raises
    ------
    LogError
        For an unknown channel, unequal lengths, a value that is no finite real number, or time that does not increase.
    """

    channels: Mapping[str, Array]
    motion: str = "rotary"
    segments: tuple[Segment, ...] = ()
    provenance: Provenance = field(default_factory=Provenance)
    records: tuple[Span, ...] = ()

    def __post_init__(self) -> None:
        frozen: dict[str, Array] = {}
        require_kind(self.channels, Mapping, "channels of a log")
        for name, values in self.channels.items():
            if name not in CHANNELS:
                raise LogError(f"unknown channel '{name}'{nearest(name, CHANNELS)} (known: {', '.join(CHANNELS)})")
            frozen[name] = _frozen(values, f"{self._label}channel '{name}'")
        object.__setattr__(self, "channels", MappingProxyType(frozen))
        dict.update(self, frozen)
        _check(frozen, self.provenance.file)

    # -- access ---------------------------------------------------------------------------------------------

    def __missing__(self, name: str) -> Array:
        message = f"{self._label}no channel '{name}' (present: {', '.join(self.channels)})"
        raise LogError(message, next_command=NextCommand.MAP)

    def __len__(self) -> int:
        return len(self.t)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (dict(self), self.motion, self.segments, self.provenance, self.records)

    def __array__(self, *_: Any, **__: Any) -> Array:
        raise RequestError("a log is a table of channels: log['omega'], log.to_pandas() or pandas.DataFrame(log)")

    def __repr__(self) -> str:
        said = f"{len(self)} samples, {self.duration:.4g} s at {self.rate:.5g} Hz: {', '.join(self.channels)}"
        return f"<Log{f' {self.provenance.file}' * bool(self.provenance.file)}: {said}>"

    def _repr_html_(self) -> str:
        from html import escape

        rows = "".join(
            f"<tr><td>{name}</td><td>{self.unit(name)}</td><td>{values.min():.5g}</td><td>{values.max():.5g}</td></tr>"
            for name, values in self.channels.items()
        )
        head = "<tr><th>channel</th><th>unit</th><th>from</th><th>to</th></tr>"
        return f"<p>{escape(repr(self)[1:-1])}</p><table>{head}{rows}</table>"

    @property
    def _label(self) -> str:
        return f"{self.provenance.file}: " if self.provenance.file else ""

    @property
    def t(self) -> Array:
        """Time in s, shape (n,)."""
        return self.channels["t"]

    @cached_property
    def period(self) -> float:
        """Median sampling period in s."""
        return float(np.median(np.diff(self.t))) if len(self) > 1 else float("nan")

    @property
    def rate(self) -> float:
        """Median sampling rate in Hz."""
        return 1.0 / self.period

    @property
    def duration(self) -> float:
        """Time from the first to the last sample in s."""
        return float(self.t[-1] - self.t[0])

    @property
    def fingerprint(self) -> str:
        """Hash of the channels: equal for logs with the same numbers, wherever they come from."""
        made = hashlib.blake2b(digest_size=12)
        for name in sorted(self.channels):
            made.update(name.encode())
            made.update(np.ascontiguousarray(self.channels[name]).data)
        return made.hexdigest()

    def unit(self, name: str) -> str:
        """SI unit of a channel on this kind of axis.

        Parameters
        ----------
        name : str
            A channel of `CHANNELS`.

        Returns
        -------
        str
        """
        return CHANNELS[name][1 if self.motion == "linear" else 0]

    def check_evaluable(self, samples: int = 3) -> None:
        """Refuse a log with numbers that no axis can have.

        Parameters
        ----------
        samples : int
            The fewest that are accepted.

        Raises
        ------
        LogError
            For fewer than `samples` samples, a value beyond `LARGEST` SI units, and a sampling period beyond
            `SHORTEST_PERIOD` to `LONGEST_PERIOD`.
        """
        if len(self) < samples:
            raise LogError(f"{self._label}{len(self)} sample{'s' * (len(self) != 1)}; at least {samples} were expected")
        if len(self) > 1 and not SHORTEST_PERIOD <= self.period <= LONGEST_PERIOD:
            raise LogError(
                f"{self._label}sampling period of {self.period:.3g} s; {SHORTEST_PERIOD:g} s to {LONGEST_PERIOD:g} s "
                "can be evaluated (check the unit of time)"
            )
        for name, values in self.channels.items():
            row = int(np.argmax(np.abs(values)))
            if abs(values[row]) > LARGEST:
                raise LogError(
                    f"{self._label}channel '{name}', sample {row}: {values[row]:.4g} {self.unit(name)}; numbers up to "
                    f"{LARGEST:g} can be evaluated (a lost sample, or a wrong unit)"
                )

    # -- changed copies --------------------------------------------------------------------------------------

    def with_channels(self, **channels: ArrayLike) -> Log:
        """Return a copy with channels added or replaced.

        Parameters
        ----------
        **channels : array, shape (n,)
            SI.

        Returns
        -------
        Log
        """
        changed: dict[str, Any] = {**self.channels, **channels}
        return replace(self, channels=changed)

    def between(self, start: float, stop: float) -> Log:
        """Return the samples with ``start <= t < stop`` (s).

        Parameters
        ----------
        start, stop : float
            s.

        Returns
        -------
        Log

        Raises
        ------
        LogError
            When no sample lies there.
        """
        first, last = np.searchsorted(self.t, [start, stop])
        if last <= first:
            raise LogError(f"{self._label}no sample between {start:g} s and {stop:g} s")
        return self.slice(int(first), int(last))

    def slice(self, start: int, stop: int) -> Log:
        """Return samples ``start <= k < stop`` with the segments that fall inside.

        Parameters
        ----------
        start, stop : int

        Returns
        -------
        Log
        """
        kept = tuple(
            Segment(s.name, max(s.start, start) - start, min(s.stop, stop) - start)
            for s in self.segments
            if s.start < stop and s.stop > start
        )
        channels = {n: c[start:stop] for n, c in self.channels.items()}
        return replace(self, channels=channels, segments=kept, records=self._records_between(self.t[start:stop]))

    def _records_between(self, t: Array) -> tuple[Span, ...]:
        """Return the records that these times reach, cut to them; none where that is one alone."""
        cut = [(one, max(one.start, t[0]), min(one.stop, t[-1])) for one in self.records if len(t)]
        kept = [
            replace(one, start=float(a), stop=float(b), begin=one.begin + float(a) - one.start)
            for one, a, b in cut
            if a < b
        ]
        return tuple(kept) if len(kept) > 1 else ()

    # -- data frames -----------------------------------------------------------------------------------------

    @classmethod
    def from_pandas(cls, frame: Any, motion: str = "rotary") -> Log:
        """Take the columns of a data frame that are named like channels, ``omega`` or ``omega [rpm]``.

        `pmsm_ctrl.read_log` takes frames with any other names, and a mapping.

        Parameters
        ----------
        frame : pandas or polars data frame, xarray data set, or mapping of name to array
            Without a column ``t`` a time index of pandas is the time, from 0 s.
        motion : {"rotary", "linear"}

        Returns
        -------
        Log

        Raises
        ------
        LogError
            When there is no time, no number, or a unit that does not belong to the channel.
        """
        units = {name: row[1 if motion == "linear" else 0] for name, row in CHANNELS.items()}
        return cls(columns_of(frame, units), motion=motion)

    def to_pandas(self) -> Any:
        """Return the channels as a pandas data frame, their units in ``frame.attrs["units"]``.

        Returns
        -------
        pandas.DataFrame

        Raises
        ------
        RequestError
            When pandas is not installed.
        """
        try:
            import pandas
        except ImportError:
            raise RequestError("pandas is not installed: pip install pandas; dict(log) needs none") from None
        frame = pandas.DataFrame(dict(self.channels))
        frame.attrs["units"] = {name: self.unit(name) for name in self.channels}
        return frame

    def __arrow_c_stream__(self, requested_schema: object = None) -> object:
        """Arrow PyCapsule interface: ``pyarrow.table(log)``, ``polars.DataFrame(log)``; needs pyarrow."""
        import pyarrow

        fields = [pyarrow.field(name, pyarrow.float64(), metadata={"unit": self.unit(name)}) for name in self.channels]
        table = pyarrow.table(list(self.channels.values()), schema=pyarrow.schema(fields))
        return table.__arrow_c_stream__(requested_schema)

    # -- file ------------------------------------------------------------------------------------------------

    def write_csv(self, path: str | os.PathLike[str]) -> Path:
        """Write the canonical CSV: one header row ``name [unit]``, then numbers that read back bit for bit.

        Parameters
        ----------
        path : path

        Returns
        -------
        Path
            The same path.
        """
        names = list(self.channels)
        header = ",".join(f"{name} [{self.unit(name)}]" for name in names)
        columns = [self.channels[name] for name in names]
        with atomic_path(path) as temporary, open(temporary, "w", encoding="utf-8", newline="\n") as stream:
            stream.write(header + "\n")
            step = 65536
            for start in range(0, len(self), step):
                block = zip(*(column[start : start + step].tolist() for column in columns), strict=True)
                stream.write("".join(",".join(map(repr, row)) + "\n" for row in block))
        return Path(path)


Logs = Log | Sequence[Log]


def as_logs(logs: Logs, what: str = "log") -> tuple[Log, ...]:
    """Return one log or a sequence of logs as a tuple.

    Parameters
    ----------
    logs : Log or sequence of Log
    what : str
        The word for them in an error message.

    Raises
    ------
    RequestError
        When there is none, one of them is no log, or two hold the same numbers.
    """
    if isinstance(logs, (Log, Mapping, str)) or not isinstance(logs, (Collection, Iterator)):
        require_kind(logs, Log, what)
    found = (logs,) if isinstance(logs, Log) else tuple(logs)
    if not found:
        raise RequestError(f"no {what}: at least one was expected")
    known: dict[str, int] = {}
    for number, log in enumerate(found, start=1):
        require_kind(log, Log, f"{what} {number}")
        if len(found) > 1 and (first := known.setdefault(log.fingerprint, number)) < number:
            one, other = (found[k - 1].provenance.file or f"{what} {k}" for k in (number, first))
            raise RequestError(f"{one}: the same numbers as {other}; every record was expected once")
    return found


def names_of(logs: Sequence[Log], unnamed: str) -> str:
    """Return the file of a log, or how many logs there are; empty where there is none.

    Parameters
    ----------
    logs : sequence of Log
    unnamed : str
        The word for one that comes from no file.
    """
    if len(logs) == 1:
        return logs[0].provenance.file or unnamed
    return f"{len(logs)} logs" if logs else ""


def _frozen(values: ArrayLike, place: str) -> Array:
    """Return a read-only array; one that is read-only already (a channel of another log) is shared, not copied."""
    if isinstance(values, np.ndarray) and values.dtype == np.float64 and not values.flags.writeable:
        whole = values if values.base is None else values.base
        if isinstance(whole, np.ndarray) and not whole.flags.writeable and values.flags.c_contiguous:
            return values
    kind = np.dtype(getattr(values, "dtype", "O"))
    try:
        kind = np.asarray(values).dtype
        array = np.array(values, dtype=np.float64) if kind.kind not in "cUS" else None
    except (TypeError, ValueError):
        array = None
    if array is None:
        found = {"c": "complex numbers", "U": "text", "S": "text"}.get(kind.kind, f"{type(values).__name__} of {kind}")
        raise LogError(f"{place}: {found} found; an array of real numbers was expected")
    array.setflags(write=False)
    return array


def _check(channels: Mapping[str, Array], file: str) -> None:
    where = f"{file}: " if file else ""
    if "t" not in channels:
        raise LogError(f"{where}no time channel 't' (found: {', '.join(channels) or 'nothing'})")
    t = channels["t"]
    if t.ndim != 1 or t.size == 0:
        raise LogError(f"{where}the log is empty; at least one sample was expected")
    for name, values in channels.items():
        if values.shape != t.shape:
            raise LogError(f"{where}channel '{name}' has shape {values.shape}, but t has {t.shape}")
        finite = np.isfinite(values)
        if not finite.all():
            row = int(np.argmin(finite))
            raise LogError(f"{where}channel '{name}', sample {row}: {values[row]} found; a finite number was expected")
    step = np.diff(t)
    if t.size > 1 and not (step > 0).all():
        row = int(np.argmin(step > 0))
        what = "the same time stamp twice" if step[row] == 0 else "time runs backwards"
        raise LogError(f"{where}sample {row + 1}: {what} (t = {t[row + 1]:.9g} s after {t[row]:.9g} s)")

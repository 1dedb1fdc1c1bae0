"""Samples of a Beckhoff PLC by ADS: cyclic notifications, each with the PLC's own time stamp, as lines of a stream."""

from __future__ import annotations

import ctypes
import queue
import re
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import Any, NamedTuple

from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.importers.names import split_header
from pmsm_ctrl.track.stream import IDLE, POLL, REOPENED

__all__ = ["Address", "ads_lines", "parse_address"]

_ADDRESS = re.compile(r"ads://(?:([^/]+)/)?(\d+(?:\.\d+){5})(?::(\d+))?")
PORT = 851  # of the first PLC runtime of TwinCAT 3
EACH_CYCLE = 1e-4  # ms; shorter than any task, so that every cycle of it is sent
BUNDLE = 50.0  # ms over which the PLC collects samples for one packet
SILENT = 3.0  # s without a sample, in RUN, after which the symbols are asked for anew
TIMEOUT = 2000  # ms for an answer
RETRY = 1.0  # s between two attempts to connect
BEHIND = 1000  # time stamps that may wait for the rest of their symbols
TICK = 1e-7  # s of a time stamp


class Address(NamedTuple):
    """Where a PLC is.

    Attributes
    ----------
    host : str
        IP address; empty for the first four numbers of the NetId.
    net_id : str
    port : int
        AMS port of the runtime.
    """

    host: str
    net_id: str
    port: int


def parse_address(text: str) -> Address:
    """Return the parts of ``ads://[HOST/]NETID[:PORT]``.

    Parameters
    ----------
    text : str

    Returns
    -------
    Address

    Raises
    ------
    RequestError
        When it is no such address.
    """
    match = _ADDRESS.fullmatch(text)
    if match is None or any(int(part) > 255 for part in match[2].split(".")):
        raise RequestError(f"{text}: ads://[HOST/]NETID[:PORT] was expected, such as ads://5.12.82.20.1.1:851")
    return Address(match[1] or "", match[2], int(match[3] or PORT))


def ads_lines(source: str, mapping: Mapping[str, str], *, poll: float = POLL, retry: float = RETRY) -> Iterator[str]:
    """Yield a header and then a line per cycle of the PLC's task, for ever.

    `IDLE` stands where nothing came, `REOPENED` where the connection was lost and is there again. The time is that of
    the PLC's stamps, from the first one.

    Parameters
    ----------
    source : str
        As for `parse_address`.
    mapping : dict of str to str
        Channel to symbol with its unit: ``MAIN.axis.speed [rpm]``.
    poll, retry : float
        Time between two looks at an idle connection, and between two attempts to connect, s.

    Yields
    ------
    str

    Raises
    ------
    RequestError
        When the address or the mapping is wrong, pyads is not installed, or the first attempt to connect fails.
    """
    address = parse_address(source)
    try:
        import pyads
    except (ImportError, OSError) as error:
        raise RequestError(f"{source}: pyads cannot be loaded ({error}): pip install 'pmsm-ctrl[ads]'") from None
    if not mapping or "t" in mapping:
        raise RequestError(
            f"{source}: --map CHANNEL='SYMBOL [UNIT]' was expected for every channel but t, which is the PLC's time"
        )
    columns = list(mapping.values())
    yield "\t".join(["t [s]", *columns])
    rows, opened = _Rows(len(columns)), False
    while True:
        try:
            with _connected(pyads, address, [split_header(one)[0] for one in columns], rows.take) as state:
                if opened:
                    yield REOPENED
                opened = True
                yield from _samples(rows, state, poll)
        except (pyads.ADSError, RequestError) as error:
            if not opened:
                raise RequestError(f"{source}: {error}") from None
        while (line := rows.next(0.0)) is not None:  # what had arrived whole is not lost with the connection
            yield line
        rows.clear()
        yield IDLE
        time.sleep(retry)


class _Rows:
    """Values that arrive one symbol at a time, in another thread, and are put together by their time stamp."""

    def __init__(self, count: int) -> None:
        self.count = count
        self.arrived: queue.SimpleQueue[tuple[int, int, float]] = queue.SimpleQueue()
        self.waiting: dict[int, dict[int, float]] = {}
        self.first: int | None = None

    def take(self, column: int, stamp: int, value: float) -> None:
        self.arrived.put((stamp, column, value))

    def clear(self) -> None:
        """Forget what the lost connection left: a row is whole or not there."""
        self.waiting.clear()
        while not self.arrived.empty():
            self.arrived.get()

    def next(self, timeout: float) -> str | None:
        """Return the line of the next time stamp that all symbols have; None when nothing comes."""
        while True:
            try:
                stamp, column, value = self.arrived.get(timeout=timeout)
            except queue.Empty:
                return None
            row = self.waiting.setdefault(stamp, {})
            row[column] = value
            if len(row) == self.count:
                del self.waiting[stamp]
                self.first = stamp if self.first is None else self.first
                values = (repr(row[k]) for k in range(self.count))
                return "\t".join([f"{TICK * (stamp - self.first):.7f}", *values])
            if len(self.waiting) > BEHIND:
                del self.waiting[min(self.waiting)]


def _samples(rows: _Rows, state: Callable[[], bool], poll: float) -> Iterator[str]:
    """Yield lines until nothing has come for a while although the PLC runs; raise where it does not answer."""
    heard = time.monotonic()
    while True:
        line = rows.next(poll)
        if line is not None:
            heard = time.monotonic()
            yield line
            continue
        yield IDLE
        if not state():
            heard = time.monotonic()  # in CONFIG or STOP it sends nothing, and will again
        elif time.monotonic() - heard > SILENT:
            return


@contextmanager
def _connected(
    pyads: Any, address: Address, symbols: list[str], take: Callable[[int, int, float], None]
) -> Iterator[Callable[[], bool]]:
    """Subscribe to symbols; yield a function that says whether the PLC is in RUN."""
    plc = pyads.Connection(address.net_id, address.port, address.host or None)
    handles = []
    plc.open()
    try:
        plc.set_timeout(TIMEOUT)
        if plc.read_state()[0] != pyads.ADSSTATE_RUN:
            raise RequestError("the PLC is not in RUN")
        for column, symbol in enumerate(symbols):
            kind = _kind(pyads, plc, symbol)
            attributes = pyads.NotificationAttrib(
                ctypes.sizeof(kind), pyads.ADSTRANS_SERVERCYCLE, max_delay=BUNDLE, cycle_time=EACH_CYCLE
            )
            handles.append(plc.add_device_notification(symbol, attributes, _receiver(plc, kind, column, take)))
        yield lambda: bool(plc.read_state()[0] == pyads.ADSSTATE_RUN)
    finally:
        for one in handles:  # each by itself: AdsLib crashes when a port is closed with one of a lost connection
            with suppress(pyads.ADSError):
                plc.del_device_notification(*one)
        plc.close()


def _kind(pyads: Any, plc: Any, symbol: str) -> Any:
    """Return the type of a symbol; refuse what is no number."""
    try:
        kind = plc.get_symbol(symbol).plc_type
    except pyads.ADSError as error:
        raise RequestError(f"symbol {symbol}: {error}") from None
    if not (isinstance(kind, type) and issubclass(kind, ctypes._SimpleCData)) or kind is pyads.PLCTYPE_STRING:
        raise RequestError(f"symbol {symbol}: a number was expected, such as LREAL")
    return kind


def _receiver(plc: Any, kind: Any, column: int, take: Callable[[int, int, float], None]) -> Callable[[Any, Any], None]:
    def receive(notification: Any, _: Any) -> None:
        _handle, stamp, value = plc.parse_notification(notification, kind, timestamp_as_filetime=True)
        take(column, int(stamp), float(value))

    return receive

"""F_c and F_v of a live source, for the page: a process of its own tracks them, and tells what it estimates.

The source is named where the server is started, never in the page: a page can name no file.
"""

from __future__ import annotations

import multiprocessing
import os
import sys
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING, Any

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import PmsmCtrlError
from pmsm_ctrl.units import axis_unit

if TYPE_CHECKING:
    from multiprocessing.process import BaseProcess

    from pmsm_ctrl.track import Alarm, Reading

__all__ = ["Live"]

EVERY = 0.2  # s of the stream between two points of the curves
AT_ONCE = 1 << 16  # bytes of standard input that are passed on in one piece
MOST = 1000  # points that are kept, and alarms; beyond them every second point is dropped
STDIN = "standard input"
ENDED = "The process that tracks has ended (killed, or out of memory). Start the workbench again."
COLUMNS = ("t", "F_c", "stderr_F_c", "F_v", "stderr_F_v")  # of a reading
PARAMETERS = {"F_c": "coulomb", "F_v": "viscous"}  # which effect holds it


class Live:
    """What is tracked while a page is open.

    Parameters
    ----------
    design : Design
        Whose friction the tracker begins with.
    source : str
        A growing file, ``-`` for standard input of the server, or ``ads://NETID``.
    mapping : dict of str to str, optional
        Channel to column.
    estimate : tuple of {"T_load", "J"}, optional
        Beside F_c and F_v.
    """

    def __init__(
        self, design: Design, source: str, mapping: Mapping[str, str] | None = None,
        estimate: tuple[str, ...] | None = None,
    ) -> None:  # fmt: skip
        from pmsm_ctrl.track.result import UNITS

        self.design, self.source = design, source
        units = {name: axis_unit(UNITS[name], self.design.motion) for name in PARAMETERS}
        self._facts = {
            "source": STDIN if source == "-" else source, "design": self.design.name, "units": units,
            "stated": {name: self.design.parameters(effect).get(name) for name, effect in PARAMETERS.items()},
        }  # fmt: skip
        self._asked = dict(mapping or {}), estimate
        self._points: list[tuple[float, ...]] = []
        self._alarms: list[dict[str, Any]] = []
        self._count, self._step = 0, 1
        self._now: dict[str, Any] | None = None
        self._heard = time.monotonic()
        self._revision, self._end = 0, ""
        self._lock = threading.Lock()

    def start(self) -> BaseProcess:
        """Start to track.

        Returns
        -------
        process
            It ends with this one.
        """
        context = multiprocessing.get_context("spawn")
        receiver, sender = context.Pipe(duplex=False)
        fed, feed = context.Pipe(duplex=False) if self.source == "-" else (None, None)
        words = (sender, fed, self.design.to_toml(), self.source, *self._asked)
        process = context.Process(target=_tracked, args=words, daemon=True)
        process.start()
        sender.close()
        if fed is not None and feed is not None:  # a process of its own has no standard input
            fed.close()
            threading.Thread(target=_passed_on, args=(feed,), daemon=True).start()
        threading.Thread(target=self._listen, args=(receiver,), daemon=True).start()
        return process

    def _listen(self, receiver: Connection) -> None:
        while not self._end:
            try:
                kind, told = receiver.recv()
            except (EOFError, OSError):
                kind, told = "end", ENDED
            self.take(kind, told)

    def take(self, kind: str, told: Any) -> None:
        """Take in what the process that tracks tells.

        Parameters
        ----------
        kind : {"reading", "alarm", "end"}
        told : Reading, Alarm or str
            The end with its reason.
        """
        with self._lock:
            self._revision += 1
            if kind == "reading":
                self._heard = time.monotonic()
                self._keep(told)
            elif kind == "alarm":
                self._alarms = [*self._alarms, vars(told)][-MOST:]
            else:
                self._end = told

    def _keep(self, reading: Reading) -> None:
        self._now = {name: getattr(reading, name) for name in ("event", *COLUMNS)}
        if self._count % self._step == 0:
            self._points.append(tuple(self._now[name] for name in COLUMNS))
        self._count += 1
        if len(self._points) > MOST:
            self._points, self._step = self._points[::2], 2 * self._step

    def shown(self) -> dict[str, Any]:
        """Return what a page shows: the facts, the state, the course of the estimates, and the alarms.

        Returns
        -------
        dict
            ``now``, the last reading; ``t`` in s, ``F_c`` and ``F_v`` in SI units with their standard errors; and
            ``silent``, the time since the last sample, s.
        """
        with self._lock:
            columns = [list(column) for column in zip(*self._points, strict=True)] or [[] for _ in COLUMNS]
            return {
                **self._facts, "revision": self._revision, "end": self._end, "now": self._now,
                "silent": time.monotonic() - self._heard, "alarms": list(self._alarms),
                **dict(zip(COLUMNS, columns, strict=True)),
            }  # fmt: skip


def _passed_on(feed: Connection) -> None:
    """Pass standard input on until it ends, or until nobody tracks any more.

    Not through its buffer: a thread that waits in there holds it, and the server could not end.
    """
    with feed:
        try:
            while sys.stdin is not None and (piece := os.read(sys.stdin.fileno(), AT_ONCE)):
                feed.send_bytes(piece)
        except (OSError, ValueError):  # nobody listens; standard input was closed
            return


def _pieced(fed: Connection) -> Iterator[str]:
    """Yield the lines of what is passed on."""
    rest = b""
    with fed, suppress(EOFError, OSError):
        while True:
            *whole, rest = (rest + fed.recv_bytes()).split(b"\n")
            yield from (line.decode("utf-8", errors="replace") for line in whole if line.strip())
    if rest.strip():
        yield rest.decode("utf-8", errors="replace")


def _tracked(
    sender: Connection, fed: Connection | None, design: str, source: str, mapping: dict[str, str],
    estimate: tuple[str, ...] | None,
) -> None:  # fmt: skip
    """Track a source until it ends, and tell every estimate: what the process does."""
    import signal

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the server, which ends this process
    from pmsm_ctrl.track import watch
    from pmsm_ctrl.track.sources import lines_from

    def show(reading: Reading) -> None:
        sender.send(("reading", reading))

    def alarm(one: Alarm) -> None:
        sender.send(("alarm", one))

    try:
        lines = lines_from(source, mapping) if fed is None else _pieced(fed)
        name = STDIN if source == "-" else source
        watch(
            Design.from_toml(design), lines, source=name, mapping=mapping, estimate=estimate,
            every=EVERY, show=show, alarm=alarm,
        )  # fmt: skip
        end = "The source has ended."
    except PmsmCtrlError as error:
        end = str(error)
    except OSError as error:
        end = f"{source}: {error.strerror or error}"
    sender.send(("end", end))

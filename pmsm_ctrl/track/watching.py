"""Tracking of a stream: F_c and F_v as samples arrive, what happened to the stream, and alarms."""

from __future__ import annotations

import math
import re
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import LogError, NextCommand
from pmsm_ctrl.regression.signals import drive_torque
from pmsm_ctrl.result import Estimate, Result, jsonable
from pmsm_ctrl.section import Notice
from pmsm_ctrl.track import notices as words
from pmsm_ctrl.track.alarms import WINDOW, Alarm, Windows
from pmsm_ctrl.track.inputs import Samples, noise_from_samples
from pmsm_ctrl.track.live import FrictionTracker, Reading
from pmsm_ctrl.track.model import EVENTS, F_C, F_V, REJECTED, STANDSTILL, STATES
from pmsm_ctrl.track.result import UNITS
from pmsm_ctrl.track.settings import Settings, start
from pmsm_ctrl.track.stream import IDLE, MISSING, REOPENED, Header, read_header, with_units
from pmsm_ctrl.units import axis_unit

__all__ = ["Watched", "watch"]

Array = NDArray[np.float64]

FIRST = 200  # samples from which the period of a stream is known
MOVING = 20  # steps among these from which the noise of a channel is known
LOST = 1.5  # periods from which on samples are missing
MOST = 2000  # points of the history, and alarms that are kept
LETTERS = re.compile("[b-df-hj-mo-zB-DF-HJ-MO-Z]")  # of labels; 1e-3, nan and inf have none of them


@dataclass(frozen=True, eq=False)
class Watched(Result):
    """The end of a stream.

    Attributes
    ----------
    design : Design
    source : str
    samples : int
    estimates : dict of str to Estimate
        Last ones.
    alarms : tuple of Alarm
    lost, damaged, repeated, jumps, reconnects : int
        Samples that are missing, lines that held no sample, samples that did not advance in time, jumps of the clock
        backwards, and how often the source was opened again.
    t, F_c, F_v, stderr_F_c, stderr_F_v : array, shape (n,)
        Course of the estimates, thinned.
    counts : dict of str to int
        Samples by event.
    left_out : tuple of Notice
        Effects of the design that the tracker does not model.
    """

    design: Design
    source: str
    samples: int
    estimates: Mapping[str, Estimate]
    alarms: tuple[Alarm, ...]
    lost: int
    damaged: int
    repeated: int
    jumps: int
    reconnects: int
    t: Array = field(repr=False)
    F_c: Array = field(repr=False)
    F_v: Array = field(repr=False)
    stderr_F_c: Array = field(repr=False)
    stderr_F_v: Array = field(repr=False)
    counts: Mapping[str, int] = field(default_factory=dict)
    left_out: tuple[Notice, ...] = ()

    @property
    def notices(self) -> tuple[Notice, ...]:
        """What happened to the stream and to the axis."""
        out = list(self.left_out)
        if not any(self.counts.get(name) for name in ("updated", "constant speed", "change")):
            out.append(words.NOT_MOVED())
        if self.alarms:
            out.append(words.CHANGING(count=len(self.alarms)))
        if rejected := self.counts.get(EVENTS[REJECTED], 0):
            out.append(words.REJECTED(count=rejected))
        if self.lost or self.damaged or self.repeated:
            out.append(words.STREAM_LOST(lost=self.lost, damaged=self.damaged, repeated=self.repeated))
        if self.jumps:
            out.append(words.STREAM_CLOCK(count=self.jumps))
        if self.reconnects:
            out.append(words.STREAM_REOPENED(count=self.reconnects))
        return tuple(out)

    def to_dict(self) -> dict[str, Any]:
        """Return plain values fit for JSON, with the keys of a tracking."""
        return dict(jsonable({
            "schema": "pmsm-ctrl/tracking/1", "log": self.source, **self.doubts(), "estimates": dict(self.estimates),
            "samples": dict(self.counts),
            "stream": {"samples": self.samples, "lost": self.lost, "damaged": self.damaged, "repeated": self.repeated,
                       "clock_jumps": self.jumps, "reconnects": self.reconnects},
            "alarms": [vars(alarm) for alarm in self.alarms],
            "t": self.t, "history": {"F_c": self.F_c, "F_v": self.F_v},
            "stderr": {"F_c": self.stderr_F_c, "F_v": self.stderr_F_v},
        }))  # fmt: skip


class _Watcher:
    """What is known of a stream between two samples."""

    def __init__(
        self, design: Design, settings: Settings | None, estimate: tuple[str, ...] | None, window: float
    ) -> None:
        self.design, self.settings, self.estimate, self.window = design, settings, estimate, window
        self.tracker: FrictionTracker | None = None
        self.waiting: deque[dict[str, float]] = deque(maxlen=FIRST)
        self.period, self.offset, self.last, self.theta = math.nan, 0.0, math.nan, math.nan
        self.samples = self.lost = self.damaged = self.repeated = self.jumps = self.reconnects = 0
        self.counts: dict[str, int] = {}
        self.windows: Windows | None = None
        self.alarms: list[Alarm] = []
        self.history: list[Reading] = []
        self.step, self.reading = 1, None
        self.missing, self.unread = False, 0  # no file is there; lines above the first header

    reading: Reading | None

    def take(self, given: dict[str, float]) -> list[Alarm]:
        """Take one sample in; the first ones wait until period and noise are known."""
        if self.tracker is not None:
            return self._sample(given)
        if len(self.waiting) == FIRST:  # the oldest one goes: an axis at rest, with the friction of the design
            self._rests(self.waiting[0]["t"])
        self.waiting.append(given)
        return self.begin() if len(self.waiting) == FIRST and self._moves() else []

    def _moves(self) -> bool:
        """Whether the noise that the design does not state can be told from the samples that wait.

        An axis at rest shows no step of its encoder, and has no friction to be tracked.
        """
        sensor = self.design.sensor
        if self.settings is not None or (sensor.encoder_counts and sensor.current_noise):
            return True
        angles = np.array([one.get("theta", one.get("omega", math.nan)) for one in self.waiting])
        torques = np.array([one.get("torque", one.get("i_q", math.nan)) for one in self.waiting])
        return bool(min(np.count_nonzero(np.diff(angles)), np.count_nonzero(np.diff(torques))) > MOVING)

    def _rests(self, t: float) -> None:
        x, settings = start(self.design), Settings()
        sd = settings.prior * x
        self.reading = Reading(t, 0.0, x[F_C], x[F_V], sd[F_C], sd[F_V], EVENTS[STANDSTILL], math.nan)
        self.samples += 1
        self.counts[EVENTS[STANDSTILL]] = self.counts.get(EVENTS[STANDSTILL], 0) + 1

    def begin(self) -> list[Alarm]:
        """Start the tracker with the samples that waited."""
        if self.tracker is not None or not self.waiting:
            return []
        given = list(self.waiting)
        self.waiting.clear()
        steps = np.diff([one["t"] for one in given])
        steps = steps[steps > 0.0]
        self.period = float(np.median(steps)) if steps.size else self.design.log_period
        settings = self.settings or self._settings_of(given)
        self.tracker = FrictionTracker(self.design, settings, period=self.period)
        self.windows = Windows(self.design, settings, self.period, self.window)
        return [alarm for one in given for alarm in self._sample(one)]

    def _settings_of(self, given: list[dict[str, float]]) -> Settings:
        measure: Any = "theta" if "theta" in given[0] else "omega"
        estimate = ("T_load", "J") if self.estimate is None else self.estimate
        settings = Settings(measure=measure, estimate=estimate)
        rows = [
            (one["t"], one[measure], one["torque"] if "torque" in one
             else float(drive_torque(self.design, one.get("i_d", 0.0), one["i_q"])), 0.0) for one in given
        ]  # fmt: skip
        sound = np.array([row for row in rows if np.isfinite(row).all()]).reshape(-1, 4)
        # of an axis that never moved the design's values are all that is known
        if len(sound) < 3 or not np.diff(sound[:, 1:3], axis=0).any(axis=0).all():
            return settings
        return noise_from_samples(self.design, settings, Samples(*sound.T))

    def _sample(self, given: dict[str, float]) -> list[Alarm]:
        assert self.tracker is not None
        assert self.windows is not None
        t = given["t"] + self.offset
        step = t - self.last
        if step < -0.5 * self.period:  # the clock was set back, or counts anew: time goes on
            self.jumps += 1
            self.offset += self.period - step
            t = self.last + self.period
        elif step <= 0.0:
            self.repeated += 1
            return []
        elif step > LOST * self.period:
            self.lost += round(step / self.period) - 1
        self.last = t
        theta = given.get("theta", math.nan)
        if math.isfinite(self.theta) and self.design.motion == "rotary":  # an angle within a turn is counted on
            theta -= 2.0 * math.pi * round((theta - self.theta) / (2.0 * math.pi))
        self.theta = theta if math.isfinite(theta) else self.theta
        self.reading = self.tracker.update(
            t, given.get("omega", math.nan), given.get("i_q", math.nan), theta=theta, i_d=given.get("i_d", 0.0),
            torque=given.get("torque"), T_load=given.get("T_load", 0.0),
        )  # fmt: skip
        self.samples += 1
        event = self.reading.event
        self.counts[event] = self.counts.get(event, 0) + 1
        self._keep()
        raised = self.windows.take(self.tracker.taken, event)
        self.alarms = [*self.alarms, *raised][-MOST:]
        return raised

    def _keep(self) -> None:
        assert self.reading is not None
        if self.samples % self.step == 0:
            self.history.append(self.reading)
        if len(self.history) > MOST:
            self.history, self.step = self.history[::2], 2 * self.step

    def _nothing(self, source: str) -> LogError:
        """Return the error of a stream without a sample."""
        if self.missing:
            return LogError(f"{source}: no such file; one that grows was expected, and it did not appear")
        if self.damaged:
            return LogError(f"{source}: no sample came; lines below the header that hold none: {self.damaged}")
        if self.unread:
            what = "a line of names such as 't [s]', 'omega [rad/s]', 'i_q [A]' was expected before the numbers"
            return LogError(f"{source}: no header in {self.unread} lines; {what}", next_command=NextCommand.MAP)
        return LogError(f"{source}: no sample came", next_command=NextCommand.IMPORT)

    def result(self, source: str) -> Watched:
        self.begin()
        if self.tracker is None or self.reading is None:
            raise self._nothing(source)
        state, P = self.tracker.state, self.tracker.P
        active = [name for name in ("F_c", "F_v", *self.tracker.settings.estimate) if name in UNITS]
        errors = {STATES[k]: math.sqrt(max(float(P[i, i]), 0.0)) for i, k in enumerate(self.tracker.settings.active)}
        nominal = {**self.design.parameters("coulomb"), **self.design.parameters("viscous"), "J": self.design.J}
        estimates = {
            name: Estimate(
                state[name], axis_unit(UNITS[name], self.design.motion), errors.get(name, math.nan), nominal.get(name)
            )
            for name in active
        }
        course = self.history or [self.reading]
        t, F_c, F_v, e_c, e_v = np.array([[r.t, r.F_c, r.F_v, r.stderr_F_c, r.stderr_F_v] for r in course]).T
        return Watched(
            self.design, source, self.samples, estimates, tuple(self.alarms), self.lost, self.damaged, self.repeated,
            self.jumps, self.reconnects, t, F_c, F_v, e_c, e_v, counts=self.counts, left_out=self.tracker.notices,
        )  # fmt: skip


def watch(
    design: Design, lines: Iterable[str], *, source: str = "stream", mapping: Mapping[str, str] | None = None,
    settings: Settings | None = None, estimate: tuple[str, ...] | None = None, every: float = 1.0,
    patience: float = math.inf, window: float = WINDOW, show: Callable[[Reading], None] | None = None,
    alarm: Callable[[Alarm], None] | None = None,
) -> Watched:  # fmt: skip
    """Track F_c and F_v over a stream until it ends, or until it is interrupted.

    Parameters
    ----------
    design : Design
    lines : iterable of str
        A header, then samples; with `IDLE` and `REOPENED` of `pmsm_ctrl.track.stream.follow`.
    source : str
        What the result calls the stream.
    mapping : dict of str to str, optional
        Channel to column.
    settings : Settings, optional
        Of the tracker; without them the angle is measured where there is one, and `estimate` says what is estimated.
    estimate : tuple of {"T_load", "J"}, optional
        Beside F_c and F_v; both if left out. An axis that turns in one direction only needs an empty one.
    every : float
        Time between two calls of `show`, s by the stream's clock.
    patience : float
        Time without a line after which the stream has ended, s.
    window : float
        Duration of motion, s, of a record of the stream: alarms are changes over records.
    show : function of Reading, optional
    alarm : function of Alarm, optional

    Returns
    -------
    Watched
        After Ctrl-C as well, with what was known then.

    Raises
    ------
    LogError
        When the stream has no header or not one sample, or its header lacks a channel.
    """
    watcher = _Watcher(design, settings, estimate, window)
    header: Header | None = None
    labels = ""  # the last line, where it was a header
    heard, due = time.monotonic(), -math.inf
    try:
        for line in lines:
            if line in (IDLE, MISSING):
                watcher.missing = line == MISSING
                if time.monotonic() - heard > patience:
                    break
                continue
            heard, watcher.missing = time.monotonic(), False
            if line == REOPENED:
                watcher.reconnects += 1
                continue
            below, labels = with_units(labels, line) if labels else None, ""
            if below is not None:
                header = _header(below, mapping, design, None)
                continue
            if (new := _header(line, mapping, design, header)) is not None:
                header, labels = new, line
                continue
            watcher.unread += header is None
            values = header.values(line) if header is not None else None
            if values is None or not math.isfinite(values["t"]):
                watcher.damaged += header is not None
                continue
            for one in watcher.take(values):
                if alarm is not None:
                    alarm(one)
            if show is not None and watcher.reading is not None and watcher.reading.t >= due:
                due = watcher.reading.t + every
                show(watcher.reading)
    except KeyboardInterrupt:  # Ctrl-C is how a live tracking ends
        pass
    return watcher.result(source)


def _header(line: str, mapping: Mapping[str, str] | None, design: Design, known: Header | None) -> Header | None:
    """Return the header that a line is; a file that was opened again repeats it."""
    if known is not None and not LETTERS.search(line):
        return None
    counts = design.sensor.encoder_counts
    found = read_header(line, mapping, design.motion, design=design.log, counts=counts)
    if found is None:
        return None
    columns = found.columns
    if "t" not in columns or not {"theta", "omega"} & set(columns) or not {"i_q", "torque"} & set(columns):
        raise LogError(
            f"the header '{line.strip()[:80]}' lacks a channel: t, theta or omega, and i_q or torque were expected "
            f"(found: {', '.join(columns)})",
            next_command=NextCommand.MAP,
        )
    return found

"""Alarms of a stream, by the rules of a fleet: windows of its motion are records, and a parameter changes over them.

Each window is filtered by itself, with F_c and F_v constant in it, so that the windows' values share no noise. Each new
window asks whether F_c or F_v has changed (`pmsm_ctrl.evidence.trends`, the false discovery rate over both). A stream
is asked without end: the k-th question may spend 0.05 / (k (k + 1)), which is 0.05 in sum over all of them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.evidence.trends import FALSE_DISCOVERIES, FEWEST_RECORDS, Changing, Regression, Step, changing, q_values
from pmsm_ctrl.track import model
from pmsm_ctrl.track.inputs import Samples, noise_from_samples
from pmsm_ctrl.track.settings import Settings, numbers
from pmsm_ctrl.track.tracking import filter_samples

__all__ = ["WINDOW", "Alarm", "Alarms", "Window", "Windows"]

Array = NDArray[np.float64]

WINDOW = 10.0  # s of motion: some cycles of most machines
MOST = 500  # windows that are kept; a change against older ones has been told, or is none
UNKNOWN = 0.25  # share of the variance before a window that is left where its motion does not excite a parameter
STILL = ("standstill", "invalid")
PARAMETERS = {"F_c": model.F_C, "F_v": model.F_V}


@dataclass(frozen=True)
class Alarm:
    """A change of friction over a stream.

    Attributes
    ----------
    parameter : {"F_c", "F_v"}
    kind : {"step", "trend"}
    t : float
        s, by the stream's clock: of a step the beginning of the new level, of a trend the beginning of the line.
    earliest, latest : float
        s, between which a step lies, at 95 %; of a trend its first and its last window.
    told : float
        s, when the alarm was raised.
    before, after : float
        SI units: the levels, or the ends of the line.
    stderr : float
        Of the difference of the two.
    p_value : float
        Of no change at that question.
    """

    parameter: str
    kind: str
    t: float
    earliest: float
    latest: float
    told: float
    before: float
    after: float
    stderr: float
    p_value: float


@dataclass(frozen=True)
class Window:
    """A parameter in one window.

    Attributes
    ----------
    start, stop : float
        s.
    value, stderr : float
    """

    start: float
    stop: float
    value: float
    stderr: float


class Alarms:
    """F_c and F_v over the windows of a stream, and the changes that have been told.

    Attributes
    ----------
    series : dict of str to list of Window
        Since the last alarm.
    """

    def __init__(self) -> None:
        self.series: dict[str, list[Window]] = {name: [] for name in PARAMETERS}
        self._due = dict.fromkeys(PARAMETERS, FEWEST_RECORDS)  # windows that a trend needs
        self._asked = 0

    def add(self, name: str, window: Window) -> None:
        """Take in a parameter of a window.

        Parameters
        ----------
        name : {"F_c", "F_v"}
        window : Window
        """
        self.series[name] = [*self.series[name], window][-MOST:]

    def ask(self) -> list[Alarm]:
        """Ask whether a parameter has changed: once after each window.

        Returns
        -------
        list of Alarm
        """
        judged = {name: one for name, series in self.series.items() if (one := _changing(series)) is not None}
        if not judged:
            return []
        self._asked += 1
        share = FALSE_DISCOVERIES / (self._asked * (self._asked + 1))
        shares = q_values([one.p_value for one in judged.values()])
        out = []
        for (name, one), q in zip(judged.items(), shares.tolist(), strict=True):
            if q <= share and (alarm := self._alarm(name, one)) is not None:
                out.append(alarm)
        return out

    def _alarm(self, name: str, found: Changing) -> Alarm | None:
        """Return the alarm of a change, once its size can be told; the windows after it begin a new series."""
        series = self.series[name]
        if found.step is not None:
            k = found.step.index
            if len(series) < k + 2:  # the window of the change itself holds both levels: one more tells the new one
                return None
            self.series[name], self._due[name] = series[k + 1 :], FEWEST_RECORDS
            return _of_step(name, series, found.step, found.p_value)
        assert found.trend is not None
        if len(series) < self._due[name]:
            return None
        # what goes on rising is told again after twice as many windows
        self.series[name], self._due[name] = [], 2 * len(series)
        return _of_trend(name, series, found.trend, found.p_value)


class Windows:
    """Cuts a stream into windows of motion, and estimates F_c and F_v in each.

    Parameters
    ----------
    design : Design
    settings : Settings
        Of the tracker.
    period : float
        Of the stream, s.
    duration : float
        Of the motion in a window, s.

    Attributes
    ----------
    alarms : Alarms
    rows : list of tuple
        The filter's inputs in the window that is not complete.

    Raises
    ------
    RequestError
        When `duration` is not positive.
    """

    def __init__(self, design: Design, settings: Settings, period: float, duration: float = WINDOW) -> None:
        if not duration > 0.0:
            raise RequestError(f"window: found {duration:g} s; a positive duration was expected")
        drift_T_load = settings.drift_T_load
        if drift_T_load is None:  # the load may vary in a window, as in the tracker
            drift_T_load = settings.drift * design.parameters("coulomb").get("F_c", 0.0)
        self.alarms = Alarms()
        self.rows: list[tuple[float, float, float, float]] = []
        self._design, self._duration, self._moved = design, duration, 0.0
        self._settings = replace(settings, drift=0.0, drift_T_load=drift_T_load)
        self._period = period

    def take(self, inputs: tuple[float, float, float, float], event: str) -> list[Alarm]:
        """Take in one sample.

        Parameters
        ----------
        inputs : tuple of float
            The filter's inputs: time, measured channel, torque, known torque.
        event : str
            How the tracker used it.

        Returns
        -------
        list of Alarm
            Those that this sample's window raised.
        """
        if event in STILL:  # says nothing of friction, and a day of it would fill the memory
            return []
        if self.rows and (step := inputs[0] - self.rows[-1][0]) <= self._settings.max_gap:
            self._moved += step
        self.rows.append(inputs)
        if self._moved < self._duration:
            return []
        samples = Samples(*np.array(self.rows).T)
        self.rows, self._moved = [], 0.0
        return self.judge(samples)

    def judge(self, samples: Samples) -> list[Alarm]:
        """Take in a whole window, and ask whether friction has changed.

        Parameters
        ----------
        samples : Samples

        Returns
        -------
        list of Alarm
        """
        if not samples.torque.any():  # a motion without the drive
            return []
        settings = noise_from_samples(self._design, self._settings, samples)
        s = numbers(self._design, settings, self._period)
        found = filter_samples(self._design, settings, s, samples)
        for name, k in PARAMETERS.items():
            variance = float(found.P[k, k])
            if 0.0 < variance < UNKNOWN * float(s[model.PRIOR + k]):
                one = Window(float(samples.t[0]), float(samples.t[-1]), float(found.x[k]), variance**0.5)
                self.alarms.add(name, one)
        return self.alarms.ask()


def _changing(series: list[Window]) -> Changing | None:
    t, value, stderr = np.array([(0.5 * (w.start + w.stop), w.value, w.stderr) for w in series]).reshape(-1, 3).T
    return changing(t, value, stderr)


def _of_step(name: str, series: list[Window], step: Step, p_value: float) -> Alarm:
    before = float(np.median([w.value for w in series[: step.index]]))
    after = float(np.median([w.value for w in series[step.index + 1 :]]))
    earliest, latest = series[step.first - 1].start, series[step.last].stop
    return Alarm(name, "step", series[step.index].start, earliest, latest, series[-1].stop, before, after,
                 step.stderr, p_value)  # fmt: skip


def _of_trend(name: str, series: list[Window], trend: Regression, p_value: float) -> Alarm:
    first, last = (0.5 * (w.start + w.stop) for w in (series[0], series[-1]))
    before, after = (trend.level + trend.slope * (t - trend.at) for t in (first, last))
    return Alarm(name, "trend", series[0].start, series[0].start, series[-1].stop, series[-1].stop, before, after,
                 trend.stderr * (last - first), p_value)  # fmt: skip

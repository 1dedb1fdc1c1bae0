"""FrictionTracker: filterpy's filters fed sample by sample, on a live stream or in a tuning script."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.track import model
from pmsm_ctrl.track.filters import Extended, Unscented
from pmsm_ctrl.track.inputs import KnownTorque, drive_torque
from pmsm_ctrl.track.settings import Kind, Settings, check_kind, covariance, memory, numbers, start

__all__ = ["FrictionTracker", "Reading"]

Array = NDArray[np.float64]


class Reading(NamedTuple):
    """What is believed after a sample. `event` is one of `pmsm_ctrl.track.model.EVENTS`; `nis` is NaN unless a
    measurement was judged."""

    t: float
    omega: float
    F_c: float
    F_v: float
    stderr_F_c: float
    stderr_F_v: float
    event: str
    nis: float


class FrictionTracker:
    """Tracks F_c and F_v, and T_load and J if asked, with filterpy's extended or unscented Kalman filter.

    Parameters
    ----------
    design : Design
        Start values, noise, and the further effects whose torque is taken as known.
    settings : Settings, optional
    kind : {"extended", "unscented"}
    period : float, optional
        Sampling period of the stream, s; by default that of the design's log. It scales the torque noise only:
        samples may come at any time.

    Raises
    ------
    RequestError
        When a setting cannot be used, or the design has no friction to start from.

    Examples
    --------
    >>> tracker = FrictionTracker(Design.read("designs/seed_motor.toml"))  # doctest: +SKIP
    >>> reading = tracker.update(t, omega, i_q, theta=theta)  # doctest: +SKIP
    """

    def __init__(
        self,
        design: Design,
        settings: Settings | None = None,
        *,
        kind: Kind = "extended",
        period: float | None = None,
    ) -> None:
        self.design, self.settings = design, settings or Settings()
        check_kind(kind)
        self._known = KnownTorque(design)
        logged = design.log_period
        self._s = numbers(design, self.settings, logged if period is None else period)
        self._m = memory()
        active = self.settings.active
        self._full = start(design)
        self._index = np.array(active)
        self._at = {name: active.index(k) for k, name in enumerate(model.STATES) if k in active}
        P = covariance(self._s, self.settings)[np.ix_(active, active)]
        shape = Unscented if kind == "unscented" else Extended
        self._filter = shape(self._full[self._index], P, self)
        self._innovation = (math.nan, math.nan)

    @property
    def notes(self) -> tuple[str, ...]:
        """Effects of the design that the tracker cannot allow for."""
        return self._known.notes

    @property
    def state(self) -> dict[str, float]:
        """The present estimates by name."""
        x = self._x()
        return {name: float(x[k]) for k, name in enumerate(model.STATES)}

    @property
    def P(self) -> Array:
        """Covariance of the estimated states, in the order of `settings.active`."""
        return np.array(self._filter.kf.P)

    @property
    def innovation(self) -> tuple[float, float]:
        """Last innovation and its variance."""
        return self._innovation

    def update(
        self,
        t: float,
        omega: float = math.nan,
        i_q: float = math.nan,
        *,
        theta: float = math.nan,
        i_d: float = 0.0,
        torque: float | None = None,
        T_load: float = 0.0,
    ) -> Reading:
        """Take one sample in and return what is believed after it.

        Parameters
        ----------
        t : s; omega : rad/s; theta : rad; i_q, i_d : A peak
        torque : N m, in place of the currents
        T_load : known load torque, N m

        A sample that is not finite, or not later than the last, changes nothing.
        """
        drive = float(drive_torque(self.design, i_d, i_q)) if torque is None else torque
        z = theta if self.settings.measure == "theta" else omega
        known = self._known_torque(t, z, theta, i_d, i_q, drive) if self._known else 0.0
        return self.step(t, z, drive - T_load, known)

    def step(self, t: float, z: float, torque: float, known: float = 0.0) -> Reading:
        """Take one sample in: measured angle or speed, drive torque less known load, torque of further effects."""
        m, s, kf = self._m, self._s, self._filter
        x = self._x()
        friction = abs(x[model.F_C]) + abs(x[model.F_V] * x[model.OMEGA])
        before = m[model.T_LAST]
        event = model.classify(m, t, z, torque, known, friction, s)
        judged = (math.nan, math.nan)
        if m[model.T_LAST] > before:
            self._grow()
        if event == model.PREDICTED:
            direction = 1.0 if m[model.SPEED] > 0.0 else -1.0
            kf.predict(direction)
            if m[model.DUE]:
                event, judged = self._judge(z, direction)
        elif event == model.STARTED:
            self._restart(z)
        elif event == model.STANDSTILL:
            self._rest(z)
        if not math.isnan(judged[0]):
            self._innovation = judged
        return self._reading(t, event, judged)

    # -- steps -----------------------------------------------------------------------------------------------

    def _x(self) -> Array:
        """Full state, with the design's values where a state is not estimated."""
        x = self._full.copy()
        x[self._index] = self._filter.kf.x.reshape(-1)
        return x

    def _known_torque(self, t: float, z: float, theta: float, i_d: float, i_q: float, torque: float) -> float:
        m = self._m
        speed = z
        if self.settings.measure == "theta":
            speed = (z - m[model.Z_LAST]) / (t - m[model.T_LAST]) if model.NEVER < m[model.T_LAST] < t else 0.0
        if not (math.isfinite(speed) and math.isfinite(torque)):
            return 0.0
        signals = {"omega": speed, "direction": float(np.sign(speed)), "theta": theta, "i_d": i_d, "i_q": i_q}
        return self._known.at({**signals, "torque": torque, "t": t})

    def _grow(self) -> None:
        P, s = self._filter.kf.P, self._s
        for k, i in enumerate(self._index):
            if i not in (model.OMEGA, model.THETA):
                room = s[model.PRIOR + i] - P[k, k]
                P[k, k] += min(s[model.DRIFT + i] * self._m[model.DT], room) if room > 0.0 else 0.0

    def _judge(self, z: float, direction: float) -> tuple[int, tuple[float, float]]:
        """Take a measurement in, reject it, or take it as the sign of a change."""
        m, s, kf = self._m, self._s, self._filter
        y, S = kf.innovation(z, direction)
        event = model.judge(m, s, y, S, direction)
        if event == model.REJECTED:
            self._restart(z)
            return event, (y, S)
        if event == model.CHANGE:
            self._doubt(y)
        split = None
        if model.constant_speed(m, s):
            x = self._x()
            rates = model.acceleration(x[0], direction, *x[1:5], m[model.TORQUE], m[model.KNOWN], 0.0)
            split = rates[2], rates[3]
            event = model.CONSTANT if event == model.UPDATED else event
        kf.update(z, direction, split)
        return event, (y, S)

    def _doubt(self, y: float) -> None:
        """Believe friction and load no more than before the first sample: the axis has changed."""
        P, s = self._filter.kf.P, self._s
        for k, i in enumerate(self._index):
            if i not in (model.OMEGA, model.THETA):
                P[k, k] += max(s[model.PRIOR + i] - P[k, k], 0.0)
        per = max(s[model.INTERVAL], self._m[model.DT]) if s[model.FROM_ANGLE] else 1.0
        P[0, 0] += (y / per) ** 2

    def _restart(self, z: float) -> None:
        m, s, kf = self._m, self._s, self._filter.kf
        x = self._x()
        direction = 1.0 if m[model.SPEED] > 0.0 else -1.0
        alpha, _, by_F_c, _, _, _ = model.acceleration(
            m[model.SPEED], direction, x[1], x[2], x[3], x[4], m[model.TORQUE_LAST], m[model.KNOWN_LAST], 0.0
        )
        speed, variance, shared = model.fresh_speed(m, s, by_F_c, kf.P[1, 1], alpha)
        self._set_motion(speed, z, variance, shared)

    def _rest(self, z: float) -> None:
        m, s = self._m, self._s
        dt, R = m[model.DT], s[model.R]
        from_angle = bool(s[model.FROM_ANGLE])
        self._set_motion(m[model.SPEED], z, 2.0 * R / (dt * dt) if from_angle else R, R / dt if from_angle else 0.0)

    def _set_motion(self, speed: float, z: float, variance: float, shared: float) -> None:
        """Set speed and angle and their covariance; friction and its covariance stay as they are."""
        kf = self._filter.kf
        x = kf.x.reshape(-1)
        x[0] = speed
        kf.P[0, :] = kf.P[:, 0] = 0.0
        kf.P[0, 0] = variance
        if "theta" in self._at:
            k = self._at["theta"]
            x[k] = z
            kf.P[k, :] = kf.P[:, k] = 0.0
            kf.P[0, 0] = variance
            kf.P[0, k] = kf.P[k, 0] = shared
            kf.P[k, k] = self._s[model.R]

    def _reading(self, t: float, event: int, judged: tuple[float, float]) -> Reading:
        x, P = self._filter.kf.x.reshape(-1), self._filter.kf.P
        return Reading(
            t,
            float(x[0]),
            float(x[1]),
            float(x[2]),
            math.sqrt(P[1, 1]),
            math.sqrt(P[2, 2]),
            model.EVENTS[event],
            judged[0] ** 2 / judged[1] if judged[1] > 0.0 else math.nan,
        )

    # -- the model in the filters' own vector ------------------------------------------------------------------

    def full(self, x: Any) -> Array:
        """Return the full state of a filter's vector."""
        out = self._full.copy()
        out[self._index] = np.asarray(x).reshape(-1)
        return out

    def moved(self, x: Any, direction: float) -> tuple[Array, tuple[float, ...]]:
        """Return the full state one step on, and the acceleration with its derivatives."""
        m, new = self._m, self.full(x)
        dt = m[model.DT]
        rates = model.acceleration(
            new[0], direction, new[1], new[2], new[3], new[4], m[model.TORQUE], m[model.KNOWN], dt
        )
        new[model.THETA] += dt * (new[0] + 0.5 * dt * rates[0])
        new[model.OMEGA] += dt * rates[0]
        return new, rates

    def seen(self, x: Any, direction: float) -> tuple[float, Array]:
        """Return the predicted measurement and its row in the full state."""
        m, s, full = self._m, self._s, self.full(x)
        row = np.zeros(model.SIZE)
        if s[model.FROM_ANGLE]:
            row[model.THETA] = 1.0
            return full[model.THETA], row
        lag = s[model.LAG]
        rates = model.acceleration(
            full[0], direction, full[1], full[2], full[3], full[4], m[model.TORQUE_LAST], m[model.KNOWN_LAST], 0.0
        )
        row[:5] = [-lag * rate for rate in rates[1:]]
        row[0] += 1.0
        return full[0] - lag * rates[0], row

    def process_noise(self, J: float) -> Array:
        """Return the covariance that torque noise adds in one step, in the filter's vector."""
        dt = self._m[model.DT]
        q = model.process_variance(self._m, self._s) / (J * J)
        push = np.zeros(model.SIZE)
        push[model.OMEGA] = 1.0
        if self._s[model.FROM_ANGLE]:
            push[model.THETA] = 0.5 * dt
        return q * np.outer(push, push)[np.ix_(self._index, self._index)]

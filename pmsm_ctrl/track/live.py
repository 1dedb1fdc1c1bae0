"""FrictionTracker: filterpy's extended Kalman filter fed sample by sample, on a live stream or in a tuning script.

It is the estimator of record. The model, the gating and the restarts are the functions that the compiled twin
calls; prediction and update are filterpy's own.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.regression.signals import drive_torque
from pmsm_ctrl.section import Notice
from pmsm_ctrl.track import model, twin
from pmsm_ctrl.track.inputs import AsMeasured, KnownTorque
from pmsm_ctrl.track.model import F_C, F_V, OMEGA, SIZE, THETA
from pmsm_ctrl.track.settings import Settings, covariance, memory, numbers, start

__all__ = ["FrictionTracker", "Reading"]

Array = NDArray[np.float64]


class Reading(NamedTuple):
    """The estimates after a sample.

    Attributes
    ----------
    t : float
        Time of the sample, s.
    omega : float
        Speed, rad/s.
    F_c, F_v : float
        Coulomb friction, N m, and viscous friction, N m s/rad.
    stderr_F_c, stderr_F_v : float
        Their standard errors.
    event : str
        How the sample was used, one of `pmsm_ctrl.track.model.EVENTS`.
    nis : float
        Normalised innovation squared; NaN unless a measurement was judged.
    """

    t: float
    omega: float
    F_c: float
    F_v: float
    stderr_F_c: float
    stderr_F_v: float
    event: str
    nis: float


class FrictionTracker:
    """Tracks F_c and F_v, and T_load and J if asked, with filterpy's extended Kalman filter.

    The state always holds `pmsm_ctrl.track.model.STATES`; a state that is not estimated has zero variance.

    Parameters
    ----------
    design : Design
        Start values, noise, and the further effects whose torque is taken as known.
    settings : Settings, optional
        What is measured and estimated, and the filter's noise.
    period : float, optional
        Sampling period of the stream, s; by default that of the design's log. It scales the torque noise only:
        samples may come at any time.

    Raises
    ------
    RequestError
        When the design has no friction to start from.

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
        period: float | None = None,
    ) -> None:
        from filterpy.kalman import ExtendedKalmanFilter

        self.design, self.settings = design, settings or Settings()
        self._known = KnownTorque(design)
        self._measured = AsMeasured(design, self.settings.measure)
        self._s = numbers(design, self.settings, design.log_period if period is None else period)
        self._m = memory()
        self._kf = ExtendedKalmanFilter(dim_x=SIZE, dim_z=1)
        self._kf.x, self._kf.P = start(design), covariance(self._s, self.settings)
        self._kf.R = np.array([[self._s[model.R]]])
        self._innovation = (math.nan, math.nan)
        self._taken = (math.nan, math.nan, math.nan, math.nan)

    @property
    def taken(self) -> tuple[float, float, float, float]:
        """The filter's inputs at the last sample: time, measured channel, torque, known torque."""
        return self._taken

    @property
    def notices(self) -> tuple[Notice, ...]:
        """Effects of the design that the tracker cannot evaluate, or cannot correct its inputs for."""
        return (*self._known.notices, *self._measured.notices)

    @property
    def state(self) -> dict[str, float]:
        """The present estimates by name; the angle counts on from the last measured one."""
        found = dict(zip(model.STATES, self._kf.x.tolist(), strict=True))
        if self._s[model.FROM_ANGLE] and self._m[model.T_LAST] > model.NEVER:
            found["theta"] += float(self._m[model.Z_LAST])
        return found

    @property
    def P(self) -> Array:
        """Covariance of the estimated states, in the order of `settings.active`."""
        return np.array(self._kf.P[np.ix_(self.settings.active, self.settings.active)])

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
        """Process one sample. A sample that is not finite, or not later than the last, changes nothing.

        Parameters
        ----------
        t : float
            Time, s.
        omega : float
            Measured speed, rad/s.
        i_q : float
            Current, A peak.
        theta : float
            Measured angle, rad.
        i_d : float
            Current, A peak.
        torque : float, optional
            Drive torque, N m, in place of the currents.
        T_load : float
            Known load torque, N m.

        Returns
        -------
        Reading
            The estimates after this sample.
        """
        if self._measured:
            read = {"omega": omega} if self.settings.measure == "omega" else {}
            read |= {"theta": theta, "i_d": i_d} | ({"i_q": i_q} if torque is None else {"torque": torque})
            read = self._measured.corrected(t, read)
            theta, i_d, i_q = read["theta"], read["i_d"], read.get("i_q", i_q)
        drive = float(drive_torque(self.design, i_d, i_q)) if torque is None else torque
        z = theta if self.settings.measure == "theta" else omega
        known = self._known_torque(t, z, theta, i_d, i_q, drive) if self._known else 0.0
        return self.step(t, z, drive - T_load, known)

    def step(self, t: float, z: float, torque: float, known: float = 0.0) -> Reading:
        """Process one sample of the filter's own inputs.

        Parameters
        ----------
        t : float
            Time, s.
        z : float
            Measured angle in rad or speed in rad/s, as the settings say.
        torque : float
            Drive torque less the known load, N m.
        known : float
            Torque of the design's further effects, N m.

        Returns
        -------
        Reading
            The estimates after this sample.
        """
        m, s, kf = self._m, self._s, self._kf
        self._taken = t, z, torque, known
        friction = abs(kf.x[F_C]) + abs(kf.x[F_V] * kf.x[OMEGA])
        turned = z - m[model.Z_LAST] if s[model.FROM_ANGLE] else z
        event = model.classify(m, t - m[model.T_LAST], turned, torque, known, friction, s)
        judged = (math.nan, math.nan)
        if event != model.INVALID:
            m[model.T_LAST], m[model.Z_LAST] = t, z
            twin.advance.py_func(kf.x, kf.P, m, s, turned, SIZE - 1)
        if event == model.PREDICTED:
            direction = 1.0 if m[model.SPEED] > 0.0 else -1.0
            self._predict(direction)
            if m[model.DUE]:
                event, judged = self._measure(direction)
                self._innovation = judged
        elif event == model.STARTED:
            twin.restart.py_func(kf.x, kf.P, m, s)
        elif event == model.STANDSTILL:
            twin.rest.py_func(kf.x, kf.P, m, s)
        x, sd = kf.x.tolist(), np.sqrt(np.diag(kf.P)).tolist()
        nis = judged[0] ** 2 / judged[1] if judged[1] > 0.0 else math.nan
        return Reading(t, x[OMEGA], x[F_C], x[F_V], sd[F_C], sd[F_V], model.EVENTS[event], nis)

    def _known_torque(self, t: float, z: float, theta: float, i_d: float, i_q: float, torque: float) -> float:
        m = self._m
        speed = z
        if self.settings.measure == "theta":
            speed = (z - m[model.Z_LAST]) / (t - m[model.T_LAST]) if model.NEVER < m[model.T_LAST] < t else 0.0
        if not (math.isfinite(speed) and math.isfinite(torque)):
            return 0.0
        signals = {"omega": speed, "direction": float(np.sign(speed)), "theta": theta, "i_d": i_d, "i_q": i_q}
        return self._known.at({**signals, "torque": torque, "t": t})

    def _predict(self, direction: float) -> None:
        """Advance mean and covariance by one sample."""
        m, s, kf = self._m, self._s, self._kf
        dt = float(m[model.DT])
        past = m[[model.PAST_SPEED, model.PAST_ALPHA]]
        alpha, *rates = model.acceleration(
            kf.x[OMEGA], direction, *kf.x[F_C:THETA], m[model.TORQUE], m[model.KNOWN], *past, dt
        )
        moved = kf.x.copy()
        moved[THETA] += dt * (moved[OMEGA] + 0.5 * dt * alpha)
        moved[OMEGA] += dt * alpha
        F, push = np.eye(SIZE), np.zeros(SIZE)
        F[OMEGA, :THETA] += dt * np.array(rates)
        push[OMEGA] = 1.0
        if s[model.FROM_ANGLE]:
            F[THETA, :THETA] += 0.5 * dt * F[OMEGA, :THETA]
            F[THETA, OMEGA] += 0.5 * dt
            push[THETA] = 0.5 * dt
        kf.F = F
        kf.Q = model.process_variance(m, s) / kf.x[model.INERTIA] ** 2 * np.outer(push, push)
        kf.predict_x = lambda u=0: setattr(kf, "x", moved)
        kf.predict()
        kf.P = 0.5 * (kf.P + kf.P.T)

    def _measure(self, direction: float) -> tuple[int, tuple[float, float]]:
        """Use a measurement or reject it; return the event, the innovation and its variance."""
        m, s, kf = self._m, self._s, self._kf
        h = np.zeros(SIZE)
        predicted = twin.measure.py_func(kf.x, m, s, direction, h)
        z = 0.0 if s[model.FROM_ANGLE] else float(m[model.SPEED])  # the angle is counted from the last sample
        y, S = z - predicted, float(h @ kf.P @ h + s[model.R])
        event = model.judge(m, s, y, S, direction)
        if event == model.REJECTED:
            twin.restart.py_func(kf.x, kf.P, m, s)
            return event, (y, S)
        if event == model.CHANGE:
            twin.distrust.py_func(kf.P, m, s, y)
        x, P = kf.x.copy(), kf.P.copy()
        kf.update(np.array([z]), HJacobian=lambda _: h.reshape(1, -1), Hx=lambda _: np.array([predicted]))
        if model.constant_speed(m, s):
            past = m[[model.PAST_SPEED, model.PAST_ALPHA]]
            rates = model.acceleration(x[OMEGA], direction, *x[F_C:THETA], m[model.TORQUE], m[model.KNOWN], *past, 0.0)
            K = kf.K[:, 0].copy()
            K[F_C], K[F_V] = model.keep_split(K[F_C], K[F_V], x[F_C], x[F_V], rates[2], rates[3])
            rest = np.eye(SIZE) - np.outer(K, h)
            kf.x, kf.P = x + K * y, rest @ P @ rest.T + s[model.R] * np.outer(K, K)
            event = model.CONSTANT if event == model.UPDATED else event
        kf.P = 0.5 * (kf.P + kf.P.T)
        model.keep_past_speed(m, s)
        return event, (y, S)

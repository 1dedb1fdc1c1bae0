"""The tracker's settings: noise and drift, from the design where they are not given."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.sampling import smoothing, speed_lag
from pmsm_ctrl.track import model

__all__ = ["Settings", "covariance", "memory", "numbers", "start"]

Array = NDArray[np.float64]

RESPONSE = 2000  # control periods over which a current loop's response to noise is followed


@dataclass(frozen=True)
class Settings:
    """Which channel the tracker reads, what it estimates, and its noise, drift and gating.

    Attributes
    ----------
    measure : {"theta", "omega"}
        The measured channel. The noise of the angle is its quantisation, which is white. The drive's speed is a
        filtered difference of angles: it lags, which the measurement equation contains, and its noise is nearly
        white only when it is used every few milliseconds.
    estimate : tuple of {"T_load", "J"}
        Further states beside F_c and F_v. Taken as known, their errors are mistaken for friction. Only for an axis that
        turns in one direction, where T_load and F_c are not separable, leave T_load out.
    drift : float
        Random walk of F_c and F_v, as a share of the design's value per square root of a second. With the
        reference motor 0.01 gives a memory of about 0.7 s.
    drift_T_load : float or None
        The same for the load torque, N m/sqrt(s); None: as much as F_c.
    prior : float
        Standard deviation of F_c and F_v before the first sample, as a share of the design's value.
    prior_F_c, prior_F_v, prior_T_load, prior_J : float or None
        The same as absolute numbers, N m, N m s/rad, N m, kg m^2. None: from `prior`; from F_c for the load torque;
        the datasheet tolerance for J.
    interval : float
        Time between two measurement updates, s; prediction runs at every sample. Over some milliseconds the
        errors of single samples (aliased current, correlated speed noise) no longer matter.
    standstill : float or None
        Speed below which friction is set-valued and not updated, rad/s. None: five standard deviations of the
        measured speed.
    gate : float
        Normalised innovation squared above which a measurement is rejected.
    max_gap : float
        Longest step that is bridged by prediction, s.
    torque_noise : float or None
        Noise of the drive torque per logged sample, N m rms. None: from the design's current noise.
    angle_noise : float or None
        Noise of the angle, rad rms. None: the quantisation of the design's encoder.
    adapt : bool
        Raise the torque noise while the innovations are much larger than it explains (unmodelled torque), and lower it
        again.
    """

    measure: Literal["theta", "omega"] = "theta"
    estimate: tuple[str, ...] = ("T_load", "J")
    drift: float = 0.01
    drift_T_load: float | None = None
    prior: float = 0.5
    prior_F_c: float | None = None
    prior_F_v: float | None = None
    prior_T_load: float | None = None
    prior_J: float | None = None
    interval: float = 0.01
    standstill: float | None = None
    gate: float = 25.0
    max_gap: float = 0.02
    torque_noise: float | None = None
    angle_noise: float | None = None
    adapt: bool = True

    def __post_init__(self) -> None:
        if self.measure not in ("theta", "omega"):
            raise RequestError(f"measure: found '{self.measure}'; accepted: theta, omega")
        for name in self.estimate:
            if name not in ("T_load", "J"):
                raise RequestError(f"estimate: found '{name}'; accepted: T_load, J (F_c and F_v always are)")
        for name in ("prior", "interval", "gate", "max_gap"):
            if not getattr(self, name) > 0.0:
                raise RequestError(f"{name}: found {getattr(self, name):g}; it should be positive")
        if not self.drift >= 0.0:
            raise RequestError(f"drift: found {self.drift:g}; it should not be negative")

    @property
    def active(self) -> tuple[int, ...]:
        """Positions of the estimated states in the full vector, in order."""
        chosen = ("omega", "F_c", "F_v", *self.estimate, *(("theta",) if self.measure == "theta" else ()))
        return tuple(k for k, name in enumerate(model.STATES) if name in chosen)


def start(design: Design) -> Array:
    """Return the full state at standstill with the design's values, shape (6,)."""
    F_c = design.parameters("coulomb").get("F_c", 0.0)
    F_v = design.parameters("viscous").get("F_v", 0.0)
    return np.array([0.0, F_c, F_v, 0.0, design.J, 0.0])


def memory() -> Array:
    """Return the filter's memory before the first sample."""
    m = np.zeros(model.MEMORY)
    m[model.T_LAST] = model.NEVER
    m[model.EXCESS] = m[model.NOISE] = 1.0
    return m


def numbers(design: Design, settings: Settings, log_period: float) -> Array:
    """Return the fixed numbers of a run in the kernels' order.

    Raises
    ------
    RequestError
        When F_c or F_v is 0 in the design and has no prior.
    """
    s = np.zeros(model.SETTINGS)
    torque_noise = settings.torque_noise
    if torque_noise is None:
        torque_noise = design.K_t_assumed * design.sensor.current_noise * math.sqrt(_noise_through_the_loop(design))
    angle = _angle_noise(design, settings)
    lag, speed_noise = _speed_filter(design, angle)
    from_angle = settings.measure == "theta"
    if from_angle:
        speed_noise = math.sqrt(2.0) * angle / log_period
    s[model.FROM_ANGLE] = float(from_angle)
    s[model.R] = angle**2 if from_angle else speed_noise**2
    s[model.TORQUE_DENSITY] = torque_noise**2 * log_period
    s[model.LAG], s[model.SPEED_NOISE] = lag, speed_noise
    s[model.THRESHOLD] = 5.0 * speed_noise if settings.standstill is None else settings.standstill
    s[model.INTERVAL], s[model.MAX_GAP], s[model.GATE] = settings.interval, settings.max_gap, settings.gate
    s[model.J_NOMINAL], s[model.ADAPTS] = design.J, float(settings.adapt)
    prior, drift = _slow_states(design, settings)
    s[model.PRIOR : model.PRIOR + model.SIZE] = prior**2
    s[model.DRIFT : model.DRIFT + model.SIZE] = drift**2
    return s


def covariance(s: Array, settings: Settings) -> Array:
    """Return the full covariance before the first sample, shape (6, 6)."""
    P = np.diag(s[model.PRIOR : model.PRIOR + model.SIZE])
    P[model.OMEGA, model.OMEGA] = max(s[model.SPEED_NOISE] ** 2, 1e-12)
    if settings.measure == "theta":
        P[model.THETA, model.THETA] = s[model.R]
    return P


def _noise_through_the_loop(design: Design) -> float:
    """Variance of the torque integral's error per logged period, over the variance of a logged sample's noise.

    The current controller responds to the noise of all its samples, logged or not, and so disturbs the true current:
    by h(j) after j control periods, and by -1 in sum. With D periods per logged sample, noise at phase q of a
    logged period enters the logged mean by g(q) = delta(q) + sum of the h(j) that fall on logged samples, and the true
    mean by -1/D: the variance is the sum of (g + 1/D)^2. Without a response between logged samples it is 1 + 3/D.
    """
    D, motor, loops = design.sensor.log_divider, design.motor, design.loops
    fast = 1.0 + 3.0 / D
    if loops is None or motor.L_q is None or motor.R is None or not (motor.L_q > 0.0 and motor.R > 0.0):
        return fast
    period, K_p, T_n = 1.0 / design.drive.f_control, loops.current.K_p, loops.current.T_n
    decay = math.exp(-motor.R * period / motor.L_q)
    waiting, h = [0.0] * design.drive.delay_periods, np.zeros(RESPONSE)
    current = integral = 0.0
    for k in range(RESPONSE):
        h[k] = current
        error = -current - (1.0 if k == 0 else 0.0)
        integral += error * period / T_n
        waiting.append(K_p * (error + integral))
        current = decay * current + (1.0 - decay) / motor.R * waiting.pop(0)
        if not abs(current) < 10.0:  # the response to 1; such a loop cannot be logged
            return fast
    h[0] += 1.0
    g = np.bincount(np.arange(RESPONSE) % D, weights=h, minlength=D)
    return float(np.sum((g + 1.0 / D) ** 2))


def _angle_noise(design: Design, settings: Settings) -> float:
    if settings.angle_noise is not None:
        return settings.angle_noise
    return design.encoder_step / math.sqrt(12.0) or 1e-6


def _speed_filter(design: Design, angle: float) -> tuple[float, float]:
    """Lag and noise of the drive's speed: the difference over a speed period, then a first-order filter.

    With gain a per period T_s, white angle noise of variance r gives speed noise of variance 2 a^2 r / ((2 - a) T_s^2).
    """
    T_s, time_constant = design.drive.speed_period, design.sensor.speed_filter
    a = smoothing(T_s, time_constant)
    return speed_lag(T_s, time_constant), angle * a / T_s * math.sqrt(2.0 / (2.0 - a))


def _slow_states(design: Design, settings: Settings) -> tuple[Array, Array]:
    """Return prior and drift as standard deviations, in the order of the states."""
    x = start(design)
    prior, drift = np.zeros(model.SIZE), np.zeros(model.SIZE)
    for k, given in ((model.F_C, settings.prior_F_c), (model.F_V, settings.prior_F_v)):
        prior[k] = settings.prior * x[k] if given is None else given
        drift[k] = settings.drift * (x[k] or prior[k])
        if not prior[k] > 0.0:
            name = model.STATES[k]
            raise RequestError(
                f"{design.source or design.name}: {name} is 0 in the design, so its prior is unknown; "
                f"give the design a start value, or prior_{name} in the tracker's settings"
            )
    if "T_load" in settings.estimate:
        given = settings.prior_T_load
        prior[model.T_LOAD] = 2.0 * prior[model.F_C] if given is None else given
        drift[model.T_LOAD] = drift[model.F_C] if settings.drift_T_load is None else settings.drift_T_load
    if "J" in settings.estimate:
        share = design.tolerance("J", 0.15)
        prior[model.INERTIA] = share * design.J if settings.prior_J is None else settings.prior_J
    return prior, drift

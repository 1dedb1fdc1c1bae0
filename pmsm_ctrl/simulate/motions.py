"""What a scenario is, and its parts: piecewise-polynomial motion, test signals, and the limits of a design.

All signals are pure functions of time, so that references do not depend on how a run is divided into pieces.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects import bound_effects
from pmsm_ctrl.errors import RequestError, nearest

__all__ = [
    "INPUTS", "TIME_TOLERANCE", "Limits", "Path", "PathBuilder", "Scenario", "binary_signal", "chirp_signal",
    "multisine_signal", "noise_signal", "require_positive", "triangle_signal", "whole",
]  # fmt: skip

Array = NDArray[Any]

# References of a scenario, in the kernel's order; one that is left out is zero.
INPUTS: tuple[str, ...] = ("theta_ref", "omega_ref", "alpha_ref", "i_q_add", "i_d_ref", "T_load")

# Times within this of a knot belong to the later piece: k T and the knot may round differently.
TIME_TOLERANCE = 1e-9

OVERSAMPLED = 16  # points of a noise per period of its highest frequency: a cubic between them is exact to 1e-4
BRISK = 100.0  # lengths/s^2; the motions that are stated in lengths take up to 63
STEADY = 10.0  # lengths/s that a linear axis holds
UNKNOWN = 0.01  # m, length of a linear axis without electrical data
MOST_PARTS = 100_000  # cycles, levels, moves or lines of one motion; each takes memory before the motion is simulated


@dataclass(frozen=True)
class Scenario:
    """A motion to simulate.

    Attributes
    ----------
    name : str
    duration : float
        s.
    references : function of time
        ``references(t)`` with t in s, shape (n,), returns any of `INPUTS` as arrays of shape (n,), SI units.
        `i_q_add` is added to the speed controller's output (feedforward, or the injected test signal).
    control : {"speed", "position", "current"}
        The outermost closed loop.
    omega_0, theta_0 : float
        Initial speed, rad/s, and angle, rad.
    segments : tuple of (name, start, stop)
        In s.
    """

    name: str
    duration: float
    references: Callable[[Array], Mapping[str, Array]]
    control: Literal["speed", "position", "current"] = "speed"
    omega_0: float = 0.0
    theta_0: float = 0.0
    segments: tuple[tuple[str, float, float], ...] = field(default=())

    def inputs(self, t: Array) -> Array:
        """Return the references.

        Parameters
        ----------
        t : array, shape (n,)
            Times, s.

        Returns
        -------
        array, shape (n, 6)
            In the order of `INPUTS`.

        Raises
        ------
        RequestError
            When the scenario prescribes an input that does not exist.
        """
        given = self.references(t)
        for name in given:
            if name not in INPUTS:
                raise RequestError(f"scenario '{self.name}': unknown input '{name}'{nearest(name, INPUTS)}")
        out = np.zeros((len(t), len(INPUTS)))
        for column, name in enumerate(INPUTS):
            if name in given:
                out[:, column] = given[name]
        return out


def require_positive(scenario: str, **values: float) -> None:
    """Check that every value is positive and finite.

    Raises
    ------
    RequestError
        For the first value that is not.
    """
    for name, value in values.items():
        if not (value > 0.0 and math.isfinite(value)):
            raise RequestError(f"scenario '{scenario}': {name}: found {value:g}; it should be positive")


def whole(scenario: str, name: str, value: float) -> int:
    """Return a count as an integer.

    Raises
    ------
    RequestError
        When it is not a whole number from 1 to `MOST_PARTS`.
    """
    if not (1.0 <= value <= MOST_PARTS and value == round(value)):
        raise RequestError(
            f"scenario '{scenario}': {name}: found {value:g}; it should be a whole number from 1 to {MOST_PARTS}"
        )
    return round(value)


@dataclass(frozen=True)
class Limits:
    """Limits of a motion; the defaults are those of the reference motor.

    Attributes
    ----------
    speed : float
        rad/s.
    acceleration : float
        rad/s^2.
    jerk : float
        rad/s^3.
    current : float
        Amplitude of an injected test signal, A.
    breakaway : float
        Current that is sure to move the shaft from rest, A.
    length : float
        What lengths of motions are stated in: 1 rad. Of a linear axis the length, m, with which motions that are made
        for the reference motor stay within the limits.
    steady : float
        Speed that is held for seconds, rad/s: the limit. A linear axis would come to its end: 10 lengths in a second.
    swing : float
        Amplitude of slow waves of the speed, rad/s: a tenth of the limit; of a linear axis 10 lengths in a second.
    """

    speed: float = 200.0
    acceleration: float = 3000.0
    jerk: float = 150000.0
    current: float = 0.06
    breakaway: float = 0.0412
    length: float = 1.0
    steady: float = 200.0
    swing: float = 20.0

    @classmethod
    def of(cls, design: Design | None) -> Limits:
        """Return the limits of a design, rounded down to one digit; the reference motor's where the design has no data.

        The speed is 0.43 of that at which the EMF meets the voltage limit, u_dc / (sqrt(3) p psi_f); the
        acceleration takes a tenth of the greatest torque; the jerk builds it up in 20 ms. The length of a linear axis
        is such that neither 200 lengths a second, the reference motor's full speed, nor `BRISK` lengths a second
        squared are beyond them.
        """
        own = cls._of_motor(design)
        if design is None or design.motion == "rotary":
            return replace(own, steady=own.speed, swing=0.1 * own.speed)
        # Round is what stands for a turn, 2 pi lengths. At round speeds an encoder moves on by whole counts in a few
        # periods of the drive, and a log would take the current ripple of its steps always at the same place.
        turn = _one_digit(2.0 * math.pi * min(own.speed / cls.speed, own.acceleration / BRISK))
        length = turn / (2.0 * math.pi)
        return replace(own, length=length, steady=STEADY * length, swing=STEADY * length)

    @classmethod
    def _of_motor(cls, design: Design | None) -> Limits:
        """Return the limits that motor and drive set."""
        standard = cls()
        if design is not None and design.motion == "linear":
            standard = cls(*(UNKNOWN * value for value in (cls.speed, cls.acceleration, cls.jerk)))
        if design is None or not design.motor.electrical:
            return standard
        p, psi_f = design.motor.p, design.motor.psi_f
        assert p is not None  # an electrical motor has both
        assert psi_f is not None
        speed = _one_digit(0.43 * design.drive.u_dc / (math.sqrt(3.0) * p * psi_f))
        friction = _friction_level(design) / design.K_t
        i_max = design.drive.i_max
        if not math.isfinite(i_max):
            return replace(standard, speed=speed, breakaway=2.0 * friction or standard.breakaway)
        acceleration = _one_digit(0.1 * design.K_t * i_max / design.J)
        return cls(speed, acceleration, acceleration / 0.02, 0.02 * i_max, 2.0 * friction or 0.02 * i_max)


def _one_digit(value: float) -> float:
    """Round down to one significant digit."""
    scale = 10.0 ** math.floor(math.log10(value))
    return math.floor(value / scale) * scale


def _friction_level(design: Design) -> float:
    """Return the largest torque in N m of the design's effects on a shaft at rest."""
    p = float(design.motor.p or 0)
    acting = [bound for bound in bound_effects(design) if bound[0].enters == "torque" and not bound[0].has_state]
    return sum(effect.standing_level(values, p) for effect, values in acting)


@dataclass(frozen=True, eq=False)
class Path:
    """A motion whose jerk is constant between knots; all arrays of shape (k,), SI units."""

    start: Array
    theta: Array
    omega: Array
    alpha: Array
    jerk: Array

    def at(self, t: Array) -> tuple[Array, Array, Array]:
        """Return angle, speed and acceleration at times `t`; after the end the last piece goes on."""
        k = np.maximum(np.searchsorted(self.start, t + TIME_TOLERANCE, side="right") - 1, 0)
        x = t - self.start[k]
        alpha, jerk = self.alpha[k], self.jerk[k]
        omega = self.omega[k] + x * (alpha + 0.5 * x * jerk)
        theta = self.theta[k] + x * (self.omega[k] + x * (0.5 * alpha + x * jerk / 6.0))
        return theta, omega, alpha + x * jerk


class PathBuilder:
    """Builds a motion from pieces; starts at rest at angle 0."""

    def __init__(self) -> None:
        self.t = self.theta = self.omega = 0.0
        self._knots: list[tuple[float, float, float, float, float]] = []

    def piece(self, duration: float, alpha: float = 0.0, jerk: float = 0.0) -> None:
        """Go on for `duration` s from the present speed, with this acceleration (rad/s^2) and jerk (rad/s^3)."""
        if duration <= 0.0:
            return
        self._knots.append((self.t, self.theta, self.omega, alpha, jerk))
        self.theta += duration * (self.omega + duration * (0.5 * alpha + duration * jerk / 6.0))
        self.omega += duration * (alpha + 0.5 * duration * jerk)
        self.t += duration

    def ramp(self, omega: float, acceleration: float) -> None:
        """Change the speed to `omega` at constant acceleration."""
        change = omega - self.omega
        self.piece(abs(change) / acceleration, math.copysign(acceleration, change))
        self.omega = omega  # rest is exactly rest

    def move(self, theta: float, limits: Limits) -> None:
        """Move from rest to rest at `theta` as fast as speed, acceleration and jerk allow; infinite jerk: trapezoid.

        Source: L. Biagiotti, C. Melchiorri, Trajectory Planning for Automatic Machines and Robots,
        Springer 2008, sec. 3.2 and 3.4.
        """
        distance = abs(theta - self.theta)
        sign = math.copysign(1.0, theta - self.theta)
        a, j = limits.acceleration, limits.jerk
        speed = min(limits.speed, _peak_speed(distance, a, j))
        T_j = 0.0 if math.isinf(j) else min(a / j, math.sqrt(speed / j))
        T_a = speed / a + T_j if speed > a * T_j else 2.0 * T_j
        peak = a if T_j == 0.0 else j * T_j
        for half in (sign, -sign):
            self.piece(T_j, 0.0, half * (j if T_j else 0.0))
            self.piece(T_a - 2.0 * T_j, half * peak)
            self.piece(T_j, half * peak, -half * (j if T_j else 0.0))
            if half == sign and distance > 0.0:
                self.omega = sign * speed
                self.piece(distance / speed - T_a)
        self.theta, self.omega = theta, 0.0

    def path(self) -> Path:
        """Return the motion so far, followed by rest or by the speed reached."""
        knots = [*self._knots, (self.t, self.theta, self.omega, 0.0, 0.0)]
        return Path(*(np.array(column) for column in zip(*knots, strict=True)))


def _peak_speed(distance: float, a: float, j: float) -> float:
    """Return the speed reached half-way when nothing but acceleration and jerk limit a move."""
    if math.isinf(j):
        return math.sqrt(distance * a)
    if distance < 2.0 * a**3 / j**2:  # the acceleration limit is not met either
        return float(j * (distance / (2.0 * j)) ** (2.0 / 3.0))
    return 0.5 * a * (math.sqrt((a / j) ** 2 + 4.0 * distance / a) - a / j)


def multisine_signal(t: Array, period: float, f_min: float, f_max: float, count: int, seed: int, rms: float) -> Array:
    """Sum of sines on the grid k / period, logarithmically spread, random phases; zero for t < 0.

    Source: R. Pintelon, J. Schoukens, System Identification: A Frequency Domain Approach, 2nd ed., Wiley 2012, ch. 5.
    """
    lines = np.unique(np.maximum(1, np.round(np.geomspace(f_min, f_max, count) * period).astype(np.int64)))
    phases = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, lines.size)
    out = np.zeros_like(t)
    for line, phase in zip(lines.tolist(), phases.tolist(), strict=True):
        out += np.cos(2.0 * np.pi * line / period * t + phase)
    return np.where(t >= -TIME_TOLERANCE, out * rms * math.sqrt(2.0 / lines.size), 0.0)


def chirp_signal(t: Array, duration: float, f_start: float, f_stop: float, amplitude: float) -> Array:
    """Sine whose frequency grows exponentially from f_start to f_stop (Hz) over `duration`; zero outside."""
    rate = math.log(f_stop / f_start) / duration
    inside = (t >= 0.0) & (t <= duration)
    phase = 2.0 * np.pi * f_start * np.expm1(rate * np.where(inside, t, 0.0)) / rate
    return np.where(inside, amplitude * np.sin(phase), 0.0)


def noise_signal(duration: float, f_min: float, f_max: float, seed: int, rms: float) -> Callable[[Array], Array]:
    """Return Gaussian noise with a flat spectrum from f_min to f_max (Hz), as a function of time; zero outside."""
    from scipy.interpolate import CubicSpline

    count = math.ceil(OVERSAMPLED * f_max * duration) + 1
    step = duration / (count - 1)
    f = np.fft.rfftfreq(count, step)
    rng = np.random.default_rng(seed)
    content = rng.normal(size=len(f)) + 1j * rng.normal(size=len(f))
    values = np.fft.irfft(np.where((f >= f_min) & (f <= f_max), content, 0.0), count)
    spline = CubicSpline(np.arange(count) * step, values * rms / math.sqrt(np.mean(values**2)))

    def signal(t: Array) -> Array:
        inside = (t >= 0.0) & (t <= duration)
        return np.where(inside, spline(np.where(inside, t, 0.0)), 0.0)

    return signal


def binary_signal(clock: float, order: int, amplitude: float) -> Callable[[Array], Array]:
    """Return a maximum-length binary sequence of 2^order - 1 values, each held for `clock` s; zero for t < 0."""
    from scipy.signal import max_len_seq

    levels = amplitude * (2.0 * max_len_seq(order)[0] - 1.0)

    def signal(t: Array) -> Array:
        number = np.floor((t + TIME_TOLERANCE) / clock).astype(np.int64)
        return np.where(number >= 0, levels[number % len(levels)], 0.0)

    return signal


def triangle_signal(t: ArrayLike, peak: float) -> Array:
    """Rise from 0 to `peak` and back over 0 <= t <= 1; zero outside."""
    x = np.asarray(t, dtype=np.float64)
    return peak * np.clip(1.0 - np.abs(2.0 * x - 1.0), 0.0, None)

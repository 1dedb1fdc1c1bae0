"""How a channel was sampled relative to another: the drive signal, or a speed, with a delay and behind a filter.

The output of a linear filter whose impulse response has mean m and variance v is, for signals T(t) that are slow
against it, ``T - m dT/dt + (m^2 + v) / 2 d^2T/dt^2``. Variances add: a pure delay has none, a mean over a period P has
``P^2 / 12``, a first-order filter of time constant lag has ``lag^2``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.design_parts import Sampled
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.filters import derivative, shifted
from pmsm_ctrl.sampling import speed_lag

__all__ = [
    "AGE",
    "CURRENT_LOOP",
    "EMF",
    "EMF_FILTERED",
    "EMF_LATE",
    "FASTEST_LOOP",
    "IN_STEP",
    "LATENESS",
    "LONGEST_FILTER",
    "SPEED_SPREAD",
    "SPREAD",
    "SURE",
    "SYNCHRONOUS",
    "UNDELAYED",
    "DriveTiming",
    "Sampling",
    "control_period",
    "drive_sampling",
    "emf_left",
    "emf_winding",
    "filter_behind",
    "in_time",
    "late_for",
    "possible_sampling",
    "sampling_columns",
    "stated_timing",
    "stated_within",
]  # fmt: skip

Array = NDArray[np.float64]

# Names of the nuisance parameters of the drive signal's sampling.
LATENESS, SPREAD, EMF, EMF_FILTERED = "tau_drive", "spread_drive", "tau_emf", "tau_emf_filtered"
IN_STEP = "in_step"  # torque by speed, of a position reference that is held
INSTANT_EMF = "instant_emf"  # what the back-emf makes of it, through the resistance
INSTANT = "instant"  # what the current of an instant is larger by than its mean over a control period
AGE, SPEED_SPREAD = "tau_speed", "spread_speed"  # of a speed without a position
# By which the compensation of the back-emf lags, s: a speed filter; and the longest one that two columns describe.
EMF_LATE, LONGEST_FILTER = 5e-3, 10e-3
# What is sampled with the current, and so as late as that.
DRIVE = ("torque", "i_q", "i_d")
OTHERS = ("theta", "omega", "u_d", "u_q")
# Standard errors by which a delay must exceed what sampling can do, and by which the spread must miss that of a filter
# for the rest to be called a delay.
SURE = 3.0
MET = 0.03  # of a sample: a delay below it is met well enough to first order
STATED_WITHIN = 0.05  # of a log period, by which a stated time of sampling may be off in any case
SLOWEST_CONTROL = 4e3  # Hz: control rate of a drive that states none
# Period of the speed loop of a drive of which nothing is known, and what a current loop lags its command at most, s:
# one of 160 Hz and more.
UNKNOWN_LOOP, CURRENT_LOOP = 1e-3, 1e-3
FASTEST_LOOP = 1e-4  # s, by which a current loop lags its command at least: one of 1.6 kHz


@dataclass(frozen=True)
class DriveTiming:
    """How a channel was sampled: the drive signal beside the position, or a speed beside the drive signal.

    Attributes
    ----------
    late : float
        Time after the other one at which it was sampled, s.
    lag : float
        Time constant of the first-order filter that it passed, s.
    sure : bool
        Whether the log tells that filter from a delay.
    reversals : float
        Delay that is left in the signal, where it has a column, but that is out while a reversal is followed, s.
    stepped : float or None
        Periods of the log after the speed's change of sign at which the friction steps in the torque, at a sample; None
        where it does not, and reversals are followed.
    """

    late: float = 0.0
    lag: float = 0.0
    sure: bool = True
    reversals: float = 0.0
    stepped: float | None = None

    @property
    def delay(self) -> float:
        """Mean delay, s."""
        return self.late + self.lag

    @property
    def spread(self) -> float:
        """Half the variance of the impulse response, s^2."""
        return 0.5 * self.lag**2

    def undone(self, log: Log, names: tuple[str, ...] = DRIVE) -> Log:
        """Return the log with the drive signal as it was at the time of the position, before the filter.

        Parameters
        ----------
        log : Log
        names : tuple of str
            The channels of that timing.
        """
        if not (self.late or self.lag):
            return log
        from scipy.interpolate import CubicSpline

        t = log.t
        ahead = np.clip(t + self.late, t[0], t[-1])
        channels = dict(log.channels)
        for name in names:
            if name in channels:
                spline = CubicSpline(t, np.unwrap(channels[name]) if name == "theta" else channels[name])
                channels[name] = spline(ahead) + self.lag * spline(ahead, 1)
        return replace(log, channels=channels)


UNDELAYED = DriveTiming()


@dataclass(frozen=True)
class Sampling:
    """What is known of the sampling of the drive signal: nuisance parameters of a regression.

    Attributes
    ----------
    timing : DriveTiming
        The part that was corrected in the log.
    late : float
        Remaining delay about which its column is linearised, s.
    stderr : float
        Of that delay, s; zero where the log does not determine it, and zero is assumed.
    sigma : (float, float)
        How far the delay, s, and half the variance of the impulse response, s^2, may lie from zero, one sigma.
    """

    timing: DriveTiming = UNDELAYED
    late: float = 0.0
    stderr: float = 0.0
    sigma: tuple[float, float] = (0.0, 0.0)

    @property
    def whole(self) -> DriveTiming:
        """How the drive signal was sampled, what is not undone included."""
        return replace(self.timing, late=self.timing.late + self.late)


SYNCHRONOUS = Sampling()


def sampling_columns(torque: Array, period: float, late: float) -> dict[str, Array]:
    """Return what a sampling adds to the measured torque, per unit of its delay and of half its variance, shape (n,).

    Parameters
    ----------
    torque : array, shape (n,)
        That acts, as a model predicts it.
    period : float
        s.
    late : float
        Delay about which the slope is taken, s: so that delay is met exactly.
    """
    slope = np.gradient(torque, period)
    curved = np.gradient(slope, period)
    if abs(late) >= MET * period:
        slope = (torque - shifted(torque, period, -late)) / late
    return {LATENESS: -slope, SPREAD: curved}


def emf_winding(design: Design) -> tuple[float, float, float, float] | None:
    """Return R, L_q, p and psi_f, by which a current loop responds to the back-emf; None unless all are known.

    Parameters
    ----------
    design : Design
    """
    m = design.motor
    if not m.electrical or m.R is None or m.L_q is None or m.p is None or m.psi_f is None:
        return None
    return m.R, m.L_q, m.p, m.psi_f


def _inertia_of_emf(design: Design) -> float:
    """Return by how much the back-emf is inertia to a command of the slowest current loop, kg m^2; 0 if not known."""
    winding = emf_winding(design)
    return 0.0 if winding is None else design.K_t_assumed * winding[2] * winding[3] * CURRENT_LOOP / winding[0]


def late_for(design: Design, early: float, inertia: float) -> float:
    """Return how late a compensation of the back-emf makes a command that early, s, beyond a loop of 320 Hz.

    Parameters
    ----------
    design : Design
        With a winding.
    early : float
        s.
    inertia : float
        kg m^2.
    """
    return max(early - 0.5 * CURRENT_LOOP, 0.0) * inertia / _inertia_of_emf(design)


def emf_left(design: Design, alpha: Array, period: float) -> tuple[Array, Array] | None:
    """Torque error of a command by the back-emf that the current loop does not reject, per second of late compensation.

    With its zero on the winding's pole the loop responds to a disturbance ``u`` by ``s u / ((L s + R) (s + w))``. The
    compensation misses ``p psi tau s omega`` of the emf where its speed is late by tau, and
    ``p psi tau s omega / (tau s + 1)`` where a filter smoothed that speed. A logged command is what the drive asked
    for; a measured current holds nothing of this. Derived from the winding's
    equation ``L di/dt + R i = u - p psi omega`` with a PI controller.

    Parameters
    ----------
    design : Design
    alpha : array, shape (n,)
        Acceleration.
    period : float
        s.

    Returns
    -------
    late, filtered : array, shape (n,)
        N m/s, by a speed that is late and by one that was filtered with `EMF_LATE`: filters of other times lie between
        the two. None where the winding is not known.
    """
    from scipy.signal import lfilter

    winding = emf_winding(design)
    if winding is None:
        return None
    R, L_q, _, _ = winding
    decay = math.exp(-period * R / L_q)
    lagged = np.asarray(lfilter([1.0 - decay], [1.0, -decay], derivative(alpha, period)))
    late = _inertia_of_emf(design) * lagged
    smooth = math.exp(-period / EMF_LATE)
    return late, np.asarray(lfilter([1.0 - smooth], [1.0, -smooth], late))


def stated_timing(stated: Sampled, period: float) -> DriveTiming:
    """Return how a channel was sampled, as the log's table in the design says.

    Parameters
    ----------
    stated : Sampled
    period : float
        Of the log, s: a mean over it is late by half of it, and has the variance of a filter of ``period / sqrt(12)``.
    """
    width = period / math.sqrt(12.0) if stated.sampling == "mean" else 0.0
    lag = math.hypot(stated.filter, width)
    centre = 0.5 * period if stated.sampling == "mean" else 0.0
    return DriveTiming(stated.late + centre + stated.filter - lag, lag)


def drive_sampling(design: Design, log: Log) -> Sampled:
    """Return what the design states of the channel that the drive torque is taken from.

    Parameters
    ----------
    design : Design
    log : Log
    """
    return design.log.of("torque" if "torque" in log else "i_q")


def in_time(design: Design, log: Log, more: DriveTiming = UNDELAYED) -> Log:
    """Undo what the design states of the sampling of motion and voltages, and the age of a speed without a position.

    Of that the design knows what it states of the channel, which is all of it, or else the drive's speed filter and
    half a period of its difference quotient.

    Parameters
    ----------
    design : Design
    log : Log
    more : DriveTiming
        How the speed was sampled and filtered beside that.
    """
    for name in OTHERS:
        if name in log:
            log = stated_timing(design.log.of(name), log.period).undone(log, (name,))
    if "theta" in log or "omega" not in log:
        return log
    omega = log["omega"]
    said = design.log.of("omega")
    if design.sensor.speed_filter > 0.0 and not (said.stated or said.filter or said.late):
        lag = speed_lag(design.drive.speed_period, design.sensor.speed_filter)
        omega = omega + lag * np.gradient(omega, log.t)
    return more.undone(log.with_channels(omega=omega), ("omega",))


def control_period(design: Design) -> float:
    """Return the period of a drive's current control, s; the longest usual one where nothing is stated of it.

    Parameters
    ----------
    design : Design
    """
    return 1.0 / (design.drive.f_control if "f_control" in design.drive.model_fields_set else SLOWEST_CONTROL)


def stated_within(design: Design, period: float) -> float:
    """Return by how much a stated time of sampling may be off, s.

    Two boards have two clocks. And a row holds what belongs to one period of the control, not to one instant: a mean
    of samples and a filter of samples are half a period earlier than in continuous time, and the angle that a serial
    encoder sends may be one period old. A command is neither of these.

    Parameters
    ----------
    design : Design
    period : float
        Of the log, s.
    """
    return max(STATED_WITHIN * period, control_period(design))


def possible_sampling(design: Design, log: Log) -> tuple[float, float]:
    """Return how late and how early, s, the drive signal of a log may be sampled beside the position.

    By a period of the log, or of the speed loop, whose steps are always sampled at the same place; and earlier by what
    a current loop lags, since the signal may be its command. A command that is stated as one is not late. What is
    stated beside a position says nothing beside a speed of which nothing is stated: an observer's lags or leads by
    itself.

    Parameters
    ----------
    design : Design
    log : Log
    """
    stated, period = drive_sampling(design, log), log.period
    if stated.stated and ("theta" in log or design.log.of("omega").stated):
        within = stated_within(design, period)
        return within, within
    late = max(period, design.drive.speed_period if design.motor.electrical else UNKNOWN_LOOP)
    return STATED_WITHIN * period if stated.sampling == "command" else late, late + CURRENT_LOOP


def filter_behind(delay: float, spread: tuple[float, float], sampling: float) -> DriveTiming | None:
    """Return the filter that explains a delay beyond what sampling can do; None where it must be a delay.

    Parameters
    ----------
    delay : float
        Mean delay, s.
    spread : (float, float)
        Half the variance of the impulse response, s^2, and its standard error.
    sampling : float
        How late a sample may be, s.

    Returns
    -------
    DriveTiming or None
    """
    least = delay - sampling
    value, stderr = float(spread[0]), float(spread[1])
    if least <= 0.0 or value + SURE * stderr < 0.5 * least**2:
        return None
    lag = min(max(math.sqrt(2.0 * max(value, 0.0)), least), delay)
    return DriveTiming(float(delay) - lag, lag, sure=value > SURE * stderr)

"""What filterpy's filter and its compiled twin share: the shaft's equation, the gating of a sample, the noise.

Both call these functions, so that each is written once; friction is evaluated by the effects' own terms.
"""

# mypy: disable-error-code="no-any-return"

from __future__ import annotations

from collections.abc import Callable
from math import isfinite
from typing import Any

import numba

from pmsm_ctrl.effects.coulomb import term as coulomb
from pmsm_ctrl.effects.viscous import term as viscous
from pmsm_ctrl.kernels import OPTIONS, soundly_cached

__all__ = [
    "EVENTS", "MEMORY", "NEVER", "SETTINGS", "STATES", "acceleration", "adapt", "classify", "constant_speed", "depart",
    "fresh_speed", "judge", "keep_past_speed", "keep_split", "process_variance",
]  # fmt: skip


# Called from Python by the tracker, and inlined into the twin's loop (1.2 x faster than calls).
def shared(function: Callable[..., Any]) -> Any:
    """Compile for both callers, Python and the twin."""
    return soundly_cached(numba.njit(**{**OPTIONS, "forceinline": True})(function))


# States in the order of the full vector; a state that is not estimated has zero variance.
STATES = ("omega", "F_c", "F_v", "T_load", "J", "theta")
SIZE = len(STATES)
OMEGA, F_C, F_V, T_LOAD, INERTIA, THETA = range(SIZE)

# How a sample was used.
EVENTS = (
    "predicted", "updated", "constant speed", "standstill", "started", "rejected", "implausible", "invalid", "gap",
    "change",
)  # fmt: skip
PREDICTED, UPDATED, CONSTANT, STANDSTILL, STARTED, REJECTED, IMPLAUSIBLE, INVALID, GAP, CHANGE = range(len(EVENTS))

# Numbers fixed for a run.
FROM_ANGLE, R, TORQUE_DENSITY, LAG, SPEED_NOISE, THRESHOLD, INTERVAL, MAX_GAP, GATE, J_NOMINAL, ADAPTS = range(11)
DRIFT = 11  # variance growth per second, SIZE numbers
PRIOR = DRIFT + SIZE  # prior variance, SIZE numbers
SETTINGS = PRIOR + SIZE

# Numbers carried from sample to sample. Time and angle are not among those that the equations use: they grow, and a
# controller in single precision would lose the motion in them. T_LAST and Z_LAST only serve to take differences.
(
    T_LAST, Z_LAST, TORQUE_LAST, KNOWN_LAST, SPEED_LAST, RUNNING, ELAPSED, MEAN, SPREAD, REJECTS, DT, SPEED,
    TORQUE, KNOWN, SURGE, DUE, TREND, CALM, SEEN, PAST_SPEED, PAST_ALPHA, MOVED, SPEED_USED, SINCE, EXCESS, NOISE,
    SIGNED, TORQUE_MEAN, DEPARTURE, GROWN,
) = range(30)  # fmt: skip
MEMORY = 30
NEVER = -1e30  # time of the last sample before the first one; not NaN, which stops some controllers

SPREAD_TIME = 1.0  # s over which the spread of abs(omega) is judged
SPREAD_LIMIT = 0.02  # relative spread below which F_c and F_v are not separately observable
REJECTS_ARE_CHANGE = 3.0  # consecutive rejected updates that count as a change of the axis
# Innovations with a persistent sign: an exponential mean over about 10, of standard deviation sqrt(w / (2 - w)) for
# white ones. Above 5.5 of those friction has changed; by chance once in 10 h at 100 Hz.
TREND_WEIGHT = 0.1
TREND_LIMIT = 5.5 * (TREND_WEIGHT / (2.0 - TREND_WEIGHT)) ** 0.5
CALM_TIME = 0.5  # s of motion after a change before the next one is detected
# The torque noise is raised where innovations scatter more than it explains: unmodelled torque. Half the squared
# difference of two successive normalised innovations is 1 on average for white ones, and small for a persistent error,
# which is a changed friction and no noise. Its mean is exponential over about 100, of standard deviation 0.17. Once it
# has exceeded 1.5 the variance of the noise follows it, as fast as the mean itself, until it is back at that of the
# design. Differences beyond three standard deviations count as those: a jump of the angle is no noise.
EXCESS_WEIGHT = 0.02
EXCESS_LIMIT = 1.5
EXCESS_MOST = 9.0


@shared
def acceleration(
    omega: float,
    direction: float,
    F_c: float,
    F_v: float,
    T_load: float,
    J: float,
    torque: float,
    known: float,
    past_speed: float,
    past_alpha: float,
    dt: float,
) -> tuple[float, float, float, float, float, float]:
    """Mean acceleration over `dt` in one direction, and its derivatives by omega, F_c, F_v, T_load, J.

    ``J alpha = torque - F_c sgn(omega) - F_v omega - T_load - known``, the friction taken at the middle of the
    step (explicit midpoint rule). `torque` is the drive's, `known` that of all further effects, N m.

    The derivatives by F_v and J are taken at `past_speed` and `past_alpha`, measured before the present interval.
    Within it the controller answers the torque noise, so that torque, predicted motion and innovation share it: gains
    that follow the predicted motion give a biased F_v (at 2 rad/s more than twice its value) and J. The past motion is
    an instrument.
    """
    per_J = 1.0 / J
    rest = torque - coulomb(direction, F_c) - T_load - known
    bend = 0.5 * dt * per_J
    middle = omega + bend * (rest - viscous(omega, F_v))
    alpha = (rest - viscous(middle, F_v)) * per_J
    slope = viscous(1.0, F_v)
    share = (1.0 - bend * slope) * per_J
    by_F_v = -viscous(past_speed, 1.0) * share
    return alpha, -slope * share, -coulomb(direction, 1.0) * share, by_F_v, -share, -past_alpha * per_J


@shared
def depart(m, s, torque, dt):  # type: ignore[no-untyped-def]
    """Note how far the torque has left its mean over an interval.

    A torque that is logged some time late errs by that time its change: in one direction over a step of many samples.
    """
    away = torque - m[TORQUE_MEAN]
    m[TORQUE_MEAN] += min(dt / s[INTERVAL], 1.0) * away
    departure = max(away * away - 9.0 * m[NOISE] * s[TORQUE_DENSITY] / dt, 0.0)  # 3 standard deviations are noise
    m[GROWN] = max(departure - m[DEPARTURE], 0.0)
    m[DEPARTURE] = departure


@shared
def classify(m, dt, step, torque, known, friction, s):  # type: ignore[no-untyped-def]
    """Classify a new sample, update the memory `m` and return the event.

    `dt` is the time since the last valid sample, huge before the first one; `step` the angle turned in it, or the
    measured speed. `friction` is the estimated level in N m; it widens the range of plausible accelerations.
    """
    if not (isfinite(dt) and isfinite(step) and isfinite(torque) and isfinite(known)):
        return INVALID
    if dt <= 0.0:
        return INVALID
    speed = step / dt if s[FROM_ANGLE] != 0.0 else step
    last, seen = m[SPEED_LAST], m[SEEN]
    m[DT] = dt
    m[SPEED] = speed
    m[TORQUE] = 0.5 * (torque + m[TORQUE_LAST])
    m[KNOWN] = 0.5 * (known + m[KNOWN_LAST])
    m[SURGE] = torque - m[TORQUE_LAST]
    depart(m, s, torque, dt)
    m[TORQUE_LAST], m[KNOWN_LAST], m[SPEED_LAST] = torque, known, speed
    m[SEEN] = 1.0
    if not dt <= s[MAX_GAP]:
        m[RUNNING] = 0.0
        if s[FROM_ANGLE] != 0.0:
            m[SEEN] = 0.0  # the mean speed over the gap is no measurement
        return GAP
    # Three times the change of speed that the torque can cause, and eight standard deviations of noise.
    change = abs(speed - last) - 8.0 * s[SPEED_NOISE]
    if seen != 0.0 and change > 0.0:
        reach = 3.0 * dt * (abs(m[TORQUE]) + abs(m[SURGE]) + abs(m[KNOWN]) + friction)
        if change * s[J_NOMINAL] > reach + 8.0 * (m[NOISE] * s[TORQUE_DENSITY] * dt) ** 0.5:
            m[RUNNING] = 0.0
            return IMPLAUSIBLE
    floor = s[THRESHOLD]
    onward = seen != 0.0 and speed * last > 0.0
    if not (onward and abs(speed) > floor and abs(last) > floor):
        # A run that slows down ends with a measurement. Were its last, unfinished interval dropped, the torque noise
        # that slowed the axis would be missing from the mean of all intervals, and friction seem too low at low speed.
        ending = m[RUNNING] != 0.0 and onward
        m[RUNNING] = 0.0
        if not ending:
            return STANDSTILL
        m[SINCE] += dt
        m[MOVED] += step
        m[DUE] = 1.0
        return PREDICTED
    weight = dt / SPREAD_TIME
    apart = abs(speed) - m[MEAN]
    if m[MEAN] == 0.0:
        m[MEAN] = abs(speed)
    else:
        m[MEAN] += weight * apart
        m[SPREAD] = (1.0 - weight) * (m[SPREAD] + weight * apart * apart)
    if m[RUNNING] == 0.0:
        m[RUNNING] = 1.0
        m[ELAPSED] = 0.0
        return STARTED
    m[ELAPSED] += dt
    m[SINCE] += dt
    m[MOVED] += step
    m[CALM] = min(m[CALM] + dt, 2.0 * CALM_TIME)
    m[DUE] = 0.0
    if m[ELAPSED] > s[INTERVAL] - 0.5 * dt:
        m[DUE] = 1.0
        m[ELAPSED] = 0.0
    return PREDICTED


@shared
def constant_speed(m, s):  # type: ignore[no-untyped-def]
    """Whether abs(omega) has varied too little, over SPREAD_TIME, to tell F_c from F_v."""
    limit = SPREAD_LIMIT * m[MEAN]
    return m[SPREAD] - s[SPEED_NOISE] * s[SPEED_NOISE] < limit * limit


@shared
def adapt(m, s, innovation):  # type: ignore[no-untyped-def]
    """Raise the torque noise where normalised innovations scatter by much more than 1, and lower it again."""
    apart = innovation - m[SIGNED]
    m[SIGNED] = innovation
    m[EXCESS] += EXCESS_WEIGHT * (min(0.5 * apart * apart, EXCESS_MOST) - m[EXCESS])
    if s[ADAPTS] != 0.0 and (m[EXCESS] > EXCESS_LIMIT or m[NOISE] > 1.0):
        m[NOISE] = max(m[NOISE] * (1.0 + EXCESS_WEIGHT * (m[EXCESS] - 1.0)), 1.0)


@shared
def judge(m, s, y, S, direction):  # type: ignore[no-untyped-def]
    """Decide whether an innovation `y` of variance `S` is used, rejected, or shows a change of the axis."""
    adapt(m, s, direction * y / S**0.5)
    if y * y > s[GATE] * S:
        m[REJECTS] += 1.0
        if m[REJECTS] < REJECTS_ARE_CHANGE:
            return REJECTED
        m[REJECTS], m[TREND], m[CALM] = 0.0, 0.0, 0.0
        return CHANGE
    m[REJECTS] = 0.0
    if (s[PRIOR + T_LOAD] == 0.0 or s[PRIOR + INERTIA] == 0.0) and not constant_speed(m, s):
        return UPDATED  # taken as known and wrong, a load or an inertia gives persistent signs at every reversal
    m[TREND] += TREND_WEIGHT * (direction * y / S**0.5 - m[TREND])
    if abs(m[TREND]) > TREND_LIMIT and m[CALM] > CALM_TIME:
        m[TREND], m[CALM] = 0.0, 0.0
        return CHANGE
    return UPDATED


@shared
def keep_past_speed(m, s):  # type: ignore[no-untyped-def]
    """Note speed and acceleration up to the interval that a measurement ends, for the next one.

    The speed is the mean between two used angles; of measured speeds the one before, whose noise has left the estimate.
    """
    speed = m[MOVED] / m[SINCE] if s[FROM_ANGLE] != 0.0 else m[SPEED_USED]
    m[PAST_ALPHA] = (speed - m[PAST_SPEED]) / m[SINCE]
    m[PAST_SPEED], m[SPEED_USED] = speed, m[SPEED]
    m[MOVED], m[SINCE] = 0.0, 0.0


@shared
def fresh_speed(m, s, by_F_c, P_cc, alpha):  # type: ignore[no-untyped-def]
    """Speed from the last samples alone, its variance, and its covariance with the angle."""
    dt = m[DT]
    if s[FROM_ANGLE] != 0.0:
        # The difference of two angles is the speed half a step ago.
        lag, variance, shared = 0.5 * dt, 2.0 * s[R] / (dt * dt), s[R] / dt
    else:
        lag, variance, shared = s[LAG], s[R], 0.0
    spread = lag * m[SURGE] / s[J_NOMINAL]
    variance += lag * lag * by_F_c * by_F_c * P_cc + spread * spread
    variance += lag * m[NOISE] * s[TORQUE_DENSITY] / (s[J_NOMINAL] * s[J_NOMINAL])
    return m[SPEED] + lag * alpha, variance, shared


@shared
def process_variance(m, s):  # type: ignore[no-untyped-def]
    """Variance of the torque's integral over a step, (N m s)^2.

    Of noise, of the unknown instant of a torque step, and of a torque that may be logged one sample late.
    """
    white = m[NOISE] * s[TORQUE_DENSITY] * m[DT]
    surge = m[SURGE] * m[DT]
    late = m[GROWN] * m[DT] * m[DT]
    instant = max(surge * surge - 18.0 * white, 0.0) / 12.0  # 3 standard deviations of a difference are noise
    return white + late + instant


@shared
def keep_split(K_c, K_v, F_c, F_v, by_F_c, by_F_v):  # type: ignore[no-untyped-def]
    """Turn the gain so that it changes F_c and F_v in proportion, with the same effect on their sum."""
    level = F_c * by_F_c + F_v * by_F_v
    if F_c <= 0.0 or F_v <= 0.0 or level == 0.0:
        return K_c, K_v
    share = (K_c * by_F_c + K_v * by_F_v) / level
    return share * F_c, share * F_v

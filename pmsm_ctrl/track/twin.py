"""The compiled twin of filterpy's extended Kalman filter: plain loops over whole logs, the same algebra.

Vectors of six states; a state that is not estimated has zero variance and takes no part. The covariance update is
Joseph's form, which keeps it symmetric and positive definite for any gain.
"""

# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

import numpy as np

from pmsm_ctrl.kernels import inlined, kernel
from pmsm_ctrl.track.model import (
    CHANGE,
    CONSTANT,
    DRIFT,
    DT,
    DUE,
    F_C,
    F_V,
    FROM_ANGLE,
    INERTIA,
    INTERVAL,
    INVALID,
    KNOWN,
    KNOWN_LAST,
    LAG,
    MOVED,
    NOISE,
    OMEGA,
    PAST_ALPHA,
    PAST_SPEED,
    PREDICTED,
    PRIOR,
    REJECTED,
    SINCE,
    SIZE,
    SPEED,
    SPEED_USED,
    STANDSTILL,
    STARTED,
    T_LAST,
    T_LOAD,
    THETA,
    TORQUE,
    TORQUE_LAST,
    UPDATED,
    Z_LAST,
    R,
    acceleration,
    classify,
    constant_speed,
    fresh_speed,
    judge,
    keep_past_speed,
    keep_split,
    process_variance,
)  # fmt: skip

__all__ = ["run"]


@inlined
def advance(x, P, m, s, step, slow):
    """Count the angle from the new sample, `step` further, and let the slow states drift up to the prior variance."""
    if s[FROM_ANGLE] != 0.0:
        x[THETA] -= step
    for i in range(1, slow):
        room = s[PRIOR + i] - P[i, i]
        if room > 0.0:
            P[i, i] += min(s[DRIFT + i] * m[DT], room)


@inlined
def predict(x, P, m, s, slow, a, u):
    """Advance mean and covariance by one step; only speed and angle change.

    With the speed's row `a` of the Jacobian, the angle's is ``dt/2 (a + e_omega) + e_theta``: products with it
    follow from those with `a`. Returns the direction of motion.
    """
    dt = m[DT]
    half = 0.5 * dt
    direction = 1.0 if m[SPEED] > 0.0 else -1.0
    alpha, d_omega, d_c, d_v, d_load, d_J = acceleration(
        x[OMEGA], direction, x[F_C], x[F_V], x[T_LOAD], x[INERTIA], m[TORQUE], m[KNOWN],
        m[PAST_SPEED], m[PAST_ALPHA], dt,
    )  # fmt: skip
    a_omega = 1.0 + dt * d_omega
    a[F_C], a[F_V], a[T_LOAD], a[INERTIA] = dt * d_c, dt * d_v, dt * d_load, dt * d_J
    x[THETA] += dt * (x[OMEGA] + 0.5 * dt * alpha)
    x[OMEGA] += dt * alpha
    u_omega, u_theta = P[OMEGA, OMEGA] * a_omega, P[THETA, OMEGA] * a_omega
    for i in range(1, slow):
        u_omega += P[OMEGA, i] * a[i]
        u_theta += P[THETA, i] * a[i]
    for i in range(1, slow):
        u[i] = P[i, OMEGA] * a_omega
        for j in range(1, slow):
            u[i] += P[i, j] * a[j]
    aa = a_omega * u_omega
    for i in range(1, slow):
        aa += a[i] * u[i]
    ab = u_theta + half * (u_omega + aa)
    v_omega = P[OMEGA, THETA] + half * (P[OMEGA, OMEGA] + u_omega)
    v_theta = P[THETA, THETA] + half * (P[THETA, OMEGA] + u_theta)
    bb = v_theta + half * (v_omega + ab)
    per_J = 1.0 / x[INERTIA]
    q = process_variance(m, s) * per_J * per_J
    if s[FROM_ANGLE] != 0.0:
        for i in range(1, slow):
            P[THETA, i] = P[i, THETA] = P[i, THETA] + half * (P[i, OMEGA] + u[i])
        P[OMEGA, THETA] = P[THETA, OMEGA] = ab + half * q
        P[THETA, THETA] = bb + half * half * q
    for i in range(1, slow):
        P[OMEGA, i] = P[i, OMEGA] = u[i]
    P[OMEGA, OMEGA] = aa + q
    return direction


@inlined
def restart(x, P, m, s):
    """Initialise speed and angle from the last samples; friction and its covariance stay."""
    direction = 1.0 if m[SPEED] > 0.0 else -1.0
    alpha, _, d_c, _, _, _ = acceleration(
        m[SPEED], direction, x[F_C], x[F_V], x[T_LOAD], x[INERTIA], m[TORQUE_LAST], m[KNOWN_LAST],
        m[PAST_SPEED], m[PAST_ALPHA], 0.0,
    )  # fmt: skip
    x[OMEGA], variance, shared = fresh_speed(m, s, d_c, P[F_C, F_C], alpha)
    m[PAST_SPEED], m[PAST_ALPHA], m[SPEED_USED] = m[SPEED], alpha, m[SPEED]
    m[MOVED], m[SINCE] = 0.0, 0.0
    for i in range(SIZE):
        P[OMEGA, i] = P[i, OMEGA] = 0.0
        P[THETA, i] = P[i, THETA] = 0.0
    P[OMEGA, OMEGA] = variance
    if s[FROM_ANGLE] != 0.0:
        x[THETA] = 0.0
        P[OMEGA, THETA] = P[THETA, OMEGA] = shared
        P[THETA, THETA] = s[R]


@inlined
def rest(x, P, m, s):
    """At standstill: use the measured speed; friction is set-valued there and stays."""
    x[OMEGA] = m[SPEED]
    for i in range(SIZE):
        P[OMEGA, i] = P[i, OMEGA] = 0.0
        P[THETA, i] = P[i, THETA] = 0.0
    if s[FROM_ANGLE] != 0.0:
        P[OMEGA, OMEGA] = 2.0 * s[R] / (m[DT] * m[DT])
        P[OMEGA, THETA] = P[THETA, OMEGA] = s[R] / m[DT]
        P[THETA, THETA] = s[R]
        x[THETA] = 0.0
    else:
        P[OMEGA, OMEGA] = s[R]


@inlined
def distrust(P, m, s, y):
    """After an abrupt change of the axis: reset the variances of friction and load to the prior."""
    for i in range(1, SIZE - 1):
        P[i, i] += max(s[PRIOR + i] - P[i, i], 0.0)
    P[OMEGA, OMEGA] += y * y if s[FROM_ANGLE] == 0.0 else (y / max(s[INTERVAL], m[DT])) ** 2


@inlined
def measure(x, m, s, direction, h):
    """Fill the measurement row `h` and return the predicted measurement."""
    for i in range(SIZE):
        h[i] = 0.0
    if s[FROM_ANGLE] != 0.0:
        h[THETA] = 1.0
        return x[THETA]
    lag = s[LAG]
    alpha, d_omega, d_c, d_v, d_load, d_J = acceleration(
        x[OMEGA], direction, x[F_C], x[F_V], x[T_LOAD], x[INERTIA], m[TORQUE_LAST], m[KNOWN_LAST],
        m[PAST_SPEED], m[PAST_ALPHA], 0.0,
    )  # fmt: skip
    h[OMEGA], h[F_C], h[F_V], h[T_LOAD], h[INERTIA] = (
        1.0 - lag * d_omega,
        -lag * d_c,
        -lag * d_v,
        -lag * d_load,
        -lag * d_J,
    )
    return x[OMEGA] - lag * alpha


@inlined
def innovation_variance(P, h, s, u):
    """Return h P h' + R and fill `u` with P h'."""
    S = s[R]
    for i in range(SIZE):
        u[i] = 0.0
        for j in range(SIZE):
            u[i] += P[i, j] * h[j]
    for i in range(SIZE):
        S += h[i] * u[i]
    return S


@inlined
def joseph(P, K, h, u, v, noise):
    """P = (I - K h) P (I - K h)' + K R K' for a gain `K` and a row `h`; `u` holds P h'."""
    for i in range(SIZE):
        for j in range(SIZE):
            P[i, j] -= K[i] * u[j]
    for i in range(SIZE):
        v[i] = 0.0
        for j in range(SIZE):
            v[i] += P[i, j] * h[j]
    for i in range(SIZE):
        for j in range(i + 1):
            # P is (I - K h) P by now; the second factor and the mean of both halves keep it symmetric
            P[i, j] = P[j, i] = 0.5 * (P[i, j] - v[i] * K[j] + P[j, i] - v[j] * K[i]) + noise * K[i] * K[j]


@inlined
def update(x, P, m, s, direction, h, u, v, K):
    """Use the measurement or reject it; return the event, the innovation and its variance."""
    y = -measure(x, m, s, direction, h) if s[FROM_ANGLE] != 0.0 else m[SPEED] - measure(x, m, s, direction, h)
    S = innovation_variance(P, h, s, u)
    innovation, variance = y, S
    event = judge(m, s, y, S, direction)
    if event == REJECTED:
        restart(x, P, m, s)
        return event, innovation, variance
    if event == CHANGE:
        distrust(P, m, s, y)
        S = innovation_variance(P, h, s, u)
    for i in range(SIZE):
        K[i] = u[i] / S
    if P[F_C, F_C] > 0.0 and P[F_V, F_V] > 0.0 and constant_speed(m, s):
        _, _, d_c, d_v, _, _ = acceleration(
            x[OMEGA], direction, x[F_C], x[F_V], x[T_LOAD], x[INERTIA], m[TORQUE], m[KNOWN],
            m[PAST_SPEED], m[PAST_ALPHA], 0.0,
        )  # fmt: skip
        K[F_C], K[F_V] = keep_split(K[F_C], K[F_V], x[F_C], x[F_V], d_c, d_v)
        event = CONSTANT if event == UPDATED else event
    for i in range(SIZE):
        x[i] += K[i] * y
    keep_past_speed(m, s)
    joseph(P, K, h, u, v, s[R])
    return event, innovation, variance


@inlined
def take(x, P, m, s, slow, dt, step, torque, known, a, u, v, h, K):
    """Take one sample; return the event, the innovation and its variance, both 0 unless a measurement was judged.

    `dt` is the time since the last valid sample, `step` the angle turned in it or the measured speed.
    """
    y, S = 0.0, 0.0
    friction = abs(x[F_C]) + abs(x[F_V] * x[OMEGA])
    event = classify(m, dt, step, torque, known, friction, s)
    if event != INVALID:
        advance(x, P, m, s, step, slow)
    if event == PREDICTED:
        # a constant bound lets the compiler unroll the loops of the usual case
        direction = predict(x, P, m, s, 3, a, u) if slow == 3 else predict(x, P, m, s, slow, a, u)
        if m[DUE] != 0.0:
            event, y, S = update(x, P, m, s, direction, h, u, v, K)
    elif event == STARTED:
        restart(x, P, m, s)
    elif event == STANDSTILL:
        rest(x, P, m, s)
    return event, y, S


@kernel
def run(t, z, torque, known, s, x, P, m, estimates, variances, covariance, innovations, events):
    """Filter a stretch of samples; `x`, `P` and `m` go on from where they were.

    Parameters
    ----------
    t, z, torque, known : array, shape (n,)
        Time, the measured angle or speed, the drive's torque less the known load, the torque of further effects.
    s : array of model.SETTINGS numbers
    x : array, shape (6,)
        Estimates.
    P : array, shape (6, 6)
        Their covariance.
    m : array of model.MEMORY numbers
        What is carried from sample to sample.
    estimates, variances : array, shape (n, slow)
        Filled with the first states; `slow` is 3 for omega, F_c and F_v, 4 with T_load, 5 with J.
    covariance : array, shape (n,)
        Filled with the covariance of F_c and F_v.
    innovations : array, shape (n, 3)
        Filled with innovation, its variance and the factor on the variance of the torque noise where a measurement was
        judged, NaN elsewhere.
    events : int8 array, shape (n,)
    """
    a, u, v = np.zeros(SIZE), np.zeros(SIZE), np.zeros(SIZE)
    h, K = np.zeros(SIZE), np.zeros(SIZE)
    slow = estimates.shape[1]
    for k in range(t.size):
        step = z[k] - m[Z_LAST] if s[FROM_ANGLE] != 0.0 else z[k]
        event, y, S = take(x, P, m, s, slow, t[k] - m[T_LAST], step, torque[k], known[k], a, u, v, h, K)
        if event != INVALID:
            m[T_LAST], m[Z_LAST] = t[k], z[k]
        judged = S > 0.0
        innovations[k, 0] = y if judged else np.nan
        innovations[k, 1] = S if judged else np.nan
        innovations[k, 2] = m[NOISE] if judged else np.nan
        for i in range(slow):
            estimates[k, i] = x[i]
            variances[k, i] = P[i, i]
        covariance[k] = P[F_C, F_V]
        events[k] = event

"""The compiled twin of the unscented filter: the same sigma points as filterpy's, in plain loops over whole logs.

What can be worked out beforehand is: the slow states stand still between two samples, so that their mean and
covariance come out of the transform as they went in, and the angle drives nothing. Deviations are taken from the
point in the middle, which loses less to rounding than the sums of points that filterpy forms.
"""

# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

from math import sqrt

import numpy as np

from pmsm_ctrl.kernels import inlined, kernel
from pmsm_ctrl.track.model import (
    CHANGE,
    CONSTANT,
    DT,
    DUE,
    F_C,
    F_V,
    FROM_ANGLE,
    INERTIA,
    INTERVAL,
    KNOWN,
    KNOWN_LAST,
    LAG,
    OMEGA,
    PREDICTED,
    PRIOR,
    REJECTED,
    SIZE,
    SPEED,
    STANDSTILL,
    STARTED,
    T_LAST,
    T_LOAD,
    THETA,
    TORQUE,
    TORQUE_LAST,
    UPDATED,
    R,
    acceleration,
    classify,
    constant_speed,
    judge,
    keep_split,
    process_variance,
)  # fmt: skip
from pmsm_ctrl.track.twin import grow, rest, restart

__all__ = ["ALPHA", "BETA", "KAPPA_AND_N", "run_unscented"]

# Van der Merwe's points, as filterpy is given them: alpha^2 (n + kappa) = n + lambda is the same for every n.
ALPHA, BETA, KAPPA_AND_N = 0.5, 2.0, 3.0
SCALE = ALPHA * ALPHA * KAPPA_AND_N
SIDE = 0.5 / SCALE  # weight of every point beside the middle one


@inlined
def root(P, U, slow, from_angle):
    """Fill the rows of `U` with the upper root of SCALE P; a state without variance has a row of zeros.

    The angle's own row is left out: nothing depends on the angle, so its points need not be carried.
    """
    for i in range(slow):
        pivot = SCALE * P[i, i]
        for k in range(i):
            pivot -= U[k, i] * U[k, i]
        U[i, i] = sqrt(pivot) if pivot > 0.0 else 0.0
        per = 1.0 / U[i, i] if pivot > 0.0 else 0.0
        for j in range(i + 1, slow):
            rest_of = SCALE * P[i, j]
            for k in range(i):
                rest_of -= U[k, i] * U[k, j]
            U[i, j] = rest_of * per
        if from_angle != 0.0:
            rest_of = SCALE * P[i, THETA]
            for k in range(i):
                rest_of -= U[k, i] * U[k, THETA]
            U[i, THETA] = rest_of * per


@inlined
def accelerated(x, U, k, sign, direction, torque, known, dt):
    """Acceleration at the sigma point ``x + sign U[k]``."""
    return acceleration(
        x[OMEGA] + sign * U[k, OMEGA],
        direction,
        x[F_C] + sign * U[k, F_C],
        x[F_V] + sign * U[k, F_V],
        x[T_LOAD] + sign * U[k, T_LOAD],
        x[INERTIA] + sign * U[k, INERTIA],
        torque,
        known,
        dt,
    )[0]


@inlined
def predict_points(x, P, m, s, slow, middle, U, gain):
    """Carry the sigma points one step on; `middle` is the middle point's weight. Returns the direction of motion.

    A point's speed changes by ``dt`` times its acceleration; the rest of the step is linear. So the points are needed
    for that change alone: for its mean, its variance, and its covariance with the states, which fills `gain`.
    """
    dt = m[DT]
    half = 0.5 * dt
    direction = 1.0 if m[SPEED] > 0.0 else -1.0
    from_angle = s[FROM_ANGLE]
    root(P, U, slow, from_angle)
    torque, known = m[TORQUE], m[KNOWN]
    alpha = accelerated(x, U, OMEGA, 0.0, direction, torque, known, dt)
    for i in range(slow):
        gain[i] = 0.0
    gain[THETA], shift, squares, points = 0.0, 0.0, 0.0, 0.0
    for k in range(slow):
        # how much more than the middle point's the speed of the two points changes
        up = dt * (accelerated(x, U, k, 1.0, direction, torque, known, dt) - alpha)
        down = dt * (accelerated(x, U, k, -1.0, direction, torque, known, dt) - alpha)
        shift += SIDE * (up + down)
        squares += SIDE * (up * up + down * down)
        points += 2.0 * SIDE if U[k, k] > 0.0 else 0.0
        apart = SIDE * (up - down)
        for i in range(k, slow):
            gain[i] += U[k, i] * apart
        gain[THETA] += U[k, THETA] * apart
    # two more points, apart in the angle alone, change as the middle one does
    points += 2.0 * SIDE if from_angle != 0.0 else 0.0
    # weighted sum of (change - shift)^2, multiplied out: the weighted sum of the changes is the shift itself
    spread = squares + (middle + points - 2.0) * shift * shift
    per_J = 1.0 / x[INERTIA]
    noise = spread + process_variance(m, s) * per_J * per_J
    with_omega, with_theta = gain[OMEGA], gain[THETA]
    if from_angle != 0.0:
        for i in range(1, slow):
            P[THETA, i] = P[i, THETA] = P[i, THETA] + dt * P[i, OMEGA] + half * gain[i]
        both = P[OMEGA, THETA]
        P[THETA, THETA] += 2.0 * dt * both + dt * dt * P[OMEGA, OMEGA] + dt * (with_theta + dt * with_omega)
        P[THETA, THETA] += half * half * noise
        P[OMEGA, THETA] = both + dt * (P[OMEGA, OMEGA] + with_omega) + half * (with_omega + noise) + with_theta
        P[THETA, OMEGA] = P[OMEGA, THETA]
    for i in range(1, slow):
        P[OMEGA, i] = P[i, OMEGA] = P[i, OMEGA] + gain[i]
    P[OMEGA, OMEGA] += 2.0 * with_omega + noise
    x[THETA] += dt * (x[OMEGA] + half * alpha) + half * shift
    x[OMEGA] += dt * alpha + shift
    return direction


@inlined
def seen(x, P, m, s, slow, middle, direction, U, up, down, cross):
    """Return the predicted measurement and its variance; `cross` is filled with its covariance with the states."""
    if s[FROM_ANGLE] != 0.0:
        # an angle that is measured as it is needs no points
        for i in range(SIZE):
            cross[i] = P[i, THETA]
        return x[THETA], P[THETA, THETA] + s[R]
    lag = s[LAG]
    root(P, U, slow, 0.0)
    torque, known = m[TORQUE_LAST], m[KNOWN_LAST]
    alpha = accelerated(x, U, OMEGA, 0.0, direction, torque, known, 0.0)
    shift = 0.0
    for k in range(slow):
        up[k] = U[k, OMEGA] - lag * (accelerated(x, U, k, 1.0, direction, torque, known, 0.0) - alpha)
        down[k] = -U[k, OMEGA] - lag * (accelerated(x, U, k, -1.0, direction, torque, known, 0.0) - alpha)
        shift += SIDE * (up[k] + down[k])
    variance = middle * shift * shift + s[R]
    for i in range(SIZE):
        cross[i] = 0.0
    for k in range(slow):
        side = SIDE if U[k, k] > 0.0 else 0.0
        variance += side * ((up[k] - shift) * (up[k] - shift) + (down[k] - shift) * (down[k] - shift))
        for i in range(k, slow):
            cross[i] += SIDE * U[k, i] * (up[k] - down[k])
    return x[OMEGA] - lag * alpha + shift, variance


@inlined
def update_points(x, P, m, s, z, slow, middle, direction, U, up, down, cross, K):
    """Take the measurement in, or reject it; return the event, the innovation and its variance."""
    predicted, S = seen(x, P, m, s, slow, middle, direction, U, up, down, cross)
    y = z - predicted
    innovation, variance = y, S
    event = judge(m, s, y, S, direction)
    if event == REJECTED:
        restart(x, P, m, s, z)
        return event, innovation, variance
    if event == CHANGE:
        for i in range(1, SIZE - 1):
            P[i, i] += max(s[PRIOR + i] - P[i, i], 0.0)
        P[OMEGA, OMEGA] += y * y if s[FROM_ANGLE] == 0.0 else (y / max(s[INTERVAL], m[DT])) ** 2
        predicted, S = seen(x, P, m, s, slow, middle, direction, U, up, down, cross)
        y = z - predicted
    for i in range(SIZE):
        K[i] = cross[i] / S
    if constant_speed(m, s):
        _, _, d_c, d_v, _, _ = acceleration(
            x[OMEGA], direction, x[F_C], x[F_V], x[T_LOAD], x[INERTIA], m[TORQUE], m[KNOWN], 0.0
        )
        K[F_C], K[F_V] = keep_split(K[F_C], K[F_V], x[F_C], x[F_V], d_c, d_v)
        event = CONSTANT if event == UPDATED else event
    for i in range(SIZE):
        x[i] += K[i] * y
        for j in range(i + 1):
            # with the gain that the filter would choose this is P - K S K'
            P[i, j] = P[j, i] = P[i, j] - K[i] * cross[j] - cross[i] * K[j] + S * K[i] * K[j]
    return event, innovation, variance


@kernel
def run_unscented(t, z, torque, known, s, x, P, m, estimates, variances, covariance, innovations, events):
    """Filter a stretch of samples with sigma points; the arguments are those of `pmsm_ctrl.track.twin.run`."""
    U = np.zeros((SIZE, SIZE))
    up, down, cross, K = np.zeros(SIZE), np.zeros(SIZE), np.zeros(SIZE), np.zeros(SIZE)
    slow = estimates.shape[1]
    n = 1.0 + (1.0 if s[FROM_ANGLE] != 0.0 else 0.0)
    for i in range(1, slow):
        n += 1.0 if s[PRIOR + i] > 0.0 else 0.0
    middle = (SCALE - n) / SCALE + 1.0 - ALPHA * ALPHA + BETA
    for k in range(t.size):
        friction = abs(x[F_C]) + abs(x[F_V] * x[OMEGA])
        before = m[T_LAST]
        event = classify(m, t[k], z[k], torque[k], known[k], friction, s)
        innovations[k, 0] = np.nan
        innovations[k, 1] = np.nan
        if m[T_LAST] > before:
            grow(P, s, slow, m[DT])
        if event == PREDICTED:
            if slow == 3:  # a constant bound lets the compiler unroll the loops of the usual case
                direction = predict_points(x, P, m, s, 3, middle, U, cross)
            else:
                direction = predict_points(x, P, m, s, slow, middle, U, cross)
            if m[DUE] != 0.0:
                event, y, S = update_points(x, P, m, s, z[k], slow, middle, direction, U, up, down, cross, K)
                innovations[k, 0] = y
                innovations[k, 1] = S
        elif event == STARTED:
            restart(x, P, m, s, z[k])
        elif event == STANDSTILL:
            rest(x, P, m, s, z[k])
        for i in range(slow):
            estimates[k, i] = x[i]
            variances[k, i] = P[i, i]
        covariance[k] = P[F_C, F_V]
        events[k] = event

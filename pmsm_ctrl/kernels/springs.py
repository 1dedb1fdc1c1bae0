"""Loads on springs: the response summed over a spectrum, and a load that dry friction holds, followed in time."""

from __future__ import annotations

from math import cos, exp, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.kernels import inlined, kernel

__all__ = ["rubbing_loads", "slider", "spring_sums"]

Array = NDArray[np.float64]

LANES, FEW = 16, 8  # loads side by side, and fewer than which are followed one by one
TILE = 64  # samples that are transposed in the cache


@kernel
def spring_sums(w: Array, products: Array, springs: Array, out: Array) -> None:
    """Sum spectra times the acceleration of a load on its spring less the rotor's, over the rotor's.

    From J_load theta_l'' = k (theta - theta_l) + d (omega - omega_l) with the load's own frequency
    ``w_a = sqrt(k / J_load)`` and damping ``zeta``: H = -s^2 / (s^2 + 2 zeta w_a s + w_a^2) at s = j w.

    Parameters
    ----------
    w : array, shape (n,)
        Frequencies, rad/s.
    products : array, shape (5, n)
        Real and imaginary part of u and of v, and p.
    springs : array, shape (k, 2)
        w_a in rad/s, and zeta.
    out : array, shape (k, 3)
        Filled: real parts of the sums of u H and of v H, and the sum of p ``|H|^2``.
    """
    for k in range(springs.shape[0]):
        w_a, zeta = springs[k, 0], springs[k, 1]
        first = second = power = 0.0
        for i in range(w.size):
            square = w[i] * w[i]
            stiff, damped = w_a * w_a - square, 2.0 * zeta * w_a * w[i]
            scale = square / (stiff * stiff + damped * damped)
            re, im = scale * stiff, -scale * damped
            first += products[0, i] * re - products[1, i] * im
            second += products[2, i] * re - products[3, i] * im
            power += products[4, i] * (re * re + im * im)
        out[k, 0], out[k, 1], out[k, 2] = first, second, power


@kernel
def _one_load(theta: Array, omega: Array, steps: int, numbers: Array, h: float, out: Array) -> None:
    """Follow one load; `numbers` as `_numbers` fills them, `out` of shape (n,)."""
    stiff, damped, f = numbers[0], numbers[1], numbers[2]
    kept, lent, pulled, left, yielding = numbers[3], numbers[4], numbers[5], numbers[6], numbers[7]
    twist, load = _begun(omega[0], f, yielding), omega[0]
    for n in range(theta.size):
        out[n] = stiff * twist + damped * (omega[n] - load)
        if n + 1 == theta.size:
            break
        change = (omega[n + 1] - omega[n]) / steps
        for m in range(steps):
            shaft = omega[n] + m * change
            pull = stiff * twist + damped * (shaft - load)
            direction = 1.0 if load > 0.0 else (-1.0 if load < 0.0 else 0.0)
            if direction == 0.0 and pull > f:
                direction = 1.0
            elif direction == 0.0 and pull < -f:
                direction = -1.0
            if direction == 0.0:
                twist += h * (shaft + 0.5 * change)
                continue
            middle = (change / h + direction * f) * yielding
            rate = shaft - load
            apart = twist - middle
            twist = middle + kept * apart + lent * rate
            load = shaft + change - (pulled * apart + left * rate)
            if direction * load < 0.0:
                pull = stiff * twist + damped * (shaft + change)
                load = _turned(load, shaft - rate, pull, f, h)


@inlined
def _begun(load: float, f: float, yielding: float) -> float:
    """Twist of a spring whose load moves at a constant speed, or rests."""
    return f * yielding if load > 0.0 else (-f * yielding if load < 0.0 else 0.0)


@inlined
def _turned(load: float, before: float, pull: float, f: float, h: float) -> float:
    """Speed of a load at the end of a step in which it has met rest: what is left of the step begins there."""
    spare = h * load / (load - before)
    return spare * max(abs(pull) - f, 0.0) * (1.0 if pull > 0.0 else -1.0)


@inlined
def _numbers(spring: Array, h: float, out: Array) -> None:
    """Fill w_a^2, 2 zeta w_a, f, what a step leaves of twist and speed of each other, and 1 / w_a^2."""
    w, zeta, f = spring[0], spring[1], spring[2]
    ringing = w * sqrt(1.0 - zeta * zeta)
    fade, c, s = exp(-zeta * w * h), cos(ringing * h), sin(ringing * h) / ringing
    out[0], out[1], out[2] = w * w, 2.0 * zeta * w, f
    out[3], out[4] = fade * (c + zeta * w * s), fade * s
    out[5], out[6] = -fade * w * w * s, fade * (c - zeta * w * s)
    out[7] = 1.0 / (w * w)


@inlined
def _step_of_all(state: Array, p: Array, shaft: float, change: float, h: float) -> None:
    """Do a step of all lanes without a branch, and then what few of them need: where a load has met rest.

    In `state` stand twist and speed, and for the latter case the speed before and whether the load has turned.
    """
    slope, met = change / h, 0
    for c in range(LANES):
        twist, load, f = state[c], state[LANES + c], p[2 * LANES + c]
        pull = p[c] * twist + p[LANES + c] * (shaft - load)
        torn = 1.0 if pull > f else (-1.0 if pull < -f else 0.0)
        direction = 1.0 if load > 0.0 else (-1.0 if load < 0.0 else torn)
        middle = (slope + direction * f) * p[7 * LANES + c]
        rate = shaft - load
        apart = twist - middle
        swung = middle + p[3 * LANES + c] * apart + p[4 * LANES + c] * rate
        speed = shaft + change - (p[5 * LANES + c] * apart + p[6 * LANES + c] * rate)
        held = direction == 0.0
        state[c] = twist + h * (shaft + 0.5 * change) if held else swung
        state[LANES + c] = 0.0 if held else speed
        state[2 * LANES + c], state[3 * LANES + c] = load, direction * speed
        met |= 1 if direction * speed < 0.0 else 0
    if met:
        for c in range(LANES):
            if state[3 * LANES + c] < 0.0:
                pull = p[c] * state[c] + p[LANES + c] * (shaft + change)
                state[LANES + c] = _turned(state[LANES + c], state[2 * LANES + c], pull, p[2 * LANES + c], h)


@kernel
def _side_by_side(theta: Array, omega: Array, steps: int, numbers: Array, h: float, out: Array) -> None:
    """Follow at most `LANES` loads in the same instructions; `out` of shape (k, n)."""
    state, tile = np.zeros(4 * LANES), np.empty(TILE * LANES)
    for c in range(LANES):
        state[c] = _begun(omega[0], numbers[2 * LANES + c], numbers[7 * LANES + c])
        state[LANES + c] = omega[0]
    for first in range(0, theta.size, TILE):
        last = min(first + TILE, theta.size)
        for n in range(first, last):
            at, speed = LANES * (n - first), omega[n]
            for c in range(LANES):
                tile[at + c] = numbers[c] * state[c] + numbers[LANES + c] * (speed - state[LANES + c])
            if n + 1 < theta.size:
                change = (omega[n + 1] - speed) / steps
                for m in range(steps):
                    _step_of_all(state, numbers, speed + m * change, change, h)
        for c in range(out.shape[0]):
            for n in range(first, last):
                out[c, n] = tile[LANES * (n - first) + c]


@kernel
def rubbing_loads(theta: Array, omega: Array, period: float, steps: int, springs: Array, out: Array) -> None:
    """Follow loads that hang on a spring and have dry friction of their own, along a measured motion of the shaft.

    ``omega_l' = w_a^2 (theta - theta_l) + 2 zeta w_a (omega - omega_l) - f sgn(omega_l)``, set-valued at rest: a load
    stays where it is while the spring pulls by less than its friction. Between two events the equation is linear and
    solved exactly, the shaft's speed being straight between samples. Where a load meets rest inside a step, what is
    left of the step has the acceleration of its end.

    Parameters
    ----------
    theta, omega : array, shape (n,)
        Position, rad (m), and speed, rad/s (m/s), of the shaft.
    period : float
        Of the samples, s.
    steps : int
        Steps per sample.
    springs : array, shape (k, 3)
        w_a in rad/s, zeta below 1, and the deceleration of a free load by its friction, ``f = F_load / J_load``.
    out : array, shape (k, n)
        Filled: torque of the spring over the load's inertia, at every sample.
    """
    h, count = period / steps, springs.shape[0]
    alone = np.empty(8)
    if count < FEW:
        for k in range(count):
            _numbers(springs[k], h, alone)
            _one_load(theta, omega, steps, alone, h, out[k])
        return
    numbers = np.empty(8 * LANES)
    for start in range(0, count, LANES):
        stop = min(start + LANES, count)
        for c in range(LANES):  # lanes that are left over follow the last load
            _numbers(springs[min(start + c, stop - 1)], h, alone)
            for n in range(8):
                numbers[n * LANES + c] = alone[n]
        _side_by_side(theta, omega, steps, numbers, h, out[start:stop])


@kernel
def slider(theta: Array, reach: float, out: Array) -> None:
    """Follow a spring without a mass whose other end is held by dry friction: it bends by `reach` and slides then.

    Parameters
    ----------
    theta : array, shape (n,)
        Position, rad (m).
    reach : float
        Largest deflection, rad (m).
    out : array, shape (n,)
        Filled: the deflection, rad (m).
    """
    bent = 0.0
    for n in range(theta.size):
        if n > 0:
            bent = min(max(bent + theta[n] - theta[n - 1], -reach), reach)
        out[n] = bent

"""Loads on springs: the response summed over a spectrum, and a load that dry friction holds, followed in time."""

from __future__ import annotations

from math import cos, exp, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.kernels import kernel

__all__ = ["rubbing_loads", "slider", "spring_sums"]

Array = NDArray[np.float64]


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
    h = period / steps
    for k in range(springs.shape[0]):
        w, zeta, f = springs[k, 0], springs[k, 1], springs[k, 2]
        ringing = w * sqrt(1.0 - zeta * zeta)
        fade, c, s = exp(-zeta * w * h), cos(ringing * h), sin(ringing * h) / ringing
        kept, lent = fade * (c + zeta * w * s), fade * s
        pulled, left = -fade * w * w * s, fade * (c - zeta * w * s)
        twist, load = 0.0, omega[0]
        if load != 0.0:
            twist = (f if load > 0.0 else -f) / (w * w)
        for n in range(theta.size):
            out[k, n] = w * w * twist + 2.0 * zeta * w * (omega[n] - load)
            if n + 1 == theta.size:
                break
            change = (omega[n + 1] - omega[n]) / steps
            for m in range(steps):
                shaft = omega[n] + m * change
                pull = w * w * twist + 2.0 * zeta * w * (shaft - load)
                direction = 1.0 if load > 0.0 else (-1.0 if load < 0.0 else 0.0)
                if direction == 0.0 and pull > f:
                    direction = 1.0
                elif direction == 0.0 and pull < -f:
                    direction = -1.0
                if direction == 0.0:
                    twist += h * (shaft + 0.5 * change)
                    continue
                middle = (change / h + direction * f) / (w * w)
                rate = shaft - load
                apart = twist - middle
                twist = middle + kept * apart + lent * rate
                load = shaft + change - (pulled * apart + left * rate)
                if direction * load < 0.0:  # at rest inside the step: what is left of it begins there
                    spare = h * load / (load - (shaft - rate))
                    pull = w * w * twist + 2.0 * zeta * w * (shaft + change)
                    load = spare * max(abs(pull) - f, 0.0) * (1.0 if pull > 0.0 else -1.0)


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

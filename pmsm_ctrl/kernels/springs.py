"""The response of a load on a spring, summed over a spectrum: one pass over the frequencies a spring."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.kernels import kernel

__all__ = ["spring_sums"]

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

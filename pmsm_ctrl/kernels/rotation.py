"""Small pieces of the sampled drive: rotation by a small angle, the voltage hexagon, the encoder, noise."""

from __future__ import annotations

from math import cos, floor, pi, sin, sqrt
from typing import Any

from pmsm_ctrl.kernels import kernel

__all__ = ["cos_small", "hexagon_scale", "normal", "quantise", "sin_small"]

SQRT3_2 = sqrt(3.0) / 2.0
TURN = 2.0 * pi


@kernel
def cos_small(x: float) -> float:
    """Cosine by its Taylor polynomial; within 3e-7 for abs(x) < 1 rad, 2e-12 for abs(x) < 0.3 rad."""
    y = x * x
    return 1.0 + y * (-1.0 / 2.0 + y * (1.0 / 24.0 + y * (-1.0 / 720.0 + y * (1.0 / 40320.0))))


@kernel
def sin_small(x: float) -> float:
    """Sine by its Taylor polynomial; within 3e-8 for abs(x) < 1 rad."""
    y = x * x
    return x * (1.0 + y * (-1.0 / 6.0 + y * (1.0 / 120.0 + y * (-1.0 / 5040.0 + y * (1.0 / 362880.0)))))


@kernel
def hexagon_scale(u_d: float, u_q: float, angle: float, u_dc: float) -> float:
    """Largest factor, at most 1, that brings a stator voltage inside the hexagon of space-vector modulation.

    The vector u_d + j u_q, turned by `angle` into the stator, can be made when no two phase legs differ
    by more than the dc-link voltage. Source: H. W. van der Broeck, H.-C. Skudelny, G. V. Stanke,
    IEEE Trans. Ind. Appl. 24 (1988) 142.
    """
    # The circle inscribed in the hexagon has radius u_dc / sqrt(3): inside it nothing has to be computed.
    if 3.0 * (u_d * u_d + u_q * u_q) <= u_dc * u_dc:
        return 1.0
    c, s = cos(angle), sin(angle)
    u_alpha = c * u_d - s * u_q
    u_beta = s * u_d + c * u_q
    u_a = u_alpha
    u_b = -0.5 * u_alpha + SQRT3_2 * u_beta
    u_c = -0.5 * u_alpha - SQRT3_2 * u_beta
    span = max(u_a, u_b, u_c) - min(u_a, u_b, u_c)
    return 1.0 if span <= u_dc else u_dc / span


@kernel
def quantise(theta: float, counts: float) -> float:
    """Position read by an encoder with `counts` in 2 pi rad (m); 0 counts is an ideal encoder."""
    if counts == 0.0:
        return theta
    return floor(theta * counts / TURN + 0.5) * TURN / counts


@kernel
def normal(noise: Any) -> float:
    """Draw from the standard normal distribution; a function of its own because it takes 0.4 s to compile."""
    return noise.standard_normal()  # type: ignore[no-any-return]

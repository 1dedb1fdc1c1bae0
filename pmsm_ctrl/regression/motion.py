"""What hangs on the measured motion: a load behind a spring or a gap, and the bristles of presliding friction.

The measured angle drives them; all are normalised by the load's inertia, so that the inertia stays a linear
parameter of the regression.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.effects.base import Effect
from pmsm_ctrl.regression.balances import Record

__all__ = ["bristle_direction", "load_behind_gap", "load_behind_spring", "spring_response"]

Array = NDArray[np.float64]

_LOOPS: dict[Any, Any] = {}


def spring_response(w_a: float, zeta: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Numerator and denominator in s of a load's acceleration on its spring less the rotor's, over the rotor's.

    From J_load theta_l'' = k (theta - theta_l) + d (omega - omega_l) with the load's own frequency
    ``w_a = sqrt(k / J_load)`` in rad/s and damping ``zeta``: -s^2 / (s^2 + 2 zeta w_a s + w_a^2).
    """
    return (-1.0, 0.0, 0.0), (1.0, 2.0 * zeta * w_a, w_a * w_a)


def load_behind_spring(record: Record, shape: Mapping[str, float]) -> Array:
    """Acceleration of a load on a spring less that of the rotor, shape (n,).

    Discretised bilinearly: exact at the load's own frequency, or where that lies above the band, at the end of the
    band. `shape` holds ``w_a`` and ``zeta``.
    """
    from scipy.signal import bilinear, lfilter

    exact = min(shape["w_a"], 2.0 * np.pi * record.prepared.cutoff)
    above, below = spring_response(shape["w_a"], shape["zeta"])
    b, a = bilinear(above, below, 0.5 * exact / np.tan(0.5 * exact * record.period))
    return np.asarray(lfilter(b, a, record.signals["alpha"]))


def load_behind_gap(record: Record, effect: Effect, shape: Mapping[str, float]) -> Array:
    """Acceleration of a load behind a gap less that of the rotor, shape (n,).

    `shape` holds ``gap`` in rad, ``w_a`` and ``zeta`` of the contact. The effect's own contact law is used with
    stiffness and damping per inertia.
    """
    loop = _LOOPS.get(effect.term)
    if loop is None:
        loop = _LOOPS[effect.term] = _gap_loop(effect.term)
    w, zeta = shape["w_a"], shape["zeta"]
    s = record.signals
    substeps = max(4, int(np.ceil(record.period * w * 4.0)))
    out = np.empty(len(s["theta"]))
    loop(out, s["theta"], s["omega"], record.period, substeps, shape["gap"], w * w, 2.0 * zeta * w)
    return out - s["alpha"]


def _gap_loop(term: Any) -> Any:
    def loop(out, theta, omega, period, substeps, gap, k, d):  # type: ignore[no-untyped-def]
        h = period / substeps
        load, speed = theta[0], omega[0]
        for n in range(len(theta)):
            last = min(n + 1, len(theta) - 1)
            before = speed
            for m in range(substeps):
                x = m / substeps
                position = (1.0 - x) * theta[n] + x * theta[last]
                rate = (1.0 - x) * omega[n] + x * omega[last]
                speed += h * term(position - load, rate - speed, gap, k, d)
                load += h * speed
            out[n] = (speed - before) / period

    import numba

    from pmsm_ctrl.kernels import OPTIONS

    return numba.njit(**{**OPTIONS, "cache": False})(loop)


def bristle_direction(record: Record, effect: Effect, shape: Mapping[str, float]) -> Array:
    """Friction of the bristle as a share of the dry friction along the measured motion, shape (n,)."""
    key = ("bristle", effect.term)
    loop = _LOOPS.get(key)
    if loop is None:
        loop = _LOOPS[key] = _bristle_loop(effect.term)
    s = record.signals
    out = np.empty(len(s["theta"]))
    z_b, tau_z = shape.get("z_b", 0.5), shape.get("tau_z", 1e-3)
    loop(out, s["theta"], s["omega"], shape["z_s"], z_b, tau_z)
    return out


def _bristle_loop(term: Any) -> Any:
    def loop(out, theta, omega, z_s, z_b, tau_z):  # type: ignore[no-untyped-def]
        zeta = 0.0
        for n in range(len(theta)):
            travel = theta[n] - theta[n - 1] if n > 0 else 0.0
            zeta, out[n] = term(zeta, travel, omega[n], 1.0, z_s, z_b, tau_z)

    import numba

    from pmsm_ctrl.kernels import OPTIONS

    return numba.njit(**{**OPTIONS, "cache": False})(loop)

"""Orders in the residual: its spectrum over the angle, not over time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.diagnose.record import Record

__all__ = ["order_spectrum", "strongest_orders"]

Array = NDArray[np.float64]
HIGHEST = 240


def order_spectrum(record: Record, residual: Array, highest: int = HIGHEST) -> tuple[Array, Array]:
    """Amplitude and significance of every mechanical order in a torque residual.

    Parameters
    ----------
    residual : array, shape (m,)
        On the thinned grid.

    Returns
    -------
    amplitude : array, shape (highest,)
        Of orders 1 to `highest`, N m; NaN where no turn is slow enough for the order to pass the filter.
    score : array, shape (highest,)
        Twice the gain in log-likelihood were the residual white where the order can be seen.
    """
    theta = record.at_grid(record.signals["theta"])
    omega = np.abs(record.at_grid(record.signals["omega"]))
    used = record.mask
    weight = record.weight[0]
    amplitude, score = np.full(highest, np.nan), np.zeros(highest)
    step = np.exp(1j * theta)
    turning = np.ones_like(step)
    for k in range(1, highest + 1):
        turning = turning * step
        seen = used & (k * omega < 2.0 * np.pi * record.prepared.cutoff * 0.8)
        if int(seen.sum()) < 30 or float(np.sum(omega[seen])) / record.rate * k < 4.0 * np.pi:
            continue
        w, r = weight[seen] ** 2, residual[seen]
        c, s = turning.real[seen], turning.imag[seen]
        matrix = np.column_stack([c, s, np.ones_like(c)])
        gram = matrix.T @ (matrix * w[:, None])
        right = matrix.T @ (w * r)
        try:
            x = np.linalg.solve(gram, right)
        except np.linalg.LinAlgError:
            continue
        if np.linalg.cond(gram) > 1e4:
            continue
        mean = right[2] / gram[2, 2]
        gain = float(right @ x - mean * right[2])
        left = float(np.sum(w * r**2) - right @ x) / max(len(r) - 3, 1)
        amplitude[k - 1] = np.hypot(x[0], x[1])
        score[k - 1] = gain / max(left, 1e-300)
    return amplitude, score


def strongest_orders(record: Record, residual: Array, count: int = 6) -> tuple[list[int], int]:
    """Return the orders that stand out most, best first, and how many were looked at."""
    _, score = order_spectrum(record, residual)
    tried = int(np.sum(score > 0.0))
    best = np.argsort(score)[::-1]
    return [int(k) + 1 for k in best[:count] if score[k] > 0.0], max(tried, 1)

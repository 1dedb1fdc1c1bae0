"""The worst stretches of time, each with what the axis was doing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.compare import policy
from pmsm_ctrl.compare.motion import Motion, motion_of
from pmsm_ctrl.residuals.dependence import run_around

__all__ = ["Stretch", "worst_stretches"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Stretch:
    """A stretch of time, s, in which a prediction fails; the residual's rms and the motion in it."""

    start: float
    stop: float
    rms: float
    motion: Motion


def worst_stretches(t: Array, residual: Array, mask: Mask, omega: Array, count: int = 3) -> tuple[Stretch, ...]:
    """Return the worst stretches, worst first, none overlapping another; none where none stands out.

    Time in s, residual and speed on a uniform grid, and the mask of samples that count, have shape (m,).
    """
    from scipy.ndimage import uniform_filter1d

    rate = (len(t) - 1) / float(t[-1] - t[0])
    seconds = min(max(policy.STRETCH_SHARE * float(t[-1] - t[0]), policy.STRETCH_SHORTEST), policy.STRETCH_LONGEST)
    width = max(5, round(seconds * rate))
    power = uniform_filter1d(np.where(mask, residual**2, 0.0), width, mode="constant")
    share = uniform_filter1d(mask.astype(np.float64), width, mode="constant")
    # a few samples between two that do not count are no stretch
    running = np.where(share > 0.3, power / np.maximum(share, 1e-12), 0.0)
    whole = max(float(np.sqrt(np.mean(residual[mask] ** 2))), 1e-300)
    fast = float(np.quantile(np.abs(omega), 0.99))
    found = []
    for _ in range(count):
        peak = int(np.argmax(running))
        if running[peak] <= 0.0:
            break
        above = running > policy.EXTENT**2 * running[peak]
        above[: max(0, peak - width)] = False
        above[peak + width + 1 :] = False
        first, last = run_around(above, peak)
        # the running rms looks half its width to either side
        first, last = max(0, first - width // 4), min(len(t) - 1, last + width // 4)
        part = slice(first, last + 1)
        rms = float(np.sqrt(np.mean(residual[part][mask[part]] ** 2)))
        running[max(0, first - width // 2) : last + width // 2 + 1] = 0.0
        if rms >= policy.STANDS_OUT * whole:
            found.append(Stretch(float(t[first]), float(t[last]), rms, motion_of(omega[part], fast)))
    return tuple(sorted(found, key=lambda s: -s.rms))

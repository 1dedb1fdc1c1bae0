"""Ends of the 95 % intervals of a fit by simulation whose sum of squares over a parameter is no parabola.

The sum of squares, least over all other parameters, grows at the ends by that of 1.96 standard errors. The others
follow by steps with the slopes of the optimum, which every step corrects: a simulation each, where new slopes would be
one for every parameter.

Sources: D. M. Bates, D. G. Watts, Nonlinear Regression Analysis and Its Applications (1988), section 6.1, profile t;
C. G. Broyden, Math. Comp. 19 (1965) 577, the correction.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

__all__ = ["Optimum"]

Array = NDArray[np.float64]

NORMAL = 1.959964  # half of a 95 % interval, in standard errors
PARABOLA = 0.1  # part of the half-width by which a profile may differ from a parabola's
STEPS, SETTLED = 6, 0.02  # of the other parameters beside what is held; and what the sum of squares may still fall by
TRIALS, CLOSE, FURTHEST, FASTEST = 10, 0.03, 6.0, 3.0  # of the search for an end, in half-widths


@dataclass(frozen=True, eq=False)
class Optimum:
    """A fit by simulation at its least sum of squares.

    Attributes
    ----------
    residual : function of array, shape (k,)
        Returns what is squared, shape (n,), priors included.
    values : array, shape (k,)
    slopes : array, shape (n, k)
        Of the residual there.
    stderr : array, shape (k,)
        Standard errors that allow for all that white noise does not; not finite where a parameter is held.
    lower, upper : array, shape (k,)
        Bounds.
    """

    residual: Callable[[Array], Array]
    values: Array
    slopes: Array
    stderr: Array
    lower: Array
    upper: Array

    @cached_property
    def _left(self) -> Array:
        return self.residual(self.values)

    @cached_property
    def _covariance(self) -> Array:
        """In white noise of the level of the residual, shape (k, k)."""
        scale = np.linalg.norm(self.slopes, axis=0)
        inverse = np.linalg.pinv((self.slopes / scale).T @ (self.slopes / scale)) / np.outer(scale, scale)
        return np.asarray(inverse * float(np.mean(self._left**2)))

    def ends(self, which: Iterable[int]) -> dict[int, tuple[float, float]]:
        """Return the ends of the intervals of some parameters; only of those whose profile is no parabola.

        Parameters
        ----------
        which : iterable of int
        """
        out = {}
        for k in which:
            half = NORMAL * float(self.stderr[k])
            if not math.isfinite(half) or half <= 0.0:
                continue
            sides = [(-1.0, self.values[k] - self.lower[k]), (1.0, self.upper[k] - self.values[k])]
            roots = [
                self._root(k, sign * min(half, room)) * half / min(half, room) for sign, room in sides if room > 0.0
            ]
            if max(abs(root / NORMAL - 1.0) for root in roots) > PARABOLA:
                low, high = (self._end(k, sign, half, float(room)) for sign, room in sides)
                out[k] = float(self.values[k] - low), float(self.values[k] + high)
        return out

    def _root(self, k: int, step: float) -> float:
        """Return the root of what the sum of squares grows by, in standard errors, with a parameter moved."""
        white = float(self._covariance[k, k])
        grown = self._least(k, step) - float(self._left @ self._left)
        return math.sqrt(max(grown, 0.0) / float(np.mean(self._left**2)) * white) / float(self.stderr[k])

    def _least(self, k: int, step: float) -> float:
        """Return the least sum of squares with a parameter moved, over all others."""
        others = np.delete(np.arange(len(self.values)), k)
        unit = np.sqrt(np.diag(self._covariance))[others]
        slopes = self.slopes[:, others] * unit
        at = self.values + self._covariance[:, k] / self._covariance[k, k] * step
        at[k] = self.values[k] + step
        at = np.clip(at, self.lower, self.upper)
        left = self.residual(at)
        least, allowed = float(left @ left), SETTLED * float(np.mean(self._left**2))
        for _ in range(STEPS):
            moved = at.copy()
            moved[others] -= unit * np.linalg.lstsq(slopes, left, rcond=None)[0]
            moved = np.clip(moved, self.lower, self.upper)
            there, by = self.residual(moved), (moved - at)[others] / unit
            if not np.any(by):
                break
            slopes += np.outer((there - left - slopes @ by) / float(by @ by), by)
            new = float(there @ there)
            if new >= least:
                continue
            gained, least, left, at = least - new, new, there, moved
            if gained < allowed:
                break
        return least

    def _end(self, k: int, sign: float, half: float, room: float) -> float:
        """Return how far the end of the interval is on one side: no further than the bound."""
        near, far, step = (0.0, 0.0), (math.inf, math.inf), min(half, room)
        for _ in range(TRIALS if room > 0.0 else 0):
            root = self._root(k, sign * step)
            if abs(root - NORMAL) <= CLOSE * NORMAL:
                break
            if root < NORMAL:
                near = step, root
                if step >= room:
                    break
            else:
                far = step, root
            if math.isfinite(far[0]):
                part = (NORMAL - near[1]) / (far[1] - near[1])
                step = near[0] + (far[0] - near[0]) * min(max(part, 0.1), 0.9)
            elif step >= FURTHEST * half:
                return room
            else:
                step = min(step * min(FASTEST, 1.1 * NORMAL / max(root, NORMAL / FASTEST)), FURTHEST * half, room)
        return step if room > 0.0 else 0.0

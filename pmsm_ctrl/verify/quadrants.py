"""The quadrant error of a circle: the spike that friction leaves where an axis reverses.

Two axes follow a circle. Its centre and radius come from the references. The radial deviation of the measured path less
its slow part (orders 0 to 2 over the turn: lag, unequal gains, squareness) has a spike behind every reversal.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.errors import LogError
from pmsm_ctrl.log import Log
from pmsm_ctrl.result import Result, jsonable
from pmsm_ctrl.section import Notice
from pmsm_ctrl.verify import notices as words

__all__ = ["Circle", "QuadrantError", "quadrants"]

Array = NDArray[np.float64]

STEADY = 0.05  # share by which the speed along the path may differ from its median
ROUND = 0.02  # share of the radius by which a reference may leave its circle
BEFORE, BEHIND = math.radians(3.0), math.radians(30.0)  # of a reversal, where its spike is sought
ORDERS = 2  # of the slow deviation
TURN = 2.0 * math.pi


@dataclass(frozen=True, eq=False)
class Circle:
    """The radial deviation of one record.

    Attributes
    ----------
    radius, speed : float
        In the unit of the axes, and per second.
    turns : float
        Turns at constant speed that were evaluated.
    spikes : array, shape (4,)
        Mean over the turns of the largest deviation behind the reversals at 0, 90, 180 and 270 degrees, outwards.
    scatter : array, shape (4,)
        Its standard deviation from turn to turn; NaN for a single turn.
    rest : float
        Rms deviation elsewhere.
    radius_error : float
        Mean radius less that of the reference.
    angle, deviation : array, shape (n,)
        Place on the circle, rad, counted on, and the deviation less its slow part.
    """

    radius: float
    speed: float
    turns: float
    spikes: Array
    scatter: Array
    rest: float
    radius_error: float
    angle: Array = field(repr=False)
    deviation: Array = field(repr=False)

    @property
    def worst(self) -> float:
        """The quadrant error: the largest of the four spikes, without sign."""
        return float(np.max(np.abs(self.spikes)))


@dataclass(frozen=True, eq=False)
class QuadrantError(Result):
    """Result of `quadrants`.

    Attributes
    ----------
    before : Circle
    after : Circle or None
    unit : str
        Of the axes.
    notices : tuple of Notice
    """

    before: Circle
    after: Circle | None
    unit: str
    notices: tuple[Notice, ...] = ()

    @property
    def change(self) -> float:
        """Change of the quadrant error, -0.8 for -80 %; NaN without a second record."""
        return math.nan if self.after is None else self.after.worst / self.before.worst - 1.0

    def to_dict(self) -> dict[str, Any]:
        """Return plain values fit for JSON."""

        def one(circle: Circle) -> dict[str, Any]:
            names = ("radius", "speed", "turns", "spikes", "scatter", "rest", "radius_error")
            return {"quadrant_error": circle.worst} | {name: getattr(circle, name) for name in names}

        return dict(jsonable({
            "schema": "pmsm-ctrl/quadrants/1", **self.doubts(), "unit": self.unit, "before": one(self.before),
            "after": None if self.after is None else one(self.after), "change": self.change,
        }))  # fmt: skip


def quadrants(
    x: Log, y: Log, after: tuple[Log, Log] | None = None,
) -> QuadrantError:  # fmt: skip
    """Return the quadrant error of a circle that two axes follow.

    Parameters
    ----------
    x, y : Log
        Of the two axes, from one trigger, with ``theta_ref`` and ``theta``; angles at the motors, or lengths.
    after : (Log, Log), optional
        The same with another compensation.

    Returns
    -------
    QuadrantError

    Raises
    ------
    LogError
        When a channel is missing, the axes have no common time, or the references draw no circle.
    """
    first = _circle(x, y)
    second = None if after is None else _circle(*after)
    found: list[Notice] = []
    for one in (first, second):
        if one is not None and one.worst < 3.0 * one.rest:
            found.append(words.NO_SPIKE(spike=one.worst, rest=one.rest, unit=x.unit("theta")))
    if second is not None:
        apart = max(abs(second.radius / first.radius - 1.0), abs(second.speed / first.speed - 1.0))
        if apart > STEADY:
            found.append(words.OTHER_CIRCLE(share=apart))
    return QuadrantError(first, second, x.unit("theta"), tuple(found))


def _circle(x: Log, y: Log) -> Circle:
    t, channels = _together(x, y)
    x_ref, x_is, y_ref, y_is = channels
    x_0, y_0, radius = _fitted(x_ref, y_ref)
    off = np.hypot(x_ref - x_0, y_ref - y_0) - radius
    angle = np.unwrap(np.arctan2(y_ref - y_0, x_ref - x_0))
    rate = np.abs(np.gradient(angle, t))
    moving = rate > 0.1 * rate.max()
    steady = moving & (np.abs(rate / np.median(rate[moving]) - 1.0) < STEADY) & (np.abs(off) < ROUND * radius)
    turns = float(np.ptp(angle[steady])) / TURN if steady.any() else 0.0
    if turns < 0.95:
        raise LogError(
            f"the references of the two axes draw {turns:.2g} of a circle at constant speed; a whole turn was expected"
        )
    phi, side = angle[steady], float(np.sign(angle[-1] - angle[0]))
    deviation = (np.hypot(x_is - x_0, y_is - y_0) - radius)[steady]
    place = np.mod(side * phi, TURN)  # forwards, whatever the sense of the circle
    near = np.mod(place + BEFORE, 0.25 * TURN) < BEFORE + BEHIND
    slow = np.column_stack([np.ones_like(phi), *(f(k * phi) for k in range(1, ORDERS + 1) for f in (np.cos, np.sin))])
    weights = np.linalg.lstsq(slow[~near], deviation[~near], rcond=None)[0]
    rest = deviation - slow @ weights
    spikes, scatter = np.zeros(4), np.full(4, np.nan)
    for quadrant in range(4):
        inside = np.mod(place - quadrant * 0.25 * TURN + BEFORE, TURN) < BEFORE + BEHIND
        number = np.floor((side * phi - quadrant * 0.25 * TURN + BEFORE) / TURN)[inside]
        found = [_largest(rest[inside][number == n]) for n in np.unique(number)]
        # spikes are named by the place on the circle, not by the sense in which it is passed
        at = quadrant if side > 0.0 else -quadrant % 4
        spikes[at] = float(np.mean(found))
        scatter[at] = float(np.std(found, ddof=1)) if len(found) > 1 else np.nan
    return Circle(
        radius, float(np.median(rate[steady])) * radius, turns, spikes, scatter,
        float(np.sqrt(np.mean(rest[~near] ** 2))), float(weights[0]), phi, rest,
    )  # fmt: skip


def _largest(values: Array) -> float:
    return float(values[np.argmax(np.abs(values))])


def _together(x: Log, y: Log) -> tuple[Array, list[Array]]:
    """Return both axes on the time of the first one, from the common trigger on."""
    for name, log in (("first", x), ("second", y)):
        missing = [one for one in ("theta_ref", "theta") if one not in log]
        if missing:
            raise LogError(f"the {name} axis has no {', '.join(missing)} (present: {', '.join(log)})")
        log.check_evaluable(100)
    t, other = x.t - x.t[0], y.t - y.t[0]
    kept = t <= other[-1]
    if kept.sum() < 100:
        raise LogError("the logs of the two axes have less than 100 samples of common time")
    t = t[kept]
    names = ("theta_ref", "theta")
    return t, [*(x[one][kept] for one in names), *(np.interp(t, other, y[one]) for one in names)]


def _fitted(x: Array, y: Array) -> tuple[float, float, float]:
    """Return centre and radius of the circle through points (I. Kasa, IEEE Trans. Instrum. Meas. 25 (1976) 8)."""
    columns = np.column_stack([2.0 * x, 2.0 * y, np.ones_like(x)])
    a, b, c = np.linalg.lstsq(columns, x**2 + y**2, rcond=None)[0]
    radius = math.sqrt(max(c + a**2 + b**2, 0.0))
    if not radius > 0.0 or np.ptp(x) < 0.5 * radius or np.ptp(y) < 0.5 * radius:
        raise LogError("the references of the two axes draw no circle")
    return float(a), float(b), radius

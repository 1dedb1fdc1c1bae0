"""What a residual may depend on, and the curves that show it.

Every coordinate brings columns of a smooth curve, one for either direction of motion where the axis moves both ways,
because friction that drifts or depends on the position changes its sign with the motion.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.evidence.waves import highest_over_position, strongest_periods
from pmsm_ctrl.regression.conditioning import Prepared
from pmsm_ctrl.regression.filters import low_pass
from pmsm_ctrl.residuals import policy
from pmsm_ctrl.residuals.orders import strongest_orders, waves
from pmsm_ctrl.units import axis_unit, drives

__all__ = ["TIME", "Curve", "Drive", "accelerations", "curves", "grid_coordinates", "with_orders"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

TIME, TRAVEL = "time since start", "position over several turns"
UNITS = {
    "speed": "rad/s", "direction": "", "position": "rad", TRAVEL: "rad", "acceleration": "rad/s^2", "current": "A",
    "torque": "N m", "force": "N", "temperature": "degC", TIME: "s",
}  # fmt: skip
SPEED_KNOTS = np.geomspace(0.01, 1.0, 7)  # of the fast speed: dense where friction is nonlinear


@dataclass(frozen=True, eq=False)
class Drive:
    """What a model knows of the drive.

    Attributes
    ----------
    torque : array, shape (m,)
        As the model predicts it: against the measured one its own noise would be a dependence.
    J : float
        Inertia in that prediction.
    per_ampere : float or None
        Torque constant; None where the log has a torque and no current.
    accelerations : (array, array), or None
        As the function of that name returns them, where several channels are judged.
    """

    torque: Array
    J: float
    per_ampere: float | None = None
    accelerations: tuple[Array, Array] | None = None


@dataclass(frozen=True, eq=False)
class Curve:
    """One coordinate with the columns of its curve on the thinned grid.

    Attributes
    ----------
    name, unit : str
    x : array, shape (m,)
        The coordinate itself.
    base : array, shape (m, b)
        What is not this coordinate's own: a constant, and for all but speed and direction one per direction.
    own : array, shape (m, k)
    draw : function
        ``draw(points, sign)`` gives base and own columns at points of the coordinate, moving with this sign.
    tried : int
        Curves that were looked at to find this one; the significance pays for them.
    orders : tuple of int
        Of position on a rotary axis.
    spectrum : array, shape (2, highest), or None
        Amplitude of every mechanical order over what noise makes of it; NaN where it cannot be seen.
    period : float
        Of a wave over several turns in the curve, rad; 0 without one.
    """

    name: str
    unit: str
    x: Array
    base: Array
    own: Array
    draw: Callable[[Array, float], tuple[Array, Array]]
    tried: int = 1
    orders: tuple[int, ...] = ()
    spectrum: Array | None = None
    period: float = 0.0


def grid_coordinates(prepared: Prepared, drive: Drive, noise: float = 0.0) -> dict[str, Array]:
    """Return coordinates of shape (m,) on the thinned grid.

    `noise` is that of the torque, rms: the current loop answers what it measures wrongly with a torque, so that small
    changes of the acceleration mirror the noise of the measured current.
    """
    s, keep = prepared.signals, prepared.keep
    alpha, confirmed = drive.accelerations or accelerations(prepared, drive.J)
    half = policy.PLAY * noise / drive.J if drive.J > 0.0 else 0.0
    slow = _with_play(confirmed, half)
    load = "current" if drive.per_ampere is not None else drives(prepared.motion)
    out = {
        "speed": s["omega"][keep],
        "direction": np.sign(s["omega"][keep]),
        "position": s["theta"][keep],
        "acceleration": slow,
        load: (drive.torque - drive.J * (alpha - slow)) / (drive.per_ampere or 1.0),
        TIME: prepared.t[keep] - prepared.t[0],
    }
    if prepared.motion != "linear" and float(np.ptp(s["theta"])) > policy.SEVERAL_TURNS:
        out[TRAVEL] = s["theta"][keep]
    if "temperature" in s and float(np.ptp(s["temperature"])) > 0.0:
        out["temperature"] = s["temperature"][keep]
    return out


def _with_play(x: Array, half: float) -> Array:
    """Follow a signal, from zero, only where it leaves a play around the last value: noise moves nothing.

    Forward and backward in time, and the mean of both: one alone would lag by the play, up as down.
    """
    from pmsm_ctrl.kernels.filters import followed

    if half == 0.0:
        return x
    ways = np.empty((2, len(x)))
    followed(x, half, ways[0])
    followed(x[::-1].copy(), half, ways[1])
    mean: Array = 0.5 * (ways[0] + ways[1][::-1])
    return mean


def accelerations(prepared: Prepared, J: float) -> tuple[Array, Array]:
    """Return the acceleration, and the same with its fast part only where the drive's torque confirms it.

    The noise of a coarse encoder stands in the prediction and in the acceleration alike, and would be a dependence.
    What is true of the fast part needs torque: the slope of one over the other, in inertias, is the share that is.

    Parameters
    ----------
    prepared : Prepared
    J : float

    Returns
    -------
    both of shape (m,)
    """
    slow, rate = policy.SLOW * prepared.cutoff, prepared.rate
    torque = prepared.signals["torque"]
    wide, slow_torque = low_pass(np.stack([prepared.alpha, torque]), rate, slow)
    alpha, fast, needed, confirmed = prepared.columns(
        np.stack([prepared.alpha, prepared.alpha - wide, torque - slow_torque, wide])
    )
    fast, needed = fast[prepared.mask], needed[prepared.mask]
    power = float(fast @ fast)
    if power <= 0.0 or float(fast @ needed) > policy.CONFIRMED * J * power:
        return alpha, alpha
    return alpha, confirmed


def curves(
    prepared: Prepared, coordinates: dict[str, Array], residual: Array, mask: Mask, weight: Array
) -> list[Curve]:
    """Return the curves that this log can show; a coordinate that hardly varies has none. Arrays have shape (m,)."""
    direction = coordinates["direction"]
    both = _both(direction, mask)
    made = []
    for name, x in coordinates.items():
        unit = axis_unit(UNITS[name], prepared.motion)
        if name == "direction":
            if both:
                made.append(_direction(unit, x))
        elif name == "speed":
            made.append(_speed(unit, x, mask, both))
        elif name == "position" and prepared.motion != "linear":
            found = _turn(prepared, unit, x, residual, mask, weight, both)
            if found is not None:
                made.append(found)
        elif name == TRAVEL:
            made.append(_travel(prepared, unit, x, (direction, both), residual * weight**2, mask))
        else:
            # what drifts drifts slowly, and a block of time that is left out has to be reached from the others
            hats = _drift if name in (TIME, "temperature") else _hats
            found = _smooth(name, unit, x, direction, mask, both, hats)
            if found is not None:
                made.append(found)
    return made


def with_orders(
    made: list[Curve], prepared: Prepared, residual: Array, mask: Mask, weight: Array, direction: Array
) -> list[Curve]:
    """Return the curves with the orders of a turn looked for again, by the weight of each sample.

    Parameters
    ----------
    made : list of Curve
        As `curves` returns them.
    prepared, residual, mask, weight
        As for `curves`.
    direction : array, shape (m,)
    """
    theta = prepared.signals["theta"][prepared.keep]
    again: list[Curve | None] = []
    for c in made:
        again.append(
            _turn(prepared, c.unit, theta, residual, mask, weight, _both(direction, mask), c) if c.orders else c
        )
    return [c for c in again if c is not None]


def _both(direction: Array, mask: Mask) -> bool:
    """Whether the axis moves both ways."""
    return bool(policy.ONE_WAY < float(np.mean(direction[mask] > 0.0)) < 1.0 - policy.ONE_WAY)


def _direction(unit: str, x: Array) -> Curve:
    def draw(points: Array, sign: float) -> tuple[Array, Array]:
        return np.ones((len(points), 1)), np.sign(points)[:, None]

    return Curve("direction", unit, x, np.ones((len(x), 1)), x[:, None], draw)


def _speed(unit: str, x: Array, mask: Mask, both: bool) -> Curve:
    top = float(np.quantile(np.abs(x[mask]), 0.999))
    knots = top * SPEED_KNOTS

    def own(points: Array) -> Array:
        """Curves of the size of the speed, one a direction: dry friction jumps at zero."""
        hats = np.column_stack([np.interp(np.abs(points), knots, row) for row in np.eye(len(knots))])
        return np.hstack([hats * (points > 0.0)[:, None], hats * (points < 0.0)[:, None]]) if both else hats

    values = own(x)
    used = values[mask].sum(axis=0) >= 8.0

    def draw(points: Array, sign: float) -> tuple[Array, Array]:
        return np.ones((len(points), 1)), own(sign * np.abs(points))[:, used]

    return Curve("speed", unit, x, np.ones((len(x), 1)), values[:, used], draw)


def _base(direction: Array, both: bool) -> Array:
    ones = np.ones((len(direction), 1))
    return np.hstack([ones, direction[:, None]]) if both else ones


def _apart(columns: Array, direction: Array, both: bool) -> Array:
    return np.hstack([columns, columns * direction[:, None]]) if both else columns


def _turn(
    prepared: Prepared, unit: str, theta: Array, residual: Array, mask: Mask, weight: Array, both: bool,
    known: Curve | None = None,
) -> Curve | None:  # fmt: skip
    direction = np.sign(prepared.signals["omega"])
    spectrum, orders, tried = strongest_orders(prepared, residual, mask, weight, policy.MOST_ORDERS)
    if not orders:
        return None
    # the best few of so many: choosing each of them was a search
    ways = max(1, tried) ** len(orders)
    if known is not None and known.orders == tuple(orders):
        return replace(known, tried=ways, spectrum=spectrum)
    raw = waves(prepared.signals["theta"], orders)
    own = prepared.columns(_apart(raw, direction, both).T).T

    def draw(points: Array, sign: float) -> tuple[Array, Array]:
        along = np.full(len(points), sign)
        return _base(along, both), _apart(waves(points, orders), along, both)

    x, base = np.mod(theta, 2.0 * np.pi), _base(direction[prepared.keep], both)
    return Curve("position", unit, x, base, own, draw, ways, tuple(orders), spectrum)


def _travel(
    prepared: Prepared, unit: str, theta: Array, directed: tuple[Array, bool], values: Array, mask: Mask
) -> Curve:  # fmt: skip
    """A smooth curve over the whole way, and the wave of more than a turn that stands out: a load behind a gear."""
    direction, both = directed
    hats, speed = _hats(theta[mask]), prepared.signals["omega"][prepared.keep][mask]
    highest = highest_over_position(theta[mask], speed, prepared.cutoff)
    periods, _ = strongest_periods([(values[mask], theta[mask])], highest, policy.STRONGEST)
    long = periods[periods > policy.SEVERAL_TURNS][:1]
    tried = max(1, int(np.ptp(theta[mask]) / policy.SEVERAL_TURNS)) if len(long) else 1

    def over(points: Array) -> Array:
        return np.hstack([hats(points), *(waves(2.0 * np.pi / one * points, (1,)) for one in long)])

    def draw(points: Array, sign: float) -> tuple[Array, Array]:
        along = np.full(len(points), sign)
        return _base(along, both), _apart(over(points), along, both)

    base, own = _base(direction, both), _apart(over(theta), direction, both)
    return Curve(TRAVEL, unit, theta, base, own, draw, tried, period=float(long[0]) if len(long) else 0.0)


def _smooth(
    name: str, unit: str, x: Array, direction: Array, mask: Mask, both: bool,
    basis: Callable[[Array], Callable[[Array], Array]],
) -> Curve | None:  # fmt: skip
    if float(np.ptp(x[mask])) <= 1e-9 * float(np.max(np.abs(x[mask]))):
        return None
    hats = basis(x[mask])

    def draw(points: Array, sign: float) -> tuple[Array, Array]:
        along = np.full(len(points), sign)
        return _base(along, both), _apart(hats(points), along, both)

    return Curve(name, unit, x, _base(direction, both), _apart(hats(x), direction, both), draw)


def _hats(x: Array, count: int = 7) -> Callable[[Array], Array]:
    """Hat functions between quantiles of `x`, half of them spread evenly over its range."""
    low, high = np.quantile(x, [0.002, 0.998])
    even = np.linspace(low, high, count)
    dense = np.quantile(x, np.linspace(0.0, 1.0, count))[1:-1]
    knots = np.unique(np.round(0.5 * (even[1:-1] + dense), 12)) if high > low else even[:1]
    knots = np.unique(np.concatenate([[low], knots, [high]]))

    def hats(points: Array) -> Array:
        return np.column_stack([np.interp(points, knots, row) for row in np.eye(len(knots))])

    return hats


def _drift(x: Array) -> Callable[[Array], Array]:
    middle, half = 0.5 * (x.max() + x.min()), 0.5 * (x.max() - x.min())

    def polynomials(points: Array) -> Array:
        z = (points - middle) / half
        return np.column_stack([z, z * z])

    return polynomials

"""Where a model fails: its residual against speed, direction, position, acceleration, current, temperature and time.

For every coordinate a smooth curve is fitted to the residual on some blocks of the log and judged on the others, so
that a share of explained variance is one that would hold on new data.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.identify.signals import Prepared

__all__ = ["Dependence", "Stretch", "Where", "coordinates", "where"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

BLOCKS = 16
GAP = 0.2  # s left out on either side of a block that is judged
SURE = 2.8  # standard errors by which the gain of left-out blocks must be above zero
UNITS = {
    "speed": ("rad/s", "m/s"), "direction": ("", ""), "position": ("rad", "m"), "acceleration": ("rad/s^2", "m/s^2"),
    "current": ("A", "A"), "temperature": ("degC", "degC"), "time": ("s", "s"),
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Dependence:
    """How much of the residual one coordinate explains.

    Attributes
    ----------
    share : float
        Of the residual's variance, on blocks left out; 0 when the curve does not hold there.
    errors : float
        Mean gain of the left-out blocks in its standard errors; above `SURE` it is significant.
    x, curve : array
        Coordinate in ascending order and the fitted residual there.
    largest : (float, float)
        Range of the coordinate in which the curve is above 70 % of its greatest size.
    """

    coordinate: str
    unit: str
    share: float
    errors: float
    x: Array
    curve: Array
    largest: tuple[float, float]

    @property
    def significant(self) -> bool:
        """Whether the dependence holds on blocks left out."""
        return self.errors > SURE


@dataclass(frozen=True)
class Stretch:
    """A stretch of time in which the model fails worst."""

    start: float
    stop: float
    rms: float


@dataclass(frozen=True, eq=False)
class Where:
    """The residual's dependences, the greatest first, and the worst stretches of time."""

    dependences: tuple[Dependence, ...]
    stretches: tuple[Stretch, ...]
    unit: str

    def sentence(self) -> str:
        """Say it in words."""
        sure = [d for d in self.dependences if d.significant and d.share > 0.02]
        if not sure:
            return "what is left depends on no coordinate of this log"
        first = sure[0]
        name = "speed and direction" if first.coordinate == "speed" else first.coordinate
        low, high = first.largest
        size = float(np.max(np.abs(first.curve)))
        return (
            f"{100 * first.share:.0f} % of what is left depends on {name}; it is largest between {low:.3g} and "
            f"{high:.3g} {first.unit}".rstrip()
            + f", up to {size:.2g} {self.unit}"
        )


def coordinates(prepared: Prepared) -> dict[str, Array]:
    """Return what a residual may depend on, each of shape (m,), on the thinned grid."""
    s, keep = prepared.signals, prepared.keep
    out = {
        "speed": s["omega"][keep],
        "direction": s["direction"][keep],
        "position": s["theta"][keep],
        "acceleration": prepared.column(prepared.alpha),
        "time": prepared.t[keep] - prepared.t[0],
    }
    if prepared.motion != "linear":
        out["position"] = np.mod(out["position"], 2.0 * np.pi)
    if "i_q" in s:
        out["current"] = s["i_q"][keep]
    if "temperature" in s and float(np.ptp(s["temperature"])) > 0.0:
        out["temperature"] = s["temperature"][keep]
    return out


def where(
    t: Array, residual: Array, mask: Mask, against: Mapping[str, Array], unit: str = "N m", motion: str = "rotary"
) -> Where:
    """Find what a residual depends on and when it is worst.

    Parameters
    ----------
    t, residual : array, shape (m,)
        Time in s and measured less predicted.
    mask : bool array, shape (m,)
        Samples that count.
    against : dict of coordinate to array, shape (m,)
        For instance `coordinates` of the prepared log.
    """
    tried = [_dependence(t[mask], residual[mask], name, values[mask], motion) for name, values in against.items()]
    found = [d for d in tried if d is not None]
    return Where(
        tuple(sorted(found, key=lambda d: -d.share)), _worst(t, residual, mask), unit
    )  # fmt: skip


def _dependence(t: Array, residual: Array, name: str, x: Array, motion: str) -> Dependence | None:
    columns = _curve_columns(name, x, motion)
    if columns.shape[1] < 2 or len(t) < 10 * columns.shape[1]:
        return None
    edges = np.linspace(t[0], t[-1] + 1e-9, BLOCKS + 1)
    gains, total = [], 0.0
    for start, stop in pairwise(edges.tolist()):
        test = (t >= start) & (t < stop)
        train = (t < start - GAP) | (t >= stop + GAP)
        if test.sum() < 5 or train.sum() < 5 * columns.shape[1]:
            continue
        mean = float(np.mean(residual[train]))
        fitted = columns[test] @ _least_squares(columns[train], residual[train])
        before, after = residual[test] - mean, residual[test] - fitted
        gains.append(float(before @ before - after @ after))
        total += float(before @ before)
    if len(gains) < 4 or total <= 0.0:
        return None
    values = np.array(gains)
    spread = float(values.std(ddof=1)) / np.sqrt(len(values))
    errors = float(values.mean()) / spread if spread > 0.0 else 0.0
    curve = columns @ _least_squares(columns, residual)
    order = np.argsort(x)
    size = np.abs(curve - np.mean(residual))
    strong = x[size >= 0.7 * size.max()]
    label = UNITS.get(name, ("", ""))[1 if motion == "linear" else 0]
    share = max(0.0, float(values.sum()) / total)
    return Dependence(name, label, share, errors, x[order], curve[order], (float(strong.min()), float(strong.max())))


def _curve_columns(name: str, x: Array, motion: str) -> Array:
    """A constant for either direction, harmonics of a turn, or hat functions between quantiles."""
    if name == "direction":
        return np.column_stack([x > 0.0, x < 0.0]).astype(np.float64)
    if name == "position" and motion != "linear":
        waves = [f(k * x) for k in range(1, 5) for f in (np.sin, np.cos)]
        return np.column_stack([np.ones_like(x), *waves])
    quantiles = np.quantile(x, np.linspace(0.0, 1.0, 9))
    top = float(np.quantile(np.abs(x), 0.99))
    close = top * np.array([-0.1, -0.03, -0.01, 0.01, 0.03, 0.1]) if name == "speed" else np.zeros(0)
    knots = np.unique(np.concatenate([quantiles, close[(close > x.min()) & (close < x.max())]]))
    if len(knots) < 3:
        return np.ones((len(x), 1))
    hats = np.column_stack([np.interp(x, knots, row) for row in np.eye(len(knots))])
    # dry friction jumps at zero speed
    return np.column_stack([hats, np.sign(x)]) if name == "speed" and x.min() < 0.0 < x.max() else hats


def _least_squares(columns: Array, values: Array) -> Array:
    gram = columns.T @ columns
    ridge = 1e-6 * np.trace(gram) / len(gram)
    return np.linalg.solve(gram + ridge * np.eye(len(gram)), columns.T @ values)


def _worst(t: Array, residual: Array, mask: Mask, count: int = 3) -> tuple[Stretch, ...]:
    """The worst of forty equal stretches of time, adjacent ones joined."""
    edges = np.linspace(t[0], t[-1] + 1e-9, 41)
    rms = np.zeros(40)
    for k in range(40):
        inside = mask & (t >= edges[k]) & (t < edges[k + 1])
        if inside.sum() >= 5:
            rms[k] = np.sqrt(np.mean(residual[inside] ** 2))
    chosen = sorted(np.argsort(rms)[::-1][:count].tolist())
    out: list[Stretch] = []
    for k in chosen:
        if rms[k] == 0.0:
            continue
        if out and abs(out[-1].stop - edges[k]) < 1e-9:
            last = out.pop()
            out.append(Stretch(last.start, float(edges[k + 1]), float(np.hypot(last.rms, rms[k]) / np.sqrt(2.0))))
        else:
            out.append(Stretch(float(edges[k]), float(edges[k + 1]), float(rms[k])))
    return tuple(sorted(out, key=lambda s: -s.rms))

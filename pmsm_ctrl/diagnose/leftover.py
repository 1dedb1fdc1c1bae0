"""What nothing in the catalogue explains: does the residual still depend on a coordinate, on blocks left out?"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.compare.blocks import holm
from pmsm_ctrl.diagnose.columns import Group
from pmsm_ctrl.diagnose.evidence import blocked_gain, f_tail
from pmsm_ctrl.diagnose.orders import order_spectrum
from pmsm_ctrl.diagnose.record import Record
from pmsm_ctrl.diagnose.selection import BLOCK_ERRORS, SIGNIFICANCE, Fitted

__all__ = ["Leftover", "leftover"]

Array = NDArray[np.float64]

# A curve that no effect stands behind has to explain more than an effect before it is worth a word.
MATERIAL = 0.01


@dataclass(frozen=True, eq=False)
class Leftover:
    """A dependence that is left, fitted by a smooth curve as a stopgap.

    Attributes
    ----------
    coordinate : str
    channel : str
        The balance it shows in.
    share : float
        Part of the residual's variance that the curve explains.
    curve : (array, array)
        Coordinate and residual, SI units.
    """

    coordinate: str
    channel: str
    share: float
    p_value: float
    text: str
    curve: tuple[Array, Array]


@dataclass(frozen=True, eq=False)
class _Tested:
    """One coordinate with its curve's columns, significance and size."""

    coordinate: str
    row: int
    x: Array
    values: Array
    p_value: float
    share: float
    material: float
    direction: Array


def leftover(fit: Fitted) -> Leftover | None:
    """Return the coordinate that what is left depends on most; None when it depends on none."""
    found = []
    for coordinate, row, x, columns in _coordinates(fit):
        values = np.zeros((*fit.record.target.shape, columns.shape[1]))
        values[row] = columns
        tested = _tested(fit, coordinate, row, x, values)
        if tested is not None:
            found.append(tested)
    corrected = holm([f.p_value for f in found])
    for one, p in sorted(zip(found, corrected, strict=True), key=lambda pair: -pair[0].share):
        if p > SIGNIFICANCE or one.material < MATERIAL:
            continue
        group = Group(None, tuple(f"c{k}" for k in range(one.values.shape[-1])), one.values, {})
        mean, stderr, _, p_rank = blocked_gain(fit.record, fit.solved, fit.whitener, group, one.direction)
        if mean > BLOCK_ERRORS * stderr or (p_rank < 0.5 * SIGNIFICANCE and mean > 0.0):
            return _described(fit, one, p)
    return None


def _coordinates(fit: Fitted) -> Iterator[tuple[str, int, Array, Array]]:
    rec = fit.record
    s = rec.signals
    omega, alpha = rec.at_grid(s["omega"]), rec.shaped(s["alpha"])
    current = rec.shaped(s["i_q"])
    for row, name in enumerate(rec.channels):
        if name != "torque" and row == 0:
            continue
        yield "speed", row, omega, _speed_hats(omega, rec.mask)
        yield "current", row, current, _hats(current, rec.mask, 8)
        if name == "torque":
            yield "acceleration", row, alpha, _hats(alpha, rec.mask, 8)
            since = _since_reversal(rec)
            columns = _hats(np.log(since), rec.mask, 8) * np.sign(omega)[:, None]
            yield "the distance since the last reversal", row, since, columns
            yield "time since start", row, rec.t, _hats(rec.t, rec.mask, 8)
            if "temperature" in s and np.ptp(s["temperature"]) > 0.0:
                warm = rec.at_grid(s["temperature"])
                yield "temperature", row, warm, _hats(warm, rec.mask, 5)
            if not rec.linear:
                yield from _turns(fit, row)


def _turns(fit: Fitted, row: int) -> Iterator[tuple[str, int, Array, Array]]:
    """Harmonics of the angle, alone and with the direction."""
    rec = fit.record
    theta, direction = rec.signals["theta"], rec.signals["direction"]
    _, score = order_spectrum(rec, fit.residual[row])
    orders = sorted({1, 2, *(int(k) + 1 for k in np.argsort(score)[::-1][:3])})
    waves = [f(k * theta) for k in orders for f in (np.sin, np.cos)]
    columns = np.column_stack([rec.shaped(w) for w in waves] + [rec.shaped(w * direction) for w in waves[:4]])
    yield f"position (orders {', '.join(map(str, orders))})", row, np.mod(rec.at_grid(theta), 2.0 * np.pi), columns


def _speed_hats(omega: Array, mask: NDArray[np.bool_]) -> Array:
    """Hat functions of speed, close together near zero and apart for both directions."""
    top = float(np.quantile(np.abs(omega[mask]), 0.999))
    knots = top * np.geomspace(0.01, 1.0, 7)
    knots = np.concatenate([-knots[::-1], knots])
    columns = np.column_stack([np.interp(omega, knots, np.eye(len(knots))[k]) for k in range(len(knots))])
    return columns[:, np.any(columns[mask] > 0.0, axis=0)]


def _since_reversal(record: Record) -> Array:
    """Distance travelled since the direction last changed, on the thinned grid."""
    theta, omega = record.signals["theta"], record.signals["omega"]
    turned = np.concatenate([[False], np.sign(omega[1:]) * np.sign(omega[:-1]) < 0.0])
    last = np.maximum.accumulate(np.where(turned, np.arange(len(theta)), 0))
    return np.maximum(record.at_grid(np.abs(theta - theta[last])), 1e-9)


def _hats(x: Array, mask: NDArray[np.bool_], count: int) -> Array:
    knots = np.unique(np.quantile(x[mask], np.linspace(0.0, 1.0, count)))
    if len(knots) < 3:
        return np.zeros((len(x), 1))
    return np.column_stack([np.interp(x, knots, np.eye(len(knots))[k]) for k in range(len(knots))])


def _tested(fit: Fitted, coordinate: str, row: int, x: Array, values: Array) -> _Tested | None:
    gains = []
    for solved, whitener in ((fit.solved, fit.whitener), (fit.plain, fit.weights)):
        z = whitener(values)
        z = np.vstack([z, np.zeros((len(solved.rest) - solved.rows, z.shape[1]))])
        size = np.linalg.norm(z, axis=0)
        z = z[:, size > 0.0] / size[size > 0.0]
        z -= solved.q @ (solved.q.T @ z)
        u, sing, _ = np.linalg.svd(z, full_matrices=False)
        u = u[:, sing > 0.03]
        if u.shape[1] == 0:
            return None
        along = u.T @ solved.rest
        gains.append((float(along @ along), u.shape[1], u @ along))
    gain, k, direction = gains[0]
    p = f_tail(gain / k, k, max(fit.solved.rows - fit.solved.q.shape[1] - k, 1))
    used = fit.whitener.channel == row
    plain = gains[1][2][: fit.plain.rows][used]
    rest = fit.plain.rest[: fit.plain.rows][used]
    part = np.sort(np.abs(plain))[-max(10, len(plain) // 10) :] * fit.whitener.sigma[row]
    level = np.sqrt(np.mean((fit.record.target[row] * fit.record.weight[row])[fit.record.mask] ** 2))
    share = float(plain @ plain / max(rest @ rest, 1e-300))
    material = float(np.sqrt(np.mean(part**2)) / max(level, 1e-300))
    return _Tested(coordinate, row, x, values, p, share, material, direction)


def _described(fit: Fitted, one: _Tested, p: float) -> Leftover:
    rec, row = fit.record, one.row
    w = rec.weight[row] * rec.mask
    a = one.values[row] * w[:, None]
    curve = one.values[row] @ np.linalg.lstsq(a, fit.residual[row] * w, rcond=1e-6)[0]
    order = np.argsort(one.x[rec.mask])
    xs, ys = one.x[rec.mask][order], curve[rec.mask][order]
    peak = xs[int(np.argmax(np.abs(ys)))]
    name = rec.channels[row]
    text = (
        f"{100 * one.share:.0f} % of what is left of the {name} balance depends on {one.coordinate}, up to "
        f"{np.max(np.abs(ys)):.2g} {rec.unit(name)} near {peak:.3g}; no effect of the catalogue explains it"
    )
    return Leftover(one.coordinate, name, one.share, p, text, (xs, ys))

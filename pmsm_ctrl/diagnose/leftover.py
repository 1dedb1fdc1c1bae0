"""What nothing in the catalogue explains: does the residual still depend on a coordinate, on blocks left out?

Or else, does an effect that was refused explain far more of it than noise would let it? Or is little left only because
the winding took it up, with a value that no motor of that datasheet has?
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.compare.dependence import Dependence, where
from pmsm_ctrl.diagnose.fit import Fitted
from pmsm_ctrl.diagnose.gates import ABSURD, MATERIAL, UNSTEADY, name_of
from pmsm_ctrl.diagnose.selection import Selection
from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.regression.model import MOST_NOISE, noise_share
from pmsm_ctrl.units import axis_unit

__all__ = ["Leftover", "leftover", "resembled", "stands_in"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# What the aliased edges of the torque do to a sample of so little weight no curve has to explain.
SOUND = 0.5
# Least share of what is left that is worth a word: with the edges left out, less than `compare` asks for.
WORTH = 0.015
# Share of what is left that a refused effect must explain, and how surely, for something to be missing all the same.
# On 30 clean logs of two simulators no refused effect went beyond 0.3 % and 1e-8; aliased edges may make it 3 %.
GLARING, CERTAIN = 0.03, 1e-12
# A winding taken for another one: standard errors that it must be off its datasheet, and the least tolerance of that,
# because copper that is hot, or measured between two phases, is one and a half times or twice the design's.
UNDOUBTED, DATASHEET = 4.0, 0.15
# What is left around reversals over what is left elsewhere, rms, from which on it is said to sit there.
TURNING = 1.5
FEWEST = 4  # samples whose mean is drawn
# What a voltage acts like that a parameter of the winding takes up, and the parameter's unit.
LIKENESS = {"R": ("a resistance", "Ohm"), "L_d": ("an inductance", "H"), "L_q": ("an inductance", "H")}


@dataclass(frozen=True, eq=False)
class Leftover:
    """A dependence that is left, fitted by a smooth curve as a stopgap.

    Attributes
    ----------
    coordinate, unit : str
    channel : str
        The balance it shows in.
    share : float
        Part of the residual's mean square that the curve explains, on blocks of time left out; or else the effect
        that it resembles.
    curve : (array, array, array)
        Coordinate, and fitted residual moving forward and backward, SI units; means where nothing was fitted.
    resembles : str
        The effect, or the part of the winding, that it resembles without being it; empty where a curve was fitted.
    """

    coordinate: str
    unit: str
    channel: str
    share: float
    p_value: float
    text: str
    curve: tuple[Array, Array, Array]
    resembles: str = ""


def leftover(fit: Fitted) -> Leftover | None:
    """Return the coordinate that what is left depends on most; None when it depends on none."""
    record, plain = fit.record, fit.plain
    predicted = plain.predicted()
    J = float(plain.values[plain.model.names.index("J")])
    per_ampere = record.design.K_t_assumed if "i_q" in record.prepared.signals else None
    acceleration = plain.model.matrix[0][:, plain.model.names.index("J")]
    # the noise of the angle stands in the acceleration and in the residual alike
    skipped = ("acceleration",) if noise_share(record, acceleration) > MOST_NOISE else ()
    found: list[tuple[Dependence, str, str]] = []
    for row, name in enumerate(record.channels):
        sound = record.mask & (record.weight[row] > SOUND)
        if int(sound.sum()) < 100:
            continue
        level = float(np.sqrt(np.mean(record.target[row][sound] ** 2)))
        # a small voltage is known no better than the whole: a frame askew by 4 mrad mixes so much of it in
        whole = float(np.sqrt(np.mean(record.target[1:, sound] ** 2) * 2.0)) if name != "torque" else level
        what = where(
            record.prepared, record.target[row], predicted[row], sound, record.unit(name), predicted[0], J,
            per_ampere, WORTH, max(MATERIAL * whole, record.coarse[row]) / max(level, 1e-300), skipped,
        )  # fmt: skip
        if what.named:
            found.append((what.named[0], name, what.sentence()))
    if not found:
        return None
    one, name, sentence = max(found, key=lambda f: f[0].added)
    balance = record.drive if name == "torque" else name
    text = f"{sentence.replace('of what is left', f'of what is left of the {balance} balance', 1)}; no effect of the "
    text += "catalogue explains it"
    return Leftover(one.name, one.unit, name, one.added, one.p_value, text, (one.x, one.forward, one.backward))


def resembled(selection: Selection) -> Leftover | None:
    """Return what is left where a refused effect explains far too much of it for noise; None where none does.

    The effect itself was refused for a reason: it is not what is missing, but something like it is.
    """
    fit = selection.fits[-1]
    total = fit.solved.chi2
    glaring = [
        t
        for t in fit.trials
        if t.gain > GLARING * total and t.p_value < CERTAIN
        and selection.refused.get(name_of(t), "").startswith(UNSTEADY)
    ]  # fmt: skip
    if not glaring:
        return None
    best = max(glaring, key=lambda t: t.gain)
    name, share = name_of(best), best.gain / total
    record = fit.record
    row = _where_it_enters(fit, best.plain_direction)
    ratio, curve = _around_reversals(fit, row)
    where_it_is, coordinate, unit = "", "time since the reversal", "s"
    if ratio > TURNING:
        where_it_is = f" and {ratio:.2g} times as large around reversals as elsewhere"
    else:
        coordinate, unit = "acceleration", axis_unit("rad/s^2", record.prepared.motion)
        curve = _over(record.at_grid(record.signals["alpha"]), record, fit.residual[row])
    text = (
        f"what is left is not noise{where_it_is}: {name} would explain {100 * share:.0f} % of it, but "
        f"{selection.refused[name]}; no effect of the catalogue explains it"
    )
    return Leftover(coordinate, unit, record.channels[row], share, best.p_value, text, curve, name)


def stands_in(fit: Fitted) -> Leftover | None:
    """Return the voltage that a parameter of the winding takes up far beyond its datasheet; None where none does.

    A dead time left out is as well a resistance of four times the datasheet's: nothing is left then, and yet no motor
    of that datasheet explains the log.
    """
    plain, record = fit.plain, fit.record
    names = [name for name in LIKENESS if name in plain.model.names]
    places = np.array([plain.model.names.index(name) for name in names], dtype=np.intp)
    off = (plain.values - plain.model.nominal)[places]
    tolerance = np.maximum(plain.model.sigma, DATASHEET * plain.model.nominal)[places]
    far = (off / tolerance) ** 2
    surely = np.abs(off) / plain.stderr[places]
    far[surely < UNDOUBTED] = 0.0
    if not np.any(far > ABSURD):
        return None
    best = int(np.argmax(far))
    name, k = names[best], int(places[best])
    taken = plain.model.matrix[:, :, k] * off[best]
    rows = range(1, len(record.channels))
    row = max(rows, key=lambda r: float(np.sum(taken[r][record.mask] ** 2)))
    with_it = fit.residual[row] + taken[row]
    share = 1.0 - float(np.mean(fit.residual[row][record.mask] ** 2) / np.mean(with_it[record.mask] ** 2))
    like, unit = LIKENESS[name]
    value, nominal = float(plain.values[k]), float(plain.model.nominal[k])
    text = (
        f"{name} would have to be {value:.3g} {unit}, {value / nominal:.2g} times its nominal value: the winding is "
        f"another one, or a voltage that acts like {like} is missing; no effect of the catalogue explains it"
    )
    over = record.at_grid(record.signals["i_d" if name == "L_d" else "i_q"])
    curve = _over(over, record, with_it)
    p = math.erfc(float(surely[best]) / math.sqrt(2.0))
    return Leftover("current", "A", record.channels[row], max(share, 0.0), p, text, curve, like)


def _where_it_enters(fit: Fitted, direction: Array) -> int:
    """Return the balance in which an effect explains most, of its whitened `direction`."""
    power = direction[: fit.plain.rows] ** 2
    return int(np.argmax(np.bincount(fit.weights.channel, weights=power, minlength=len(fit.record.channels))))


def _around_reversals(fit: Fitted, row: int) -> tuple[float, tuple[Array, Array, Array]]:
    """Return the rms around reversals over that elsewhere, and the residual over the time since the reversal."""
    record = fit.record
    omega, t = record.signals["omega"], record.prepared.t
    turns = np.flatnonzero(np.diff(np.sign(omega)) != 0.0)
    reach = 2.0 / record.prepared.cutoff
    grid = record.t
    if len(turns) == 0:
        return 0.0, (np.zeros(0),) * 3
    after = np.clip(np.searchsorted(t[turns], grid), 1, len(turns)) - 1
    before = np.minimum(after + 1, len(turns) - 1)
    nearest = np.where(np.abs(grid - t[turns[after]]) < np.abs(grid - t[turns[before]]), after, before)
    since = grid - t[turns[nearest]]
    weight = (record.weight[row] * record.mask) ** 2
    near = np.abs(since) < reach
    square = fit.residual[row] ** 2
    powers = [float(np.sum(weight[s] * square[s]) / max(float(np.sum(weight[s])), 1e-300)) for s in (near, ~near)]
    edges = np.linspace(-reach, 2.0 * reach, 31)
    forward = np.sign(omega[turns[nearest] + 1]) > 0.0
    curve = _means(since, fit.residual[row], forward, record.mask, edges)
    return float(np.sqrt(powers[0] / max(powers[1], 1e-300))), curve


def _over(x: Array, record: Record, residual: Array) -> tuple[Array, Array, Array]:
    low, high = np.quantile(x[record.mask], [0.002, 0.998])
    edges = np.linspace(low, high, 26)
    forward = record.at_grid(record.signals["omega"]) > 0.0
    return _means(x, residual, forward, record.mask, edges)


def _means(x: Array, residual: Array, forward: Mask, used: Mask, edges: Array) -> tuple[Array, Array, Array]:
    """Return the middles of the bins between edges, and the mean residual in each, moving forward and backward."""
    sides = []
    for side in (forward, ~forward):
        here = used & side & (x >= edges[0]) & (x <= edges[-1])
        place = np.clip(np.searchsorted(edges, x[here], side="right") - 1, 0, len(edges) - 2)
        count = np.bincount(place, minlength=len(edges) - 1)
        total = np.bincount(place, weights=residual[here], minlength=len(edges) - 1)
        sides.append(np.divide(total, count, out=np.full(len(count), np.nan), where=count >= FEWEST))
    return 0.5 * (edges[1:] + edges[:-1]), sides[0], sides[1]

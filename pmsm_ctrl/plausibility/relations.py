"""The physics of a drive as a few small regressions: what the log says of J, R, psi_f and the cross-coupling.

Each coefficient is set against the design's number. Standard errors are of the sandwich kind over stretches of time,
so that a residual which is correlated, or no noise at all, does not make them small.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.design_parts import Motor
from pmsm_ctrl.plausibility.bins import Bins
from pmsm_ctrl.plausibility.policy import POLICY
from pmsm_ctrl.regression.reversals import REACHES, bend

__all__ = [
    "BOXES", "WIDE", "Evidence", "Fit", "Ratio", "bristle_balance", "evidence_of", "fitted", "moved", "torque_balance",
    "voltage_balances", "weight_balance",
]  # fmt: skip

Array = NDArray[np.float64]

STRETCHES = 24  # of time, over which the scatter of the products is taken
SLOW = 0.03  # of the 99 % quantile of the speed: friction is set-valued below
LITTLE_REST = 0.05  # share of a window at rest that a reversal takes
FEW = 0.25  # of the windows that move, below which all of them count
FEWEST = 60  # rows of a regression
STEADY = 0.25  # of a speed that a window four times as wide leaves at least
RANK = 1e-8  # smallest eigenvalue over the largest one of a regression's products
TOLD = 0.99  # share of a coefficient's direction that the log has to tell
BIASED = 0.5  # share of what is left that may act along a column
REFINED = 5  # times the grid of the springs is halved about the best one
BOXES = 4  # bins of a window's boxes, 20 ms at 5 ms
WIDE = 16  # of a window in which even a coarse angle has an acceleration


@dataclass(frozen=True)
class Ratio:
    """A coefficient of the log over the design's number.

    Attributes
    ----------
    value, stderr : float
    """

    value: float
    stderr: float


@dataclass(frozen=True, eq=False)
class Fit:
    """A regression: coefficients, standard errors, and the share of the target's power that it leaves.

    Attributes
    ----------
    names : tuple of str
    values, stderr : array, shape (k,)
    left : float
        0 to 1.
    own : array, shape (k,)
        Share of the target's power that falls back to the residual without the column.
    power : float
        Mean square of the target.
    """

    names: tuple[str, ...]
    values: Array
    stderr: Array
    left: float
    own: Array
    power: float

    def value(self, name: str) -> float:
        """Return a coefficient; 0 without the column."""
        return float(self.values[self.names.index(name)]) if name in self.names else 0.0

    def ratio(self, name: str, over: float) -> Ratio | None:
        """Return a coefficient over the design's number; None without the column."""
        if name not in self.names or not over:
            return None
        k = self.names.index(name)
        # what is left may be correlated with the column: as much of it as the column itself makes is not known better
        bias = BIASED * abs(float(self.values[k])) * math.sqrt(self.left / max(float(self.own[k]), 1e-12))
        return Ratio(float(self.values[k]) / over, math.hypot(float(self.stderr[k]), bias) / abs(over))


def fitted(target: Array, columns: Mapping[str, Array], used: NDArray[np.bool_] | None = None) -> Fit | None:
    """Regress on the columns that vary; None where too few rows are usable.

    Parameters
    ----------
    target : array, shape (m,)
    columns : mapping of str to array, shape (m,)
    used : bool array, shape (m,), optional
    """
    good = np.isfinite(target) if used is None else used & np.isfinite(target)
    for values in columns.values():
        good = good & np.isfinite(values)
    rows = int(good.sum())
    if rows < FEWEST:
        return None
    sizes = {name: float(np.sqrt(np.mean(values[good] ** 2))) for name, values in columns.items()}
    names = tuple(name for name, size in sizes.items() if size > 0.0)
    a = np.column_stack([columns[name][good] / sizes[name] for name in names])
    b = target[good]
    power = float(b @ b)
    if not names or not power > 0.0:
        return None
    gram = a.T @ a / rows
    powers, directions = np.linalg.eigh(gram)
    kept = powers > RANK * powers[-1]
    told = directions[:, kept]
    inverse = told / powers[kept] @ told.T
    apart = np.sum(told**2, axis=1) > TOLD  # else only its sum with another coefficient is known
    values = inverse @ (a.T @ b) / rows
    rest = b - a @ values
    edges = np.linspace(0, rows, STRETCHES + 1).astype(int)
    scores = np.add.reduceat(a * rest[:, None], edges[:-1], axis=0)
    cov = inverse @ (scores.T @ scores) @ inverse / rows**2
    scale = np.array([sizes[name] for name in names])
    own = values**2 / np.maximum(np.diag(inverse), 1e-300) * rows / power
    stderr = np.where(apart, np.sqrt(np.diag(cov)) / scale, np.inf)
    return Fit(names, values / scale, stderr, float(rest @ rest) / power, own, power / rows)


def torque_of(design: Design, channels: Mapping[str, Array]) -> Array | None:
    """Return the drive torque, N m, shape (m,); None without a torque and a current."""
    if "torque" in channels:
        return channels["torque"]
    if "i_q" not in channels:
        return None
    motor = design.motor
    reluctance = 0.0
    if motor.p is not None and motor.L_d is not None and motor.L_q is not None and "i_d" in channels:
        reluctance = 1.5 * motor.p * (motor.L_d - motor.L_q)
    return np.asarray(design.K_t_assumed * channels["i_q"] + reluctance * channels.get("i_d", 0.0) * channels["i_q"])


def moved(bins: Bins, boxes: int = BOXES) -> tuple[Array, Array] | None:
    """Return speed and acceleration in a window, shape (m,); None without a channel, or where nothing but noise moves.

    The speed that noise makes falls eightfold with a window four times as wide; that of a motion stays.
    """
    name = next((name for name in ("theta", "omega") if name in bins.channels), None)
    if name is None:
        return None
    of = bins.motion if name == "theta" else bins.speed
    for size in {BOXES, WIDE, boxes} - bins.motions.keys():
        bins.motions[size] = of(bins.channels[name], size)
    narrow, wide = (float(np.sqrt(np.nanmean(bins.motions[size][0] ** 2))) for size in (BOXES, WIDE))
    return bins.motions[boxes] if wide > STEADY * narrow else None


def moving(omega: Array) -> NDArray[np.bool_]:
    """Return where the axis is not about at rest, shape (m,)."""
    size = np.abs(omega)
    known = size[np.isfinite(size)]
    top = float(np.quantile(known, 0.99)) if known.size else 0.0
    return np.asarray(size > SLOW * top)


def torque_balance(bins: Bins, torque: Array, boxes: int = BOXES, lag: int = 0) -> Fit | None:
    """Regress the torque, taken `lag` bins later, on acceleration, friction and a small delay."""
    motion = moved(bins, boxes)
    return None if motion is None else _balance(bins, motion, _sliding(bins, boxes), bins.smooth(torque, boxes), lag)


def weight_balance(bins: Bins, torque: Array, angle: Array, boxes: int, lag: int) -> Fit | None:
    """Regress the torque on the weight of an arm as well.

    Parameters
    ----------
    bins : Bins
    torque : array, shape (m,)
    angle : array, shape (n,)
        Of the log that the bins were made of, rad.
    boxes, lag : int
    """
    motion = moved(bins, boxes)
    if motion is None:
        return None
    waves = {"sin": np.sin(angle), "cos": np.cos(angle)}
    beside = {name: bins.smooth(bins.means(wave), boxes) for name, wave in waves.items()}
    return _balance(bins, motion, _sliding(bins, boxes), bins.smooth(torque, boxes), lag, beside=beside)


def _sliding(bins: Bins, boxes: int) -> NDArray[np.bool_]:
    """Return the windows in which the axis moves from end to end, shape (m,).

    Friction at rest is whatever holds the axis: a window that holds some of it has less than F_c in its mean, which
    looks like a late torque where the axis stops and starts. Where nearly every window holds some, all that move count.
    """
    motion, closer = moved(bins, boxes), moved(bins, 1)
    if motion is None or closer is None:
        return np.zeros(len(bins.t), dtype=np.bool_)
    known = np.isfinite(closer[0])
    rest = (known & ~moving(closer[0])).astype(np.float64)
    fast = moving(motion[0])
    free = fast & (bins.smooth(rest, boxes) < LITTLE_REST)
    return free if free.sum() > FEW * fast.sum() else fast


def bristle_balance(bins: Bins, torque: Array, angle: Array) -> Fit | None:
    """Regress the torque, in time, on acceleration and the friction of a spring that slides, as a whole or in part.

    The best spring is sought closely: where friction is most of the torque, one that reaches a tenth too far leaves
    more than a delay does.

    Parameters
    ----------
    bins : Bins
    torque : array, shape (m,)
    angle : array, shape (n,)
        Of the log that the bins were made of.
    """
    motion = moved(bins)
    if motion is None:
        return None
    used, seen = _sliding(bins, BOXES), bins.smooth(torque, BOXES)
    found: dict[tuple[float, float], Fit] = {}

    def tried(share: float, elastic: float) -> None:
        side = bins.smooth(bins.means(bend(angle, share, elastic)), BOXES)
        if (fit := _balance(bins, motion, used, seen, 0, side=side)) is not None:
            found[share, elastic] = fit

    for elastic in (0.0, 1.0):
        for share in REACHES.tolist():
            tried(share, elastic)
    further, more = float(REACHES[1] / REACHES[0]), 1.0
    for _ in range(REFINED if found else 0):
        further, more = math.sqrt(further), 0.5 * more
        share, elastic = min(found, key=lambda one: found[one].left)
        for near in ((share / further, elastic), (share * further, elastic)):
            tried(*near)
        share, elastic = min(found, key=lambda one: found[one].left)
        for near in ((share, max(elastic - more, 0.0)), (share, min(elastic + more, 1.0))):
            tried(*near)
    return min(found.values(), key=lambda fit: fit.left, default=None)


def _balance(
    bins: Bins, motion: tuple[Array, Array], used: NDArray[np.bool_], torque: Array, lag: int, step: int = 1,
    side: Array | None = None, beside: Mapping[str, Array] | None = None,
) -> Fit | None:  # fmt: skip
    """Regress a torque in windows, taken `lag` bins later; every `step`-th of the used windows takes part.

    With `side` the dry friction follows it in place of the direction, and the torque is in time.
    """
    omega, alpha = motion
    y = np.roll(torque, -lag)
    if lag:
        y[: max(0, -lag)] = y[len(y) - max(0, lag) :] = np.nan
    columns = {"J": alpha, "F_v": omega, "constant": np.ones_like(y), **(beside or {})}
    if side is None:
        columns |= {"F_c": np.sign(np.where(used, omega, 0.0)), "late": np.gradient(y, bins.width)}
    else:
        columns["F_c"] = side
    return fitted(y[::step], {name: values[::step] for name, values in columns.items()}, used[::step])


def voltage_balances(
    bins: Bins, motor: Motor, names: Sequence[str] = ("u_d", "u_q", "i_d", "i_q")
) -> dict[str, Fit | None]:
    """Regress u_d and u_q on the winding; `names` are the channels that stand for them.

    Most drives keep i_d at zero: that stands for one that is not logged. A constant i_d adds to the flux linkage of the
    magnet, and no log tells the two apart: the design's inductance says how much of it that is.
    """
    assert motor.p is not None
    have = {"i_d": np.zeros_like(bins.t), **bins.channels}
    if any(name not in have for name in names):
        return {}
    motion = moved(bins, BOXES)
    if motion is None:
        return {}
    omega, alpha = motion
    u_d, u_q, i_d, i_q = (bins.smooth(have[name], BOXES) for name in names)
    w = motor.p * omega
    power = np.where(np.isfinite(w * i_d), w**2, 0.0)
    usual = float(np.nansum(power * i_d)) / max(float(power.sum()), 1e-300)
    share = 1.0 + usual * (motor.L_d or 0.0) / motor.psi_f if motor.psi_f else 1.0
    d = {"R": i_d, "X": -w * i_q, "L": np.gradient(i_d, bins.width), "tilt": w}
    q = {"R": i_q, "psi_f": share * w, "X": w * (i_d - usual), "L": np.gradient(i_q, bins.width)}
    q["u_0"] = np.ones_like(w)
    q["late"] = motor.p * alpha  # of a motion that is late or early the back-emf holds some acceleration, as i_q does
    return {"d": fitted(u_d, d), "q": fitted(u_q, q)}


@dataclass(frozen=True, eq=False)
class Evidence:
    """The regressions of one log.

    Attributes
    ----------
    design : Design
    bins : Bins
    torque : array, shape (m,), or None
        N m (N).
    channel : str
        Where the torque comes from.
    narrow, wide : Fit or None
        The torque's balance in windows of `BOXES` and of `WIDE` bins.
    lag : int
        Bins by which the torque is late in them.
    voltages : mapping of "d" and "q" to Fit or None
    """

    design: Design
    bins: Bins
    torque: Array | None
    channel: str
    narrow: Fit | None
    wide: Fit | None
    lag: int
    voltages: Mapping[str, Fit | None]

    @property
    def from_current(self) -> bool:
        """Whether the torque was computed from the currents."""
        return self.channel == "i_q"

    @property
    def ratios(self) -> dict[str, Ratio]:
        """What the log says over what the design says: J, R, psi_f and the cross-coupling X."""
        motor = self.design.motor
        d, q = self.voltages.get("d"), self.voltages.get("q")
        torque = min((f for f in (self.narrow, self.wide) if f is not None), key=lambda f: f.left, default=None)
        found = {
            "J": torque.ratio("J", self.design.J) if torque else None,
            "R": q.ratio("R", motor.R or 0.0) if q else None,
            "psi_f": q.ratio("psi_f", motor.psi_f or 0.0) if q else None,
            "X": d.ratio("X", motor.L_q or 0.0) if d else None,
        }
        return {name: ratio for name, ratio in found.items() if ratio is not None and np.isfinite(ratio.stderr)}


def evidence_of(design: Design, bins: Bins) -> Evidence:
    """Fit the torque's balance, at the lag that explains it best, and those of the voltages."""
    torque = torque_of(design, bins.channels)
    channel = "torque" if "torque" in bins.channels else "i_q"
    narrow = wide = None
    lag = 0
    if torque is not None:
        narrow = torque_balance(bins, torque)
        lag = _best_lag(bins, torque, narrow)
        if lag:
            narrow = torque_balance(bins, torque, BOXES, lag)
        wide = torque_balance(bins, torque, WIDE, lag)
    voltages = voltage_balances(bins, design.motor) if design.motor.p is not None else {}
    return Evidence(design, bins, torque, channel, narrow, wide, lag, voltages)


def _best_lag(bins: Bins, torque: Array, now: Fit | None) -> int:
    """Return the bins by which the torque has to be moved; 0 unless that explains far more of it."""
    longest, motion = int(POLICY.longest_lag / bins.width), moved(bins, BOXES)
    if now is None or motion is None or now.left < POLICY.well or len(torque) < 20 * longest:
        return 0
    seen, used = bins.smooth(torque, BOXES), _sliding(bins, BOXES)
    best, least = 0, POLICY.late_gain * now.left
    for lag in (*range(-longest // 4, 0), *range(1, longest + 1)):
        fit = _balance(bins, motion, used, seen, lag, BOXES)
        if fit is not None and fit.left < least and fit.value("J") > 0.0:
            best, least = lag, fit.left
    return best

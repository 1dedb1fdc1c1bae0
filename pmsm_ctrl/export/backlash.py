"""Backlash from logs with an encoder at the motor and one at the load, as the fields of drives.

While the motor pushes the load one way or the other, the difference of both angles rests on one flank or on the other.
Their distance is the backlash. A twist in proportion to the load's acceleration and a difference of the encoders'
scales are fitted beside it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.export.blocks import identifier
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.joining import parts_of, with_records
from pmsm_ctrl.regression.timing import uniform, unwrapped

__all__ = ["Backlash", "backlash_files", "measured_backlash"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

BOTH = frozenset({"theta", "theta_load"})
SMOOTHING = 0.02  # s, of the load's speed and acceleration
SLOWEST = 0.05  # share of the largest speed below which the load is at rest: there it lies anywhere between the flanks
ROUNDS = 6  # of sorting the samples by flank and fitting again
FEWEST = 2  # changes of the flank
RAREST = 0.05  # share of the samples on the flank that is touched less
# Share of the samples in the middle half. With flanks it is that of the crossings; of one cluster that was cut into
# halves a third lies there.
BETWEEN = 0.15
CLEAR = 3.0  # standard errors
SPREAD = 4.0  # medians of the distance to the flank beyond which a sample is on its way between them
STEPS = 3.0  # of both encoders, which a backlash has to exceed
BLOCKS = 12  # one of which is left out at a time
LARGEST = 32767  # of a signed number of 16 bits


@dataclass(frozen=True)
class Backlash:
    """The distance of the flanks of a transmission.

    Attributes
    ----------
    width : float
        At the motor's scale, rad (m).
    stderr : float
    changes : int
        Times that the flank changed.
    leading : float
        Share of the moving samples in which the motor leads in the direction of motion.
    left : float
        Rms distance from the flank of the samples that rest on one, rad (m).
    """

    width: float
    stderr: float
    changes: int
    leading: float
    left: float

    @property
    def follows_direction(self) -> bool:
        """Whether the flank changes where the direction of motion does, as compensations assume."""
        return not 0.1 < self.leading < 0.9


@dataclass(frozen=True, eq=False)
class _Flanks:
    """The moving samples of all records: difference of the angles, columns beside the flank, and what moves the load.

    Attributes
    ----------
    apart : array, shape (n,)
    beside : array, shape (n, m)
        A constant of each record, the load's acceleration, its angle.
    direction, push : array, shape (n,)
        Signs of the load's speed and acceleration.
    record : array of int, shape (n,)
    step : float
        Steps of both encoders together, rad (m).
    """

    apart: Array
    beside: Array
    direction: Array
    push: Array
    record: NDArray[np.intp]
    step: float

    def fit(self, flank: Array, used: Mask | None = None) -> tuple[float, Array]:
        """Return the distance of the flanks, and the difference of the angles from their middle, shape (n,)."""
        columns = np.column_stack([0.5 * flank, self.beside])
        size = np.linalg.norm(columns, axis=0)
        scaled = columns / np.where(size > 0.0, size, 1.0)
        keep = slice(None) if used is None else used
        found = np.linalg.lstsq(scaled[keep], self.apart[keep], rcond=1e-9)[0]
        return float(found[0] / size[0]), self.apart - scaled[:, 1:] @ found[1:]

    def sorted_by_flank(self, start: Array) -> tuple[float, Array, Array]:
        """Return the distance, the distances from the middle, and the flank of each sample, from a first guess of it.

        A push and a travel over the flanks' middle are the same: the motor leads on the one flank, not on the other.
        """
        flank = start
        width, off = self.fit(flank)
        for _ in range(ROUNDS):
            flank = np.where(off >= 0.0, 1.0, -1.0)
            if abs(float(flank.sum())) == len(flank):
                break
            width, off = self.fit(flank, self.resting(width, off, flank))
        return width, off, flank

    def resting(self, width: float, off: Array, flank: Array) -> Mask:
        """Return the samples that rest on a flank: those of the crossings and bounces are far from it."""
        away = np.abs(off - 0.5 * width * flank)
        return np.asarray(away <= max(SPREAD * float(np.median(away)), self.step))


def measured_backlash(logs: Iterable[Log]) -> Backlash | str:
    """Return the backlash between the encoders of motor and load, or why the logs do not tell it.

    Parameters
    ----------
    logs : iterable of Log
        Those with ``theta`` and ``theta_load`` are used.
    """
    parts = [part for log in logs if log.channels.keys() >= BOTH for part in parts_of(with_records(log))]
    if not parts:
        return "no log has theta and theta_load"
    found = _moving(parts)
    if found is None:
        return "the load does not move"
    tried = [found.sorted_by_flank(start) for start in (found.direction, found.push)]
    width, off, flank = min(tried, key=lambda one: float(np.sum(np.abs(one[1] - 0.5 * one[0] * one[2]))))
    if width < STEPS * found.step:
        return (
            f"the difference of both encoders stays within {STEPS:g} of their steps: there is no backlash, or the load "
            "touches one flank alone; a motion with reversals was expected"
        )
    changes = int(np.count_nonzero((np.diff(flank) != 0.0) & (np.diff(found.record) == 0)))
    rarer = float(min(np.mean(flank > 0.0), np.mean(flank < 0.0)))
    if changes < FEWEST or rarer < RAREST:
        return "the load touches one flank alone: a motion with reversals was expected"
    resting = found.resting(width, off, flank)
    left = (off - 0.5 * width * flank)[resting]
    stderr = _jackknife(found, flank, resting)
    between = float(np.mean(np.abs(off) < 0.25 * width))
    if between > BETWEEN or not width > CLEAR * stderr:
        return (
            f"the difference of both encoders has no two flanks: {100.0 * between:.0f} % of the moving samples lie in "
            "the middle between them"
        )
    leading = float(np.mean(flank == found.direction))
    return Backlash(width, stderr, changes, leading, float(np.sqrt(np.mean(left**2))))


def _moving(parts: list[Log]) -> _Flanks | None:
    from scipy.ndimage import uniform_filter1d

    rows = []
    for k, part in enumerate(parts):
        t, channels, good, _ = uniform(part)
        period = float(t[1] - t[0])
        theta, load = (unwrapped(channels[name]) for name in ("theta", "theta_load"))
        count = max(1, round(SMOOTHING / period))
        speed = uniform_filter1d(np.gradient(load, period), count, mode="nearest")
        push = uniform_filter1d(np.gradient(speed, period), count, mode="nearest")
        moving = good & (np.abs(speed) > SLOWEST * np.abs(speed).max())
        once = np.eye(len(parts))[np.full(int(moving.sum()), k)]
        beside = np.column_stack([once, push[moving], load[moving] - load[0]])
        rows.append((theta[moving] - load[moving], beside, np.sign(speed[moving]), push[moving], np.full(len(once), k)))
    steps = max(sum(_step(part[name]) for name in BOTH) for part in parts)
    apart, beside, direction, push, record = (np.concatenate(column) for column in zip(*rows, strict=True))
    if len(apart) < 10 * BLOCKS:
        return None
    return _Flanks(apart - apart.mean(), beside, direction, np.where(push >= 0.0, 1.0, -1.0), record, steps)


def _step(angle: Array) -> float:
    """Return the step of a logged angle; one that is not quantised has next to none."""
    apart = np.diff(np.unique(angle))
    return float(np.quantile(apart[apart > 0.0], 0.01)) if np.any(apart > 0.0) else 0.0


def _jackknife(found: _Flanks, flank: Array, resting: Mask) -> float:
    """Return the standard error of the distance, from what it is without each block of the samples.

    Sums of errors within a step of the encoders do not show in that.
    """
    block = np.arange(len(flank)) * BLOCKS // len(flank)
    without = np.array([found.fit(flank, resting & (block != k))[0] for k in range(BLOCKS)])
    spread = (BLOCKS - 1) * float(np.mean((without - without.mean()) ** 2))
    return math.sqrt(spread + found.step**2 / 12.0)


# -- the file -------------------------------------------------------------------------------------------------------


def backlash_files(design: Design, logs: Iterable[Log]) -> dict[str, str]:
    """Return the backlash that logs with two encoders show as a file, or a file that says why there is none.

    Source: Siemens, SINUMERIK 808D Parameter Manual, MD32450; Beckhoff Information System, TF5200, P-AXIS-00021 and
    P-AXIS-00103, and Tc2_MC2, MC_BacklashCompensation.

    Parameters
    ----------
    design : Design
        Its gear brings the angle to the load.
    logs : iterable of Log

    Returns
    -------
    dict of str to str
        Empty where no log has both encoders.
    """
    given = [log for log in logs if log.channels.keys() >= BOTH]
    if not given:
        return {}
    axis, found = identifier(design.name), measured_backlash(given)
    if isinstance(found, str):
        return {f"{axis}_backlash_not_exported.txt": f"{found}\n"}
    return {f"{axis}_backlash.csv": _csv(design, found)}


def _csv(design: Design, found: Backlash) -> str:
    linear = design.motion == "linear"
    gear = design.load.gear
    unit, scale = ("mm", 1e3) if linear else ("deg", math.degrees(1.0) / gear)
    width = scale * math.copysign(found.width, found.leading - 0.1)
    count = round(1e4 * width)
    rows = [
        ("MD32450", "$MA_BACKLASH", f"{width:.6g}", unit),
        ("P-AXIS-00103", "getriebe[i].lose", f"{count}" if abs(count) <= LARGEST else "",
         "0.1 um" if linear else "0.0001 deg"),
        ("P-AXIS-00021", "lr_param.anwahl_losekomp", "1", ""),
        ("MC_BacklashCompensation", "Backlash", f"{width:.6g}", unit),
    ]  # fmt: skip
    where = "" if linear or gear == 1.0 else f" at the load, {gear:.6g} motor turns a turn"
    lines = ["object,name,value,unit", *(",".join(row) for row in rows)]
    lines += [
        f"# Measured: {width:.4g} +- {scale * found.stderr:.2g} {unit}{where}; the flank changed {found.changes} "
        f"times; {scale * found.left:.2g} {unit} rms are left of it.",
        "# Positive: the encoder of the motor leads (the normal case of MD32450). For a position loop on that encoder.",
        "# It contains the twist of the transmission under the load's own dry friction.",
        "# P-AXIS-00021: 1 where the last motion before switching on was in positive direction; 2 in negative.",
    ]
    if abs(count) > LARGEST:
        lines.append(f"# {count} is beyond the 16 bits of P-AXIS-00103.")
    if not found.follows_direction:
        lines.append(
            f"# The motor leads in {100.0 * found.leading:.0f} % of the moving samples alone: here the flank follows "
            "the torque and not the direction of motion, by which these compensations switch."
        )
    lines.append(
        "# Not confirmed with a manual: the unit of MC_BacklashCompensation (that of the axis is assumed), and whether "
        "its value is the whole travel."
    )
    return "\n".join([*lines, ""])

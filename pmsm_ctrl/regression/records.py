"""What may differ from record to record of a joined log: dry friction, viscous friction, a constant torque.

The records of an axis share its inertia and its structure; its friction drifts between them. Each of the three differs
from its mean over the records by deviations that add up to zero, with a prior whose standard deviation, the spread
between records, is found in `spread`. A mean that the design lacks is not hidden by them; but constant torques that
differ have a mean by chance alone, which is a load only where it is larger than that.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.regression.columns import Group

__all__ = [
    "COUNTS",
    "LEVELS",
    "MEAN",
    "contrasts",
    "level_groups",
    "level_signals",
    "members",
    "symbols_of",
    "usual_spread",
]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# What differs: symbol -> the signal that its column is made of; a constant torque has none.
LEVELS = {"dF_c": "direction", "dF_v": "omega", "offset": ""}
MEAN = "offset of all records"  # over the root of their number
# The spread that is assumed before the records speak, as a share of the dry friction at the usual speed, and how many
# records that counts for: two records say next to nothing of a spread.
USUAL, COUNTS = 0.05, 1.0
LITTLE = 0.1  # share of the drive's torque that stands for its dry friction where none shows


def members(record: Record) -> Mask:
    """Return which samples of the thinned grid belong to each record, shape (records, m).

    Parameters
    ----------
    record : Record
    """
    t, half = record.t, 0.5 * record.period
    return np.array([(t > one.start - half) & (t < one.stop + half) for one in record.records]).reshape(-1, len(t))


def contrasts(count: int) -> Array:
    """Return orthonormal directions in which records differ from their mean, shape (count - 1, count).

    Parameters
    ----------
    count : int
        Records.
    """
    out = np.zeros((max(count - 1, 0), count))
    for k in range(1, count):
        out[k - 1, :k] = 1.0
        out[k - 1, k] = -float(k)
        out[k - 1] /= np.sqrt(k * (k + 1.0))
    return out


def symbols_of(symbol: str, count: int) -> tuple[str, ...]:
    """Return the names of the columns by which a level differs between so many records.

    Parameters
    ----------
    symbol : str
        Of `LEVELS`.
    count : int
        Records.
    """
    return tuple(f"{symbol} between records, {k}" for k in range(1, count))


def level_signals(record: Record) -> dict[str, Array]:
    """Return the filtered and thinned column of each level, shape (m,), the same in all records.

    Parameters
    ----------
    record : Record
    """
    key = ("levels",)
    if key not in record.kept:
        one = np.ones(len(record.prepared.t))
        record.kept[key] = {
            symbol: record.shaped(record.signals[signal] if signal else one) for symbol, signal in LEVELS.items()
        }
    columns: dict[str, Array] = record.kept[key]
    return columns


def usual_spread(record: Record) -> dict[str, float]:
    """Return the spread of each level that is assumed before the records speak, in its SI unit.

    Parameters
    ----------
    record : Record
    """
    used = record.mask
    torque = float(np.sqrt(np.mean(record.target[0][used] ** 2)))
    size = USUAL * max(record.dry, LITTLE * torque)
    speed = float(np.sqrt(np.mean(level_signals(record)["dF_v"][used] ** 2)))
    return {"dF_c": size, "dF_v": size / max(speed, 1e-300), "offset": size}


def level_groups(record: Record) -> Iterator[tuple[Group, float]]:
    """Yield, for each level, the columns by which it differs between records, and the spread that is assumed.

    Parameters
    ----------
    record : Record
    """
    count = len(record.records)
    if count < 2:
        return
    along = contrasts(count) @ members(record)
    spread = usual_spread(record)
    for symbol, column in level_signals(record).items():
        rows = (along * column, *(None for _ in record.channels[1:]))
        yield Group(None, symbols_of(symbol, count), rows, {}), spread[symbol]
    rows = (level_signals(record)["offset"][None] / np.sqrt(count), *(None for _ in record.channels[1:]))
    yield Group(None, (MEAN,), rows, {}), spread["offset"]

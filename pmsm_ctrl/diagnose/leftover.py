"""What nothing in the catalogue explains: does the residual still depend on a coordinate, on blocks left out?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.compare.where import Dependence, where
from pmsm_ctrl.diagnose.model import MOST_NOISE, noise_share
from pmsm_ctrl.diagnose.selection import MATERIAL, Fitted

__all__ = ["Leftover", "leftover"]

Array = NDArray[np.float64]

# What the aliased edges of the torque do to a sample of so little weight no curve has to explain.
SOUND = 0.5
# Least share of what is left that is worth a word: with the edges left out, less than `compare` asks for.
WORTH = 0.015


@dataclass(frozen=True, eq=False)
class Leftover:
    """A dependence that is left, fitted by a smooth curve as a stopgap.

    Attributes
    ----------
    coordinate, unit : str
    channel : str
        The balance it shows in.
    share : float
        Part of the residual's mean square that the curve explains, on blocks of time left out.
    curve : (array, array, array)
        Coordinate, and fitted residual moving forward and backward, SI units.
    """

    coordinate: str
    unit: str
    channel: str
    share: float
    p_value: float
    text: str
    curve: tuple[Array, Array, Array]


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
        what = where(
            record.prepared, record.target[row], predicted[row], sound, record.unit(name), predicted[0], J,
            per_ampere, WORTH, MATERIAL, skipped,
        )  # fmt: skip
        if what.named:
            found.append((what.named[0], name, what.sentence()))
    if not found:
        return None
    one, name, sentence = max(found, key=lambda f: f[0].added)
    balance = "force" if record.linear and name == "torque" else name
    text = f"{sentence.replace('of what is left', f'of what is left of the {balance} balance', 1)}; no effect of the "
    text += "catalogue explains it"
    return Leftover(one.name, one.unit, name, one.added, one.p_value, text, (one.x, one.forward, one.backward))

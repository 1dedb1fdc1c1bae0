"""A single wave over time, or over the position of a linear axis, that most of what is left of the torque consists of.

A process force, and the force ripple of a linear motor, depend on no coordinate that a curve is drawn over. A noise
model of some order takes them for noise, and the noise floor is then as high as the wave.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.evidence.linalg import factored
from pmsm_ctrl.evidence.waves import FINER, PASSED, PERIODS, highest_over_position, spectrum_over, tops
from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.residuals import policy
from pmsm_ctrl.residuals.notices import SINGLE_WAVE
from pmsm_ctrl.section import Notice

__all__ = ["SingleWave", "single_wave"]

Array = NDArray[np.float64]

BESIDE = 8  # waves on either side that a line stands out of
POINTS = 49  # of the wave that is drawn


@dataclass(frozen=True, eq=False)
class SingleWave:
    """A wave that explains more than half of what is left of the torque.

    Attributes
    ----------
    coordinate, unit : str
        ``time``, s, or ``position``, m.
    share : float
        Of the weighted sum of squares that is left.
    p_value : float
    curve : (array, array)
        A period of the coordinate, and the wave, N m (N).
    notice : Notice
    """

    coordinate: str
    unit: str
    share: float
    p_value: float
    curve: tuple[Array, Array]
    notice: Notice


def single_wave(record: Record, residual: Array) -> SingleWave | None:
    """Return the wave that explains more than half of what is left of the torque; None where there is none.

    A periodic motion has lines in its spectrum, and so has any error of the model: a wave on one of them is no load
    beside the motion.

    Parameters
    ----------
    record : Record
    residual : array, shape (m,)
        Of the torque.
    """
    places = [("time", "s", record.t, PASSED * record.cutoff)]
    if record.linear and "theta" in record.signals:
        theta = record.at_grid(record.signals["theta"])
        omega = record.at_grid(record.signals["omega"])
        highest = highest_over_position(theta[record.mask], omega[record.mask], record.cutoff)
        places.append(("position", "m", theta, highest))
    found = [one for place in places if (one := _over(record, residual, *place)) is not None]
    return max(found, key=lambda one: one.share, default=None)


def _over(record: Record, residual: Array, name: str, unit: str, x: Array, highest: float) -> SingleWave | None:
    """Return the strongest wave over a coordinate if it explains enough."""
    weight = record.weight[0] * record.mask
    used = weight > 0.0
    extent = float(np.ptp(x[used])) if np.any(used) else 0.0
    if extent <= 0.0 or highest * extent <= PERIODS:
        return None
    left, whole = (values[used] * weight[used] for values in (residual, record.target[0]))
    place = x[used] - float(x[used].min())
    power = spectrum_over(left * weight[used], place, extent, highest)
    highest_peak = np.array([PERIODS * FINER + int(np.argmax(power[PERIODS * FINER :]))])
    best = float(tops(power, highest_peak)[0]) / (FINER * extent)
    columns = _waves(2.0 * np.pi * best * place) * weight[used, None]
    size = factored(columns).solve(left)
    rest = left - columns @ size
    share = 1.0 - float(rest @ rest) / max(float(left @ left), 1e-300)
    if share < policy.MOST_OF_IT or float(left @ left) < policy.SIZE**2 * float(whole @ whole):
        return None  # whatever it is, nobody needs to know
    independent = 2.0 * record.cutoff * float(used.sum()) / record.rate
    p = highest * extent * (1.0 - share) ** (0.5 * (independent - 2.0))  # Fisher's test of a periodogram
    line = _line((whole - left) * weight[used], place, extent, best)
    if p > policy.SIGNIFICANCE or line < policy.SIGNIFICANCE:
        return None
    notice = SINGLE_WAVE(
        percent=100.0 * share, balance=record.drive, coordinate=name,
        period=f"{1e3 / best:.3g} mm" if name == "position" else f"{best:.3g} Hz",
        amplitude=float(np.hypot(*size[:2])), unit=record.unit("torque"),
    )  # fmt: skip
    points = np.linspace(0.0, 1.0 / best, POINTS)
    curve = _waves(2.0 * np.pi * best * points)[:, :2] @ size[:2]
    return SingleWave(name, unit, share, p, (points, curve), notice)


def _waves(angle: Array) -> Array:
    return np.column_stack([np.cos(angle), np.sin(angle), np.ones(len(angle))])


def _line(values: Array, place: Array, extent: float, number: float) -> float:
    """Return the p-value that a wave does not stand out of those beside it."""
    at = round(number * extent * FINER)
    power = spectrum_over(values, place, extent, number + (BESIDE + 1) / extent)
    reach, own = BESIDE * FINER, 2 * FINER  # with what a wave leaks into the next ones
    beside = np.concatenate([power[max(at - reach, 0) : at - own], power[at + own : at + reach]])
    return float(2 * BESIDE * np.exp(-power[at] / max(float(np.mean(beside)), 1e-300)))

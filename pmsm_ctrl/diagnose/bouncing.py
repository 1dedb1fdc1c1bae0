"""Intervals of the parameters of a load that bounces between flanks, which the regression does not tell.

The regression follows the load along the measured motion. After a few bounces it is somewhere else than the true one,
and a contact that hardly bounces predicts the torque better than the true one: by hundreds of times what noise would
do. So the load is followed by a filter that the measured angle corrects (`effects.structures.contact_filter`), and the
values are sought under which the angle is most likely. The filter is an approximation, and the likelihood is rough, so
no curvature of it tells an error. The error is that on twins of the log: the same torque on a load with the values that
were found, with noise as was found, from whose angle the values are sought again. The mean error is taken off. Half of
the interval is the root mean square of the errors times the quantile of Student's distribution for so few of them. The
values of the regression are inside: they are what is written, and the best for its torque.

Sources: R. Y. Rubinstein, Methodology Comput. Appl. Probab. 1 (1999) 127, search by drawn values; B. Efron,
R. J. Tibshirani, An Introduction to the Bootstrap (1993), chapters 6 and 10.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.diagnose.fit import Accepted, Fitted
from pmsm_ctrl.effects.structures import Gap
from pmsm_ctrl.effects.structures.contact_filter import course, innovations
from pmsm_ctrl.effects.structures.transmission import FREQUENCY, RUBBING
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.columns import UnavailableError
from pmsm_ctrl.regression.timing import unwrapped

__all__ = ["of_bouncing_load"]

Array = NDArray[np.float64]

# Blocks of samples that are looked at: those in which the load does most, of at least this share of the most.
BLOCK, MOST_BLOCKS, SHARE = 1000, 4, 0.1
TWINS = 3
STUDENT = 3.182446 / 1.959964  # over the normal one, the quantile of Student's distribution for three twins
ROUNDS, DRAWS, BEST = 12, 40, 10
ROUNDS_OF_TWIN, DRAWS_OF_TWIN, BEST_OF_TWIN = 7, 30, 8
FADES = 0.7  # share of a spread that the next round takes from the one before
STEPS = 10.0  # of the integration, per radian of the contact's swing
TAILS = 5.0  # degrees of freedom of Student's distribution: the filter misses some impacts
AT_FIRST = 20  # innovations that tell more of where the load was than of what it is
LOOSE = 0.16  # noise of the load's speed, in what the torque's noise does to it in a sample
HEAVIEST = 0.95  # share of the inertia
# Logarithms: gap, load, its frequency and damping in contact, the inertia, noise of torque and of angle. The spread at
# first, the one that a round keeps, and how far the search goes.
FIRST = np.array([0.25, 0.15, 0.6, 0.7, 0.004, 0.5, 0.4])
LEAST = np.array([0.02, 0.02, 0.06, 0.1, 0.001, 0.05, 0.05])
FURTHEST = np.array([1.1, 0.9, 1.6, 2.3, 0.03, 2.3, 2.3])
CONTACT, DAMPED = 2.0 * np.pi * 200.0, 0.2  # where the search begins, rad/s
LARGER = 1.1  # than what the regression finds of gap and load, which is too small mostly
OUTSIDE = 1e12
LOUD = 30.0  # by how much the logarithm of the likelihood must fall over a spread of the first round
# Logarithms of gap, J_load, k and d over those of gap, load, frequency and damping.
TOLD = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 1.0, 2.0, 0.0], [0.0, 1.0, 1.0, 1.0]])


@dataclass(frozen=True, eq=False)
class _Heard:
    """Stretches of a log: angle and accelerating torque, and where the search for the values begins."""

    accepted: Accepted
    parts: tuple[tuple[Array, Array], ...]
    period: float
    begin: Array

    def unlikely(self, x: Array) -> float:
        """Return the negative logarithm of the likelihood of the angle."""
        values, inertias, noise, steps = self.told(x)
        if inertias[1] > HEAVIEST * (inertias[0] + inertias[1]):
            return OUTSIDE
        total = 0.0
        for theta, torque in self.parts:
            off, square = innovations(self.accepted.effect, values, inertias, theta, torque, self.period, noise, steps)
            each = 0.5 * np.log(square) + 0.5 * (TAILS + 1.0) * np.log1p(off**2 / square / TAILS)
            total += float(np.sum(each[AT_FIRST:]))
        return total if np.isfinite(total) else OUTSIDE

    def told(self, x: Array) -> tuple[dict[str, float], tuple[float, float], tuple[float, float, float, float], int]:
        """Return the effect's parameters, the inertias, the noise and the steps."""
        gap, load, w, zeta, inertia, torque_noise, angle_noise = np.exp(x).tolist()
        structure = self.accepted.effect.structure
        assert isinstance(structure, Gap)
        values = {structure.gap: gap, structure.load: load, structure.stiffness: load * w * w}
        values[structure.damping] = 2.0 * zeta * w * load
        noise = torque_noise, angle_noise, LOOSE * torque_noise * self.period / load, 0.5 * gap
        return values, (inertia - load, load), noise, int(np.ceil(STEPS * self.period * w)) + 3

    def twin(self, x: Array, rng: np.random.Generator) -> _Heard:
        """Return what would be heard of a load with these values."""
        values, inertias, noise, steps = self.told(x)
        parts = []
        for theta, torque in self.parts:
            made = course(self.accepted.effect, values, inertias, theta, torque, self.period, steps)
            parts.append((
                made + noise[1] * rng.standard_normal(len(made)),
                torque + noise[0] * rng.standard_normal(len(torque)),
            ))  # fmt: skip
        return replace(self, parts=tuple(parts), begin=x)


def of_bouncing_load(fit: Fitted, number: int, log: Log, sigmas: float) -> dict[str, tuple[float, float]]:
    """Return the ends of the intervals of a gap's parameters; none where the log cannot be followed.

    Parameters
    ----------
    fit : Fitted
    number : int
        Position among the accepted effects.
    log : Log
        What was fitted, before any filter.
    sigmas : float
        Half of the interval, in standard errors.
    """
    one = fit.accepted[number]
    structure = one.effect.structure
    if not isinstance(structure, Gap) or (heard := _heard(fit, number, structure, log)) is None:
        return {}
    rng = np.random.default_rng(0)
    found = _sought(heard.unlikely, heard.begin, FIRST, rng, (ROUNDS, DRAWS, BEST))
    if np.any(np.abs(found - heard.begin)[:4] > FURTHEST[:4] - LEAST[:4]) or not _told_apart(heard, found):
        return {}  # at an end of what is searched, or anywhere in it
    small, size = 3.0 * LEAST, (ROUNDS_OF_TWIN, DRAWS_OF_TWIN, BEST_OF_TWIN)
    off = np.array([_sought(heard.twin(found, rng).unlikely, found, small, rng, size) - found for _ in range(TWINS)])
    middle = TOLD @ (found - off.mean(axis=0))[:4]
    half = sigmas * STUDENT * np.sqrt(TOLD**2 @ np.mean(off[:, :4] ** 2, axis=0))
    position = fit.position(number)
    assert position is not None  # it was heard
    amount = float(fit.estimate.values[fit.model.columns_of(position).start])
    written = structure.parameters(one.effect, {**one.shape, structure.load: amount})
    symbols = structure.gap, structure.load, structure.stiffness, structure.damping
    lower, upper = np.exp(middle - half).tolist(), np.exp(middle + half).tolist()
    return {
        symbol: (min(low, written[symbol]), max(high, written[symbol]))
        for symbol, low, high in zip(symbols, lower, upper, strict=True)
    }


def _told_apart(heard: _Heard, found: Array) -> bool:
    """Whether the angle tells each of the contact's values from others; a search that hears nothing ends anywhere."""
    least = heard.unlikely(found)
    return all(
        heard.unlikely(found + sign * FIRST * (np.arange(len(found)) == k)) > least + LOUD
        for k in range(len(TOLD))
        for sign in (-1.0, 1.0)
    )


def _sought(
    unlikely: Callable[[Array], float], begin: Array, spread: Array, rng: np.random.Generator,
    size: tuple[int, int, int],
) -> Array:  # fmt: skip
    """Return where a function is least: the mean of the best of drawn values, round the best of the round before."""
    rounds, draws, best = size
    middle, furthest = begin, np.minimum(FURTHEST, 10.0 * spread)
    for _ in range(rounds):
        drawn = middle + spread * rng.standard_normal((draws, len(begin)))
        drawn = np.clip(drawn, begin - furthest, begin + furthest)
        kept = drawn[np.argsort([unlikely(x) for x in drawn])[:best]]
        middle = (1.0 - FADES) * middle + FADES * kept.mean(axis=0)
        spread = np.maximum((1.0 - FADES) * spread + FADES * kept.std(axis=0), LEAST)
    return middle


def _heard(fit: Fitted, number: int, structure: Gap, log: Log) -> _Heard | None:
    """Return the stretches in which a load moves most against its shaft; None where the log has no angle of one run."""
    record, one, position = fit.record, fit.accepted[number], fit.position(number)
    signals = record.signals
    if RUBBING in one.shape:  # the filter knows no friction of the load
        return None
    if position is None or record.unseen or record.records or "theta" not in log or "torque_logged" not in signals:
        return None
    if len(log["theta"]) != len(signals["torque_logged"]) or (
        record.late is not None and abs(record.late) > record.period
    ):
        return None
    theta = unwrapped(log["theta"])
    try:
        torque = _accelerating(fit, position)
        moved = structure.columns(record, one.effect, one.shape)[0]["torque"]
    except UnavailableError:
        return None
    parts = tuple((theta[a:b].copy(), torque[a:b].copy()) for a, b in _stretches(moved))
    if not parts:
        return None
    load = float(fit.estimate.values[fit.model.columns_of(position).start])
    inertia = float(fit.estimate.values[fit.model.names.index("J")])
    gap = one.shape[structure.gap]
    noise = _noise(torque), max(_noise(theta), record.step / np.sqrt(12.0))
    begin = np.array([LARGER * gap, min(LARGER * load, 0.8 * inertia), CONTACT, DAMPED, inertia, *noise])
    if not np.all(begin > 0.0) or FREQUENCY not in one.shape:
        return None
    return _Heard(one, parts, record.period, np.log(begin))


def _accelerating(fit: Fitted, position: int) -> Array:
    """Return the measured torque less all that the model knows but the inertias, shape (n,)."""
    record = fit.record
    torque = record.signals["torque_logged"] - record.signals.get("T_load", 0.0)
    for place, group in enumerate(fit.model.groups):
        if group.effect is None or place == position:
            continue
        columns: list[Mapping[str, Array]] = list(group.effect.structure.columns(record, group.effect, group.shape))
        values = fit.estimate.values[fit.model.columns_of(place)].tolist()
        for value, column in zip(values, columns, strict=True):
            torque = torque - value * column.get("torque", 0.0)
    return np.asarray(torque, dtype=np.float64)


def _stretches(moved: Array) -> Iterator[tuple[int, int]]:
    """Yield first and last sample of what lies side by side of the blocks in which a signal is largest."""
    count = len(moved) // BLOCK
    power = np.sum(moved[: count * BLOCK].reshape(count, BLOCK) ** 2, axis=1)
    chosen = [k for k in np.argsort(-power)[:MOST_BLOCKS].tolist() if power[k] > SHARE * power.max()]
    begin: int | None = None
    for k in range(count + 1):
        if k in chosen and begin is None:
            begin = k
        elif k not in chosen and begin is not None:
            yield begin * BLOCK, k * BLOCK
            begin = None


def _noise(values: Array) -> float:
    """Return the standard deviation of what is white in a signal that is smooth otherwise."""
    return float(np.median(np.abs(np.diff(values, 4))) / (0.6745 * np.sqrt(70.0)))

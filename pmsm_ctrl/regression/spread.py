"""Friction that differs between records: the spread, the deviation of each record, and records that disagree.

The deviations of the records have a normal distribution. Its standard deviation, the spread, is estimated together with
all other parameters: restricted maximum likelihood by the EM algorithm (N. M. Laird, J. H. Ware, Biometrics 38 (1982)
963) with a weak prior. A deviation that a record does not determine is drawn towards the mean of the others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.evidence.linalg import added
from pmsm_ctrl.evidence.tests import f_tail, holm
from pmsm_ctrl.evidence.whitening import Whitener
from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.regression.columns import Group
from pmsm_ctrl.regression.covariance import NoiseCovariance, noise_covariance
from pmsm_ctrl.regression.edges import MAD
from pmsm_ctrl.regression.model import Model, Solved, solve_model
from pmsm_ctrl.regression.records import (
    COUNTS,
    LEVELS,
    MEAN,
    contrasts,
    level_signals,
    members,
    symbols_of,
    usual_spread,
)

__all__ = [
    "Levels",
    "disagreement",
    "levels_of",
    "spreads",
    "with_counts",
    "with_mean",
    "with_noise_of_records",
    "with_spread",
    "without_level",
]

Array = NDArray[np.float64]
Places = NDArray[np.intp]

ROUNDS, ENOUGH = 500, 1e-4  # of the EM algorithm, and the relative change of a spread at which it ends
# Assumed standard deviation of the inertia between records by errors of model and sampling, as a share of it.
USUAL_INERTIA = 0.005
# Share of its information that a mean must have for itself, and the significance from which on it is a load.
KNOWN, SURE = 1e-6, 0.01
# Degrees of freedom by which the usual spread is known where records differ by no more than that. Of 40 pairs whose
# constant torques differ by twice as much none has a load; a load of a fifth of the friction has its name.
USUAL_KNOWN = 5.0
SMALLEST = 1e-6  # of the spread that is assumed
NOISIER = 1.5  # ratio of the noise of two records from which on they count differently


@dataclass(frozen=True, eq=False)
class Levels:
    """Deviations of each record from the mean of all.

    Attributes
    ----------
    deviation, stderr : dict of symbol to array, shape (records,)
        Of friction from its mean over the records, and of the constant torque from what the model has for all, with
        standard errors, in SI units.
    spread : dict of symbol to float
        Standard deviation between records.
    """

    deviation: dict[str, Array]
    stderr: dict[str, Array]
    spread: dict[str, float]


def _places(model: Model, count: int) -> dict[str, Places]:
    """Where the columns of each level stand in a model."""
    where = {name: k for k, name in enumerate(model.names)}
    return {s: np.array([where[name] for name in symbols_of(s, count)], dtype=np.intp) for s in LEVELS}


def with_spread(record: Record, model: Model, whitener: Whitener) -> Model:
    """Return the model with the estimated spread between records as the prior of their deviations.

    Parameters
    ----------
    record : Record
    model : Model
    whitener : Whitener
    """
    count = len(record.records)
    if count < 2:
        return model
    solved = solve_model(record, model, whitener)
    places = _places(model, count)
    level = np.concatenate(list(places.values()))
    mean = model.names.index(MEAN)
    information, along = _information(solved, np.append(level, mean))
    rest = np.setdiff1d(np.arange(len(model.names)), level)
    own, pull = _eliminated(information, along, level, rest)
    found = _spread(own, pull, usual_spread(record), count)
    sigma = model.sigma.copy()
    for symbol, where in places.items():
        sigma[where] = found[symbol]
    information[level, level] += 1.0 / sigma[level] ** 2
    return _with_mean(record, replace(model, sigma=sigma), information, along)


def with_mean(record: Record, model: Model, whitener: Whitener) -> Model:
    """Return the model with the mean of the constant torques free only as far as their spread, as it is, explains it.

    Parameters
    ----------
    record : Record
    model : Model
    whitener : Whitener
    """
    if len(record.records) < 2:
        return model
    information, along = _information(solve_model(record, model, whitener), np.array([model.names.index(MEAN)]))
    return _with_mean(record, model, information, along)


def _with_mean(record: Record, model: Model, information: Array, along: Array) -> Model:
    """Return the model with a prior of the mean, from the information without one and its product with the values."""
    count = len(record.records)
    mean, found, usual = model.names.index(MEAN), spreads(model, count)["offset"], usual_spread(record)["offset"]
    sigma, spread = model.sigma.copy(), max(found, usual)
    # records that differ no more than usual give no reason to assume more than that
    known = USUAL_KNOWN if found <= usual else COUNTS
    by_chance = _mean_by_chance(information, along, mean, spread, known + count - 1.0)
    sigma[mean] = spread if by_chance else SMALLEST * spread
    return replace(model, sigma=sigma)


def _mean_by_chance(information: Array, along: Array, mean: int, spread: float, dof: float) -> bool:
    """Whether constant torques that differ so much have such a mean by chance; if not, it is a load that is missing."""
    own, pull = _eliminated(information, along, np.array([mean]), np.setdiff1d(np.arange(len(along)), [mean]))
    known = float(own[0, 0])
    if known <= KNOWN * information[mean, mean]:  # the model has a constant torque of its own
        return True
    return f_tail((float(pull[0]) / known) ** 2 / (spread**2 + 1.0 / known), 1, round(dof)) > SURE


def _information(solved: Solved, level: Places) -> tuple[Array, Array]:
    """Return the information on the parameters, shape (k, k), and its product with them, without the levels' priors."""
    information = solved.triangle.T @ solved.triangle
    along = solved.triangle.T @ solved.along
    information[level, level] -= 1.0 / solved.model.sigma[level] ** 2
    return information, along


def _eliminated(information: Array, along: Array, kept: Places, rest: Places) -> tuple[Array, Array]:
    """Return the information on the kept parameters where nothing is known of the rest, and its product with them."""
    size = np.sqrt(np.maximum(np.diag(information)[rest], 1e-300))
    scaled = np.linalg.pinv(information[np.ix_(rest, rest)] / np.outer(size, size), rcond=1e-10, hermitian=True)
    inverse = scaled / np.outer(size, size)
    cross = information[np.ix_(kept, rest)] @ inverse
    own = information[np.ix_(kept, kept)] - cross @ information[np.ix_(rest, kept)]
    return 0.5 * (own + own.T), along[kept] - cross @ along[rest]


def _spread(own: Array, pull: Array, usual: dict[str, float], count: int, further: float = 0.0) -> dict[str, float]:
    """Return the spread of each level by the EM algorithm; `further` deviations that the rest has taken over.

    Parameters
    ----------
    own, pull : array
        Information on the deviations, level by level, and its product with them.
    usual : dict of symbol to float
        The spread that is assumed, which counts for `COUNTS` records.
    count : int
        Records.
    further : float
    """
    each = count - 1
    start = np.array(list(usual.values()))
    found = start.copy()
    for _ in range(ROUNDS):
        prior = np.repeat(found, each)
        # in units of the prior, so that nothing is divided by a small spread
        covariance = np.linalg.inv(np.eye(len(prior)) + own * np.outer(prior, prior)) * np.outer(prior, prior)
        mean = covariance @ pull
        squares = (mean**2 + np.diag(covariance)).reshape(-1, each).sum(axis=1)
        if further:  # directions that are free elsewhere say nothing of the spread: they come back as the prior itself
            squares = squares - further * found**2
        new = np.sqrt(np.maximum(squares + COUNTS * start**2, 0.0) / (COUNTS + each - further))
        new = np.maximum(new, SMALLEST * start)
        done = bool(np.all(np.abs(new - found) <= ENOUGH * found))
        found = new
        if done:
            break
    return dict(zip(usual, found.tolist(), strict=True))


def spreads(model: Model, count: int) -> dict[str, float]:
    """Return the spread between records that a model has, by level.

    Parameters
    ----------
    model : Model
    count : int
        Records.
    """
    return {symbol: float(model.sigma[where[0]]) for symbol, where in _places(model, count).items()}


def levels_of(record: Record, fit: Solved, weights: Whitener, whitener: Whitener) -> Levels:
    """Return the deviation of each record's friction from the mean of all.

    Parameters
    ----------
    record : Record
    fit : Solved
        By the weights.
    weights, whitener : Whitener
    """
    count = len(record.records)
    covariance = noise_covariance(fit, weights, whitener).of_fit()
    back = contrasts(count).T
    deviation, stderr = {}, {}
    for symbol, where in _places(fit.model, count).items():
        turn = back
        if symbol == "offset":
            where = np.append(where, fit.model.names.index(MEAN))
            turn = np.column_stack([back, np.full(count, 1.0 / np.sqrt(count))])
        deviation[symbol] = turn @ fit.values[where]
        own = turn @ covariance[np.ix_(where, where)] @ turn.T
        stderr[symbol] = np.sqrt(np.maximum(np.diag(own), 0.0))
    return Levels(deviation, stderr, spreads(fit.model, count))


def disagreement(record: Record, model: Model, weights: Whitener, whitener: Whitener) -> list[float]:
    """Return, for each record, the p-value that it shares inertia and friction with the others, Holm's correction made.

    A Wald test of what the record has of its own in inertia and in the three levels, by weighted least squares, against
    the noise and the spread of the other records. Inertias differ as well: by what the model and the sampling leave of
    them, and by as much as noise in the acceleration of a record shrinks its own. The spread is known from few records,
    which the degrees of freedom allow for: of the direction in which a record deviates, the share that is spread has
    those of the other records (F. E. Satterthwaite, Biometrics Bulletin 2 (1946) 110).

    Parameters
    ----------
    record : Record
    model : Model
        With the levels of the records.
    weights, whitener : Whitener
    """
    count = len(record.records)
    inside = members(record)
    signals = [record.acceleration(), *level_signals(record).values()]
    inertia = float(model.nominal[model.names.index("J")])
    rows = (contrasts(count) @ inside * record.acceleration(), *(None for _ in record.channels[1:]))
    usual = usual_spread(record) | {"J": USUAL_INERTIA * inertia}
    common = model.sigma.copy()
    common[model.names.index("J")] = np.inf  # what the datasheet says of all of them divides none
    common[model.names.index(MEAN)] = np.inf  # nor does a load that is missing in all of them
    model = replace(model, sigma=common)
    for number, share in enumerate(_noise_shares(record)):
        own_rows = ((inside[number] * record.acceleration())[None], *(None for _ in record.channels[1:]))
        model = model.plus(Group(None, (f"J of record {number + 1}",), own_rows, {}), max(share, SMALLEST) * inertia)
    model = model.plus(Group(None, symbols_of("J", count), rows, {}), usual["J"])
    places = [*_places(model, count).values(), len(model.names) - np.arange(1, count)[::-1]]
    level = np.concatenate(places)
    fit = solve_model(record, model, whitener)
    own = np.array([column * here for here in inside for column in signals])
    information, along = _with_own(fit, level, whitener.part(0, own))
    k, each = len(model.names), len(signals)
    p_values = []
    for number in range(count):
        chosen = slice(each * number, each * (number + 1))
        free = np.concatenate([np.setdiff1d(np.arange(k), level), k + np.arange(each * count)[chosen]])
        spread = _spread(*_eliminated(information, along, level, free), usual, count, 1.0)
        sigma = model.sigma.copy()
        for where, value in zip(places, spread.values(), strict=True):
            sigma[where] = value
        beside = solve_model(record, replace(model, sigma=sigma), weights)
        p_values.append(_own_p_value(noise_covariance(beside, weights, whitener), own[chosen], count))
    return holm(p_values)


def _noise_shares(record: Record) -> list[float]:
    """Return the share of noise in the acceleration of each record, at most 1: by so much it may shrink its inertia.

    Source: W. A. Fuller, Measurement Error Models, Wiley 1987, sec. 1.1.
    """
    from pmsm_ctrl.regression.filters import low_pass

    alpha = record.acceleration()
    fast = np.abs(alpha - low_pass(alpha, record.rate, 0.5 * record.cutoff))
    shares = []
    for here in members(record):
        used = here & record.mask
        noise = 2.0 * (MAD * _median(fast[used])) ** 2  # of the whole band
        weight = record.weight[0][used] ** 2
        motion = float(weight @ alpha[used] ** 2)
        shares.append(min(1.0, noise * float(weight.sum()) / motion) if motion > 0.0 else 1.0)
    return shares


def _with_own(fit: Solved, level: Places, rows: Array) -> tuple[Array, Array]:
    """Return the information on a fit's parameters and on further whitened columns, and its product with them."""
    k, extra = len(fit.values), len(rows)
    information, along = np.zeros((k + extra, k + extra)), np.zeros(k + extra)
    information[:k, :k], along[:k] = _information(fit, level)
    cross = rows @ fit.bases[0].T @ fit.triangle[fit.parts[0]]
    information[k:, :k], information[:k, k:], information[k:, k:] = cross, cross.T, rows @ rows.T
    along[k:] = rows @ fit.rest_of(0) + cross @ fit.values
    return information, along


def _own_p_value(covariance: NoiseCovariance, own: Array, count: int) -> float:
    """Return the p-value of one record's own columns, shape (k, m), beside a fit by weighted least squares."""
    fit = covariance.fit
    rows = covariance.weights.part(0, own)
    shared = fit.mixing[fit.parts[0]].T @ (fit.bases[0] @ rows.T)
    found = added(rows @ rows.T, shared, rows @ fit.rest_of(0))
    if found.rank == 0:
        return 1.0
    whole = covariance.of_added({0: rows}, shared, found.back)
    prior = (fit.mixing @ (shared @ found.back))[fit.parts[-1].stop :]
    pulled = np.linalg.solve(whole, found.along)
    wald = float(found.along @ pulled)
    share = float(np.sum((prior @ pulled) ** 2)) / max(wald, 1e-300)
    dof = round((COUNTS + count - 2.0) / max(min(share, 1.0) ** 2, 1e-6))
    return f_tail(wald / found.rank, found.rank, dof)


def without_level(record: Record, left: Array, spread: dict[str, float] | None, noise: float) -> Array:
    """Return a residual, shape (m,), less what dry friction, viscous friction and a constant torque explain of it.

    Parameters
    ----------
    record : Record
    left : array, shape (m,)
        Of the torque balance.
    spread : dict of symbol to float, or None
        Standard deviation of each; nothing is known of them when left out.
    noise : float
        Of a sample, rms.
    """
    columns = np.array(list(level_signals(record).values())).T
    weight = record.weight[0] * record.mask / max(noise, 1e-300)
    rows, target = columns * weight[:, None], left * weight
    if spread is not None:
        prior = np.diag([1.0 / max(spread[symbol], 1e-300) for symbol in LEVELS])
        rows, target = np.vstack([rows, prior]), np.concatenate([target, np.zeros(len(prior))])
    size = np.linalg.norm(rows, axis=0)
    size[size == 0.0] = 1.0
    values = np.linalg.lstsq(rows / size, target, rcond=1e-9)[0] / size
    return np.asarray(left - columns @ values)


def with_noise_of_records(record: Record, residual: Array) -> Record:
    """Return the record with the samples of noisier records counting less, in every balance by its own noise.

    The noise is what a residual holds in the upper half of the band, which no missing effect reaches.

    Parameters
    ----------
    record : Record
    residual : array, shape (channels, m)
    """
    from pmsm_ctrl.regression.filters import low_pass

    if len(record.records) < 2:
        return record
    counts = np.ones((len(residual), len(record.records)))
    for row, left in enumerate(residual):
        fast = np.abs(left - low_pass(left, record.rate, 0.5 * record.cutoff))
        noise = np.array([_median(fast[here & record.mask]) for here in members(record)])
        known = noise > 0.0
        if not known.any() or np.max(noise[known]) < NOISIER * np.min(noise[known]):
            continue
        counts[row] = np.where(known, np.min(noise[known]) / np.where(known, noise, 1.0), 1.0)
    return record if np.all(counts == 1.0) else with_counts(record, tuple(map(tuple, counts.tolist())))


def with_counts(record: Record, counts: tuple[tuple[float, ...], ...]) -> Record:
    """Return the record with the samples of each of its records counting differently.

    Parameters
    ----------
    record : Record
    counts : tuple, shape (channels, records)
        By which the weights are multiplied.
    """
    inside = members(record)
    factors = np.where(inside.any(axis=0), np.array(counts) @ inside, 1.0)
    return replace(record, weight=record.weight * factors, counts=counts, memo={}, kept={})


def _median(values: Sequence[float] | Array) -> float:
    return float(np.median(values)) if len(values) else 0.0

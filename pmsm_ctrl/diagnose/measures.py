"""The numbers that the criteria judge, taken from fits and trials."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose.criteria import CrossValidation, Machine
from pmsm_ctrl.diagnose.fit import Accepted, Fitted
from pmsm_ctrl.diagnose.refine import refine
from pmsm_ctrl.diagnose.search import BLOCKS, EVEN, Trial, blocked_gain, try_group
from pmsm_ctrl.evidence.tests import limited_gain_errors, mean_gain, rank_test
from pmsm_ctrl.regression.columns import Group, effect_group, seen_as_candidate
from pmsm_ctrl.regression.model import Model, Solved, solve_model, solve_on_factors
from pmsm_ctrl.regression.prediction import errors
from pmsm_ctrl.regression.records import LEVELS
from pmsm_ctrl.regression.two_stage import beside_held

__all__ = [
    "WINDING",
    "amplitudes",
    "as_a_whole",
    "beside_rivals",
    "contribution",
    "cross_validated",
    "excess_of",
    "has_own_order",
    "in_band",
    "in_doubt",
    "judged_gain",
    "left_inside",
    "machine_of",
    "matched",
    "order_of",
    "plain_errors",
    "prewhitened_error",
    "record_deviation",
    "seen_beyond",
    "sized",
    "slight",
    "sound_error",
    "squares",
    "typical_error",
    "weighted_errors",
    "winding_deviation",
    "winding_return",
    "with_rivals",
]

Array = NDArray[np.float64]

WINDING = ("R", "L_d", "L_q", "psi_f")


def cross_validated(fit: Fitted, trial: Trial, position: bool = False) -> tuple[CrossValidation, float, float]:
    """Return the cross-validation of a trial, its gain on the log's rows, and the return of the winding.

    All with the weights of the estimate or prewhitened, whichever was judged the more significant.

    Parameters
    ----------
    fit : Fitted
    trial : Trial
    position : bool
        Whether parts of the way are left out in place of parts of the time.
    """
    solved, whitener = (fit.plain, fit.weights) if trial.by_weights else (fit.solved, fit.whitener)
    direction = trial.plain_direction if trial.by_weights else trial.direction
    gains = blocked_gain(fit.record, solved, whitener, trial.group, direction, fit.whitener.memory, position)
    whole = gain_of_rows(solved, direction)
    limited = limited_gain_errors(gains, whole / BLOCKS / (1.0 - EVEN))  # no block holds more of it
    found = CrossValidation(*mean_gain(gains), len(gains), rank_test(gains), limited)
    return found, whole, winding_return(solved, direction)


def beside_rivals(fit: Fitted, trial: Trial) -> tuple[float, float, CrossValidation] | None:
    """Judge a trial beside what must not be taken for it; None without such rivals.

    Returns
    -------
    p_value : float
        Corrected for the shapes searched and for the number of candidates.
    share : float
        What is left of its gain, with all of its columns where no rival resembles the effect by nature.
    found : CrossValidation
    """
    effect, record, model = trial.candidate.effect, fit.record, with_rivals(fit, trial)
    if model is None:
        return None
    solved = solve_model(record, model, fit.whitener, fit.solved)
    own = try_group(solved, fit.whitener, trial.candidate, trial.group)
    gains = blocked_gain(record, solved, fit.whitener, trial.group, own.direction, fit.whitener.memory)
    found = CrossValidation(*mean_gain(gains), len(gains), rank_test(gains))
    share = own.gain / max(trial.gain, 1e-300)
    if effect.structure.unlike_rivals:
        whole, plain = as_a_whole(fit, trial), solve_model(record, model, fit.weights, fit.plain)
        left = try_group(plain, fit.weights, trial.candidate, whole.group)
        share = left.gain / max(whole.gain, 1e-300)
    return min(1.0, own.p_value * len(fit.trials)), share, found


def with_rivals(fit: Fitted, trial: Trial) -> Model | None:
    """Return the model with what must not be taken for a trial, as large as it may be; None without such rivals."""
    effect, record = trial.candidate.effect, fit.record
    parts = effect.structure.rivals(effect, trial.group.shape, record)
    if effect.enters == "torque" and not effect.order:
        parts = [
            *parts,
            *(part for one in fit.accepted for part in one.effect.structure.beside_shape(record, one.shape)),
        ]
    if not parts:
        return None
    symbols = tuple(f"rival {k + 1}" for k in range(len(parts)))
    return fit.model.plus(Group(None, symbols, record.stack_all(parts), {}), 1.0)


def machine_of(design: Design, fit: Fitted, tolerance: float) -> dict[str, Machine]:
    """Return inertia and winding as far as they are estimated, with what the design says of them.

    Parameters
    ----------
    design : Design
    fit : Fitted
    tolerance : float
        Where the design states none, as a share.
    """
    found = {}
    for name in ("J", *WINDING):
        if name not in fit.model.names:
            continue
        k = fit.model.names.index(name)
        nominal = design.J if name == "J" else float(getattr(design.motor, name))
        value, stderr = float(fit.estimate.values[k]), float(fit.plain.stderr[k])
        found[name] = Machine(value, stderr, nominal, design.tolerance(name, tolerance))
    return found


def gain_of_rows(solved: Solved, direction: Array) -> float:
    """Return the part of a gain in the rows of the log; the rest is a smaller deviation from the priors."""
    rest, part = solved.rest[: solved.rows], direction[: solved.rows]
    return max(float(part @ (2.0 * rest - part)), 0.0)


def winding_return(solved: Solved, direction: Array) -> float:
    """Return the part of a gain in the winding's priors: the winding returns towards its datasheet."""
    rest, part = solved.rest[solved.rows :], direction[solved.rows :]
    return float(np.sum((part * (2.0 * rest - part))[_winding(solved.model)]))


def winding_deviation(solved: Solved) -> float:
    """Return the deviation of the winding from its datasheet, as a sum of squares in its tolerances."""
    return float(np.sum(solved.rest[solved.rows :][_winding(solved.model)] ** 2))


def record_deviation(solved: Solved) -> float:
    """Return the deviation of friction and load between records, as a sum of squares in their spread.

    Where each record moves in one direction only, these deviations can stand in for a load.
    """
    levels = [name.split(" ")[0] in LEVELS for name in _with_prior(solved.model)]
    return float(np.sum(solved.rest[solved.rows :][np.array(levels, dtype=bool)] ** 2))


def _winding(model: Model) -> NDArray[np.bool_]:
    """Which of the rows of priors are the winding's."""
    return np.array([name in WINDING for name in _with_prior(model)], dtype=bool)


def _with_prior(model: Model) -> list[str]:
    """Return the names of the parameters that have a prior, in the order of its rows."""
    return [name for name, sigma in zip(model.names, model.sigma.tolist(), strict=True) if np.isfinite(sigma)]


def contribution(fit: Fitted, trial: Trial) -> float:
    """Rms of what only this effect explains over that of the balance, on the tenth of the samples where it is largest.

    Zero where the steps of the channel are as large.
    """
    best = 0.0
    levels = np.mean((fit.record.target * fit.record.weight)[:, fit.record.mask] ** 2, axis=1)
    for row, _ in trial.group.entering:  # in the others a rounding error is left
        part = np.abs(trial.plain_direction[: fit.plain.rows][fit.whitener.channel == row]) * fit.whitener.sigma[row]
        if not np.any(part):
            continue
        count = max(10, len(part) // 10)
        largest = np.partition(part, -count)[-count:]
        size = float(np.sqrt(np.mean(largest**2)))
        if size > fit.record.coarse[row]:
            best = max(best, size / max(float(np.sqrt(levels[row])), 1e-300))
    return best


def slight(fit: Fitted, trial: Trial) -> bool:
    """Whether an effect is so small that it has to be surely the same in half the band.

    Parameters
    ----------
    fit : Fitted
    trial : Trial
    """
    values = dict(zip(trial.group.symbols, trial.values.tolist(), strict=True))
    return trial.candidate.effect.structure.slight(fit.plain.known, values)


def has_own_order(fit: Fitted, trial: Trial) -> bool:
    """Whether an effect is known by an order of a turn that no accepted effect has.

    An error of a current sensor has multiples of its order as well, by its square: they are not their own.

    Parameters
    ----------
    fit : Fitted
    trial : Trial
    """
    effect, p = trial.candidate.effect, fit.record.design.motor.p or 0
    if not effect.order:
        return False
    order = round(trial.group.shape[effect.order])
    return not any(
        order == (known := order_of(one, p)) or (one.effect.electrical_order and known and order % known == 0)
        for one in fit.accepted
    )


def amplitudes(fit: Fitted, number: int) -> dict[str, tuple[float, float]]:
    """Return what multiplies the columns of an accepted effect, and the standard errors; none without a column.

    Parameters
    ----------
    fit : Fitted
    number : int
        Of the effect.
    """
    position = fit.position(number)
    if position is None:
        return {}
    columns = fit.model.columns_of(position)
    values, stderr = fit.estimate.values[columns].tolist(), fit.plain.stderr[columns].tolist()
    return dict(zip(fit.model.names[columns], zip(values, stderr, strict=True), strict=True))


def order_of(one: Accepted, pole_pairs: float) -> int:
    """Return the order of a turn by which an effect is known; 0 for any other.

    Parameters
    ----------
    one : Accepted
    pole_pairs : float
        0 where they are not known.
    """
    electrical = one.effect.electrical_order
    return round(electrical * pole_pairs if electrical else one.shape.get(one.effect.order, 0.0))


def judged_gain(fit: Fitted, trial: Trial) -> tuple[Solved, float]:
    """Return the solution whose weights judged a trial, and the fall of its sum of squares by the trial.

    A share of the residual is the ratio of two sums of squares, which must have the same weights. The `gain` of a slow
    trial is not a sum of squares but a test statistic for correlated noise.

    Parameters
    ----------
    fit : Fitted
    trial : Trial
        One of its trials.

    Returns
    -------
    Solved
        The prewhitened one, or for a slow trial that of the estimate's weights.
    float
        Fall of its sum of squares.
    """
    return (fit.plain, trial.plain_gain) if trial.by_weights else (fit.solved, trial.gain)


def excess_of(solved: Solved, trial: Trial, gain: float) -> tuple[float, float]:
    """Return the share of the residual that a gain explains, and its share of what lies above the noise.

    Both of the sums of squares in the balances that the effect enters.
    """
    left = [solved.rest_of(row) for row, _ in trial.group.entering]
    whole = max(sum(float(rest @ rest) for rest in left), gain, 1e-300)
    above = max(whole - sum(len(rest) for rest in left), gain, 1e-300)
    return gain / whole, gain / above


def in_band(fit: Fitted, trial: Trial) -> float:
    """Return the share of the residual that an effect explains where it acts, by plain weights; see `matched`."""
    channel = fit.whitener.channel
    explained = [trial.plain_direction[: fit.plain.rows][channel == row] for row, _ in trial.group.entering]
    return matched(explained, [fit.plain.rest_of(row) for row, _ in trial.group.entering])


def matched(explained: Sequence[Array], rest: Sequence[Array]) -> float:
    """Return the share of a residual that is explained, both filtered by the spectrum of what is: a matched filter.

    Whatever the residual holds elsewhere, such as the noise of an encoder beside a drag, does not count. 1 is all of
    it; below 0 it gets worse.

    Parameters
    ----------
    explained, rest : sequence of array
        Per balance.
    """
    left = whole = 0.0
    for part, one in zip(map(np.fft.rfft, explained), map(np.fft.rfft, rest), strict=True):
        power = np.abs(part) ** 2
        left += float(power @ np.abs(one - part) ** 2)
        whole += float(power @ np.abs(one) ** 2)
    return 1.0 - left / whole if whole > 0.0 else 0.0


def seen_beyond(solved: Solved, column: int, bound: float) -> float:
    """Return the share of the residual that a parameter explains by being beyond a bound, where it acts.

    Of the residual with the parameter held at the bound, all others fitted again; as in `matched`.

    Parameters
    ----------
    solved : Solved
        In which the parameter is beyond it.
    column : int
    bound : float
    """
    free = [solved.rest_of(row) for row in range(len(solved.bases))]
    target = [
        rest + (solved.triangle[part] @ solved.values) @ basis
        for rest, part, basis in zip(free, solved.parts, solved.bases, strict=True)
    ]
    at_bound = solve_on_factors(solved.model, solved.triangle, solved.along, solved.bases, target, {column: bound})
    rest = [at_bound.rest_of(row) for row in range(len(free))]
    return matched([there - here for there, here in zip(rest, free, strict=True)], rest)


def as_a_whole(fit: Fitted, trial: Trial) -> Trial:
    """Return a trial with all of its columns, by the estimate's weights.

    The significance of a load behind a gap comes from the samples alone in which it moves otherwise than the shaft by
    more than noise. In the model it acts on all of them, and its shape is fitted to all of them.
    """
    group = effect_group(fit.record, trial.candidate.effect, trial.group.shape)
    whole = try_group(fit.plain, fit.weights, trial.candidate, beside_held(group, fit.model.responses))
    return refine(fit.record, fit.plain, fit.weights, whole)


def sized(fit: Fitted, trial: Trial, least: float) -> Trial:
    """Return the trial by which an effect is sized: all of its columns where those beyond noise explain most.

    Beside the rivals: what they explain as well is no part of either.

    Parameters
    ----------
    fit : Fitted
    trial : Trial
    least : float
        That part of what the whole explains, at least.
    """
    if not trial.candidate.effect.structure.judged_in_part:
        return trial
    whole, model = as_a_whole(fit, trial), with_rivals(fit, trial)
    beside = fit.plain if model is None else solve_model(fit.record, model, fit.weights, fit.plain)
    part, all_of_it = (try_group(beside, fit.weights, trial.candidate, one.group).gain for one in (trial, whole))
    return replace(whole, plain_gain=whole.gain) if part > least * all_of_it else trial


def in_doubt(fit: Fitted, trial: Trial, least: float) -> bool:
    """Whether an effect explains most in samples in which all that is fast, were it noise, could be it.

    Parameters
    ----------
    fit : Fitted
    trial : Trial
    least : float
        That part of what it explains has to be beyond all that is fast.
    """
    if not trial.candidate.effect.structure.judged_in_part:
        return False
    whole = effect_group(fit.record, trial.candidate.effect, trial.group.shape)
    slow = beside_held(seen_as_candidate(fit.record, whole, offered=True), fit.model.responses)
    return try_group(fit.plain, fit.weights, trial.candidate, slow).gain < least * trial.plain_gain


def weighted_errors(fit: Fitted) -> dict[str, float]:
    """Rms residual per balance; samples that the log's rate could not follow count as little as they did in the fit."""
    rows = (fit.residual * fit.record.weight)[:, fit.record.mask]
    return dict(zip(fit.record.channels, np.sqrt(np.mean(rows**2, axis=1)).tolist(), strict=True))


def prewhitened_error(judge: Fitted, fit: Fitted) -> float:
    """Rms residual of a fit in units of the noise of another one, its correlation taken away."""
    rest = judge.whitener(fit.record.target - fit.solved.predicted())
    return float(np.sqrt(np.mean(rest**2)))


def sound_error(fit: Fitted, least: float) -> float:
    """Rms residual of the torque balance, all moving samples of at least this weight alike."""
    used = fit.record.mask & (fit.record.weight[0] >= least)
    return float(np.sqrt(np.mean(fit.residual[0][used] ** 2))) if used.any() else 0.0


def typical_error(fit: Fitted) -> float:
    """Median absolute residual of the torque balance, all moving samples alike: single edges do not change it."""
    return float(np.median(np.abs(fit.residual[0][fit.record.mask])))


def plain_errors(fit: Fitted) -> dict[str, float]:
    """Rms residual per balance, all moving samples alike."""
    return {name: rms for name, (rms, _) in errors(fit.record, fit.residual).items()}


def squares(fit: Fitted, residual: Array, sigma: Array) -> float:
    """Sum of squares of a residual, shape (channels, m), as the fit weighs it; `sigma` is the noise per balance."""
    rows = residual * fit.record.weight * fit.record.mask / sigma[:, None]
    return float(np.sum(rows**2))


def left_inside(before: Fitted, after: Fitted) -> float:
    """Share of an effect's gain that remains with all parameters inside their bounds, 0 to 1."""
    sigma = before.weights.sigma

    def gain(old: Solved, new: Solved) -> float:
        parts = [(before, old), (after, new)]
        first, second = (squares(fit, fit.record.target - one.predicted(), sigma) for fit, one in parts)
        return first - second

    free, inside = gain(before.plain, after.plain), gain(before.estimate, after.estimate)
    return float(np.clip(inside / free, 0.0, 1.0)) if free > 0.0 else 0.0

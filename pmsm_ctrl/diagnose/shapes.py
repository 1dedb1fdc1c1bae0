"""The nonlinear parameters of the accepted effects, fitted together with all others, and their part in every error.

Gauss-Newton on the shapes with the linear parameters eliminated at each step. A shape taken as known would leave the
amounts with standard errors many times too small.

Source: G. H. Golub, V. Pereyra, SIAM J. Numer. Anal. 10 (1973) 413, variable projection.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose.candidates import varied
from pmsm_ctrl.diagnose.fit import Accepted, Fitted
from pmsm_ctrl.regression.balances import LATE, Record
from pmsm_ctrl.regression.base_fit import delay_of, laid_out_again, true_torque, with_priors
from pmsm_ctrl.regression.bounds import bounded
from pmsm_ctrl.regression.columns import Group, UnavailableError, effect_group
from pmsm_ctrl.regression.covariance import noise_covariance, with_honest_errors
from pmsm_ctrl.regression.model import Model, Solved, solve_model
from pmsm_ctrl.regression.modelled import with_direction, with_modelled_torque

__all__ = [
    "LONGEST", "Free", "moved_to", "searched", "shifted", "sizes_in_shape", "straight_over", "tangent_of",
    "trusted", "with_shapes_fitted",
]  # fmt: skip

Array = NDArray[np.float64]
Free = tuple[int, str]  # position among the accepted effects, and the name in its shape

ROUNDS = 8
# After a step the torque that the model itself predicts is read again, until it stays to within this share.
READINGS, STAYS = 8, 3e-4
# Difference of a shape's logarithm for its column, and longest step of it, in the step over which its structure calls
# the prediction a straight line; and the part of a standard error that ends the steps.
DIFFERENCE, LONGEST, SETTLED = 0.05, 20.0, 0.02
HALVINGS = 4
# How straight the prediction must be over that step: left of it, as a share of its change.
STRAIGHT = 0.5
# Standard deviation of a shape's logarithm before any log: a thousand from end to end, evenly, as the searches span.
# A slope at one shape says nothing of others that are a million times as large.
KNOWN_BEFORE = 2.0


def with_shapes_fitted(design: Design, fit: Fitted) -> Fitted:
    """Return the fit at its best shapes, with standard errors that count the shapes among the parameters.

    A shape at its bound, and a whole number, stay as they are and count as known. So does one over which the prediction
    is rough: a slope says nothing there. Where the effect is searched by it, as a load that bounces between flanks is,
    all of its shapes stay, and it has no standard errors.

    Parameters
    ----------
    design : Design
    fit : Fitted
    """
    free = [(k, name) for k, one in enumerate(fit.accepted) for name in _free(one)]
    try:
        over = {one for one in free if _is_rough(design, fit, one)}
        rough = frozenset(k for k, name in over if not _is_beside(fit.accepted[k], name))
        fit = replace(fit, rough=rough, unmoved=frozenset(one for one in over if one[0] not in rough))
        free = [one for one in free if one[0] not in rough and one not in over]
        delayed = any(group.delays for group in fit.model.groups)
        if delayed:  # until now it is met within a share of a period
            fit = _reading_its_torque(design, fit)
        if not free:
            return _with_errors(fit) if delayed else fit
        columns = slice(len(fit.model.names), None)
        for _ in range(ROUNDS):
            tangent = tangent_of(design, fit, free)
            step, stderr, inverse = tangent.values[columns], tangent.stderr[columns], tangent.inverse[columns]
            del tangent  # with its columns, which the next one has again
            longest = LONGEST * straight_over(fit.accepted, free)
            moved = _moved(design, fit, free, (step, inverse, longest))
            if moved is None or np.all(np.abs(step) <= SETTLED * stderr):
                break
            fit = _reading_its_torque(design, moved)
        tangent = tangent_of(design, fit, free)
    except UnavailableError:  # a shape beyond what the log can evaluate
        return _with_errors(fit)
    covariance = noise_covariance(tangent, fit.weights, fit.whitener).of_fit()
    count = len(fit.model.names)
    stderr = np.sqrt(np.maximum(np.diag(covariance)[:count], 0.0))
    held = stderr.copy()
    held[list(fit.estimate.held)] = np.nan
    known = [k for k in range(len(free)) if np.isfinite(tangent.stderr[columns][k])]
    chosen = [*range(count), *(count + k for k in known)]
    return replace(
        fit,
        solved=_prewhitened(fit),
        plain=replace(fit.plain, stderr=stderr),
        estimate=replace(fit.estimate, stderr=held),
        covariance=covariance[np.ix_(chosen, chosen)],
        free=tuple(free[k] for k in known),
    )


def sizes_in_shape(design: Design, fit: Fitted) -> dict[str, tuple[float, float]]:
    """Return the sizes that stand in the shape of the last effect, with their standard errors; those that have any.

    Parameters
    ----------
    design : Design
    fit : Fitted

    Returns
    -------
    dict of symbol to (value, stderr)
    """
    number = len(fit.accepted) - 1
    sizes = set(fit.accepted[number].effect.amplitudes) & set(searched(fit.accepted[number]))
    if not sizes:
        return {}
    found = with_shapes_fitted(design, fit)
    if found.covariance is None:
        return {}
    relative = np.sqrt(np.diag(found.covariance)[len(found.model.names) :]).tolist()
    shape = found.accepted[number].shape
    return {
        name: (shape[name], shape[name] * error)
        for (k, name), error in zip(found.free, relative, strict=True)
        if k == number and name in sizes
    }


def _free(one: Accepted) -> list[str]:
    """Return the names of a shape that are fitted and at no bound."""
    structure, shape = one.effect.structure, one.shape

    def near(name: str, sign: float) -> float:
        return shape[name] * float(np.exp(sign * DIFFERENCE * structure.straight_over(one.effect, shape, name)))

    return [
        name
        for name in searched(one)
        if all(structure.inside(one.effect, shape, name, near(name, sign)) == near(name, sign) for sign in (1.0, -1.0))
    ]


def straight_over(accepted: Sequence[Accepted], free: Sequence[Free]) -> Array:
    """Return the steps of shapes' logarithms over which the prediction is a straight line, shape (len(free),).

    Parameters
    ----------
    accepted : sequence of Accepted
    free : sequence of (int, str)
        Positions among them, and names in their shapes.
    """
    over = [(accepted[k].effect, accepted[k].shape, name) for k, name in free]
    return np.array([effect.structure.straight_over(effect, shape, name) for effect, shape, name in over])


def searched(one: Accepted) -> list[str]:
    """Return the names of a shape that are fitted and are no whole numbers, at a bound or not.

    Parameters
    ----------
    one : Accepted
    """
    structure = one.effect.structure
    fixed = structure.fixed(one.effect)
    fitted = {*varied(one.grid, one.shape), *structure.beside_the_search(one.effect)}
    return [name for name, value in one.shape.items() if name in fitted and name not in fixed and value > 0.0]


def shifted(accepted: Sequence[Accepted], free: Sequence[Free], step: Array) -> tuple[Accepted, ...]:
    """Return the effects with the logarithms of their shapes moved, inside their bounds.

    Parameters
    ----------
    accepted : sequence of Accepted
    free : sequence of (int, str)
        Positions among them, and names in their shapes.
    step : array, shape (len(free),)
    """
    out = list(accepted)
    for (k, name), by in zip(free, step.tolist(), strict=True):
        one = out[k]
        value = one.effect.structure.inside(one.effect, one.shape, name, one.shape[name] * float(np.exp(by)))
        if any(p.symbol == name and p.within_grid for p in one.effect.parameters):
            ends = [shape[name] for shape in one.grid]
            value = min(max(value, min(ends)), max(ends))
        out[k] = replace(one, shape={**one.shape, name: value})
    return tuple(out)


def _is_beside(one: Accepted, name: str) -> bool:
    """Whether a shape is fitted beside the search: the effect is what it is without it."""
    return name in one.effect.structure.beside_the_search(one.effect)


def _is_rough(design: Design, fit: Fitted, one: Free) -> bool:
    """Whether the prediction over a shape is no straight line even over a small step of it."""

    def change(step: float) -> Array:
        return _change(design, fit, shifted(fit.accepted, (one,), np.array([step])))

    far = float(straight_over(fit.accepted, (one,))[0])
    near = DIFFERENCE * far
    slope = (change(near) - change(-near)) / (2.0 * near)
    left = [np.linalg.norm(change(step) - step * slope) for step in (far, -far)]
    return bool(max(left) > STRAIGHT * far * np.linalg.norm(slope))


def _model(design: Design, fit: Fitted, accepted: tuple[Accepted, ...]) -> tuple[Record, Model]:
    """Return the record and the model of other shapes, with the priors of the fit.

    Where the drive signal is late, the columns of its sampling read the torque of these shapes, not of the fit's.
    """
    moved = [k for k, (one, before) in enumerate(zip(accepted, fit.accepted, strict=True)) if one.shape != before.shape]
    record, groups = fit.record, list(fit.model.groups)
    turning = [accepted[k] for k in moved if accepted[k].effect.structure.replaces_direction]
    for one in turning:
        record = with_direction(record, one.effect.structure.direction(record, one.effect, one.shape))
    if turning:  # every column of dry friction is another one
        model = laid_out_again(design, record, fit.model, accepted)
    else:
        for k in moved:
            position = fit.position(k)
            assert position is not None  # it does not replace the direction
            groups[position] = effect_group(record, accepted[k].effect, accepted[k].shape)
        model = with_priors(groups, fit.model)
    if moved and _is_late(record):
        driving = record.signals["torque"] - record.signals.get("T_load", 0.0)
        more = (model.matrix[0] - fit.model.matrix[0]) @ fit.estimate.values
        record = with_modelled_torque(record, record.at_grid(driving) + more, record.late or 0.0)
        model = laid_out_again(design, record, fit.model, accepted)
    return record, model


def _reading_its_torque(design: Design, fit: Fitted) -> Fitted:
    """Return a fit of moved shapes; the columns of a late drive signal are made of the torque that it predicts.

    As it was where the readings do not settle: those of a delay as long as the motion is fast.
    """
    given, change = fit, np.inf
    for _ in range(READINGS if _is_late(fit.record) else 0):
        torque = true_torque(fit.model, fit.estimate)
        record = with_modelled_torque(fit.record, torque, delay_of(fit.model, fit.estimate.values))
        model = laid_out_again(design, record, fit.model, fit.accepted)
        solved = solve_model(record, model, fit.weights, fit.plain)
        fit = replace(fit, record=record, model=model, plain=solved, estimate=bounded(solved))
        before, change = change, float(np.linalg.norm(true_torque(model, fit.estimate) - torque))
        if change > before:
            return given
        if change < STAYS * np.linalg.norm(torque):
            break
    return fit


def _is_late(record: Record) -> bool:
    return record.late is not None and abs(record.late) >= LATE * record.period


def _change(design: Design, fit: Fitted, accepted: tuple[Accepted, ...]) -> Array:
    """Return by how much other shapes change the prediction, shape (channels, m); all values stay."""
    moved = [k for k, (one, before) in enumerate(zip(accepted, fit.accepted, strict=True)) if one.shape != before.shape]
    if _is_late(fit.record) or any(accepted[k].effect.structure.replaces_direction for k in moved):
        return np.asarray((_model(design, fit, accepted)[1].matrix - fit.model.matrix) @ fit.estimate.values)
    change = np.zeros(fit.record.target.shape)
    for k in moved:  # all other columns stay
        position = fit.position(k)
        assert position is not None  # it does not replace the direction
        values = fit.estimate.values[fit.model.columns_of(position)]
        before = fit.model.groups[position].rows
        for row, columns in effect_group(fit.record, accepted[k].effect, accepted[k].shape).entering:
            was = before[row]
            change[row] += values @ (columns if was is None else columns - was)
    return change


def moved_to(design: Design, fit: Fitted, accepted: tuple[Accepted, ...]) -> Fitted:
    """Return the fit of other shapes, solved without bounds and without honest standard errors.

    Parameters
    ----------
    design : Design
    fit : Fitted
    accepted : tuple of Accepted
        The same effects, of other shapes.
    """
    record, model = _model(design, fit, accepted)
    solved = solve_model(record, model, fit.weights, fit.plain)
    return replace(fit, record=record, model=model, accepted=accepted, plain=solved, estimate=solved)


def tangent_of(design: Design, fit: Fitted, free: Sequence[Free]) -> Solved:
    """Solve the model with a column for every shape, behind all others: the prediction's slope over its logarithm.

    A shape that hardly changes the prediction makes the others no less certain than it may be itself.

    Parameters
    ----------
    design : Design
    fit : Fitted
    free : sequence of (int, str)
        Positions among the accepted effects, and names in their shapes.

    Raises
    ------
    UnavailableError
        For a shape that does nothing, or that the log cannot evaluate.
    """
    slopes = []
    for unit, (k, name) in zip(np.diag(DIFFERENCE * straight_over(fit.accepted, free)), free, strict=True):
        ahead, back = (shifted(fit.accepted, free, sign * unit) for sign in (1.0, -1.0))
        if not back[k].shape[name] > 0.0:  # a walk along a profile that has no end
            raise UnavailableError("a shape that vanished")
        width = float(np.log(ahead[k].shape[name] / back[k].shape[name]))  # half of it at a bound
        slopes.append((_change(design, fit, ahead) - _change(design, fit, back)) / max(width, 1e-300))
        if not np.any(slopes[-1]):
            raise UnavailableError("a shape does nothing")
    rows = tuple(row if np.any(row) else None for row in np.array(slopes).swapaxes(0, 1))
    model = fit.model.plus(Group(None, tuple(f"shape {k}" for k in range(len(free))), rows, {}), KNOWN_BEFORE)
    return solve_model(fit.record, model, fit.weights, fit.plain)


def trusted(step: Array, inverse: Array, longest: Array) -> Array:
    """Return the damped step that is nowhere longer than this: the less a shape matters, the less of its part is left.

    Cut off at its length each on its own, a step would lead another way: one shape far, and the others to where they
    would balance it further still. Source: J. J. More, Lecture Notes in Mathematics 630 (1978) 105.

    Parameters
    ----------
    step : array, shape (k,)
        By Gauss and Newton.
    inverse : array, shape (k, rank)
        From the directions of the fit to it: its covariance is that of these rows.
    longest : array, shape (k,)
    """
    left, size, _ = np.linalg.svd(inverse / longest[:, None], full_matrices=False)
    along = left.T @ (step / longest)
    damped, damping = along, 0.0
    while np.max(np.abs(left @ damped)) > 1.0:
        damping = 2.0 * damping or 1.0 / float(size[0]) ** 2
        damped = along / (1.0 + damping * size**2)
    return np.asarray(longest * (left @ damped))


def _moved(design: Design, fit: Fitted, free: Sequence[Free], step: tuple[Array, Array, Array]) -> Fitted | None:
    """Return the fit at moved shapes, without their errors; None where no step of `trusted` makes it better."""
    before, (whole, inverse, longest) = fit.estimate.chi2, step
    reach = longest * min(1.0, float(np.max(np.abs(whole) / longest)))  # a step that is short anyway is halved as well
    for halved in range(HALVINGS):
        accepted = shifted(fit.accepted, free, trusted(whole, inverse, reach / 2.0**halved))
        record, model = _model(design, fit, accepted)
        solved = solve_model(record, model, fit.weights, fit.plain)
        inside = bounded(solved)
        if inside.chi2 < before:
            return replace(fit, record=record, model=model, accepted=accepted, plain=solved, estimate=inside)
    return None


def _prewhitened(fit: Fitted) -> Solved:
    """Return the prewhitened solution of a fit whose shapes may have moved."""
    return fit.solved if fit.solved.model is fit.model else solve_model(fit.record, fit.model, fit.whitener)


def _with_errors(fit: Fitted) -> Fitted:
    """Return a fit whose shapes may have moved, with standard errors that take the shapes as known."""
    covariance = noise_covariance(fit.plain, fit.weights, fit.whitener)
    plain, estimate = (with_honest_errors(replace(covariance, fit=one)) for one in (fit.plain, fit.estimate))
    return replace(fit, solved=_prewhitened(fit), plain=plain, estimate=estimate)

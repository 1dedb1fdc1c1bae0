"""The base model fitted to one record: its terms read the torque that it predicts, and its sampling is bounded."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects.base import Effect
from pmsm_ctrl.effects.catalogue import bound_effects
from pmsm_ctrl.evidence.linalg import own_shares
from pmsm_ctrl.evidence.whitening import Whitener, make_whitener
from pmsm_ctrl.regression.balances import LATE, Record
from pmsm_ctrl.regression.bounds import bounded
from pmsm_ctrl.regression.columns import Group, UnavailableError, effect_group
from pmsm_ctrl.regression.covariance import NoiseCovariance, noise_covariance, with_honest_errors
from pmsm_ctrl.regression.lateness import lateness, with_sampling_bounded
from pmsm_ctrl.regression.model import FIXED, OWN, TWIN, Model, Solved, base_groups, solve_model
from pmsm_ctrl.regression.modelled import in_time, with_direction, with_modelled_torque
from pmsm_ctrl.regression.saturated import Saturated, rough_solution, rough_weights, saturated, whiteners
from pmsm_ctrl.regression.spread import with_spread

__all__ = [
    "SETTLED", "Accepted", "Estimated", "Settled", "assembled", "base_fit", "delay_of", "error_left", "estimated",
    "false_torque", "laid_out_again", "reads_torque", "settled_model", "torque_left", "true_torque", "weighted",
    "with_bristles", "with_priors",
]  # fmt: skip

Array = NDArray[np.float64]

SETTLED = "settled model"  # that of the design alone, as it is remembered with a record
# Passes in which a delay is linearised at its last value: to first order one of two samples comes out a third low.
PASSES = 4
ROUNDS_OF_NOISE = 2  # in which the noise is taken from what the model itself leaves
SURE = 3.0  # standard errors of a sum of squares, by which the model must leave less


@dataclass(frozen=True, eq=False)
class Accepted:
    """An effect that is in the model beside the design's own, with its nonlinear parameters."""

    effect: Effect
    shape: Mapping[str, float]
    grid: tuple[Mapping[str, float], ...] = ()


@dataclass(frozen=True, eq=False)
class Settled:
    """A model whose terms read the torque that it predicts.

    Attributes
    ----------
    record : Record
        With modelled torque in its signals.
    model : Model
        With the sampling of the drive signal inside what is possible.
    rough : Solved
        By rough weights; without bases and residual.
    notes : tuple of str
        Effects of the design that this log cannot evaluate.
    left : Saturated
        Residual of the model with curves of speed and time.
    """

    record: Record
    model: Model
    rough: Solved
    notes: tuple[str, ...]
    left: Saturated


@dataclass(frozen=True, eq=False)
class Estimated:
    """A settled model, solved with the noise of the residual of a saturated model.

    Attributes
    ----------
    record : Record
    model : Model
    whitener, weights : Whitener
        The noise with its correlation, and without: the weights of the estimate.
    solved, weighted : Solved
        The model solved with either, without bounds.
    """

    record: Record
    model: Model
    whitener: Whitener
    weights: Whitener
    solved: Solved
    weighted: Solved

    # Standard errors that allow for the noise's correlation take longer than the fit, and not every fit is asked.
    @cached_property
    def covariance(self) -> NoiseCovariance:
        """Of `weighted`."""
        return noise_covariance(self.weighted, self.weights, self.whitener)

    @cached_property
    def plain(self) -> Solved:
        """The fit `weighted`, with standard errors that allow for the noise's correlation."""
        return with_honest_errors(self.covariance)

    @cached_property
    def inside(self) -> Solved:
        """The fit inside the bounds of the parameters."""
        return bounded(self.weighted)

    @cached_property
    def estimate(self) -> Solved:
        """The fit inside the bounds, with its standard errors: what is reported and written."""
        if not self.inside.held:
            return self.plain
        return with_honest_errors(replace(self.covariance, fit=self.inside))

    def level(self, name: str) -> float:
        """Return a parameter without bounds."""
        return float(self.weighted.values[self.model.names.index(name)])

    def value(self, name: str) -> tuple[float, float]:
        """Return a parameter without bounds, and its standard error."""
        k = self.model.names.index(name)
        return float(self.plain.values[k]), float(self.plain.stderr[k])


def error_left(record: Record, fit: Estimated) -> float:
    """Return the weighted rms error of the torque balance, as a share of the torque.

    Parameters
    ----------
    record : Record
    fit : Estimated
        Of the base model to that record.
    """
    return torque_left(record, fit.weighted)


def torque_left(record: Record, solved: Solved) -> float:
    """Return the same of a solution.

    Parameters
    ----------
    record : Record
    solved : Solved
        Of a model on that record.
    """
    weight = record.weight[0] * record.mask
    left = (record.target[0] - solved.predicted()[0]) * weight
    return float(np.linalg.norm(left)) / max(float(np.linalg.norm(record.target[0] * weight)), 1e-300)


def base_fit(design: Design, record: Record, settled: bool = True) -> Estimated:
    """Fit the design as it stands to a record.

    Parameters
    ----------
    design : Design
    record : Record
    settled : bool
        Whether a filter of the drive signal was undone already, if there was one.
    """
    found = settled_model(design, record, (), settled)
    return estimated(found.record, found.model, found.left)


def settled_model(design: Design, record: Record, accepted: tuple[Accepted, ...] = (), settled: bool = True) -> Settled:
    """Return the model of the design with further effects, about the delay that the drive signal has.

    That of the design alone is remembered with the record.

    Parameters
    ----------
    design : Design
    record : Record
    accepted : tuple of Accepted
    settled : bool
        False in a fit that finds out how the drive signal was sampled.
    """
    if accepted or design is not record.design:
        return _settled_model(design, record, accepted, settled)
    key = (SETTLED, settled)
    if key not in record.kept:
        found = _settled_model(design, record, (), settled)
        if found.record.kept is not record.kept:  # a bristle turns the friction: its columns are others
            return found
        # no circle of references
        used = replace(found.record, kept={}, weighing=None)
        record.kept[key] = replace(found, record=used, rough=found.rough.bare())
    remembered: Settled = record.kept[key]
    return replace(remembered, record=replace(remembered.record, kept=record.kept))


def _settled_model(design: Design, record: Record, accepted: tuple[Accepted, ...], settled: bool) -> Settled:
    record = with_bristles(design, record, accepted)
    model, notes = assembled(design, record, accepted, settled)
    if _delays(model) and record.delayed > record.period:  # no slope of the measured torque reaches as far
        record = with_modelled_torque(record, in_time(record, record.delayed), record.delayed)
        model, notes = assembled(design, record, accepted, settled)
    model = _with_twins_held(record, model)
    left = saturated(record, model)
    rough = rough_solution(record, _with_torque_held(record, model), left, rough_weights(record, left))
    for _ in range(PASSES):
        torque, late = true_torque(model, rough), delay_of(model, rough.values)
        inertia = float(rough.values[model.names.index("J")])
        del model, rough, left  # the matrix of a long log is large: the next one takes its place
        record = replace(with_modelled_torque(record, torque, late), found=inertia)
        model, notes = assembled(design, record, accepted, settled)
        model = _with_torque_held(record, _with_twins_held(record, model), OWN)
        left = saturated(record, model)
        weights = rough_weights(record, left)
        rough = rough_solution(record, model, left, weights)
        held = with_sampling_bounded(record, model, rough, float(weights.sigma[0])) if settled else model
        if held is not model:
            model = held
            rough = rough_solution(record, model, left, weights)
        if abs(delay_of(model, rough.values) - (record.late or 0.0)) < LATE * record.period:
            break
    return Settled(record, model, rough, notes, left)


def _with_torque_held(record: Record, model: Model, least: float = 1.0) -> Model:
    """Hold the design's terms that read the torque, unless at least this share of each is independent of other columns.

    Friction proportional to the torque explains all of it where the axis is driven in one direction only: with a factor
    of one and an inertia of zero.
    """
    sigma = model.sigma.copy()
    held = [k for k in np.flatnonzero(model.nominal).tolist() if reads_torque(model.group_of(k).effect)]
    if held:
        shares = own_shares(model.matrix[0] * (record.weight[0] * record.mask)[:, None])
        for k in held:
            if shares[k] <= least:
                sigma[k] = FIXED * abs(model.nominal[k])
    return replace(model, sigma=sigma)


def reads_torque(effect: Effect | None) -> bool:
    """Return whether an effect on the torque is a share of it.

    Parameters
    ----------
    effect : Effect or None
    """
    return effect is not None and effect.enters == "torque" and "torque" in effect.signals


def estimated(record: Record, model: Model, left: Saturated) -> Estimated:
    """Solve a model with the noise of the residual of a saturated one.

    Parameters
    ----------
    record : Record
    model : Model
    left : Saturated
    """
    model, whitener, weights = _with_noise(record, model, left)
    whitener, solved = _no_louder_than_the_base(record, model, left, whitener)
    return Estimated(record, model, whitener, weights, solved, solve_model(record, model, weights))


def weighted(found: Settled) -> Solved:
    """Solve a settled model by the weights alone, without bounds: where no prewhitened fit is asked for.

    Parameters
    ----------
    found : Settled
    """
    model, _, weights = _with_noise(found.record, found.model, found.left)
    return solve_model(found.record, model, weights)


def _with_noise(record: Record, model: Model, left: Saturated) -> tuple[Model, Whitener, Whitener]:
    """Return the model with the spread that its noise hides, the prewhitener, and the weights."""
    whitener, weights = whiteners(record, left.residual, left.rank)
    return with_spread(record, model, whitener), whitener, weights


def _no_louder_than_the_base(
    record: Record, model: Model, left: Saturated, whitener: Whitener
) -> tuple[Whitener, Solved]:
    """Return the prewhitener, with noise no larger than the model's own residual, and the model solved with it.

    The saturated model is fitted by weights alone. Where most of the noise is slow, its columns follow the slow noise
    and add fast noise of their own. The whitened residual of the model itself is then the smaller one, and the better
    estimate of the noise. A difference below the scatter of a sum of squares is ignored.
    """
    solved = solve_model(record, model, whitener)
    for _ in range(ROUNDS_OF_NOISE):
        rest = record.target - solved.predicted()
        rows = range(len(record.channels))
        louder = [float(np.sum(whitener.part(row, left.residual[row]) ** 2)) for row in rows]
        chance = SURE * math.sqrt(2.0 * len(whitener.used))
        quiet = [row for row in rows if float(np.sum(whitener.part(row, rest[row]) ** 2)) < louder[row] - chance]
        if not quiet:
            break
        residual = left.residual.copy()
        residual[quiet] = rest[quiet]
        residual[record.weight * record.mask == 0.0] = 0.0
        left = replace(left, residual=residual)
        whitener = make_whitener(residual, record.weight, record.mask, record.rate, left.rank)
        solved = solve_model(record, model, whitener)
    return whitener, solved


def assembled(
    design: Design, record: Record, accepted: Iterable[Accepted], settled: bool = True
) -> tuple[Model, tuple[str, ...]]:
    """Return the model of the design with further effects, and notes on what this log cannot evaluate.

    Parameters
    ----------
    design : Design
    record : Record
    accepted : iterable of Accepted
    settled : bool
        As in `settled_model`.
    """
    wired = (one for one in accepted if not one.effect.structure.replaces_direction)
    return base_groups(design, record, settled, [effect_group(record, one.effect, one.shape) for one in wired])


def _with_twins_held(record: Record, model: Model) -> Model:
    """Hold the design's parameters that no motion of the log tells from those before them at what the design states.

    The least squares would share the sum of two such terms in a way that nothing supports. Those are a load and the dry
    friction in one direction, or iron losses and friction.
    """
    stated = [k for k in range(len(model.names)) if model.group_of(k).entry >= 0 and not np.any(model.matrix[1:, :, k])]
    own = [k for k in (model.names.index("J"), *stated) if np.any(model.matrix[0][:, k])]
    columns = model.matrix[0][:, own] * (record.weight[0] * record.mask)[:, None]
    size = np.linalg.norm(columns, axis=0)
    beside = np.abs(np.diag(np.linalg.qr(columns / np.where(size > 0.0, size, 1.0), mode="r")))
    twins = [k for k, share in zip(own, beside.tolist(), strict=False) if k in stated and share < TWIN]
    if record.driven:
        twins += [k for k in stated if k in own and _is_dry(model.group_of(k).effect)]
    if not twins:
        return model
    sigma, torque = model.sigma.copy(), float(np.linalg.norm(record.target[0] * record.weight[0] * record.mask))
    for k in twins:
        sigma[k] = FIXED * (abs(model.nominal[k]) or torque / max(float(size[own.index(k)]), 1e-300))
    return replace(model, sigma=sigma)


def _is_dry(effect: Effect | None) -> bool:
    """Whether an effect is friction whose size hangs on nothing."""
    return effect is not None and effect.signals == ("direction",)


def laid_out_again(design: Design, record: Record, model: Model, accepted: Iterable[Accepted] = ()) -> Model:
    """Return a model with every column made on another record, and the priors that it has.

    Parameters
    ----------
    design : Design
    record : Record
    model : Model
    accepted : iterable of Accepted
        The effects in it beside the design's own.

    Raises
    ------
    UnavailableError
        When they have other parameters on this record.
    """
    made, _ = assembled(design, record, accepted)
    if made.names != model.names:
        raise UnavailableError("another shape has other parameters")
    return with_priors(made.groups, model)


def with_priors(groups: Sequence[Group], model: Model) -> Model:
    """Return groups as a model with the priors of another one of the same parameters.

    Parameters
    ----------
    groups : sequence of Group
    model : Model
    """
    made = Model.of(groups, model.names, model.nominal, model.sigma)
    return replace(made, doubt=model.doubt, bias=model.bias)


def with_bristles(design: Design, record: Record, accepted: Iterable[Accepted] = ()) -> Record:
    """Return the record in which dry friction follows the bristle, if the model has one.

    Parameters
    ----------
    design : Design
    record : Record
    accepted : iterable of Accepted
    """
    own = (Accepted(effect, values) for effect, values in bound_effects(design) if effect.active(values))
    for one in (*own, *accepted):
        structure = one.effect.structure
        if structure.replaces_direction:
            record = with_direction(record, structure.direction(record, one.effect, one.shape))
    return record


def true_torque(model: Model, fit: Solved) -> Array:
    """Return the torque that acts, shape (m,): the balance without what is only measured wrongly.

    Parameters
    ----------
    model : Model
    fit : Solved
    """
    torque: Array = fit.predicted()[0] - false_torque(model, fit.values)
    return torque


def false_torque(model: Model, values: Array) -> Array:
    """Return what is only measured wrongly in the torque balance, shape (m,).

    Parameters
    ----------
    model : Model
    values : array, shape (k,)
    """
    out = np.zeros(model.matrix.shape[1])
    for position, group in enumerate(model.groups):
        if group.misread:
            columns = model.columns_of(position)
            out += model.matrix[0][:, columns] @ values[columns]
    return out


def _delays(model: Model) -> bool:
    return any(group.effect is not None and group.effect.structure.delays for group in model.groups)


def delay_of(model: Model, values: Array) -> float:
    """Return the delay of the currents that a model has, s, inside its bounds; 0 where it has none.

    Parameters
    ----------
    model : Model
    values : array, shape (k,)
    """
    return lateness(model, values) + sum(
        group.effect.structure.delay(group.effect, values[model.columns_of(position)].tolist())
        for position, group in enumerate(model.groups)
        if group.effect is not None
    )

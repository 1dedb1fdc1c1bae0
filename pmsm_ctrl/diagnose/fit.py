"""The design plus the effects accepted so far, fitted to one log, and every candidate tried on the residual."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose.candidates import Candidate, candidates_for
from pmsm_ctrl.diagnose.refine import refine
from pmsm_ctrl.diagnose.search import (
    Offer,
    Rows,
    Trial,
    as_judged,
    beyond_each,
    offer,
    plain_evidence,
    tried,
    try_all,
    try_candidate,
    try_group,
)
from pmsm_ctrl.effects.base import Effect
from pmsm_ctrl.evidence.linalg import Added
from pmsm_ctrl.evidence.whitening import Whitener
from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.regression.base_fit import (
    Accepted,
    Estimated,
    Settled,
    assembled,
    delay_of,
    estimated,
    false_torque,
    settled_model,
    with_bristles,
)
from pmsm_ctrl.regression.bounds import bounded
from pmsm_ctrl.regression.columns import SINGLE, forget_effects, seen_as_candidate
from pmsm_ctrl.regression.covariance import NoiseCovariance
from pmsm_ctrl.regression.model import Model, Solved, solve_model
from pmsm_ctrl.regression.modelled import with_modelled_torque
from pmsm_ctrl.regression.prediction import better_without, physical_columns
from pmsm_ctrl.regression.spread import with_mean, with_spread

__all__ = ["BASE", "Accepted", "Elsewhere", "Fitted", "fit_beside", "fit_design", "predicted_elsewhere", "ranked"]

Array = NDArray[np.float64]

BASE = -1
MOST_REFINED = 6  # candidates of a round
NOT_MUCH_WORSE = 0.5  # share of a gain: a grid through a sharp valley may miss as much
AT_ONCE = 2e6  # bytes of whitened columns that are judged at once, of one column each
# Share of the gain within which two candidates explain the same; the simpler one then comes first.
PARSIMONY = 0.98


@dataclass(frozen=True, eq=False)
class Fitted:
    """The design plus accepted effects, fitted to one log.

    Attributes
    ----------
    record : Record
        With modelled torque in its signals.
    model : Model
    whitener, weights : Whitener
        The noise with its correlation, and without: the weights of the estimate.
    solved, plain : Solved
        The model solved with either, without bounds: what candidates are tested against.
    estimate : Solved
        `plain` inside the bounds of the parameters: what is reported and written.
    trials : tuple of Trial
        Every candidate that has columns on this log, the one that explains most first.
    closed : tuple of Candidate
        The others.
    notes : tuple of str
        Effects of the design that this log cannot evaluate.
    accepted : tuple of Accepted
        The effects, with the nonlinear parameters that this fit holds.
    covariance : array, shape (k + f, k + f), or None
        Of the k values of `plain` and the logarithms of the f nonlinear parameters in `free`; None where those were not
        fitted together.
    free : tuple of (int, str)
        Positions among the accepted effects, and names in their shapes.
    rough : frozenset of int
        Positions of effects whose prediction is not linear over a shape, even locally; they have no standard errors.
    unmoved : frozenset of (int, str)
        Shapes that stay as they are, because the prediction is rough over them; what the effect is hangs on others.
    profiles : dict of (int, str) to (float, float)
        95 % intervals of the parameters whose sum of squares is no parabola, by position of the effect (`BASE` for the
        design's own) and symbol.
    """

    record: Record
    model: Model
    whitener: Whitener
    solved: Solved
    plain: Solved
    estimate: Solved
    weights: Whitener
    trials: tuple[Trial, ...]
    closed: tuple[Candidate, ...]
    notes: tuple[str, ...]
    accepted: tuple[Accepted, ...]
    covariance: Array | None = None
    free: tuple[tuple[int, str], ...] = ()
    rough: frozenset[int] = frozenset()
    unmoved: frozenset[tuple[int, str]] = frozenset()
    profiles: Mapping[tuple[int, str], tuple[float, float]] = field(default_factory=dict)

    # Read by a dozen criteria.
    @cached_property
    def residual(self) -> Array:
        """Measured less predicted, shape (channels, m)."""
        return self.record.target - self.estimate.predicted()

    @cached_property
    def values(self) -> Array:
        """The parameters as they are reported, shape (k,): without nuisances that raise the error of the torque."""
        values = self.estimate.values
        at = {k: float(values[k]) for k in physical_columns(self.model)}
        better = better_without(self.record, self.model, self.estimate.predicted(), at)
        return np.array([better[k] for k in range(len(values))]) if better else values

    @cached_property
    def left(self) -> Array:
        """Measured less predicted as it is reported, shape (channels, m): by `values`."""
        if self.values is self.estimate.values:
            return self.residual
        return np.asarray(self.record.target - self.model.matrix @ self.values)

    def light(self) -> Fitted:
        """Return the fit without candidates and bases: on a long log they are large."""
        solved, plain, estimate = (replace(one, bases=()) for one in (self.solved, self.plain, self.estimate))
        return replace(self, trials=(), solved=solved, plain=plain, estimate=estimate)

    def spared(self) -> Fitted:
        """Return the fit without bases and the candidates' columns: with what a later search asks of an earlier fit."""
        return replace(self.light(), trials=tuple(trial.spared() for trial in self.trials))

    def judging_itself(self) -> Fitted:
        """Return the fit with its candidates beside this fit, not beside the one whose shapes were not fitted yet.

        On a long log that one is large.
        """
        solved, plain = (self.solved, self.whitener), (self.plain, self.weights)
        return replace(self, trials=tuple(replace(one, judge=solved, plain_judge=plain) for one in self.trials))

    def without_last(self) -> Fitted | None:
        """Return the fit without the last accepted effect, with the same nuisance parameters held.

        A new fit without the effect could hold other ones: the sampling is better determined with the effect in the
        model. None where the effect has no columns of its own.
        """
        last = self.position(len(self.accepted) - 1)
        if last is None or last != len(self.model.groups) - 1:
            return None
        whole, k = self.model, self.model.columns_of(last).start
        doubt, bias = ({n: value for n, value in known.items() if n < k} for known in (whole.doubt, whole.bias))
        model = replace(
            whole, groups=whole.groups[:last], names=whole.names[:k], nominal=whole.nominal[:k], sigma=whole.sigma[:k],
            matrix=whole.matrix[:, :, :k], doubt=doubt, bias=bias,
        )  # fmt: skip
        model = with_mean(self.record, model, self.whitener)  # what the effect explained must not become a mean load
        judges = (self.whitener, self.solved), (self.weights, self.plain)
        solved, plain = (solve_model(self.record, model, weights, like) for weights, like in judges)
        return replace(
            self, model=model, solved=solved, plain=plain, estimate=bounded(plain), accepted=self.accepted[:-1],
            trials=(), closed=(), covariance=None, free=(), rough=frozenset(), unmoved=frozenset(), profiles={},
        )  # fmt: skip

    def held_alike(self, after: Fitted) -> Fitted:
        """Return this fit with the nuisance parameters held that a fit with one more effect holds.

        With the effect a fit may find that noise biases the timing by least squares, and hold the one by the reference.
        A biased timing makes the error smaller, whatever the model.

        Parameters
        ----------
        after : Fitted
        """
        if set(self.model.doubt) >= set(after.model.doubt):
            return self
        return after.without_last() or self

    def position(self, number: int, model: Model | None = None) -> int | None:
        """Where an accepted effect stands among the model's groups; None where it has no columns of its own.

        Parameters
        ----------
        number : int
            Of the effect.
        model : Model, optional
            The same model on another record.
        """
        if self.accepted[number].effect.structure.replaces_direction:
            return None
        wired = [k for k, one in enumerate(self.accepted) if not one.effect.structure.replaces_direction]
        return len((model or self.model).groups) - len(wired) + wired.index(number)


def fit_design(
    design: Design, record: Record, accepted: tuple[Accepted, ...], effects: Mapping[str, Effect],
    explore: bool = True,
) -> Fitted:  # fmt: skip
    """Fit the design with the accepted effects, and try every candidate on the residual."""
    found, fit, laid = _laid_out(design, record, accepted, effects)
    closed: tuple[Candidate, ...] = ()
    trials: list[Trial] = []
    if explore:
        every = try_all(laid, fit.plain, fit.weights)
        closed = tuple(one for (one, _), trial in zip(laid.candidates, every, strict=True) if trial is None)
        refined = _refined(fit, [as_judged(fit.record, trial) for trial in every if trial is not None])
        trials = in_order(judged((fit.solved, fit.whitener), fit.covariance, refined))
    _forget(record, fit.record)
    return Fitted(
        fit.record, fit.model, fit.whitener, fit.solved, fit.plain, fit.estimate, fit.weights, tuple(trials),
        closed, found.notes, accepted,
    )  # fmt: skip


def fit_beside(design: Design, record: Record, accepted: tuple[Accepted, ...], other: Fitted) -> Fitted:
    """Fit the design with the accepted effects by the noise of another fit, no candidate tried.

    The noise is what a model with all candidates leaves. Where the effects that are new were candidates of the other
    fit, both such models are nearly the same, and none of their hundreds of columns has to be laid out again.

    Parameters
    ----------
    design : Design
    record : Record
    accepted : tuple of Accepted
    other : Fitted
        Of the same record.
    """
    found = settled_model(design, record, accepted)
    used, whitener, weights = found.record, other.whitener, other.weights
    model = with_spread(used, found.model, whitener)
    fit = Estimated(
        used, model, whitener, weights, solve_model(used, model, whitener), solve_model(used, model, weights)
    )
    _forget(record, used)
    return Fitted(
        used, model, whitener, fit.solved, fit.plain, fit.estimate, weights, (), (), found.notes, accepted
    )  # fmt: skip


def ranked(
    design: Design, record: Record, accepted: tuple[Accepted, ...], effects: Mapping[str, Effect]
) -> list[Trial]:
    """Return the candidates that have columns beside the accepted effects, the one that explains most first.

    Their significance is not judged.

    Parameters
    ----------
    design : Design
    record : Record
    accepted : tuple of Accepted
    effects : dict of id to Effect
    """
    _, fit, laid = _laid_out(design, record, accepted, effects)
    every = [as_judged(fit.record, t) for t in try_all(laid, fit.plain, fit.weights) if t is not None]
    trials = in_order([replace(trial, plain_gain=trial.gain) for trial in _refined(fit, every)])
    while trials and not trials[0].singular:
        first = trials[0]
        if not try_group(fit.solved, fit.whitener, first.candidate, first.group).singular:
            break
        trials = in_order([replace(first, singular=True), *trials[1:]])
    _forget(record, fit.record)
    return trials


def _laid_out(
    design: Design, record: Record, accepted: tuple[Accepted, ...], effects: Mapping[str, Effect]
) -> tuple[Settled, Estimated, Offer]:
    """Fit the design with the accepted effects, by the noise that all candidates together leave."""
    found = settled_model(design, record, accepted)
    present = [e.id for e in design.effects] + [a.effect.id for a in accepted]
    residual = record.target[0] - found.rough.predicted()[0]
    candidates = candidates_for(found.record, effects, residual, present)
    laid, left = offer(found.record, found.model, candidates)
    if len(record.mask) > SINGLE:  # hundreds of columns of an hour are not kept until a few of them are chosen
        laid = laid.without_columns()
        _forget(record, found.record)
        forget_effects(record)
    return found, estimated(found.record, found.model, left), laid


def _forget(given: Record, used: Record) -> None:
    """Drop hundreds of columns; the best of each candidate stays with its trial."""
    used.memo.clear()
    if used.kept is not given.kept:
        used.kept.clear()


@dataclass(frozen=True, eq=False)
class Elsewhere:
    """A model on a record that it was not fitted to.

    Attributes
    ----------
    record : Record
        Read with the torque of the fit.
    model : Model
    values : array, shape (k,)
        The fit's parameters, 0 where it has none of that name.
    predicted : array, shape (channels, m)
    """

    record: Record
    model: Model
    values: Array
    predicted: Array


def predicted_elsewhere(design: Design, record: Record, accepted: tuple[Accepted, ...], fit: Fitted) -> Elsewhere:
    """Return the balances of another record, predicted with the parameters of a fit.

    Parameters
    ----------
    design : Design
    record : Record
    accepted : tuple of Accepted
    fit : Fitted
    """
    record = with_bristles(design, record, accepted)
    for _ in range(2):
        model, _ = assembled(design, record, accepted)
        by_name = dict(zip(fit.model.names, fit.values, strict=True))
        values = np.array([by_name.get(name, 0.0) for name in model.names])
        predicted = model.matrix @ values
        record = with_modelled_torque(record, predicted[0] - false_torque(model, values), delay_of(model, values))
    return Elsewhere(record, model, values, predicted)


def judged(fit: tuple[Solved, Whitener], covariance: NoiseCovariance, trials: Sequence[Trial]) -> list[Trial]:
    """Keep the trials' shapes and sizes, found with plain weights, and judge their significance.

    Twice: prewhitened, which has the greatest power where a column is right at all frequencies, and with the weights
    of the estimate, which tolerates errors of its fast part. The better one counts, at twice its p-value.

    Parameters
    ----------
    fit : (Solved, Whitener)
        Prewhitened.
    covariance : NoiseCovariance
        Of the estimate.
    trials : sequence of Trial
    """
    out: list[Trial] = []
    size = max(1, int(AT_ONCE / (8.0 * len(fit[1].used))))
    for some in (trials[start : start + size] for start in range(0, len(trials), size)):
        groups = [trial.group for trial in some]
        found = beyond_each(*fit, groups), beyond_each(covariance.fit, covariance.weights, groups)
        out += [
            _judged(fit, covariance, trial, white[1], plain) for trial, white, plain in zip(some, *found, strict=True)
        ]
    return out


def _judged(
    fit: tuple[Solved, Whitener], covariance: NoiseCovariance, trial: Trial, own: Added, plain: tuple[Rows, Added]
) -> Trial:
    sure = tried(trial.candidate, trial.group, own, fit)
    slow_gain, slow_p = plain_evidence(covariance, trial.candidate, trial.group, plain)
    fast_p = 1.0 if sure.wrong_sign else sure.p_value
    by_weights = slow_p < fast_p
    gain = slow_gain if by_weights else sure.gain
    return replace(
        trial, plain_gain=trial.gain, plain_judge=trial.judge,
        gain=gain, score=sure.score + gain - sure.gain, p_value=min(1.0, 2.0 * min(slow_p, fast_p)),
        judge=fit, singular=trial.singular or sure.singular, by_weights=by_weights,
    )  # fmt: skip


def in_order(trials: list[Trial]) -> list[Trial]:
    """Sort by what they explain of the residual; of two that explain the same the simpler one comes first."""
    left = sorted(trials, key=lambda t: (t.wrong_sign or t.singular, t.at_bound, -t.plain_gain))
    out: list[Trial] = []
    while left:
        first = left[0]
        alike = [
            t
            for t in left
            if t.plain_gain >= PARSIMONY * first.plain_gain and not (t.wrong_sign or t.singular or t.at_bound)
        ]
        chosen = (
            min(alike, key=lambda t: (len(t.values) + len(t.candidate.free(t.group.shape)), -t.plain_gain))
            if alike
            else first
        )
        out.append(chosen)
        left.remove(chosen)
    return out


def _refined(fit: Estimated, trials: list[Trial]) -> list[Trial]:
    """Refine the shapes of the few that matter; where an effect has shapes of two kinds, the best of either."""
    best = sorted((t for t in trials if not t.wrong_sign), key=lambda t: -t.score)[:MOST_REFINED]
    out = []
    for trial in trials:
        if trial in best and trial.score > 0.0:
            refined = [
                refine(fit.record, fit.plain, fit.weights, one, seen_as_candidate) for one in _of_each_kind(fit, trial)
            ]
            trial = max(refined, key=lambda one: one.score)
        out.append(trial)
    return out


def _of_each_kind(fit: Estimated, trial: Trial) -> list[Trial]:
    """Return the trial, and the best of the shapes of another kind where that is not much worse."""
    kind = trial.group.shape.keys()
    others = tuple(shape for shape in trial.candidate.grid if shape.keys() != kind)
    other = try_candidate(fit.record, fit.plain, fit.weights, replace(trial.candidate, grid=others)) if others else None
    if other is None or other.wrong_sign or other.score < NOT_MUCH_WORSE * trial.score:
        return [trial]
    return [trial, replace(other, candidate=trial.candidate)]

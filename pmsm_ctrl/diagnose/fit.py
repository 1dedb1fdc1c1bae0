"""The design plus the effects accepted so far, fitted to one log, and every candidate tried on the residual."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose.candidates import Candidate, candidates_for
from pmsm_ctrl.diagnose.refine import refine
from pmsm_ctrl.diagnose.search import (
    Trial,
    offer,
    plain_evidence,
    try_all,
    try_group,
)
from pmsm_ctrl.effects.base import Effect
from pmsm_ctrl.evidence.whitening import Whitener
from pmsm_ctrl.regression.balances import Record, with_modelled_torque
from pmsm_ctrl.regression.base_fit import (
    Accepted,
    assembled,
    delay_of,
    estimated,
    false_torque,
    settled_model,
    with_bristles,
)
from pmsm_ctrl.regression.columns import seen_as_candidate
from pmsm_ctrl.regression.covariance import NoiseCovariance
from pmsm_ctrl.regression.model import Model, Solved

__all__ = ["Accepted", "Fitted", "errors", "fit_design", "predicted_elsewhere"]

Array = NDArray[np.float64]

MOST_REFINED = 6  # candidates of a round
# Two candidates that explain the same to within this share differ by nothing but their flexibility.
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
        What of the design this log cannot evaluate.
    accepted : tuple of Accepted
        The effects, with the nonlinear parameters that this fit holds.
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

    @property
    def residual(self) -> Array:
        """Measured less predicted, shape (channels, m)."""
        return self.record.target - self.estimate.predicted()

    def position(self, number: int) -> int | None:
        """Where an accepted effect stands among the model's groups; None where it has no columns of its own."""
        if self.accepted[number].effect.structure.replaces_direction:
            return None
        wired = [k for k, one in enumerate(self.accepted) if not one.effect.structure.replaces_direction]
        return len(self.model.groups) - len(wired) + wired.index(number)


def fit_design(
    design: Design, record: Record, accepted: tuple[Accepted, ...], effects: Mapping[str, Effect],
    explore: bool = True,
) -> Fitted:  # fmt: skip
    """Fit the design with the accepted effects, and try every candidate on the residual."""
    found = settled_model(design, record, accepted)
    given, record, model, notes = record, found.record, found.model, found.notes
    present = [e.id for e in design.effects] + [a.effect.id for a in accepted]
    residual = record.target[0] - found.rough.predicted()[0]
    candidates = candidates_for(record, design, effects, residual, present)
    laid, left = offer(record, model, candidates)
    fit = estimated(record, model, left)
    whitener, weights, solved, plain, estimate = fit.whitener, fit.weights, fit.solved, fit.plain, fit.estimate
    if not explore:
        return Fitted(record, model, whitener, solved, plain, estimate, weights, (), (), notes, accepted)
    tried = try_all(laid, plain, weights)
    closed = [candidate for candidate, trial in zip(candidates, tried, strict=True) if trial is None]
    trials = [trial for trial in tried if trial is not None]
    trials = [judged((solved, whitener), fit.covariance, t) for t in _refined(record, plain, weights, trials)]
    trials = in_order(trials)
    record.memo.clear()  # hundreds of columns; the best of each candidate stays with its trial
    if record.kept is not given.kept:
        record.kept.clear()
    return Fitted(
        record, model, whitener, solved, plain, estimate, weights, tuple(trials), tuple(closed), notes, accepted
    )


def predicted_elsewhere(
    design: Design, record: Record, accepted: tuple[Accepted, ...], fit: Fitted,
    effects: Mapping[str, Effect],
) -> tuple[Record, Array]:  # fmt: skip
    """Return another record, read with the torque of the fit, and its balances predicted with the fit's parameters."""
    record = with_bristles(design, record, accepted)
    for _ in range(2):
        model, _ = assembled(design, record, accepted)
        by_name = dict(zip(fit.model.names, fit.estimate.values, strict=True))
        values = np.array([by_name.get(name, 0.0) for name in model.names])
        predicted = model.matrix @ values
        record = with_modelled_torque(record, predicted[0] - false_torque(model, values), delay_of(model, values))
    return record, predicted


def errors(record: Record, residual: Array, channels: Iterable[str] | None = None) -> dict[str, tuple[float, float]]:
    """Rms residual and its share of the measured balance: moving samples."""
    out = {}
    for row, name in enumerate(record.channels):
        if channels is not None and name not in channels:
            continue
        used = record.mask
        size = float(np.sqrt(np.mean(record.target[row][used] ** 2)))
        rms = float(np.sqrt(np.mean(residual[row][used] ** 2)))
        out[name] = (rms, rms / size if size > 0.0 else float("nan"))
    return out


def judged(fit: tuple[Solved, Whitener], covariance: NoiseCovariance, trial: Trial) -> Trial:
    """Keep a trial's shape and size, found with plain weights, and judge its significance.

    Twice: prewhitened, which has the greatest power where a column is right at all frequencies, and with the weights
    of the estimate, which tolerates errors of its fast part. The better one counts, at twice its p-value.
    """
    sure = try_group(*fit, trial.candidate, trial.group)
    slow_gain, slow_p = plain_evidence(covariance, trial.candidate, trial.group)
    fast_p = 1.0 if sure.wrong_sign else sure.p_value
    slow = slow_p < fast_p
    gain = slow_gain if slow else sure.gain
    return replace(
        trial, plain_gain=trial.gain, plain_judge=trial.judge,
        gain=gain, score=sure.score + gain - sure.gain, p_value=min(1.0, 2.0 * min(slow_p, fast_p)),
        judge=fit, singular=trial.singular or sure.singular, slow=slow,
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
        chosen = min(alike, key=lambda t: (len(t.values) + t.candidate.free, -t.plain_gain)) if alike else first
        out.append(chosen)
        left.remove(chosen)
    return out


def _refined(record: Record, solved: Solved, whitener: Whitener, trials: list[Trial]) -> list[Trial]:
    """Refine the shapes of the few that matter."""
    best = sorted((t for t in trials if not t.wrong_sign), key=lambda t: -t.score)[:MOST_REFINED]
    return [
        refine(record, solved, whitener, t, seen_as_candidate) if t in best and t.score > 0.0 else t for t in trials
    ]

"""Forward selection with gates: effects are accepted one at a time, everything refitted and rewhitened each time."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.compare.blocks import holm
from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose.candidates import REPEATED, Candidate, candidates_for
from pmsm_ctrl.diagnose.columns import as_candidate, effect_group
from pmsm_ctrl.diagnose.evidence import (
    Evidence,
    Trial,
    blocked_gain,
    physical_bounds,
    plain_evidence,
    saturated_whitener,
    try_candidate,
    try_group,
)
from pmsm_ctrl.diagnose.model import (
    OWN,
    Model,
    Solved,
    base_groups,
    solve_model,
    with_honest_errors,
    with_torque_held,
)
from pmsm_ctrl.diagnose.motion import bristle_direction
from pmsm_ctrl.diagnose.record import LATE, Record, with_direction, with_modelled_torque
from pmsm_ctrl.diagnose.refine import refine
from pmsm_ctrl.diagnose.whitening import Whitener
from pmsm_ctrl.effects.base import Effect

__all__ = [
    "RELIEF",
    "WINDING",
    "Accepted",
    "Fitted",
    "Step",
    "fit_design",
    "name_of",
    "relief",
    "select",
    "strain",
    "tied",
]

Array = NDArray[np.float64]

SIGNIFICANCE = 0.01  # family-wise, by Holm
# Standard errors that the gain of left-out blocks must reach. A small first effect may do with less: spread evenly over
# the blocks its gain reaches half the root of the whole, and this share of that must be seen.
BLOCK_ERRORS, LEAST_ERRORS, SEEN = 2.8, 2.0, 0.75
# Smallest contribution worth a name, as a share of the balance's size. A smaller one is where it explains this share of
# what is left: beside a hard acceleration all friction is small.
MATERIAL, SMALL, TELLING = 0.004, 0.001, 0.012
LOWERED = 0.996  # what is left of the error in at least one balance once an effect is in
# The winding stands in for effects, at a price: squares of how far it left its datasheet, in tolerances. An effect that
# brings back so much of it need not lower an error, and so much more of it need only hold up on left-out blocks:
# nobody's resistance is four times that of the datasheet.
RELIEF, ABSURD = 25.0, 225.0
WINDING = ("R", "L_d", "L_q", "psi_f")
MOST_STEPS = 8
BEYOND = "beyond its bounds"
UNSEEN, OUTSIDE = "not significant", "its parameters come out beyond their bounds"
UNSTEADY = "does not hold on left-out blocks"
SERVED = 0.2  # what one balance may lose of what another one gains
# How often at most a delay is met again where it was found: to first order one of two samples comes out a third low.
PASSES = 4
# Two candidates that explain the same to within this share differ by nothing but their flexibility.
PARSIMONY = 0.98


@dataclass(frozen=True, eq=False)
class Accepted:
    """An effect that was taken in, with its nonlinear parameters."""

    effect: Effect
    shape: Mapping[str, float]
    grid: tuple[Mapping[str, float], ...] = ()


@dataclass(frozen=True, eq=False)
class Fitted:
    """The design plus accepted effects, fitted to one log.

    Attributes
    ----------
    record : Record
        With modelled torque in its signals.
    error, relative : dict of balance to rms residual and to its share of the measured balance
    """

    record: Record
    model: Model
    whitener: Whitener
    solved: Solved
    plain: Solved
    weights: Whitener
    trials: tuple[Trial, ...]
    closed: tuple[Candidate, ...]
    notes: tuple[str, ...] = ()

    @property
    def residual(self) -> Array:
        """Measured less predicted, shape (channels, m)."""
        return self.record.target - self.plain.predicted()


@dataclass(frozen=True, eq=False)
class Step:
    """One accepted effect: the trial that won, its evidence and the rivals it cannot be told from."""

    trial: Trial
    evidence: Evidence
    equivalents: tuple[str, ...]
    before: Fitted
    after: Fitted | None = None


@dataclass(frozen=True, eq=False)
class Selection:
    """The whole way: fits before and after every step, and why the rest was refused."""

    fits: tuple[Fitted, ...]
    steps: tuple[Step, ...]
    accepted: tuple[Accepted, ...]
    refused: Mapping[str, str] = field(default_factory=dict)


def _assemble(design: Design, record: Record, accepted: Iterable[Accepted], own: Iterable[Effect]) -> tuple[
    Model, tuple[str, ...]
]:  # fmt: skip
    model, notes = base_groups(design, record, own)
    for one in accepted:
        if one.effect.structure != "bristle":
            model = model.plus(effect_group(record, one.effect, one.shape))
    return model, notes


def fit_design(
    design: Design, record: Record, accepted: tuple[Accepted, ...], effects: Mapping[str, Effect],
    own: tuple[Effect, ...] = (), explore: bool = True,
) -> Fitted:  # fmt: skip
    """Fit the design with the accepted effects, and try every candidate on what is left."""
    for one in (*_bristles(design, effects), *accepted):
        if one.effect.structure == "bristle":
            record = with_direction(record, bristle_direction(record, one.effect, one.shape))
    model, notes = _assemble(design, record, accepted, own)
    rough = solve_model(record, with_torque_held(record, model), saturated_whitener(record, model, ())[1])
    for _ in range(PASSES):
        record = with_modelled_torque(record, _true_torque(model, rough), _delay(model, rough.values))
        model, notes = _assemble(design, record, accepted, own)
        model = with_torque_held(record, model, OWN)
        rough = solve_model(record, model, saturated_whitener(record, model, ())[1])
        if abs(_delay(model, rough.values) - (record.late or 0.0)) < LATE * record.period:
            break
    present = [e.id for e in design.effects] + [a.effect.id for a in accepted]
    residual = record.target[0] - rough.predicted()[0]
    candidates = candidates_for(record, design, effects, residual, present)
    whitener, weights = saturated_whitener(record, model, [g.values for c in candidates for g in c.groups(record)])
    solved = solve_model(record, model, whitener)
    plain = with_honest_errors(solve_model(record, model, weights), weights, whitener)
    if not explore:
        return Fitted(record, model, whitener, solved, plain, weights, (), (), notes)
    trials, closed = [], []
    for candidate in candidates:
        trial = try_candidate(record, plain, weights, candidate)
        if trial is None:
            closed.append(candidate)
        else:
            trials.append(trial)
    trials = [judged((solved, whitener), (plain, weights), t) for t in _refined(record, plain, weights, trials)]
    trials = in_order(trials)
    record.memo.clear()  # hundreds of columns; the best of each candidate stays with its trial
    return Fitted(record, model, whitener, solved, plain, weights, tuple(trials), tuple(closed), notes)


def judged(fit: tuple[Solved, Whitener], plain: tuple[Solved, Whitener], trial: Trial) -> Trial:
    """Keep a trial's shape and size, found with plain weights, and judge its significance.

    Twice: prewhitened, which has the greatest power where a column is right at all frequencies, and with the weights
    of the estimate, which bears errors of its fast part. The better one counts, and pays for the second try.
    """
    (solved, whitener), (weighted, weights) = fit, plain
    sure = try_group(solved, whitener, trial.candidate, trial.group)
    slow_gain, slow_p = plain_evidence(weighted, weights, whitener, trial.candidate, trial.group)
    fast_p = 1.0 if sure.wrong_sign else sure.p_value
    slow = slow_p < fast_p
    gain = slow_gain if slow else sure.gain
    return replace(
        trial, plain_gain=trial.gain, plain_direction=trial.direction,
        gain=gain, score=sure.score + gain - sure.gain, p_value=min(1.0, 2.0 * min(slow_p, fast_p)),
        direction=sure.direction, singular=trial.singular or sure.singular, slow=slow,
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


def _true_torque(model: Model, fit: Solved) -> Array:
    """Torque that acts: the balance without what is only measured wrongly."""
    return fit.predicted()[0] - _false_torque(model, fit.values)


def _false_torque(model: Model, values: Array) -> Array:
    out = np.zeros(model.matrix.shape[1])
    for position, group in enumerate(model.groups):
        if group.effect is not None and group.effect.channels == ("i_d", "i_q"):
            columns = model.columns_of(position)
            out += model.matrix[0][:, columns] @ values[columns]
    return out


def _delay(model: Model, values: Array) -> float:
    """Delay of the currents that a model has, s, inside its bounds; 0 where it has none."""
    for position, group in enumerate(model.groups):
        if group.effect is not None and group.effect.structure == "delay":
            tau = group.effect.linear[0]
            return float(np.clip(values[model.columns_of(position)][0], tau.lower, tau.upper))
    return 0.0


def _bristles(design: Design, effects: Mapping[str, Effect]) -> list[Accepted]:
    found = []
    for entry in design.effects:
        effect = effects.get(entry.id)
        if effect is not None and effect.structure == "bristle":
            values = effect.values(entry)
            if values["z_s"] > 0.0:
                found.append(Accepted(effect, values))
    return found


def _refined(record: Record, solved: Solved, whitener: Whitener, trials: list[Trial]) -> list[Trial]:
    """Refine the shapes of the few that matter."""
    best = sorted((t for t in trials if not t.wrong_sign), key=lambda t: -t.score)[:6]
    return [refine(record, solved, whitener, t, as_candidate) if t in best and t.score > 0.0 else t for t in trials]


def select(
    design: Design,
    record: Record,
    effects: Mapping[str, Effect],
    own: tuple[Effect, ...] = (),
    holdout: Record | None = None,
    progress: Callable[[float], None] | None = None,
    order: tuple[str, ...] = (),
) -> Selection:
    """Accept effects until nothing passes the gates.

    With `order` the first ones are these, or none at all when one of them does not pass.
    """
    accepted: tuple[Accepted, ...] = ()
    fit = fit_design(design, record, accepted, effects, own)
    fits, steps = [fit], []
    refused: dict[str, str] = {}
    for number in range(MOST_STEPS):
        refused = {}
        only = order[number] if number < len(order) else ""
        # what an effect taken in is not exactly is left in every block, and can look like a small one
        least = BLOCK_ERRORS if accepted else LEAST_ERRORS
        won = _winner(fit, refused, least, only)
        while won is not None:
            trial, evidence = won
            new = (*accepted, Accepted(trial.candidate.effect, trial.group.shape, trial.candidate.grid))
            new = _reshaped(design, record, new, effects, own)
            after = fit_design(design, record, new, effects, own)
            # what is to come next may be what brings a parameter back inside its bounds
            why = "" if number + 1 < len(order) else _objection(after, fit)
            why = why or _holdout_objection(design, holdout, accepted, new, fit, after, effects, own)
            if not why:
                break
            refused[name_of(trial)] = why
            won = _winner(fit, refused, least, only)
        if won is None:
            if only:
                return Selection((fits[0],), (), (), refused)
            break
        steps.append(Step(trial, evidence, _equivalents(fit, trial), fit, after))
        accepted, fit = new, after
        fits.append(fit)
        if progress is not None:
            progress(min(0.9, 0.2 + 0.7 * (number + 1) / MOST_STEPS))
    return Selection(tuple(fits), tuple(steps), accepted, refused)


def _reshaped(
    design: Design, record: Record, accepted: tuple[Accepted, ...], effects: Mapping[str, Effect],
    own: tuple[Effect, ...],
) -> tuple[Accepted, ...]:  # fmt: skip
    """Refine the nonlinear parameters of the effects taken earlier, now that another one is in.

    Those of a spring just taken as well: it was judged without what is noise.
    """
    out = list(accepted)
    for k, one in enumerate(accepted):
        spring = one.effect.structure == "transmission" and "gap" not in one.shape
        if k == len(accepted) - 1 and not spring:
            continue
        if len(one.grid) < 2 or set(one.shape) <= {"order"} or one.effect.structure == "bristle":
            continue
        others = (*out[:k], *out[k + 1 :])
        fit = fit_design(design, record, others, {}, own)
        candidate = Candidate(one.effect, (*one.grid, one.shape), len(one.grid))
        trial = try_group(fit.plain, fit.weights, candidate, effect_group(fit.record, one.effect, one.shape))
        best = refine(fit.record, fit.plain, fit.weights, trial)
        if not best.wrong_sign:
            out[k] = Accepted(one.effect, best.group.shape, one.grid)
    return tuple(out)


def name_of(trial: Trial) -> str:
    """Return the effect, with its order where an axis can have several."""
    order = trial.group.shape.get("order")
    effect = trial.candidate.effect.id
    return f"{effect} {order:g}" if effect in REPEATED and order else effect


def _winner(fit: Fitted, refused: dict[str, str], least: float, only: str = "") -> tuple[Trial, Evidence] | None:
    """Return the best candidate that passes every gate, writing down why the ones before it do not."""
    p_holm = dict(zip(map(id, fit.trials), holm([t.p_value for t in fit.trials]), strict=True))
    for trial in fit.trials:
        name = name_of(trial)
        if name in refused or (only and trial.candidate.effect.id != only):
            continue
        why, evidence = _gates(fit, trial, p_holm[id(trial)], least)
        if evidence is not None and not why:
            return trial, evidence
        refused[name] = why
    return None


def _gates(fit: Fitted, trial: Trial, p_holm: float, least: float) -> tuple[str, Evidence | None]:
    if trial.singular:
        return "this log cannot tell it from what the model has already", None
    if trial.wrong_sign:
        return OUTSIDE, None
    if p_holm > SIGNIFICANCE:
        return f"{UNSEEN} (corrected p = {p_holm:.2g})", None
    material = _material(fit, trial)
    telling = trial.plain_gain > TELLING * fit.plain.chi2
    if material < (SMALL if telling else MATERIAL):
        return f"significant but immaterial: {100 * material:.2g} % of the balance where it acts", None
    judge = (fit.plain, fit.weights) if trial.slow else (fit.solved, fit.whitener)
    direction = trial.plain_direction if trial.slow else trial.direction
    mean, stderr, blocks, p_rank = blocked_gain(fit.record, *judge, trial.group, direction, fit.whitener.memory)
    evidence = Evidence(trial.gain, trial.p_value, p_holm, blocks, mean, stderr, p_rank, material)
    asked = min(max(SEEN * 0.5 * np.sqrt(_from_rows(judge[0], direction)), least), BLOCK_ERRORS)
    surely = mean > asked * stderr or p_rank < 0.5 * SIGNIFICANCE or relief(judge[0], direction) > ABSURD
    if not (surely and mean > 0.0):
        return f"{UNSTEADY} (gain {mean:.3g} +- {stderr:.2g})", evidence
    return "", evidence


def _from_rows(solved: Solved, direction: Array) -> float:
    """What of a gain the rows of the log bring; the rest is parameters that come back towards their nominal values."""
    rest, part = solved.rest[: solved.rows], direction[: solved.rows]
    return max(float(part @ (2.0 * rest - part)), 0.0)


def relief(solved: Solved, direction: Array) -> float:
    """What of a gain the winding brings by coming back to its datasheet."""
    rest, part = solved.rest[solved.rows :], direction[solved.rows :]
    return float(np.sum((part * (2.0 * rest - part))[_winding(solved.model)]))


def _winding(model: Model) -> NDArray[np.bool_]:
    """Which of the rows of priors are the winding's."""
    return np.array([name in WINDING for name in np.array(model.names)[np.isfinite(model.sigma)]], dtype=bool)


def _material(fit: Fitted, trial: Trial) -> float:
    """Size of what only this effect explains against the balance, on the tenth of the samples where it is largest.

    None of it where the steps of the channel are as large.
    """
    best = 0.0
    for row in range(len(fit.record.channels)):
        part = np.abs(trial.plain_direction[: fit.plain.rows][fit.whitener.channel == row]) * fit.whitener.sigma[row]
        if not np.any(part):
            continue
        count = max(10, len(part) // 10)
        largest = np.partition(part, -count)[-count:]
        level = np.sqrt(np.mean((fit.record.target[row] * fit.record.weight[row])[fit.record.mask] ** 2))
        size = float(np.sqrt(np.mean(largest**2)))
        if size > fit.record.coarse[row]:
            best = max(best, size / max(level, 1e-300))
    return best


def _equivalents(fit: Fitted, trial: Trial) -> tuple[str, ...]:
    """Effects whose best explanation of the same rows is nearly as good and nearly the same."""
    own = trial.direction
    size = float(own @ own)
    found = []
    for other in fit.trials:
        if (
            other is trial
            or other.wrong_sign
            or other.singular
            or other.candidate.effect.id == trial.candidate.effect.id
        ):
            continue
        # what the rival leaves of what this one explains
        along = float(own @ other.direction)
        left = size - along**2 / max(float(other.direction @ other.direction), 1e-300)
        if left < tied(size):
            found.append(other.candidate.effect.id)
    ids = [*found]
    for effect in trial.candidate.effect.look_alikes:
        singular = next(
            (t for t in fit.trials if t.candidate.effect.id == effect and t.singular and not t.candidate.free), None
        )
        if singular is not None and effect not in ids:
            ids.append(effect)
    return tuple(ids)


def tied(gain: float) -> float:
    """By how much two explanations of so large a gain may differ and still be the same to this log."""
    return max(20.0, 0.01 * gain)


def _objection(after: Fitted, before: Fitted) -> str:
    """An effect that makes one balance worse to please another is not the missing one."""
    old, new = _weighted(before), _weighted(after)
    sizes = dict(zip(after.record.channels, after.weights.sigma, strict=True))
    change = {name: (new[name] ** 2 - old[name] ** 2) / sizes[name] ** 2 for name in new}
    for name, more in change.items():
        # a winding that was bent to stand in for the effect may have served one balance better than the truth does
        if new[name] > 1.03 * old[name] and more > -SERVED * min(change.values()):
            return f"makes the {name} balance worse"
    relieved = strain(before.plain) - strain(after.plain) > RELIEF
    plain = [{name: rms for name, (rms, _) in errors(fit.record, fit.residual).items()} for fit in (before, after)]
    lowered = any(b[name] <= LOWERED * a[name] for a, b in ((old, new), plain) for name in new)
    if not (relieved or lowered):
        return "lowers no error by an amount worth a name"
    known = dict(zip(after.model.names, after.plain.values.tolist(), strict=True))
    bounds = physical_bounds((g.effect for g in after.model.groups if g.effect), known)
    for k, name in enumerate(after.model.names):
        low, high = bounds.get(name.split("#")[0], (-np.inf, np.inf))
        value, slack = after.plain.values[k], 3.0 * after.plain.stderr[k]
        if not low - slack <= value <= high + slack:
            return f"drives {name} to {value:.3g}, {BEYOND}"
    return ""


def _weighted(fit: Fitted) -> dict[str, float]:
    """Rms residual per balance; samples that the log's rate could not follow count as little as they did in the fit."""
    used = fit.record.mask
    rows = (fit.residual * fit.record.weight)[:, used]
    return dict(zip(fit.record.channels, np.sqrt(np.mean(rows**2, axis=1)).tolist(), strict=True))


def strain(solved: Solved) -> float:
    """How far the winding had to leave its datasheet, as a sum of squares in its tolerances."""
    return float(np.sum(solved.rest[solved.rows :][_winding(solved.model)] ** 2))


def _holdout_objection(
    design: Design, holdout: Record | None, old: tuple[Accepted, ...], new: tuple[Accepted, ...],
    before: Fitted, after: Fitted, effects: Mapping[str, Effect], own: tuple[Effect, ...],
) -> str:  # fmt: skip
    if holdout is None:
        return ""
    first = holdout_error(design, holdout, old, before, effects, own)
    second = holdout_error(design, holdout, new, after, effects, own)
    worse = {name: (first[name][0], second[name][0]) for name in first}
    if sum(b / a for a, b in worse.values() if a > 0) / len(worse) < 1.0:
        return ""
    return "makes the held-out record worse"


def holdout_error(
    design: Design, holdout: Record, accepted: tuple[Accepted, ...], fit: Fitted, effects: Mapping[str, Effect],
    own: tuple[Effect, ...],
) -> dict[str, tuple[float, float]]:  # fmt: skip
    """Return rms error and its share per balance on another record, with the parameters of the fit."""
    record = holdout
    for one in (*_bristles(design, effects), *accepted):
        if one.effect.structure == "bristle":
            record = with_direction(record, bristle_direction(record, one.effect, one.shape))
    common = [row for row, name in enumerate(record.channels) if name in fit.record.channels]
    for _ in range(2):
        model, _ = _assemble(design, record, accepted, own)
        by_name = dict(zip(fit.plain.model.names, fit.plain.values, strict=True))
        values = np.array([by_name.get(name, 0.0) for name in model.names])
        predicted = model.matrix @ values
        record = with_modelled_torque(record, predicted[0] - _false_torque(model, values), _delay(model, values))
    return errors(record, record.target - predicted, [record.channels[row] for row in common])


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

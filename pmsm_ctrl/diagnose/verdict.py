"""The verdict, and what it rests on: reasons are notices, the likeliest first.

In this order: log and design do not belong together; an effect is missing; the motion does not excite the friction;
structure is left that no effect explains; the log does not decide; and only then, consistent.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pmsm_ctrl.diagnose import notices
from pmsm_ctrl.diagnose.contradictions import contradicting, told
from pmsm_ctrl.diagnose.fit import Fitted
from pmsm_ctrl.diagnose.level import floor_of, level_of
from pmsm_ctrl.diagnose.measures import excess_of
from pmsm_ctrl.diagnose.policy import POLICY, Policy
from pmsm_ctrl.diagnose.refusal import Reason
from pmsm_ctrl.diagnose.result import Deviation, Verdict
from pmsm_ctrl.diagnose.selection import Selection, name_of
from pmsm_ctrl.plausibility import ACCOUNTED, Plausibility
from pmsm_ctrl.regression.notices import SAMPLED_IN_STEP, timing_notice
from pmsm_ctrl.regression.saturated import FEWEST_DIRECTIONS, SAMPLES_PER_DIRECTION
from pmsm_ctrl.section import Notice

__all__ = ["judged", "open_questions"]


def judged(
    selection: Selection,
    believed: Plausibility | None,
    asides: tuple[Notice | None, Notice | None, Notice | None],
    deviations: tuple[Deviation, ...],
    policy: Policy = POLICY,
) -> tuple[Verdict, tuple[Notice, ...]]:
    """Return the verdict and its reasons, the likeliest first.

    Parameters
    ----------
    selection : Selection
    believed : Plausibility or None
        Of the log.
    asides : (Notice or None, Notice or None, Notice or None)
        Friction that the motion does not excite, structure that no effect explains, and structure that left-out data
        do not confirm.
    deviations : tuple of Deviation
    policy : Policy
    """
    impossible = (*(believed.contradictions if believed else ()), *contradictions_of(selection.fit, policy))
    if impossible:
        return Verdict.IMPLAUSIBLE, impossible
    if selection.steps:
        return Verdict.EFFECTS_MISSING, ()
    for verdict, reason in zip((Verdict.NOT_EXCITED, Verdict.UNEXPLAINED), asides[:2], strict=True):
        if reason is not None:
            return verdict, (reason,)
    doubts = (doubt for doubt in (believed.doubts if believed else ()) if doubt.code not in ACCOUNTED)
    unconfirmed = () if asides[2] is None else (asides[2],)
    undecided = (*doubts, *unconfirmed, *open_questions(selection, deviations, policy))
    return (Verdict.INCONCLUSIVE, undecided) if undecided else (Verdict.CONSISTENT, ())


def contradictions_of(fit: Fitted, policy: Policy = POLICY) -> tuple[Notice, ...]:
    """Return why a fit contradicts the design: a parameter, or that it explains no torque to speak of.

    Parameters
    ----------
    fit : Fitted
    policy : Policy
    """
    found, torque = [], level_of(fit, 0)
    for name, value in contradicting(fit, policy).items():
        nominal = float(fit.model.nominal[fit.model.names.index(name)])
        if value < 0.0:
            found.append(notices.NEGATIVE_PARAMETER(parameter=name, value=value))
        else:
            found.append(notices.FACTOR_OFF(parameter=name, value=value, ratio=value / nominal, nominal=nominal))
    noise = torque.left**2 * policy.refused_share <= 1.0  # what is left: no model explains more then
    if told(fit, policy) and not noise and torque.explained < policy.explained_torque * torque.explicable:
        found.append(notices.UNRELATED_TORQUE(percent=100.0 * max(torque.explained, 0.0)))
    return tuple(found)


def open_questions(
    selection: Selection, deviations: tuple[Deviation, ...], policy: Policy = POLICY
) -> Iterator[Notice]:
    """Yield the reasons not to call a log without a named effect consistent.

    Parameters
    ----------
    selection : Selection
    deviations : tuple of Deviation
    policy : Policy
    """
    fit = selection.fit
    independent = 2.0 * fit.record.cutoff * float(fit.record.mask.sum()) / fit.record.rate
    least = SAMPLES_PER_DIRECTION * FEWEST_DIRECTIONS
    if independent < least:
        yield notices.TOO_SHORT(count=independent, least=least)
    for row, name in enumerate(fit.record.channels):
        level = level_of(fit, row)
        if row == 0 and level.explained < policy.explained_torque:
            little = notices.LITTLE_KNOWN if level.above_floor(policy) else notices.LITTLE_EXPLAINED
            yield little(percent=100.0 * max(level.explained, 0.0))
        balance = fit.record.drive if row == 0 else name
        if level.above_floor(policy):
            yield notices.ABOVE_FLOOR(balance=balance, ratio=level.left)
        elif row == 0 and (ratio := _at_edges(fit)) ** 2 * policy.refused_share > 1.0:
            yield notices.EDGES_ABOVE_FLOOR(balance=balance, ratio=ratio)
    if fit.record.turning > policy.refused_share:
        yield notices.TURNS_TOO_OFTEN(percent=100.0 * fit.record.turning)
    yield from (note for note in fit.record.notes if note.code == SAMPLED_IN_STEP.code)
    if not fit.record.timing.sure:
        yield timing_notice(fit.record.timing, fit.record.drive)
    for deviation in deviations:
        if deviation.outside and deviation.parameter != "K_t":  # J, psi_f: a wrong K_t alone only scales
            percent = 100.0 * (deviation.estimate / deviation.nominal - 1.0)
            yield notices.OUTSIDE_TOLERANCE(parameter=deviation.parameter, percent=percent)
        if deviation.parameter == "F_c" and deviation.nominal > 0.0 >= deviation.estimate:
            yield _no_friction(deviation, policy)
    yield from _refused(selection, policy)


def _no_friction(dry: Deviation, policy: Policy) -> Notice:
    """Return that a dry friction at its bound is none, or that the log does not tell it: one direction and a load."""
    if dry.nominal > policy.sure_errors * dry.stderr:
        return notices.NO_FRICTION(parameter=dry.parameter, value=dry.estimate)
    return notices.FRICTION_UNKNOWN(parameter=dry.parameter, stderr=dry.stderr, unit=dry.unit)


def _at_edges(fit: Fitted) -> float:
    """Return the rms residual of the torque over its noise floor, all moving samples alike: edges stand out of it."""
    left = float(np.sqrt(np.mean(fit.residual[0][fit.record.mask] ** 2)))
    return left / max(floor_of(fit, 0), 1e-300)


def _refused(selection: Selection, policy: Policy) -> Iterator[Notice]:
    """Yield the refused effect that explains most of the residual of its balances, if that is much and significant."""
    found = []
    for trial in selection.fit.trials:
        share, _ = excess_of(selection.fit.solved, trial, trial.gain)
        refusal = selection.refused.get(name_of(trial))
        if share < policy.refused_share or refusal is None or trial.p_value >= policy.significance:
            continue
        if refusal.reason not in (Reason.NOT_SIGNIFICANT, Reason.WITHIN_SAMPLING):
            found.append((share, trial, refusal))
    if found:
        share, trial, refusal = max(found, key=lambda one: one[0])
        yield notices.LARGE_REFUSED(effect=name_of(trial), percent=100.0 * share, refusal=refusal)

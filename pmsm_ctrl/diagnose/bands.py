"""The same log in another band, and in half of its own, where a name is checked."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.diagnose.case import Case
from pmsm_ctrl.diagnose.event import Event
from pmsm_ctrl.diagnose.fit import Accepted, Fitted
from pmsm_ctrl.diagnose.fitted_design import fitted_design
from pmsm_ctrl.diagnose.policy import Policy
from pmsm_ctrl.diagnose.refusal import Reason, Refusal
from pmsm_ctrl.diagnose.same_size import same_in_half
from pmsm_ctrl.diagnose.search import beyond
from pmsm_ctrl.errors import LogError
from pmsm_ctrl.evidence.linalg import Added
from pmsm_ctrl.regression.columns import SINGLE, effect_group, forget_effects
from pmsm_ctrl.regression.conditioning import default_cutoff
from pmsm_ctrl.regression.evaluated import without_stretches
from pmsm_ctrl.regression.two_stage import beside_held

__all__ = ["conditioned_in", "left_of", "unlike_in_half", "without_events"]


Array = NDArray[np.float64]

# Samples of the thinned grid beyond which hundreds of columns are not kept beside a second record: they are larger.
FEW = 30_000


def unlike_in_half(case: Case, before: Fitted, after: Fitted, surely: bool = False) -> Refusal | None:
    """Return that an effect is another one in half the band: its amounts there are not those in the band.

    The size of an effect does not hang on the band in which it is looked at; that of an error of the model does. The
    shape is that of the whole band. A delay is linearised about itself and has no amount to compare; of a wave of a
    turn that is mostly too fast for half the band, the skirts of the filters are left. Where an effect is most of the
    residual, the sampling that half the band finds without it may be wrong by milliseconds, and the amounts with it:
    the log is then conditioned there with the effect as well. The inertia may be as wrong: the amounts of an effect
    without a memory, whose shape adapts to nothing, are then those of a fit of everything in either band.

    Parameters
    ----------
    case : Case
    before, after : Fitted
        Everything fitted without and with it.
    surely : bool
        Whether the amounts have to be the same, as far as half the band holds any. It does of all but waves.
    """
    one = after.accepted[-1]
    if one.effect.structure.delays:
        return None
    default = default_cutoff(case.record.prepared.rate)  # a wider one is that of the fast part of the drive signal
    if len(case.record.mask) > FEW:
        forget_effects(case.record)
    band = 0.5 * (case.record.cutoff if _is_wave(one) else min(case.record.cutoff, default))
    refusal = _unlike_in(conditioned_in(band, case), case, before, after, surely)
    if refusal is None or not _is_most(before, after, case.policy):
        return refusal
    half = _in_band(case, band=band, shown=fitted_design(case.design, after))
    refusal = _unlike_in(half, case, before, after, surely)
    position = after.position(len(after.accepted) - 1)
    if refusal is None or half is None or one.effect.structure.has_memory or position is None:
        return refusal
    there = without_events(half, case.events).without_candidates(after.accepted)
    own, part = (fit.model.columns_of(fit.position(len(fit.accepted) - 1) or 0) for fit in (after, there))
    return _same(
        after.plain.values[own],
        there.plain.values[part],
        there.plain.stderr[part],
        _amounts(before, one)[0].size,
        case.policy,
        surely,
    )


def _is_wave(one: Accepted) -> bool:
    return bool(one.effect.order or one.effect.period or one.effect.electrical_order)


def _is_most(before: Fitted, after: Fitted, policy: Policy) -> bool:
    """Whether the last effect is most of the whole residual."""
    return after.plain.chi2 <= (1.0 - policy.above_floor) * before.plain.chi2


def _unlike_in(half: Case | None, case: Case, before: Fitted, after: Fitted, surely: bool) -> Refusal | None:
    """Return that the amounts of the last effect are others in a narrower band."""
    one = after.accepted[-1]
    wave, structure = _is_wave(one), one.effect.structure
    unknown = Refusal(Reason.OTHER_BAND, {"percent": 0.0}) if surely and not wave else None
    if half is None:
        return unknown
    there = without_events(half, case.events).without_candidates(before.accepted)
    (whole, passed), (part, left_over) = (_amounts(fit, one) for fit in (before, there))
    if min(whole.rank, part.rank) < len(whole.size) or (wave and left_over < case.policy.stable * passed):
        return unknown
    # a minor gap that surely is the same up to a factor is confirmed by twice as much elsewhere
    fixed = not structure.has_memory or (structure.unlike_rivals and not surely)
    return _same(whole.values, part.values, part.stderr, part.size, case.policy, surely, fixed)


def _same(
    whole: Array, part: Array, stderr: Array, size: Array, policy: Policy, surely: bool, fixed: bool = True
) -> Refusal | None:
    """Compare amounts in half the band with those in the band."""
    return same_in_half(*left_of(whole, part, stderr, size), policy, surely, fixed)


def left_of(whole: Array, part: Array, stderr: Array, size: Array) -> tuple[float, float]:
    """Return what is left of amounts, as one share, and its standard error.

    Those of other units count by the torque they make.

    Parameters
    ----------
    whole, part : array, shape (k,)
        Amounts, and what they are elsewhere.
    stderr : array, shape (k,)
        Of the latter.
    size : array, shape (k,)
        Rms of the columns.
    """
    weights = size**2 * whole
    scale = float(weights @ whole)
    return float(weights @ part) / scale, math.sqrt(float(weights**2 @ stderr**2)) / scale


def _amounts(fit: Fitted, one: Accepted) -> tuple[Added, float]:
    """Return what the columns of an effect explain beyond a fit without it, and their mean square."""
    group = effect_group(fit.record, one.effect, one.shape)
    power = sum(float(np.mean(rows[:, fit.record.mask] ** 2)) for rows in group.rows if rows is not None)
    return beyond(fit.plain, fit.weights, beside_held(group, fit.model.responses))[1], power


def conditioned_in(band: float, case: Case) -> Case | None:
    """Return the case in another band, conditioned once; None where hardly anything is fast enough for that band.

    Parameters
    ----------
    band : float
        Hz.
    case : Case
    """
    if band in case.bands:
        return case.bands[band]
    found = _in_band(case, band=band, first=case)
    if len(case.record.mask) <= SINGLE:  # what is kept of a long log is large
        case.bands[band] = found
    return found


def _in_band(case: Case, **how: Any) -> Case | None:
    try:
        return None if case.in_band is None else case.in_band(**how)
    except LogError:
        return None


def without_events(case: Case, events: tuple[Event, ...]) -> Case:
    """Return the case with the stretches masked, and with steps of the friction as changes that are fitted.

    Parameters
    ----------
    case : Case
    events : tuple of Event
    """
    if not events:
        return case
    stretches = [(one.start, one.stop) for one in events if not one.lasting]
    record = without_stretches(case.record, stretches, [one.start for one in events if one.lasting])
    return replace(case, record=record, events=events, fits=[])

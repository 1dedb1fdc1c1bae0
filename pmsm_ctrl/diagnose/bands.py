"""The same log in a narrower band: where a name is looked for if the usual band has none, and where one is checked."""

from __future__ import annotations

import math
from dataclasses import replace

from pmsm_ctrl.diagnose import criteria
from pmsm_ctrl.diagnose.case import Case
from pmsm_ctrl.diagnose.event import Event
from pmsm_ctrl.diagnose.fit import Accepted, Fitted
from pmsm_ctrl.diagnose.refusal import Refusal
from pmsm_ctrl.diagnose.search import beyond
from pmsm_ctrl.errors import LogError
from pmsm_ctrl.evidence.linalg import Added
from pmsm_ctrl.regression.columns import SINGLE, effect_group
from pmsm_ctrl.regression.conditioning import default_cutoff
from pmsm_ctrl.regression.evaluated import without_stretches
from pmsm_ctrl.regression.two_stage import beside_held

__all__ = ["conditioned_in", "unlike_in_half", "without_events"]


def unlike_in_half(case: Case, before: Fitted, after: Fitted) -> Refusal | None:
    """Return that an effect is another one in half the band: its amounts there are not those in the band.

    The size of an effect does not hang on the band in which it is looked at; that of an error of the model does. The
    shape is that of the whole band. A delay is linearised about itself and has no amount to compare.

    Parameters
    ----------
    case : Case
    before, after : Fitted
        Everything fitted without and with it.
    """
    one = after.accepted[-1]
    if one.effect.structure.delays:
        return None
    half = conditioned_in(0.5 * min(case.record.cutoff, default_cutoff(case.record.prepared.rate)), case)
    if half is None:
        return None
    there = without_events(half, case.events).without_candidates(before.accepted)
    whole, part = (_amounts(fit, one) for fit in (before, there))
    if min(whole.rank, part.rank) < len(whole.size):
        return None
    weights = part.size**2 * whole.values  # amounts of other units count by the torque that they make
    scale = float(weights @ whole.values)
    left, stderr = float(weights @ part.values) / scale, math.sqrt(float(weights**2 @ part.stderr**2)) / scale
    return criteria.same_in_half(left, stderr, case.policy)


def _amounts(fit: Fitted, one: Accepted) -> Added:
    """Return what the columns of an effect explain beyond a fit without it."""
    group = beside_held(effect_group(fit.record, one.effect, one.shape), fit.model.responses)
    return beyond(fit.plain, fit.weights, group)[1]


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
    try:
        found = None if case.in_band is None else case.in_band(band=band, first=case)
    except LogError:
        found = None
    if len(case.record.mask) <= SINGLE:  # what is kept of a long log is large
        case.bands[band] = found
    return found


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

"""The last fit of a selection: its shapes fitted together with all other values, and their intervals."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from pmsm_ctrl.diagnose.case import Case
from pmsm_ctrl.diagnose.fit import Fitted
from pmsm_ctrl.diagnose.policy import POLICY, Policy
from pmsm_ctrl.diagnose.profiles import NORMAL, with_profiles
from pmsm_ctrl.diagnose.refusal import Reason, Refusal
from pmsm_ctrl.diagnose.selection import Selection, name_of
from pmsm_ctrl.diagnose.shapes import searched, with_shapes_fitted
from pmsm_ctrl.regression.columns import SINGLE

__all__ = ["finally_fitted", "not_beside_shapes", "reaching_zero", "without_end"]


def finally_fitted(case: Case, selection: Selection) -> Selection:
    """Return the selection with its last fit finished; nothing is named where the first effect may be nothing.

    Parameters
    ----------
    case : Case
    selection : Selection
    """
    last = with_profiles(case.design, with_shapes_fitted(case.design, selection.fit))
    if (refusal := not_beside_shapes(last, case.policy)) is not None:
        refused = {**selection.refused, name_of(selection.steps[-1].trial): refusal}
        before = case.fit(selection.fits[-2].accepted)
        return finally_fitted(case, Selection((*selection.fits[:-2], before), selection.steps[:-1], refused))
    refusal = reaching_zero(last) or without_end(last)
    if refusal is not None:
        refused = {**selection.refused, name_of(selection.steps[0].trial): refusal}
        return Selection((case.fit(()),), (), refused)
    last = last.judging_itself() if len(last.record.mask) > SINGLE else last
    return replace(selection, fits=(*selection.fits[:-1], last))


def not_beside_shapes(fit: Fitted, policy: Policy = POLICY) -> Refusal | None:
    """Return that the last effect may be nothing: it was what the shapes of those before it were wrong by.

    An effect is accepted beside others whose shapes are held, and is judged again once all shapes are fitted together.
    Of a single amount with a shape of its own the interval may not hold zero: a bend that is as large as it is
    uncertain is the error of another bend. Several amounts are judged together.

    Parameters
    ----------
    fit : Fitted
        With its shapes fitted, and its intervals.
    policy : Policy
    """
    from scipy.special import chdtrc

    number = len(fit.accepted) - 1
    place = fit.position(number) if number > 0 and fit.free else None
    if place is None or fit.covariance is None:
        return None
    one, own = fit.accepted[number], fit.model.columns_of(place)
    values, stderr = fit.plain.values[own], fit.plain.stderr[own]
    if searched(one) and len(values) == 1:
        symbol, value, error = fit.model.names[own][0], float(values[0]), float(stderr[0])
        low, high = fit.profiles.get((number, symbol), (value - NORMAL * error, value + NORMAL * error))
        nothing = low <= 0.0 <= high
        half = 0.5 * (high - low) / NORMAL
        detail = {"parameter": symbol, "value": value, "stderr": half if math.isfinite(half) else error}
        return Refusal(Reason.NOT_DETERMINED, detail) if nothing else None
    wald = float(values @ np.linalg.pinv(fit.covariance[own, own], hermitian=True) @ values)
    p_value = float(chdtrc(len(values), wald))
    return Refusal(Reason.NOT_SIGNIFICANT, {"p": p_value}) if p_value > policy.significance else None


def reaching_zero(fit: Fitted) -> Refusal | None:
    """Return that the first effect may be nothing: the interval of a size that stands in its shape reaches zero.

    A standard error says less: a deflection that is too small for the log has a steep side and a flat one. An interval
    without an end on either side says nothing. A size that the steps of the angle do not show is as good as nothing.

    Parameters
    ----------
    fit : Fitted
        With its intervals.
    """
    if not fit.accepted:
        return None
    one = fit.accepted[0]
    for name in sorted(set(one.effect.amplitudes) & set(searched(one))):
        low, high = fit.profiles.get((0, name), (1.0, 1.0))
        unseen = not one.effect.structure.resolved(fit.record, one.shape)
        if unseen or (low <= 0.0 and high < one.effect.parameter(name).upper):
            half = fit.record.step if unseen else 0.5 * (high - low)
            return Refusal(Reason.NOT_DETERMINED, {"parameter": name, "value": one.shape[name], "stderr": half})
    return None


def without_end(fit: Fitted) -> Refusal | None:
    """Return that the first effect is a voltage whose shape the log does not hold: its interval has no upper end.

    A dead time whose knee is beyond the currents is proportional to them. It is a resistance, which the model has, and
    all that it gains may be that the resistance returns to the datasheet.

    Parameters
    ----------
    fit : Fitted
        With its intervals.
    """
    if not fit.accepted or fit.accepted[0].effect.enters != "voltage":
        return None
    one = fit.accepted[0]
    for name in sorted(searched(one)):
        low, high = fit.profiles.get((0, name), (0.0, 0.0))
        if math.isinf(high):
            return Refusal(Reason.NOT_DETERMINED, {"parameter": name, "value": one.shape[name], "stderr": high - low})
    return None

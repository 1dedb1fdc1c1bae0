"""Reasons to doubt an estimate: conditioning, few degrees of freedom, a size that no motor has, a bias."""

from __future__ import annotations

import numpy as np

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects.catalogue import bound_effects
from pmsm_ctrl.identify import notices as words
from pmsm_ctrl.identify import policy
from pmsm_ctrl.identify.instrumental import BiasTest
from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.regression.least_squares import Cause, Fit
from pmsm_ctrl.rendering.numbers import probability
from pmsm_ctrl.section import Notice

__all__ = ["contradictions_of", "doubts", "large", "left_out", "verdict"]


def doubts(design: Design, fit: Fit) -> list[Notice]:
    """Return what a fit says against its own numbers.

    Parameters
    ----------
    design : Design
    fit : Fit
    """
    found = []
    if fit.condition > policy.ILL_CONDITIONED:
        found.append(words.ILL_CONDITIONED(condition=fit.condition))
    if fit.dof < policy.FEW_DEGREES_OF_FREEDOM:
        found.append(words.FEW_DEGREES_OF_FREEDOM(dof=fit.dof, percent=100.0 / np.sqrt(2.0 * fit.dof)))
    if "J" in fit.values:
        deviation = fit.values["J"] / design.J - 1.0
        tolerance = design.tolerance("J", policy.INERTIA_TOLERANCE)
        if abs(deviation) > tolerance:
            found.append(words.INERTIA_OFF(percent=100.0 * deviation, tolerance=100.0 * tolerance))
    return found


def contradictions_of(design: Design, fit: Fit) -> tuple[Notice, ...]:
    """Return what no motor can have: an inertia below zero, or far off the design's, well beyond its error.

    Parameters
    ----------
    design : Design
    fit : Fit
    """
    lost = fit.unidentifiable.get("J")
    if lost is not None and lost.cause is Cause.IMPOSSIBLE:
        value, stderr = lost.detail["value"], lost.detail["stderr"]
        return (words.INERTIA_NEGATIVE(value=value, stderr=stderr),) if value < -policy.SURE * stderr else ()
    J = fit.values.get("J")
    if J is None:
        return ()
    sure = policy.SURE * fit.stderr["J"]
    far = J - sure > policy.IMPLAUSIBLE * design.J or J + sure < design.J / policy.IMPLAUSIBLE
    return (words.INERTIA_FAR(value=J, ratio=J / design.J),) if far else ()


def left_out(design: Design, record: Record) -> tuple[Notice, ...]:
    """Return a notice of every torque of the design that this log cannot evaluate.

    Parameters
    ----------
    design : Design
    record : Record
    """
    entering = (effect for effect, _ in bound_effects(design) if effect.enters == "torque")
    found = ((effect.id, effect.structure.available(record, effect)) for effect in entering)
    return tuple(words.EFFECT_LEFT_OUT(effect=name, why=why) for name, why in found if why)


def large(error: float) -> tuple[Notice, ...]:
    """Return a notice where the parameters do not describe the torque of the log.

    Parameters
    ----------
    error : float
        Residual over torque, rms.
    """
    if error <= policy.LARGE_ERROR:
        return ()
    return (words.LARGE_ERROR(percent=100.0 * error, explained=100.0 * max(0.0, 1.0 - error**2)),)


def verdict(bias: BiasTest | None, fit: Fit) -> tuple[Notice, ...]:
    """Return what the test says of least squares.

    Parameters
    ----------
    bias : BiasTest, optional
    fit : Fit
    """
    if bias is None:
        return ()
    if not bias.bias:
        return (words.BIAS_UNTESTED(),)
    if not bias.biased:
        shown = probability(bias.p_value)
        return (words.NOT_BIASED(p=bias.p_value, shown=f"p {shown}" if shown[0] == "<" else f"p = {shown}"),)
    parts = (
        f"{name} by {100.0 * bias.bias[name] / fit.values[name]:+.2g} % ({bias.shares[name]:+.1f} standard errors)"
        for name in bias.biased
    )
    return (words.BIASED(names=", ".join(parts)),)

"""Parameters of a fit that contradict the design: log and design do not belong together, or an effect is wrong."""

from __future__ import annotations

import math

import numpy as np

from pmsm_ctrl.diagnose.fit import Fitted
from pmsm_ctrl.diagnose.level import level_of
from pmsm_ctrl.diagnose.policy import POLICY, Policy
from pmsm_ctrl.evidence.linalg import factored
from pmsm_ctrl.regression.model import MOST_NOISE, noise_share
from pmsm_ctrl.regression.slow_inertia import slow_friction

__all__ = ["contradicting", "told"]

# Parameters that cannot be negative; those that cannot differ from the design by a large factor (friction can).
POSITIVE, KNOWN, ELECTRICAL = ("J", "R", "psi_f", "F_c"), ("J", "R", "psi_f"), ("R", "psi_f")
# A dead time looks like a resistance of four times the datasheet's, one that the drive compensates by more than there
# is like one below zero: unexplained structure, and no contradiction where the flux linkage is no large factor off.
IMITATED, BESIDE = ("R",), "psi_f"


def contradicting(fit: Fitted, policy: Policy = POLICY) -> dict[str, float]:
    """Return the parameters of a fit that contradict the design, and their values.

    Parameters
    ----------
    fit : Fitted
    policy : Policy
    """
    names = POSITIVE if told(fit, policy) else ELECTRICAL + _by_direction(fit, policy)
    if _sound(fit, BESIDE, policy):
        names = tuple(name for name in names if name not in IMITATED)
    return {name: value for name in names if (value := _impossible(fit, name, policy)) is not None}


def _sound(fit: Fitted, name: str, policy: Policy) -> bool:
    """Whether a parameter of the machine is surely no large factor off the design's."""
    if name not in fit.model.names:
        return False
    k = fit.model.names.index(name)
    nominal, value = float(fit.model.nominal[k]), float(fit.plain.values[k])
    sure, far = policy.sure_errors * float(fit.plain.stderr[k]), policy.implausible_factor
    return nominal / far < value - sure and value + sure < far * nominal


def told(fit: Fitted, policy: Policy) -> bool:
    """Whether J and F_c say something: a torque or an acceleration that is mostly noise says little about the axis.

    Parameters
    ----------
    fit : Fitted
    policy : Policy
    """
    return level_of(fit, 0).explicable >= policy.explained_torque and _sharp(fit)


def _by_direction(fit: Fitted, policy: Policy) -> tuple[str, ...]:
    """Return F_c where it is below zero whatever the inertia: its sign needs the direction, and no acceleration."""
    if level_of(fit, 0).explicable < policy.explained_torque:
        return ()
    value, stderr = slow_friction(fit.record)
    return ("F_c",) if value < -policy.sure_errors * stderr else ()


def _sharp(fit: Fitted) -> bool:
    """Whether the acceleration is more than noise, which makes an inertia too small, and friction too."""
    k = fit.model.names.index("J")
    return noise_share(fit.record, fit.model.matrix[0][:, k]) < MOST_NOISE


def unweighted(fit: Fitted, column: int) -> float:
    """Return a parameter of the torque balance by least squares with every sample of the same weight.

    Where only single edges accelerate the axis, and these have small weights, the weighted fit hardly determines J.

    Parameters
    ----------
    fit : Fitted
    column : int
        Of the model.
    """
    used = fit.record.mask
    matrix = fit.model.matrix[0][used]
    inside = np.flatnonzero(np.any(matrix, axis=0))
    if column not in inside:
        return float(fit.plain.values[column])
    values = factored(matrix[:, inside]).solve(fit.record.target[0][used])
    return float(values[inside.tolist().index(column)])


def _share(fit: Fitted, column: int) -> float:
    """Return the share of a parameter in the torque: a very small friction may come out slightly below zero."""
    used = fit.record.mask
    part = fit.model.matrix[0][used, column] * fit.plain.values[column]
    return float(np.linalg.norm(part) / max(float(np.linalg.norm(fit.record.target[0][used])), 1e-300))


def _negative_friction(fit: Fitted, column: int, policy: Policy) -> bool:
    """Whether a dry friction below zero is much of the torque, and the fit inside the bounds leaves more of that.

    In a log of one direction few samples, whose direction is in doubt, tell dry friction from a constant load.
    """
    if _share(fit, column) <= policy.friction_share:
        return False
    used = fit.record.mask
    sides = (fit.residual[0], fit.record.target[0] - fit.plain.predicted()[0])
    left, free = (float(np.sum((fit.record.weight[0] * side)[used] ** 2)) for side in sides)
    return left - free > policy.refused_share * left


def _impossible(fit: Fitted, name: str, policy: Policy) -> float | None:
    """Return a parameter that cannot be what was estimated: below zero, or so many times off the design's."""
    if name not in fit.model.names:
        return None
    k = fit.model.names.index(name)
    value, sure = float(fit.plain.values[k]), policy.sure_errors * float(fit.plain.stderr[k])
    nominal = float(fit.model.nominal[k])
    if not math.isfinite(sure):
        return None
    plain = value if name in ELECTRICAL else unweighted(fit, k)
    if value < -sure and plain < 0.0 and (name in KNOWN or _negative_friction(fit, k, policy)):
        return value
    far = policy.implausible_factor
    high = name in KNOWN and name not in IMITATED and min(plain, value - sure) > far * nominal
    return value if high or (name in KNOWN and max(plain, value + sure) < nominal / far) else None

"""Whether a model explains enough of the torque for a name to mean anything."""

from __future__ import annotations

import numpy as np

from pmsm_ctrl.diagnose.bands import unlike_in_half
from pmsm_ctrl.diagnose.case import Case
from pmsm_ctrl.diagnose.fit import Fitted
from pmsm_ctrl.diagnose.level import level_of
from pmsm_ctrl.diagnose.policy import POLICY, Policy
from pmsm_ctrl.diagnose.selection import Selection
from pmsm_ctrl.regression.filters import low_pass

__all__ = ["explains_most", "explains_most_beside_noise", "may_name", "same_beside_noise"]


def explains_most(fit: Fitted, policy: Policy = POLICY) -> bool:
    """Whether a model explains most of the torque that is not noise, and not much less than is noise.

    A load that no model knows may be taken for noise: where noise is most of the torque, the two cannot be told apart.

    Parameters
    ----------
    fit : Fitted
    policy : Policy
    """
    torque = level_of(fit, 0)
    return torque.explained >= policy.explained_torque * max(torque.explicable, 1.0 - torque.explicable)


def explains_most_beside_noise(fit: Fitted, policy: Policy = POLICY) -> bool:
    """Whether a model explains most of the torque that is not noise, however little, and the rest is as fast as noise.

    A load that no channel holds is slower. White noise has half of its power in the upper half of the band; half as
    much as that is asked for.

    Parameters
    ----------
    fit : Fitted
    policy : Policy
    """
    torque, record = level_of(fit, 0), fit.record
    rest = np.where(record.mask, fit.residual[0], 0.0)
    slow = low_pass(rest, record.rate, 0.5 * record.cutoff)
    fast = float(np.mean((rest - slow) ** 2)) >= 0.5 * policy.stable * float(np.mean(rest**2))
    return fast and torque.explained >= policy.explained_torque * torque.explicable


def may_name(found: Selection, policy: Policy = POLICY) -> bool:
    """Whether the model explains most of the torque with all accepted effects, or without any.

    Each fit has weights of its own: an effect never makes a model explain less.

    Parameters
    ----------
    found : Selection
    policy : Policy
    """
    return any(explains_most(fit, policy) for fit in (found.fit, found.fits[0]))


def same_beside_noise(case: Case, found: Selection) -> bool:
    """Whether the torque is mostly noise, and every effect surely of the same size in half the band: noise is not.

    Parameters
    ----------
    case : Case
    found : Selection
    """
    if not found.steps or may_name(found, case.policy) or not explains_most_beside_noise(found.fit, case.policy):
        return False
    pairs = zip(found.fits, found.fits[1:], strict=False)
    return all(unlike_in_half(case, before, after, surely=True) is None for before, after in pairs)

"""Whether an effect is of the same size elsewhere: in half the band, above it, and by the torque inside it alone."""

from __future__ import annotations

from pmsm_ctrl.diagnose.policy import POLICY, Policy
from pmsm_ctrl.diagnose.refusal import Reason, Refusal

__all__ = ["same_above", "same_in_half", "same_inside"]


def same_in_half(
    left: float, stderr: float, policy: Policy = POLICY, surely: bool = False, fixed: bool = True
) -> Refusal | None:
    """Check that an effect is of the same size in half the band.

    Parameters
    ----------
    left, stderr : float
        Its amount there over that in the band, and the standard error.
    policy : Policy
    surely : bool
        Whether it has to be the same up to a factor of ``1 / policy.stable``, and not only not surely another one.
    fixed : bool
        Whether its amount may not be larger there either, surely: that of a spring far below its resonance may.
    """
    slack = policy.sure_errors * stderr
    same = left + slack >= policy.stable and not (fixed and left - slack > 1.0 + policy.stable)
    if surely:
        same = same and policy.stable < left - slack and left + slack < 1.0 / policy.stable
    return None if same else Refusal(Reason.OTHER_BAND, {"percent": 100.0 * left})


def same_inside(left: float, stderr: float, policy: Policy = POLICY) -> Refusal | None:
    """Check that an effect is surely there without what of the torque is faster than the band, and not surely another.

    Parameters
    ----------
    left, stderr : float
        Its amount by the modelled torque inside the band over that by the whole torque, and the standard error.
    policy : Policy
    """
    slack = policy.sure_errors * stderr
    same = left - slack > 0.0 and left + slack >= policy.stable
    return None if same else Refusal(Reason.FAST_TORQUE, {"percent": 100.0 * left})


def same_above(left: float, stderr: float, policy: Policy = POLICY) -> Refusal | None:
    """Check that a wave is not surely of another size above the band.

    Parameters
    ----------
    left, stderr : float
        Its amount there over that in the band, and the standard error.
    policy : Policy
    """
    slack = policy.sure_errors * stderr
    same = left + slack >= policy.stable and left - slack <= 1.0 / policy.stable
    return None if same else Refusal(Reason.OTHER_ABOVE, {"percent": 100.0 * left})

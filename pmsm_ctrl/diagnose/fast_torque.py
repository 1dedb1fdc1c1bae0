"""An effect that reads the torque, and that the measured torque beyond the band alone makes look as it does.

A term that bends over the torque needs it as fast as it was, and the model predicts the band alone. What is faster is
that of the log. Where the log missed edges of the torque, it has the errors that the residual has, and a saturation
that is made of it explains them: the error is on both sides (W. A. Fuller, Measurement Error Models, Wiley 1987).
"""

from __future__ import annotations

from pmsm_ctrl.diagnose.bands import left_of
from pmsm_ctrl.diagnose.fit import Fitted
from pmsm_ctrl.diagnose.policy import POLICY, Policy
from pmsm_ctrl.diagnose.refusal import Refusal
from pmsm_ctrl.diagnose.same_size import same_inside
from pmsm_ctrl.diagnose.search import Trial, beyond
from pmsm_ctrl.regression.columns import effect_group
from pmsm_ctrl.regression.modelled import inside_band
from pmsm_ctrl.regression.two_stage import beside_held

__all__ = ["of_fast_torque"]


def of_fast_torque(fit: Fitted, trial: Trial, policy: Policy = POLICY) -> Refusal | None:
    """Return that an effect on the torque is another one by the torque that the model predicts, and no other.

    Parameters
    ----------
    fit : Fitted
    trial : Trial
        One of its trials.
    policy : Policy
    """
    effect, record = trial.candidate.effect, fit.record
    if effect.enters != "torque" or not {"torque", "i_q"} & set(effect.signals):
        return None
    found = []
    for read in (record, inside_band(record)):
        group = beside_held(effect_group(read, effect, trial.group.shape), fit.model.responses)
        found.append(beyond(fit.plain, fit.weights, group)[1])
    whole, part = found
    if min(whole.rank, part.rank) < len(whole.size):
        return None
    return same_inside(*left_of(whole.values, part.values, part.stderr, whole.size), policy)

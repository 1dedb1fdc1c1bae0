"""Why a candidate is not accepted: a reason for programs, and its words in one place."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from pmsm_ctrl.rendering.numbers import with_error

__all__ = ["BESIDE_NOISE", "NEVER_SEEN", "Reason", "Refusal"]


class Reason(StrEnum):
    """Why a candidate is not accepted; the value stands in the JSON as ``why_not_code``."""

    NOT_INDEPENDENT = "not_independent"
    PARAMETER_AT_BOUND = "parameter_at_bound"
    NOT_SIGNIFICANT = "not_significant"
    TOO_SMALL = "too_small"
    BESIDE_LARGER = "beside_larger"
    MINOR = "minor"
    NOT_CONFIRMED = "not_confirmed"
    ONE_PATH = "one_path"
    EXPLAINED_BY_RIVALS = "explained_by_rivals"
    LIKE_RIPPLE = "like_ripple"
    IN_STEP = "in_step"
    ONE_WAY = "one_way"
    ONE_SPEED = "one_speed"
    IN_PASSING = "in_passing"
    TURNS_TOO_OFTEN = "turns_too_often"
    BALANCE_WORSE = "balance_worse"
    ERROR_NOT_LOWERED = "error_not_lowered"
    REFIT_WORSE = "refit_worse"
    MODEL_OUT_OF_BOUNDS = "model_out_of_bounds"
    OUT_OF_TOLERANCE = "out_of_tolerance"
    NOT_DETERMINED = "not_determined"
    WITHIN_SAMPLING = "within_sampling"
    LIKE_FILTER = "like_filter"
    LIKE_NOISE = "like_noise"
    LIKE_COMMAND = "like_command"
    OTHER_BAND = "other_band"
    OTHER_ABOVE = "other_above"
    FAST_TORQUE = "fast_torque"
    HOLDOUT_WORSE = "holdout_worse"
    NOT_NEEDED = "not_needed"
    NOT_EXCITED = "not_excited"
    UNAVAILABLE = "unavailable"


# Refusals for which the table of candidates gives the detection limit.
NEVER_SEEN = frozenset({Reason.NOT_SIGNIFICANT, Reason.PARAMETER_AT_BOUND})
# Refusals that noise can bring upon an effect that is there, as far as it is a small part of what a band holds.
BESIDE_NOISE = frozenset({
    Reason.TOO_SMALL, Reason.MINOR, Reason.NOT_CONFIRMED, Reason.BALANCE_WORSE, Reason.ERROR_NOT_LOWERED,
})  # fmt: skip

WORDS: Mapping[Reason, str] = {
    Reason.NOT_INDEPENDENT: "not distinguishable from the model on this log",
    Reason.PARAMETER_AT_BOUND: "rejected: {what}",
    Reason.NOT_SIGNIFICANT: "not significant (p = {p:.2g}, Holm)",
    Reason.TOO_SMALL: "significant but too small: {percent:.2g} % of the balance where it acts",
    Reason.BESIDE_LARGER: "significant but too small beside the accepted effects: {percent:.2g} % of the balance, "
    "within the model error of an effect of {largest:.2g} %",
    Reason.MINOR: "significant but minor: {percent:.2g} % of the residual above the noise floor",
    Reason.NOT_CONFIRMED: "not confirmed by cross-validation (gain {gain}; {asked:.2g} standard errors are needed)",
    Reason.ONE_PATH: "not confirmed by cross-validation over the position (gain {gain}): the motion repeats itself, so "
    "that whatever is left repeats with the position as well; motion over other positions would tell",
    Reason.EXPLAINED_BY_RIVALS: "explained to {percent:.0f} % by channel timing, channel filters, harmonics of a "
    "turn or presliding (cross-validation gain beside them {gain})",
    Reason.LIKE_RIPPLE: "not distinguishable from the reluctance torque of a current ripple ({percent:.0f} % of it): "
    "instants of i_d and i_q in the log, stated as such, would tell",
    Reason.IN_STEP: "not distinguishable from currents and voltages sampled in step with a held reference: {what} "
    "outside the tolerance, as such a log shows it",
    Reason.ONE_WAY: "not distinguishable from dry and viscous friction: the axis goes {percent:.2g} % of its way back; "
    "motion in both directions would tell",
    Reason.ONE_SPEED: "seen at one speed only, about {speed:.2g} rad/s for {turns:.1f} turns: not distinguishable from "
    "a wave over time; runs at two slow speeds would tell",
    Reason.IN_PASSING: "seen to {percent:.0f} % where the axis starts, stops or reverses too fast for the band: not "
    "distinguishable from presliding or a rest that is too short to see; slower reversals would tell",
    Reason.TURNS_TOO_OFTEN: "not judged: it acts at reversals, and in {percent:.0f} % of the samples the axis turns "
    "too often for its direction to be known",
    Reason.BALANCE_WORSE: "rejected: increases the error of the {balance} balance",
    Reason.ERROR_NOT_LOWERED: "rejected: lowers no error noticeably",
    Reason.REFIT_WORSE: "rejected: the refitted design leaves more torque than the given one, with it hardly less",
    Reason.MODEL_OUT_OF_BOUNDS: "rejected: drives {parameter} to {value:.3g}, beyond its bounds",
    Reason.OUT_OF_TOLERANCE: "rejected: moves {parameter} from {before:.3g} to {value:.3g}, out of its tolerance",
    Reason.NOT_DETERMINED: "rejected: {parameter} = {value:.3g} +- {stderr:.2g}, not determined by this log",
    Reason.WITHIN_SAMPLING: "within what sampling alone can cause: {value:.2g} +- {stderr:.1g} ms, where {low:.2g} to "
    "{high:.2g} ms are possible",
    Reason.LIKE_FILTER: "not distinguishable from a filter that makes the drive signal {value:.2g} ms late; state "
    "which it is as filter or late in [log]",
    Reason.LIKE_NOISE: "not distinguishable from noise of the acceleration: beside it the drive signal would be spread "
    "over {spread:.2g} ms, more than sampling does; a finer encoder or a faster motion would tell",
    Reason.LIKE_COMMAND: "not distinguishable from what a slow current loop makes of a command beside a delay",
    Reason.OTHER_BAND: "rejected: of another size in half the band, {percent:.0f} % of that in the whole",
    Reason.OTHER_ABOVE: "rejected: of another size above the band, {percent:.0f} % of that in it",
    Reason.FAST_TORQUE: "rejected: without the part of the measured torque that is faster than the band it would be of "
    "another size, {percent:.0f} % of this",
    Reason.HOLDOUT_WORSE: "rejected: increases the error on the held-out record",
    Reason.NOT_NEEDED: "not needed by the final model",
    Reason.NOT_EXCITED: "not excited: only {percent:.0f} % of the motion is slow enough for order {order}; needs "
    "{needs}",
    Reason.UNAVAILABLE: "not available: {why}",
}


@dataclass(frozen=True)
class Refusal:
    """Why a candidate is not accepted, with the numbers behind it.

    Attributes
    ----------
    reason : Reason
    detail : mapping of str to value
        What the sentence is made from.
    """

    reason: Reason
    detail: Mapping[str, Any] = field(default_factory=dict)

    def __str__(self) -> str:
        detail = dict(self.detail)
        if "gain" in detail:
            detail["gain"] = with_error(detail["gain"], detail["stderr"])
        return WORDS[self.reason].format(**detail)

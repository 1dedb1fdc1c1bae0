"""The criteria for an effect, before and after the refit with it, as pure functions of numbers.

Each returns a `Refusal`, or None where the effect passes.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pmsm_ctrl.diagnose.policy import POLICY, Policy
from pmsm_ctrl.diagnose.refusal import Reason, Refusal

__all__ = [
    "CrossValidation", "Machine", "along_the_way", "barely_confirmed", "beside_larger", "beside_ripple",
    "beside_rivals", "beyond_sampling", "cross_validation", "determined", "error_lowered", "holdout", "inside_bounds",
    "inside_tolerance", "left_inside", "no_balance_worse", "no_contradiction", "no_plain_error_worse",
    "no_voltage_worse", "significance", "signs", "size", "size_of_shape",
]  # fmt: skip


@dataclass(frozen=True)
class CrossValidation:
    """Gain on blocks of time that were left out of the fit.

    Attributes
    ----------
    gain, stderr : float
        Mean fall of a block's sum of squares, in units of the noise, and its standard error.
    blocks : int
    p_rank : float
        Wilcoxon's one-sided p-value of the blocks' gains: it sees effects that show in a few short stretches.
    limited : float
        Standard errors by which the mean exceeds zero where no block counts as more than twice its share.
    """

    gain: float
    stderr: float
    blocks: int
    p_rank: float
    limited: float = 0.0


class Machine(NamedTuple):
    """A parameter of the machine: its estimate and standard error, and the design's value with its relative tolerance.

    The tolerance is a share of `nominal`.
    """

    value: float
    stderr: float
    nominal: float
    tolerance: float


def signs(independent: bool, outside: str) -> Refusal | None:
    """Check that an effect has columns of its own, with parameters that physics allows.

    Parameters
    ----------
    independent : bool
        Whether the effect's columns differ from the model's on this log.
    outside : str
        Which of its parameters lies outside of its bounds, and the bound; empty where none does.
    """
    if not independent:
        return Refusal(Reason.NOT_INDEPENDENT)
    return Refusal(Reason.PARAMETER_AT_BOUND, {"what": outside}) if outside else None


def significance(p_holm: float, policy: Policy = POLICY) -> Refusal | None:
    """Check the p-value of the F-test.

    Parameters
    ----------
    p_holm : float
        Corrected for all candidates and for the shapes searched.
    policy : Policy
    """
    return Refusal(Reason.NOT_SIGNIFICANT, {"p": p_holm}) if p_holm > policy.significance else None


def size(
    share: float, explained: float, excess: float, policy: Policy = POLICY, minor_too: bool = False
) -> Refusal | None:
    """Check that an effect is worth a name.

    Parameters
    ----------
    share : float
        Its contribution over the rms of the balance, where it is largest.
    explained : float
        Share of the residual's sum of squares that it explains.
    excess : float
        The same of what the residual has above its noise floor, where the effect acts.
    policy : Policy
    minor_too : bool
        Whether it may explain less than most of that.
    """
    least = policy.small_size if explained > policy.explained else policy.size
    telling = explained > policy.refused_share and excess > policy.above_floor  # most of what is wrong, however small
    if share < least and not (telling and share > 0.0):
        return Refusal(Reason.TOO_SMALL, {"percent": 100.0 * share})
    if excess < (policy.excess if minor_too else policy.above_floor):
        return Refusal(Reason.MINOR, {"percent": 100.0 * min(excess, 1.0)})
    return None


def beside_larger(share: float, largest: float, policy: Policy = POLICY) -> Refusal | None:
    """Check that an effect is larger than the model error of those accepted before.

    Parameters
    ----------
    share : float
        Its contribution over the rms of the balance, where it is largest.
    largest : float
        The same of the largest accepted effect; 0 without one.
    policy : Policy
    """
    if share >= policy.relative_size * largest:
        return None
    return Refusal(Reason.BESIDE_LARGER, {"percent": 100.0 * share, "largest": 100.0 * largest})


def cross_validation(
    found: CrossValidation, whole: float, returned: float, first: bool, policy: Policy = POLICY, twice: bool = False
) -> Refusal | None:
    """Check that the gain is confirmed on blocks that were left out.

    Parameters
    ----------
    found : CrossValidation
    whole : float
        Gain of the whole log that the log's own rows bring, in units of the noise.
    returned : float
        Gain that the winding brings by returning to its datasheet, in squares of its tolerances.
    first : bool
        Whether this is the first effect.
    policy : Policy
    twice : bool
        Whether the mean gain has to exceed zero by twice as many standard errors, whatever the other tests say.
    """
    if twice and found.gain <= 2.0 * policy.block_errors * found.stderr:
        return _not_confirmed(found, 2.0 * policy.block_errors)
    expected = policy.expected_share * float(np.sqrt(max(whole, 0.0)))
    asked = min(max(expected, policy.first_block_errors), policy.block_errors) if first else policy.block_errors
    sure = found.gain > asked * found.stderr or found.p_rank < 0.5 * policy.significance or returned > policy.impossible
    sure = sure or found.limited > policy.block_errors
    return None if sure and found.gain > 0.0 else _not_confirmed(found, asked)


def _not_confirmed(found: CrossValidation, asked: float) -> Refusal:
    """Return the refusal with the number of standard errors that the gain has to exceed zero by."""
    return Refusal(Reason.NOT_CONFIRMED, {"gain": found.gain, "stderr": found.stderr, "asked": asked})


def along_the_way(found: CrossValidation, by_time: CrossValidation, policy: Policy = POLICY) -> Refusal | None:
    """Check that an effect that depends on the position is confirmed on parts of the way that were left out.

    A motion that repeats itself passes every position in the same state. What any error of the model leaves is then a
    function of the position, and is the same in parts of the time that were left out: these are sure of it, and those
    are not.

    Parameters
    ----------
    found : CrossValidation
        On parts of the way, each of which holds about the same share of what is explained and of the samples.
    by_time : CrossValidation
        On parts of the time.
    policy : Policy
    """
    alike = found.gain * by_time.stderr >= policy.stable * by_time.gain * found.stderr
    confirmed = cross_validation(found, 0.0, 0.0, first=False, policy=policy) is None
    if alike or confirmed or not found.blocks:  # on a short way nothing can be left out
        return None
    return Refusal(Reason.ONE_PATH, {"gain": found.gain, "stderr": found.stderr})


def barely_confirmed(found: CrossValidation, policy: Policy = POLICY) -> Refusal | None:
    """Check that left-out blocks speak for an effect, whose size in half the band has to confirm it.

    Parameters
    ----------
    found : CrossValidation
    policy : Policy
    """
    sure = found.gain > policy.first_block_errors * found.stderr
    return None if sure else _not_confirmed(found, policy.first_block_errors)


def beside_rivals(
    p_value: float, share: float, found: CrossValidation, policy: Policy = POLICY, surely: bool = False,
    alike: bool = False,
) -> Refusal | None:  # fmt: skip
    """Check that an effect is significant and confirmed beside its rivals, and that enough of it is left.

    Rivals that explain a gap leave a little to it, always. The less is left, the surer it has to be.

    Parameters
    ----------
    p_value : float
        Beside the rivals, corrected for all candidates and for the shapes searched.
    share : float
        What is left of its gain beside them.
    found : CrossValidation
        Beside them.
    policy : Policy
    surely : bool
        Whether it has to be as sure as where little is left.
    alike : bool
        Whether they resemble the effect by nature: then any share will do.
    """
    left = 1.0 if alike else share
    sure = left > policy.refused_share and found.gain > policy.block_errors * found.stderr
    enough = left > policy.left_inside and found.gain > policy.rival_errors * found.stderr and not surely
    if p_value <= policy.significance and (sure or enough):
        return None
    explained = 100.0 * min(max(1.0 - share, 0.0), 1.0)
    return Refusal(Reason.EXPLAINED_BY_RIVALS, {"percent": explained, "gain": found.gain, "stderr": found.stderr})


def beside_ripple(gain: float, ripple: float, logged: float, policy: Policy = POLICY) -> Refusal | None:
    """Check that an effect explains more than the reluctance torque of a current ripple.

    What any ripple explains is flexible enough to be a friction curve. One that is there has a part in the log.

    Parameters
    ----------
    gain, ripple, logged : float
        Fall of the sum of squares by the effect, by any ripple, and by the one that the log shows, over the noise.
    policy : Policy
    """
    if (1.0 - policy.tied_share) * gain > ripple or logged < policy.above_floor * gain:
        return None
    return Refusal(Reason.LIKE_RIPPLE, {"percent": 100.0 * min(ripple / gain, 1.0)})


def no_balance_worse(
    before: Mapping[str, float], after: Mapping[str, float], noise: Mapping[str, float], policy: Policy = POLICY
) -> Refusal | None:
    """Check that no balance gets worse, unless for much less than another one gains.

    Before, the winding may have been fitted so as to stand in for the effect, which can suit one balance better.

    Parameters
    ----------
    before, after : dict of balance to float
        Rms error as the fit weighs it.
    noise : dict of balance to float
        Rms noise, in the same units.
    policy : Policy

    Returns
    -------
    Refusal or None
    """
    return _worse(before, after, noise, policy.balance_worse, policy)


def no_voltage_worse(
    before: Mapping[str, float], after: Mapping[str, float], noise: Mapping[str, float], policy: Policy = POLICY
) -> Refusal | None:
    """Check that an effect on the voltages raises the error of none of them, all samples weighted alike.

    Unless for much less than another one gains: what an encoder adds to u_q by its speed can be a thousand times the
    effect, and changes with any model, by chance.

    Parameters
    ----------
    before, after : dict of balance to float
        Rms error, V.
    noise : dict of balance to float
        Rms noise, V.
    policy : Policy
    """
    return _worse(before, after, noise, policy.unchanged, policy)


def _worse(
    before: Mapping[str, float], after: Mapping[str, float], noise: Mapping[str, float], ratio: float, policy: Policy
) -> Refusal | None:
    """Return the first balance whose error rises by more than a ratio, and by more than a share of another's gain."""
    change = {name: (after[name] ** 2 - before[name] ** 2) / noise[name] ** 2 for name in after}
    for name, more in change.items():
        if after[name] > ratio * before[name] and more > -policy.traded * min(change.values()):
            return Refusal(Reason.BALANCE_WORSE, {"balance": name})
    return None


def error_lowered(
    before: Mapping[str, float], after: Mapping[str, float], returned: float, policy: Policy = POLICY
) -> Refusal | None:
    """Check that some error falls, or that the winding returns to its datasheet.

    Parameters
    ----------
    before, after : dict of name to float
        Rms errors.
    returned : float
        Fall of the winding's distance from its datasheet, in squares of its tolerances.
    policy : Policy
    """
    if returned > policy.returned or any(after[name] <= policy.lowered * before[name] for name in after):
        return None
    return Refusal(Reason.ERROR_NOT_LOWERED)


def inside_bounds(
    values: Mapping[str, tuple[float, float]], bounds: Mapping[str, tuple[float, float]], policy: Policy = POLICY
) -> Refusal | None:
    """Check that the final parameters of every effect of the model are physically possible.

    Parameters
    ----------
    values : dict of parameter to (value, stderr)
        A second parameter of the same symbol is called ``symbol#2``.
    bounds : dict of symbol to (lower, upper)
    policy : Policy
    """
    for name, (value, stderr) in values.items():
        low, high = bounds.get(name.split("#")[0], (-np.inf, np.inf))
        slack = policy.sure_errors * stderr
        if not low - slack <= value <= high + slack:
            return Refusal(Reason.MODEL_OUT_OF_BOUNDS, {"parameter": name, "value": value})
    return None


def inside_tolerance(
    before: Mapping[str, Machine], after: Mapping[str, Machine], policy: Policy = POLICY
) -> Refusal | None:
    """Check that no parameter of the machine leaves its tolerance with an effect, by more than that tolerance.

    One that is outside without the effect as well is a wrong value of the design, whatever else is missing. One that
    the log does not tell to within its tolerance without the effect has not moved.

    Parameters
    ----------
    before, after : dict of parameter to Machine
        Estimated without and with the effect.
    policy : Policy
    """
    for name, one in after.items():
        was, allowed = before[name].value, one.tolerance * one.nominal
        if before[name].stderr > allowed:
            continue
        outside = abs(one.value - one.nominal) - allowed > policy.sure_errors * one.stderr
        if outside and abs(one.value - was) > allowed >= abs(was - one.nominal):
            return Refusal(Reason.OUT_OF_TOLERANCE, {"parameter": name, "before": was, "value": one.value})
    return None


def no_contradiction(before: Collection[str], after: Mapping[str, float]) -> Refusal | None:
    """Check that a log which belongs to its design does not contradict it with an effect.

    Parameters
    ----------
    before : collection of str
        Parameters that contradict the design without the effect.
    after : dict of parameter to float
        Those that do so with it, and their values.
    """
    new = [name for name in after if name not in before]
    return Refusal(Reason.MODEL_OUT_OF_BOUNDS, {"parameter": new[0], "value": after[new[0]]}) if new else None


def left_inside(share: float, p_inside: float, beyond: Refusal, policy: Policy = POLICY) -> Refusal | None:
    """Check that an effect is needed where the base parameters stay inside their bounds.

    Parameters
    ----------
    share : float
        Share of what the effect explains that is left then.
    p_inside : float
        Its p-value then, corrected for all candidates.
    beyond : Refusal
        The base parameter that the fit without bounds drives beyond them.
    policy : Policy
    """
    return None if share > policy.left_inside and p_inside <= policy.significance else beyond


def determined(
    values: Mapping[str, tuple[float, float]], tried: int, ran_out: bool, policy: Policy = POLICY
) -> Refusal | None:
    """Check that the log determines how large an effect is.

    Its amplitudes and their errors are those that are reported: of all samples, and beside everything else. One of them
    has to differ from zero with the certainty that the F-test asks for, which weighs samples and frequencies its own
    way: Bonferroni's correction for the amplitudes and for everything that was tried.

    Parameters
    ----------
    values : dict of parameter to (value, stderr)
        Of its amplitudes; none where it has no column of its own.
    tried : int
        Shapes of all candidates that could have been named in its place.
    ran_out : bool
        Whether its shape wants to be outside of the range that was searched: there is no optimum inside.
    policy : Policy
    """
    if ran_out:
        return Refusal(Reason.PARAMETER_AT_BOUND, {"what": "a parameter of its shape at the end of its range"})
    free = {name: one for name, one in values.items() if not math.isnan(one[1])}  # not what is held
    if not free:
        return None
    name, (value, stderr) = max(free.items(), key=lambda one: abs(one[1][0]) / max(one[1][1], 1e-300))
    p = math.erfc(abs(value) / max(stderr, 1e-300) / math.sqrt(2.0))
    if p * len(free) * tried > policy.significance:
        return Refusal(Reason.NOT_DETERMINED, {"parameter": name, "value": value, "stderr": stderr})
    return None


def size_of_shape(values: Mapping[str, tuple[float, float]], policy: Policy = POLICY) -> Refusal | None:
    """Check that the log determines the size of an effect whose shape carries it, as the deflection of a bristle does.

    Parameters
    ----------
    values : dict of parameter to (value, stderr)
    policy : Policy
    """
    for name, (value, stderr) in values.items():
        if value <= policy.sure_errors * stderr:
            return Refusal(Reason.NOT_DETERMINED, {"parameter": name, "value": value, "stderr": stderr})
    return None


def no_plain_error_worse(
    before: float, after: float, typical: float = 1.0, policy: Policy = POLICY
) -> Refusal | None:  # fmt: skip
    """Check that an effect on the torque does not raise its error, all samples weighted alike.

    Where the typical error falls, only samples with an error of another order have a larger one: edges of the torque
    that the log did not sample, whose error is the same with any model. An effect that adds more error than there was
    is no such edge.

    Parameters
    ----------
    before, after : float
        Rms error, N m (N).
    typical : float
        Median absolute error after, over that before.
    policy : Policy
    """
    if typical <= policy.lowered and after**2 <= 2.0 * before**2:
        return None
    return Refusal(Reason.BALANCE_WORSE, {"balance": "torque"}) if after > policy.unchanged * before else None


def beyond_sampling(
    value: float, stderr: float, possible: tuple[float, float], policy: Policy = POLICY
) -> Refusal | None:
    """Check that a delay exceeds what the sampling of the channels can cause.

    Parameters
    ----------
    value, stderr : float
        Of the delay, s.
    possible : (float, float)
        How early and how late a sample can be, s.
    policy : Policy
    """
    low, high = possible
    if max(value - high, low - value) > policy.sure_errors * stderr:
        return None
    found = {"value": value, "stderr": stderr, "low": low, "high": high}
    return Refusal(Reason.WITHIN_SAMPLING, {name: 1e3 * seconds for name, seconds in found.items()})


def holdout(before: Mapping[str, float], after: Mapping[str, float], policy: Policy = POLICY) -> Refusal | None:
    """Check that the error on another record falls in the mean over the balances, and rises in none.

    Parameters
    ----------
    before, after : dict of balance to float
        Rms error on the held-out record.
    policy : Policy
    """
    ratios = [after[name] / before[name] for name in before if before[name] > 0.0]
    fails = sum(ratios) >= len(before) or any(ratio > policy.balance_worse for ratio in ratios)
    return Refusal(Reason.HOLDOUT_WORSE) if fails else None

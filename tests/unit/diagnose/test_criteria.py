"""Every criterion of the diagnosis, on numbers alone, on either side of its threshold."""

from __future__ import annotations

import re
from dataclasses import FrozenInstanceError, fields, replace

import numpy as np
import pytest

from pmsm_ctrl.diagnose import criteria, notices
from pmsm_ctrl.diagnose.criteria import CrossValidation
from pmsm_ctrl.diagnose.policy import POLICY, Policy
from pmsm_ctrl.diagnose.refusal import WORDS, Reason, Refusal
from pmsm_ctrl.section import Template


def reason(refusal: Refusal | None) -> Reason | None:
    return None if refusal is None else refusal.reason


@pytest.mark.parametrize(
    ("independent", "outside", "expected"),
    [
        (True, "", None), (False, "", Reason.NOT_INDEPENDENT), (True, "k at its bound 0", Reason.PARAMETER_AT_BOUND),
        (False, "k at its bound 0", Reason.NOT_INDEPENDENT),
    ],
)  # fmt: skip
def test_signs(independent: bool, outside: str, expected: Reason | None) -> None:
    found = criteria.signs(independent, outside)
    assert reason(found) is expected
    assert expected is not Reason.PARAMETER_AT_BOUND or str(found) == "rejected: k at its bound 0"


def test_significance() -> None:
    assert criteria.significance(0.0099) is None
    assert str(criteria.significance(0.0213)) == "not significant (p = 0.021, Holm)"
    assert criteria.significance(0.04, replace(POLICY, significance=0.05)) is None


@pytest.mark.parametrize(
    ("share", "explained", "passes"),
    [(0.0041, 0.0, True), (0.0039, 0.0119, False), (0.0039, 0.0121, True), (0.0009, 0.05, False)],
)
def test_size_is_that_of_the_balance_or_what_is_explained(share: float, explained: float, passes: bool) -> None:
    refusal = criteria.size(share, explained, 1.0)
    assert reason(refusal) is (None if passes else Reason.TOO_SMALL)


def test_what_is_most_of_the_rest_is_worth_a_name_however_small() -> None:
    least, most = POLICY.refused_share, POLICY.above_floor
    assert criteria.size(0.0005, 1.01 * least, 1.01 * most) is None
    for share, explained, excess in ((0.0005, 0.99 * least, 1.0), (0.0005, 1.0, 0.99 * most), (0.0, 1.0, 1.0)):
        assert reason(criteria.size(share, explained, excess)) is Reason.TOO_SMALL


def test_beside_a_larger_effect_a_small_one_may_be_what_that_leaves() -> None:
    assert criteria.beside_larger(0.005, 0.0) is None
    assert criteria.beside_larger(1.01 * POLICY.relative_size * 0.5, 0.5) is None
    refusal = criteria.beside_larger(0.01, 0.5)
    assert reason(refusal) is Reason.BESIDE_LARGER
    assert str(refusal).endswith(
        "beside the accepted effects: 1 % of the balance, within the model error of an effect of 50 %"
    )


def test_an_effect_explains_half_of_what_is_above_the_noise() -> None:
    least = POLICY.above_floor
    assert least == 0.5
    assert criteria.size(0.5, 0.5, 1.01 * least) is None
    refusal = criteria.size(0.5, 0.5, 0.99 * least)
    assert reason(refusal) is Reason.MINOR
    assert str(refusal) == f"significant but minor: {99.0 * least:.2g} % of the residual above the noise floor"
    assert criteria.size(1.0, 0.3, 0.99 * least, minor_too=True) is None
    assert reason(criteria.size(1.0, 0.3, 0.99 * POLICY.excess, minor_too=True)) is Reason.MINOR
    # what is too small for a name is called so first
    assert reason(criteria.size(0.0, 0.0, 0.0)) is Reason.TOO_SMALL


def confirmed(gain: float, whole: float = 1e4, returned: float = 0.0, first: bool = True, p_rank: float = 0.5) -> bool:
    found = CrossValidation(gain, 1.0, 16, p_rank)
    return criteria.cross_validation(found, whole, returned, first) is None


def test_cross_validation_asks_for_so_many_standard_errors() -> None:
    assert confirmed(2.81)
    assert not confirmed(2.79)
    assert str(criteria.cross_validation(CrossValidation(3590.0, 3512.0, 16, 0.5), 1e4, 0.0, True)) == (
        "not confirmed by cross-validation (gain 3600 ± 3500; 2.8 standard errors are needed)"
    )


@pytest.mark.parametrize(("gain", "passes"), [(2.1, True), (1.9, False), (-3.0, False)])
def test_left_out_blocks_speak_barely_for_an_effect(gain: float, passes: bool) -> None:
    refusal = criteria.barely_confirmed(CrossValidation(gain, 1.0, 16, 0.5))
    assert reason(refusal) is (None if passes else Reason.NOT_CONFIRMED)


@pytest.mark.parametrize(
    ("p_value", "share", "gain", "passes"),
    [
        (0.009, 0.9, 1.1, True), (0.011, 0.9, 9.0, False), (1e-9, 0.9, 0.9, False), (1e-9, 0.9, -3.0, False),
        (1e-9, 0.51, 1.1, True), (1e-9, 0.49, 2.7, False), (1e-90, 0.1, 90.0, False),
        (1e-9, 0.19, 2.9, True), (1e-9, 0.11, 9.0, True), (0.011, 0.19, 9.0, False),  # less is left, and more surely
    ],
)  # fmt: skip
def test_enough_of_an_effect_must_be_left_beside_its_rivals(
    p_value: float, share: float, gain: float, passes: bool
) -> None:
    refusal = criteria.beside_rivals(p_value, share, CrossValidation(gain, 1.0, 16, 0.001))
    assert reason(refusal) is (None if passes else Reason.EXPLAINED_BY_RIVALS)


def test_any_share_will_do_beside_rivals_that_resemble_the_effect_by_nature() -> None:
    def alike(share: float, gain: float) -> Refusal | None:
        return criteria.beside_rivals(1e-9, share, CrossValidation(gain, 1.0, 16, 0.001), alike=True)

    assert alike(0.01, 1.1) is None
    refusal = alike(0.25, 0.9)
    assert refusal is not None
    assert str(refusal).startswith("explained to 75 % by channel timing")


def test_what_is_left_of_a_minor_effect_beside_its_rivals_must_be_sure() -> None:
    def minor(errors: float) -> Refusal | None:
        return criteria.beside_rivals(1e-9, 0.9, CrossValidation(errors, 1.0, 16, 0.001), surely=True)

    assert minor(2.81) is None
    assert reason(minor(2.79)) is Reason.EXPLAINED_BY_RIVALS


def test_an_effect_must_explain_more_than_a_ripple_of_the_current() -> None:
    assert criteria.beside_ripple(1000.0, 989.0, 989.0) is None
    assert criteria.beside_ripple(1000.0, 991.0, 499.0) is None, "a ripple of which the log shows nothing"
    refusal = criteria.beside_ripple(1000.0, 991.0, 501.0)
    assert reason(refusal) is Reason.LIKE_RIPPLE
    assert str(refusal).startswith("not distinguishable from the reluctance torque of a current ripple (99 % of it)")
    assert criteria.beside_ripple(5.0, 0.0, 0.0) is None, "a motor without saliency"


def test_the_size_that_a_shape_carries_must_be_determined() -> None:
    assert criteria.size_of_shape({"z_s": (3.1e-3, 1e-3)}) is None
    refusal = criteria.size_of_shape({"z_s": (2.9e-3, 1e-3)})
    assert reason(refusal) is Reason.NOT_DETERMINED
    assert criteria.size_of_shape({}) is None, "one whose columns carry it"
    assert criteria.size_of_shape({"z_s": (1e-3, float("nan"))}) is None, "one without a standard error"


@pytest.mark.parametrize(("whole", "asked"), [(16.0, 2.0), (0.0, 2.0), (36.0, 2.25), (49.0, 2.625), (100.0, 2.8)])
def test_a_small_first_effect_needs_three_quarters_of_what_it_leads_to_expect(whole: float, asked: float) -> None:
    # the gain of 16 equal blocks reaches half the root of the whole
    assert confirmed(asked + 0.01, whole)
    assert not confirmed(asked - 0.01, whole)
    assert confirmed(2.81, whole, first=False)
    assert not confirmed(2.79, whole, first=False)


def test_a_minor_effect_with_a_memory_is_confirmed_twice_as_surely() -> None:
    def minor(errors: float, p_rank: float = 0.001) -> Refusal | None:
        found = CrossValidation(errors, 1.0, 16, p_rank, 9.0)
        return criteria.cross_validation(found, 1e4, 300.0, False, twice=True)

    assert minor(5.61) is None
    assert reason(minor(5.59)) is Reason.NOT_CONFIRMED, "whatever ranks, limited gains and the winding say"


def test_cross_validation_by_ranks_and_by_the_winding() -> None:
    assert confirmed(0.1, p_rank=0.0049)
    assert not confirmed(0.1, p_rank=0.0051)
    assert confirmed(0.1, returned=226.0)
    assert not confirmed(0.1, returned=224.0)
    assert not confirmed(-0.1, returned=226.0, p_rank=0.0), "a loss is never confirmed"


def test_no_balance_may_get_worse_unless_another_one_gains_much_more() -> None:
    noise = {"torque": 1.0, "u_q": 1.0}
    old = {"torque": 10.0, "u_q": 1.0}
    assert criteria.no_balance_worse(old, {"torque": 9.0, "u_q": 1.02}, noise) is None
    # u_q loses 0.21 of its noise's square, the torque gains 0.5: more than a fifth
    assert reason(criteria.no_balance_worse(old, {"torque": 99.5**0.5, "u_q": 1.1}, noise)) is Reason.BALANCE_WORSE
    assert criteria.no_balance_worse(old, {"torque": 5.0, "u_q": 1.1}, noise) is None


@pytest.mark.parametrize(
    ("u_d", "u_q", "noise_q", "passes"),
    [
        (1.0009, 1.0, 1.0, True), (1.0011, 1.0, 1.0, False), (1.0011, 0.999, 1.0, False),
        (0.9, 1.002, 1.0, True), (0.9, 1.02, 1.0, False),  # a fifth of what the other one gains, each by its noise
        (0.9, 1.02, 0.1, False), (0.9, 1.02, 10.0, True),
    ],
)  # fmt: skip
def test_no_voltage_may_get_worse_all_samples_alike_but_for_much_less_than_another_gains(
    u_d: float, u_q: float, noise_q: float, passes: bool
) -> None:
    before, after = {"u_d": 1.0, "u_q": 1.0}, {"u_d": u_d, "u_q": u_q}
    refusal = criteria.no_voltage_worse(before, after, {"u_d": 1.0, "u_q": noise_q})
    assert reason(refusal) is (None if passes else Reason.BALANCE_WORSE)


def test_an_error_has_to_fall_or_the_winding_to_return() -> None:
    below, above = POLICY.lowered - 1e-4, POLICY.lowered + 1e-4
    assert criteria.error_lowered({"torque": 1.0}, {"torque": below}, 0.0) is None
    assert criteria.error_lowered({"torque": 1.0, "u_q": 2.0}, {"torque": 1.5, "u_q": 2.0 * below}, 0.0) is None
    stays = {"torque": 1.0, "u_q": 2.0}, {"torque": above, "u_q": 2.0}
    assert reason(criteria.error_lowered(*stays, 24.9)) is Reason.ERROR_NOT_LOWERED
    assert criteria.error_lowered(*stays, 25.1) is None


def test_final_parameters_stay_inside_their_bounds_to_within_their_errors() -> None:
    bounds = {"F_c": (0.0, np.inf)}
    assert criteria.inside_bounds({"F_c": (-0.29, 0.1)}, bounds) is None
    refusal = criteria.inside_bounds({"F_c": (0.2, 0.1), "F_c#2": (-0.31, 0.1)}, bounds)
    assert str(refusal) == "rejected: drives F_c#2 to -0.31, beyond its bounds"
    assert criteria.inside_bounds({"tau_u": (-1.0, 0.0)}, bounds) is None, "no bounds are known of it"


@pytest.mark.parametrize(
    ("before", "after", "stderr", "passes"),
    [
        (0.94, -0.02, 0.02, False),  # stands in for the inertia
        (1.14, 1.16, 1e-3, True),  # moves little
        (1.60, 1.30, 0.02, True),  # outside without it: a wrong value of the design
        (0.94, 0.60, 0.10, True),  # outside by 2.5 standard errors
        (0.94, 0.60, 0.08, False),
        (1.14, 0.86, 1e-3, True),  # moves far, inside
    ],
)
def test_no_effect_moves_a_parameter_of_the_machine_out_of_its_tolerance(
    before: float, after: float, stderr: float, passes: bool
) -> None:
    machine = [{"J": criteria.Machine(2.0 * value, 2.0 * stderr, 2.0, 0.15)} for value in (before, after)]
    refusal = criteria.inside_tolerance(*machine)
    assert reason(refusal) is (None if passes else Reason.OUT_OF_TOLERANCE)


@pytest.mark.parametrize(("stderr", "passes"), [(1e-3, False), (7.3e-3, True)])
def test_a_parameter_that_the_log_does_not_tell_has_not_moved(stderr: float, passes: bool) -> None:
    """A drift of the friction was refused for an L_d of 16 +- 7 mH that became 8: the log tells it with the drift."""
    before, after = (criteria.Machine(value, error, 0.0196, 0.2) for value, error in ((0.0159, stderr), (0.0079, 1e-4)))
    refusal = criteria.inside_tolerance({"L_d": before}, {"L_d": after})
    assert reason(refusal) is (None if passes else Reason.OUT_OF_TOLERANCE)


@pytest.mark.parametrize(
    ("share", "p", "passes"),
    [(0.9, 1e-4, True), (0.4, 1e-4, False), (0.9, 0.02, False)],
)
def test_a_base_parameter_beyond_its_bounds_counts_where_nothing_is_left(share: float, p: float, passes: bool) -> None:
    beyond = Refusal(Reason.MODEL_OUT_OF_BOUNDS, {"parameter": "F_c", "value": -5e-4})
    assert criteria.left_inside(share, p, beyond) is (None if passes else beyond)


def test_no_effect_makes_a_log_contradict_its_design() -> None:
    """A friction that rises left F_c = -0.06 in the place of a presliding, and the verdict was implausible (440294)."""
    assert criteria.no_contradiction((), {}) is None
    assert criteria.no_contradiction(("F_c",), {"F_c": -0.06}) is None, "it contradicts the design without the effect"
    refusal = criteria.no_contradiction(("R",), {"R": -1.0, "F_c": -0.06})
    assert reason(refusal) is Reason.MODEL_OUT_OF_BOUNDS
    assert refusal is not None
    assert refusal.detail == {"parameter": "F_c", "value": -0.06}


def test_the_log_has_to_determine_how_large_an_effect_is() -> None:
    assert criteria.determined({"a_s": (0.1, 0.2), "a_c": (0.8, 0.1)}, 20, False) is None
    assert criteria.determined({}, 20, False) is None
    assert criteria.determined({"k_i": (0.0, float("nan"))}, 20, False) is None, "held: it has no error"
    assert reason(criteria.determined({"dF_c": (2.5e4, 2.5e4)}, 20, False)) is Reason.NOT_DETERMINED
    saturation = {"k_s": (0.0149, 0.0060)}  # of a clean log in a held reference (920142), at p < 1e-12
    assert reason(criteria.determined(saturation, 20, False)) is Reason.NOT_DETERMINED
    assert reason(criteria.determined({"dF_c": (1.0, 0.1)}, 20, True)) is Reason.PARAMETER_AT_BOUND


def test_a_size_pays_for_the_shapes_that_were_tried() -> None:
    """An order of a turn on a measured robot joint, of 590, beside 16 other candidates: the F-test had p = 3e-35."""
    cogging = {"a_s": (-0.042, 0.087), "a_c": (0.293, 0.075)}
    refusal = criteria.determined(cogging, 590 * 17, False)
    assert refusal is not None
    assert (refusal.reason, refusal.detail["parameter"]) == (Reason.NOT_DETERMINED, "a_c")
    assert criteria.determined(cogging, 1, False) is None
    # a two-sided normal tail of 0.01 / 20 is 3.4808 standard errors (Abramowitz and Stegun, table 26.1)
    assert criteria.determined({"T_0": (3.49, 1.0)}, 20, False) is None
    assert reason(criteria.determined({"T_0": (3.47, 1.0)}, 20, False)) is Reason.NOT_DETERMINED


def test_an_effect_on_the_torque_raises_no_error() -> None:
    assert criteria.no_plain_error_worse(1.0, 1.0) is None
    assert reason(criteria.no_plain_error_worse(1.0, 1.01)) is Reason.BALANCE_WORSE


def test_only_edges_may_have_a_larger_error_where_the_typical_one_falls() -> None:
    falls, stays = 0.99 * POLICY.lowered, 1.01 * POLICY.lowered
    assert criteria.no_plain_error_worse(1.0, 1.15, falls) is None
    assert reason(criteria.no_plain_error_worse(1.0, 1.5, falls)) is Reason.BALANCE_WORSE
    assert reason(criteria.no_plain_error_worse(1.0, 1.01, stays)) is Reason.BALANCE_WORSE


def test_held_out_record() -> None:
    assert criteria.holdout({"torque": 1.0, "u_q": 1.0}, {"torque": 0.9, "u_q": 1.02}) is None
    # no balance pays for another one
    before = {"torque": 4.79, "u_d": 1.0, "u_q": 1.0}
    assert reason(criteria.holdout(before, {"torque": 7.92, "u_d": 0.6, "u_q": 0.6})) is Reason.HOLDOUT_WORSE
    assert reason(criteria.holdout({"torque": 1.0, "u_q": 1.0}, {"torque": 0.95, "u_q": 1.06})) is Reason.HOLDOUT_WORSE
    assert reason(criteria.holdout({"torque": 1.0}, {"torque": 1.0})) is Reason.HOLDOUT_WORSE


# ---- policy, reasons and words ----------------------------------------------------------------------------------


def test_policy_documents_every_threshold_and_does_not_change() -> None:
    assert Policy.__doc__ is not None
    documented = {name for line in re.findall(r"^    ([a-z_, ]+) : ", Policy.__doc__, re.MULTILINE)
                  for name in line.split(", ")}  # fmt: skip
    assert documented == {field.name for field in fields(Policy)}
    assert len(documented) <= 40
    with pytest.raises(FrozenInstanceError):
        POLICY.size = 0.0  # type: ignore[misc]


@pytest.mark.parametrize(("gain", "tie"), [(0.0, 20.0), (1999.0, 20.0), (2001.0, 20.01), (1e5, 1e3)])
def test_a_tie_is_a_share_of_the_gain_and_no_less_than_the_noise(gain: float, tie: float) -> None:
    assert POLICY.tie(gain) == pytest.approx(tie)


def test_every_reason_has_words_and_every_notice_its_own_code() -> None:
    assert set(WORDS) == set(Reason)
    templates = [one for one in vars(notices).values() if isinstance(one, Template)]
    codes = [one.code for one in templates]
    assert len(set(codes)) == len(codes)
    assert all(re.fullmatch(r"[a-z_]+", code) for code in codes)
    assert not any(one.words.endswith(".") for one in templates)


@pytest.mark.parametrize(
    ("value", "named"), [(0.5e-3, False), (1.2e-3, False), (1.4e-3, True), (-1.9e-3, False), (-2.4e-3, True)]
)
def test_a_delay_is_named_beyond_what_sampling_can_do(value: float, named: bool) -> None:
    refusal = criteria.beyond_sampling(value, 0.1e-3, (-2e-3, 1e-3))
    assert (refusal is None) == named
    if refusal is not None:
        assert refusal.reason is Reason.WITHIN_SAMPLING
        assert "where -2 to 1 ms are possible" in str(refusal)

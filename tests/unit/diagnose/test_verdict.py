"""What a verdict rests on, on fits that are written down by hand."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose import diagnose
from pmsm_ctrl.diagnose.explained import explains_most, explains_most_beside_noise
from pmsm_ctrl.diagnose.level import Level, level_of
from pmsm_ctrl.diagnose.outcome import noise_floor
from pmsm_ctrl.diagnose.policy import POLICY
from pmsm_ctrl.diagnose.refusal import Reason, Refusal
from pmsm_ctrl.diagnose.result import Deviation
from pmsm_ctrl.diagnose.verdict import judged
from pmsm_ctrl.log import Log
from pmsm_ctrl.plausibility import Plausibility
from pmsm_ctrl.regression.drive_timing import DriveTiming
from pmsm_ctrl.section import Notice
from tests.effort import seeds, slow
from tests.unit.regression.test_drive_timing import believed, made

DOUBT, HANDLED = Notice("torque_sign", "opposite sign"), Notice("time_gaps", "gaps")
LOG = Log({"t": np.arange(3.0)})
NOMINAL = {"J": 1e-4, "F_c": 0.02, "R": 19.0}
PSI_F = 0.172


def fit_of(
    measured: float = 20.0,
    left: float = 1.0,
    samples: float = 4e3,
    friction: float = 0.5,
    rough: float = 0.0,
    free: float = 0.0,
    **values: float,
) -> Any:
    """A fit of a torque balance alone; sizes in units of its noise."""
    at, samples = {**NOMINAL, **values}, int(samples)
    row = np.resize([1.0, -1.0], (1, samples))
    record = SimpleNamespace(
        counts=(), notes=(),
        mask=np.ones(samples, dtype=bool), weight=np.ones((1, samples)), target=measured * row, channels=("torque",),
        cutoff=40.0, rate=200.0, drive="torque", noise_of=lambda values: 0.0, timing=DriveTiming(),
        rough=rough, turning=0.0,
    )  # fmt: skip
    nominal = np.array([PSI_F if name == "psi_f" else NOMINAL[name] for name in at])
    matrix = np.zeros((1, samples, len(nominal)))
    matrix[0, :, list(at).index("F_c")] = -100.0 * friction * measured * row[0]  # of the torque, where F_c is -0.01
    return SimpleNamespace(
        record=record, residual=left * row, weights=SimpleNamespace(sigma=np.ones(1)),
        whitener=SimpleNamespace(sigma=np.ones(1)),
        model=SimpleNamespace(names=list(at), nominal=nominal, matrix=matrix),
        plain=SimpleNamespace(
            values=np.array(list(at.values())), stderr=0.01 * nominal, predicted=lambda: (measured - free) * row
        ),
        trials=[], solved=SimpleNamespace(rest_of=lambda row: np.full(10, 10.0)),  # a sum of squares of 1000
    )  # fmt: skip


def verdict_of(
    fit: Any,
    believed: Plausibility | None = None,
    asides: tuple[Notice | None, Notice | None, Notice | None] = (None, None, None),
    deviations: tuple[Deviation, ...] = (),
    steps: tuple[Any, ...] = (),
    refused: Any = None,
) -> tuple[str, list[str]]:
    selection: Any = SimpleNamespace(fit=fit, steps=steps, refused=refused or {})
    verdict, reasons = judged(selection, believed, asides, deviations)
    return verdict.value, [reason.code for reason in reasons]


def test_a_level_knows_what_is_explained_and_what_could_be() -> None:
    level = level_of(fit_of(measured=10.0, left=5.0), 0)
    assert (level.measured, level.left) == pytest.approx((10.0, 5.0))
    assert level.explained == pytest.approx(0.75)
    assert level.explicable == pytest.approx(0.99)
    assert Level(0.5, 0.5).explicable == 0.0


def test_a_sound_log_is_consistent_and_needs_no_reason() -> None:
    assert verdict_of(fit_of()) == ("consistent", [])
    assert verdict_of(fit_of(), Plausibility(LOG, doubts=(HANDLED,))) == ("consistent", [])


def test_the_order_of_the_verdicts() -> None:
    blind, left = Notice("not_excited", "x"), Notice("residual_dependence", "y")
    contrary = Plausibility(LOG, contradictions=(DOUBT,))
    assert verdict_of(fit_of(), contrary, (blind, left), steps=(1,)) == ("implausible", ["torque_sign"])
    assert verdict_of(fit_of(), asides=(blind, left, None), steps=(1,)) == ("effects_missing", [])
    assert verdict_of(fit_of(), asides=(blind, left, None)) == ("not_excited", ["not_excited"])
    assert verdict_of(fit_of(), asides=(None, left, None)) == ("unexplained", ["residual_dependence"])
    # what left-out blocks do not confirm is an open question
    assert verdict_of(fit_of(), asides=(None, None, left)) == ("inconclusive", ["residual_dependence"])


def test_an_open_doubt_of_the_import_forbids_consistent() -> None:
    assert verdict_of(fit_of(), Plausibility(LOG, doubts=(HANDLED, DOUBT))) == ("inconclusive", ["torque_sign"])


@pytest.mark.parametrize(
    ("values", "code"),
    [
        ({"J": -1e-5}, "negative_parameter"), ({"F_c": -0.01}, "negative_parameter"),
        ({"J": 3.1e-4}, "parameter_factor_off"), ({"R": 5.0}, "parameter_factor_off"),
    ],
)  # fmt: skip
def test_what_no_motor_can_have_is_implausible(values: dict[str, float], code: str) -> None:
    assert verdict_of(fit_of(**values)) == ("implausible", [code])


def test_a_dry_friction_of_nearly_nothing_may_come_out_below_zero() -> None:
    assert verdict_of(fit_of(F_c=-0.01, friction=0.05)) == ("consistent", [])


@pytest.mark.parametrize(("free", "verdict"), [(0.9, "implausible"), (0.96, "consistent")])
def test_a_dry_friction_below_zero_has_to_explain_something(free: float, verdict: str) -> None:
    assert verdict_of(fit_of(F_c=-0.01, free=free))[0] == verdict  # without bounds 0.9 of the noise is left, or 0.96


def test_a_resistance_far_above_the_design_may_be_a_dead_time() -> None:
    assert verdict_of(fit_of(R=80.0)) == ("consistent", [])  # its structure is for `unexplained` to find


@pytest.mark.parametrize(
    ("share", "code"), [(1.0, None), (1.03, None), (-1.0, "negative_parameter"), (0.2, "parameter_factor_off")]
)
def test_a_resistance_below_zero_is_a_dead_time_where_the_flux_linkage_is_right(share: float, code: str | None) -> None:
    """A drive may compensate more dead time than it has. Voltages of the wrong sign or factor show in psi_f as well."""
    verdict, reasons = verdict_of(fit_of(R=-2.0, psi_f=share * PSI_F))
    assert (verdict == "implausible") == (code is not None)
    assert code is None or code in reasons
    assert verdict_of(fit_of(R=-2.0)) == ("implausible", ["negative_parameter"])  # where psi_f is not told


def test_friction_may_be_anything_above_zero() -> None:
    assert verdict_of(fit_of(F_c=0.2)) == ("consistent", [])


def test_a_torque_that_does_not_belong_to_the_motion_is_implausible() -> None:
    assert verdict_of(fit_of(measured=10.0, left=9.0)) == ("implausible", ["unrelated_torque"])
    # most of a torque near its noise floor is noise, not another axis'
    # (and most of what is left lies above the floor: 1 - 1 / 1.9^2)
    assert verdict_of(fit_of(measured=2.4, left=1.9)) == ("inconclusive", ["little_known", "above_noise_floor"])


def test_a_log_of_noise_decides_nothing() -> None:
    # the residual is as high as its floor, and hardly lower than the torque; what it says of J means nothing either
    assert verdict_of(fit_of(measured=1.2, left=1.0, J=1e-5)) == ("inconclusive", ["little_explained"])


def test_a_residual_well_above_its_floor_is_not_consistent() -> None:
    # half of a sum of squares of 2 is noise: beyond that all candidates together explain most of the residual
    assert verdict_of(fit_of(left=1.42)) == ("inconclusive", ["above_noise_floor"])
    # unless the steps of the encoder are known to make as much, of which candidates explain a part
    assert verdict_of(fit_of(left=1.42, rough=1.1 / NOMINAL["J"]))[0] == "consistent"
    assert verdict_of(fit_of(left=1.42, rough=0.9 / NOMINAL["J"]))[0] == "inconclusive"
    assert verdict_of(fit_of(left=1.41)) == ("consistent", [])


@pytest.mark.parametrize(("steps", "floor"), [(0.0, 1.0), (0.9, 1.0), (3.0, 3.0), (5.0, 4.0)])
def test_the_noise_floor_holds_the_steps_of_the_encoder_and_is_no_more_than_what_is_left(
    steps: float, floor: float
) -> None:
    fit = fit_of(left=4.0, rough=steps / NOMINAL["J"])
    fit.record.unit = lambda name: "N m"
    assert noise_floor(fit.record, fit)["torque"] == {
        "rms": pytest.approx(floor), "unit": "N m", "relative": pytest.approx(floor / 20.0),
    }  # fmt: skip


@pytest.mark.parametrize(("height", "expected"), [(10.0, "inconclusive"), (9.0, "consistent")])
def test_a_residual_of_edges_that_are_weighted_lightly_is_not_consistent(height: float, expected: str) -> None:
    fit = fit_of(samples=4e3)
    edges = np.arange(4000) % 10 == 0
    fit.record.weight[0, edges] = 0.1
    fit.residual[0, edges] *= height
    verdict, codes = verdict_of(fit)
    assert (verdict, codes) == (expected, ["edges_above_noise_floor"] if expected == "inconclusive" else [])


@pytest.mark.parametrize(("share", "codes"), [(0.11, ["turns_too_often"]), (0.09, [])])
def test_an_axis_that_turns_too_often_for_its_direction_to_be_known_leaves_the_question_open(
    share: float, codes: list[str]
) -> None:
    fit = fit_of()
    fit.record.turning = share
    assert verdict_of(fit) == ("inconclusive" if codes else "consistent", codes)


def test_a_drive_signal_that_may_be_filtered_or_late_leaves_the_question_open() -> None:
    fit = fit_of()
    fit.record.timing = DriveTiming(late=2e-4, lag=8e-4, sure=False)
    assert verdict_of(fit) == ("inconclusive", ["drive_signal_late"])
    fit.record.timing = DriveTiming(late=2e-4, lag=8e-4)
    assert verdict_of(fit)[0] == "consistent"


@pytest.mark.parametrize("seed", seeds(3))
def test_a_slow_load_of_the_process_is_structure_and_not_noise(seed: int) -> None:
    log = made(seed)
    t = log.t
    # of no period that the motion has: half of the axis's torque, which a coloured noise of any order would explain
    load = 0.5 * np.std(log["i_q"]) * np.sqrt(2.0) * np.sin(1.76 * t + seed)
    found = diagnose(believed(), Log({**log.channels, "i_q": log["i_q"] + load}), plan=False)
    assert not found.steps
    assert (str(found.verdict), found.to_dict()["reason_codes"]) == ("unexplained", ["slow_torque"])


def test_a_record_that_is_too_short_decides_nothing() -> None:
    assert verdict_of(fit_of(samples=100)) == ("inconclusive", ["record_too_short"])


@pytest.mark.parametrize("flagged", [True, False])
def test_a_parameter_outside_its_tolerance_is_not_consistent(flagged: bool) -> None:
    off = Deviation("R", 19.0, 24.0, 0.1, "Ohm", True, flagged)
    assert verdict_of(fit_of(), deviations=(off,)) == ("inconclusive", ["parameter_outside_tolerance"])
    scale = Deviation("K_t", 1.0, 1.03, 0.001, "N m/A", True, flagged)
    assert verdict_of(fit_of(), deviations=(scale,)) == ("consistent", [])
    none = Deviation("F_c", 0.02, 0.0, 0.001, "N m", False, False)
    assert verdict_of(fit_of(), deviations=(none,)) == ("inconclusive", ["no_friction"])
    unknown = Deviation("F_c", 0.02, 0.0, 0.05, "N m", False, False)  # one direction beside a weight
    assert verdict_of(fit_of(), deviations=(unknown,)) == ("inconclusive", ["friction_unknown"])


@pytest.mark.parametrize(
    ("gain", "reason", "expected"),
    [
        (300.0, Reason.PARAMETER_AT_BOUND, ("inconclusive", ["refused_but_large"])),
        (50.0, Reason.PARAMETER_AT_BOUND, ("consistent", [])), (300.0, Reason.NOT_SIGNIFICANT, ("consistent", [])),
    ],
)  # fmt: skip
def test_a_large_effect_that_was_refused_leaves_the_question_open(gain: float, reason: Reason, expected: Any) -> None:
    fit = fit_of()
    candidate = SimpleNamespace(effect=SimpleNamespace(label=lambda shape: "cogging"))
    group = SimpleNamespace(shape={}, entering=[(0, None)])  # its share is that of the residual of its balances
    fit.trials = [SimpleNamespace(gain=gain, p_value=1e-9, candidate=candidate, group=group)]
    assert verdict_of(fit, refused={"cogging": Refusal(reason, {"p": 0.5, "what": "k at its bound 0"})}) == expected


@pytest.mark.parametrize(
    ("explained", "noise", "most"),
    [
        (0.51, 0.0, True), (0.49, 0.0, False),
        (0.41, 0.2, True), (0.39, 0.2, False),  # half of what is not noise
        (0.26, 0.5, True), (0.24, 0.5, False), (0.2, 0.8, False),  # noise that may as well be a load
    ],
)  # fmt: skip
def test_a_model_explains_most_of_what_is_no_noise_and_half_as_much_as_is(
    explained: float, noise: float, most: bool
) -> None:
    size = noise**-0.5 if noise else 1e6
    assert explains_most(fit_of(measured=size, left=size * (1.0 - explained) ** 0.5)) is most


@pytest.mark.parametrize(
    ("explained", "frequency", "most"), [(0.11, 30.0, True), (0.09, 30.0, False), (0.11, 10.0, False)]
)
def test_beside_noise_a_model_explains_half_of_what_is_none(explained: float, frequency: float, most: bool) -> None:
    """Eight tenths of the torque are noise; what is slower than half of the band may be a load."""
    fit = fit_of(measured=0.8**-0.5, left=((1.0 - explained) / 0.8) ** 0.5)
    t = np.arange(len(fit.record.mask)) / fit.record.rate
    fit.residual = float(np.abs(fit.residual[0, 0])) * 2.0**0.5 * np.sin(2.0 * np.pi * frequency * t)[None]
    assert explains_most_beside_noise(fit) is most
    assert not explains_most(fit)


# of 3 the load makes more than half of what is above the noise floor at the wave's frequencies: it is minor beside that
@pytest.mark.parametrize(("seed", "minor"), [(1, False), slow(4, False), slow(3, True)])
def test_no_effect_is_named_where_most_of_the_torque_is_unexplained(seed: int, minor: bool) -> None:
    # a load that no motion tells is twice as large as all the rest; a wave of the shaft beside it is significant
    log, rng = made(seed, samples=24_000), np.random.default_rng(seed)
    load, usual = np.zeros_like(log.t), float(np.std(log["i_q"]))
    for _ in range(40):
        load += rng.normal() * np.sin(2.0 * np.pi * rng.uniform(0.5, 8.0) * log.t + rng.uniform(0.0, 6.0))
    wave = (0.5 if minor else 0.8) * usual * np.sin(4.0 * log["theta"])
    pushed = log.with_channels(i_q=log["i_q"] + 2.0 * usual / np.std(load) * load + wave)
    found = diagnose(believed(), pushed, plan=False)
    assert (found.verdict, found.steps) == ("inconclusive", ())
    assert found.reasons[0].code == "little_explained"
    named = diagnose(believed(), pushed, plan=False, policy=replace(POLICY, explained_torque=0.0))
    assert [step.effect for step in named.steps] == ([] if minor else ["cogging"])
    first = named.ranking[0]
    assert (first.effect, first.why_not.startswith("significant but minor")) == ("cogging", minor)


@pytest.mark.parametrize(("sign", "verdict"), [(1.0, "inconclusive"), (-1.0, "implausible")])
def test_a_torque_of_the_wrong_sign_shows_in_friction_where_the_acceleration_is_noise(
    sign: float, verdict: str
) -> None:
    rng, t = np.random.default_rng(1), np.arange(2000) / 200.0
    slow, fast = 2.0 * np.pi * 0.23, 2.0 * np.pi * 0.61
    theta = np.sin(slow * t) + 0.4 * np.sin(fast * t) + rng.normal(0.0, 3e-4, t.size)
    omega = slow * np.cos(slow * t) + 0.4 * fast * np.cos(fast * t)
    torque = sign * (0.5 * np.sign(omega) + 0.1 * omega) + rng.normal(0.0, 0.05, t.size)
    design = Design.from_dict({"motor": {"J": 3e-3, "K_t": 1.0}})
    found = diagnose(design, Log({"t": t, "theta": theta, "torque": torque}), candidates=["constant_load"], plan=False)
    assert found.verdict == verdict
    if sign < 0.0:
        assert [notice.code for notice in found.reasons] == ["negative_parameter"]

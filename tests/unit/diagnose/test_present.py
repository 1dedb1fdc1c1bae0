"""The words of a diagnosis, on results that are written down by hand."""

from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pmsm_ctrl.diagnose import notices
from pmsm_ctrl.diagnose.figures import error_figure
from pmsm_ctrl.diagnose.policy import POLICY
from pmsm_ctrl.diagnose.present import _candidates, _errors, _found, verdict_text
from pmsm_ctrl.diagnose.refusal import Reason, Refusal
from pmsm_ctrl.diagnose.result import Calibration, Diagnosis, DiagnosisStep, Ranked, Verdict
from pmsm_ctrl.diagnose.unexplained import _repeated, resemblance
from pmsm_ctrl.regression.drive_timing import LATENESS, DriveTiming
from pmsm_ctrl.regression.record_result import RecordResult
from pmsm_ctrl.result import Estimate
from pmsm_ctrl.section import Notice


def errors(torque: float) -> dict[str, dict[str, Any]]:
    return {"torque": {"rms": torque, "unit": "N m", "relative": torque}}


STRIBECK = DiagnosisStep(
    "stribeck", "stribeck", "Stribeck friction", ("viscous_power",),
    {"dF_s": Estimate(0.00801, "N m", 0.00011), "delta": Estimate(1.834, "1")},
    errors(0.05), errors(0.02), errors(0.06), errors(0.03),
    {"p_holm": 0.0, "blocks": 16, "block_gain": 5234.0, "block_stderr": 262.0},
)  # fmt: skip
AT_END = {"what": "dU at its bound 0"}
RANKING = (
    Ranked("stribeck", 0.4, 0.0),
    Ranked("constant_load", 0.001, 0.3, Refusal(Reason.NOT_SIGNIFICANT, {"p": 0.9}),
           {"T_0": Estimate(0.000594, "N m")}),
    Ranked("unbalance", 0.001, 0.3, Refusal(Reason.NOT_SIGNIFICANT, {"p": 0.9}),
           {"a_s": Estimate(0.00021, "N m"), "a_c": Estimate(0.0002, "N m")}),
    Ranked("dead_time", 0.001, 1.0, Refusal(Reason.PARAMETER_AT_BOUND, AT_END), {"dU": Estimate(float("inf"), "V")}),
)  # fmt: skip


@pytest.fixture
def found() -> Diagnosis:
    table = {"nominal": errors(0.07), "base": errors(0.05), "final": errors(0.02), "noise_floor": errors(0.019)}
    return Diagnosis(
        Verdict.EFFECTS_MISSING, SimpleNamespace(name="axis", motion="rotary"), table, (STRIBECK,), RANKING, (), None,  # type: ignore[arg-type]
        (Notice("speed_lag", "the logged speed lags the torque by 0.17 ms (corrected)"),), None, None,
        *fitted(late=2.5e-4, lag=3e-3),
    )  # fmt: skip


def fitted(late: float, lag: float) -> tuple[Any, Any]:
    """Record and selection of a log whose torque was so late, and filtered before that was undone."""
    model = SimpleNamespace(names=("J", LATENESS))
    fit = SimpleNamespace(
        model=model, plain=SimpleNamespace(values=np.array([1.0, late]), stderr=np.array([0.1, 1e-5]))
    )
    return SimpleNamespace(timing=DriveTiming(0.0, lag), cutoff=52.06), SimpleNamespace(fit=fit)


def test_the_verdict_names_the_effects(found: Diagnosis) -> None:
    assert verdict_text(found) == "1 missing effect: Stribeck friction"
    two = replace(found, steps=(STRIBECK, replace(STRIBECK, title="Delay between channels")))
    assert verdict_text(two) == "2 missing effects: Stribeck friction, Delay between channels"
    cogging = replace(STRIBECK, title="Cogging torque")
    several = replace(found, steps=(cogging, STRIBECK, cogging, cogging))
    assert verdict_text(several) == "4 missing effects: Cogging torque (3 orders), Stribeck friction"
    detent, slide = replace(STRIBECK, title="Detent force"), SimpleNamespace(name="slide", motion="linear")
    two = replace(found, steps=(detent, detent), design=slide)  # type: ignore[arg-type]
    assert verdict_text(two) == "2 missing effects: Detent force (2 periods)"


@pytest.mark.parametrize("verdict", [v for v in Verdict if v is not Verdict.EFFECTS_MISSING])
def test_every_other_verdict_has_words(found: Diagnosis, verdict: Verdict) -> None:
    assert verdict_text(replace(found, verdict=verdict, steps=()))


def test_the_error_falls_model_by_model(found: Diagnosis) -> None:
    table = _errors(found)
    assert table.header == ("model", "torque error", "held-out torque error")
    assert table.caption.endswith("low-passed at 52.06 Hz, which the fitted log allows")
    assert table.rows == (
        ("design as given", "7.00 %", ""), ("parameters refitted", "5.00 %", "6.00 %"),
        ("+ stribeck", "2.00 %", "3.00 %"), ("noise floor", "1.90 %", ""),
    )  # fmt: skip
    assert _errors(replace(found, steps=())).header == ("model", "torque error")


def test_held_out_errors_with_the_level_of_the_friction_refitted_are_called_that(found: Diagnosis) -> None:
    """`compare` and the table of records print another number, without that fit, of the same record."""
    rows = tuple(RecordResult(name, False, 15.0, 1e3, {}, {}) for name in ("monday", "tuesday"))
    assert _errors(replace(found, records=rows)).header[2] == "held-out torque error, level refitted"
    assert _errors(replace(found, records=rows[:1])).header[2] == "held-out torque error"


def test_a_free_run_that_drifts_is_called_that_instead_of_a_growing_figure(found: Diagnosis) -> None:
    """The right effect may make it drift the sooner: with friction that falls with speed the axis alone is unstable."""
    runs = {"nominal": (400.0, -9.0), "base": (0.1, 0.9), "final": (75.0, -2.0)}
    told = {name: {"rms": rms, "unit": "rad", "fit": share} for name, (rms, share) in runs.items()}
    steps = (replace(STRIBECK, free_run=told["final"]),)
    table = _errors(replace(found, steps=steps, free_run=told))
    assert table.header[-2:] == ("free run, position", "fit")
    assert [row[-2:] for row in table.rows] == [
        ("drifts away", ""), ("0.1 rad", "90.00 %"), ("drifts away", ""), ("", "")
    ]  # fmt: skip
    every = dict.fromkeys(told, told["final"])
    assert _errors(replace(found, steps=steps, free_run=every)).header[-1] == "free run, position"


def test_no_error_is_written_over_the_name_of_its_model(found: Diagnosis) -> None:
    """An error of 2 % below one of 88 % was written over the words under the axis."""
    figure = error_figure(
        replace(found, record=SimpleNamespace(drive="torque"), errors=found.errors | {"nominal": errors(0.88)})
    )
    figure.draw_without_rendering()
    (axes,) = figure.axes
    names = [label.get_window_extent() for label in axes.get_xticklabels()]
    for value in axes.texts:
        assert not any(value.get_window_extent().overlaps(name) for name in names), value.get_text()


def test_numbers_have_the_digits_they_deserve(found: Diagnosis) -> None:
    assert _found(found).rows == (
        ("stribeck", "dF_s = 0.00801 ± 0.00011 N m, delta = 1.834", "< 1e-12", "5230 ± 260", "viscous_power"),
    )


def test_the_table_of_candidates_says_what_the_log_would_have_shown(found: Diagnosis) -> None:
    assert [row[-1] for row in _candidates(found).rows] == [
        "not significant (p = 0.9, Holm); detectable here above 0.59 mN m",
        "not significant (p = 0.9, Holm); detectable here above a_s 0.21 mN m, a_c 0.2 mN m",
        "rejected: dU at its bound 0; not detectable on this log",
    ]


def test_json_has_sentences_and_codes(found: Diagnosis) -> None:
    data = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert data["verdict"] == "effects_missing"
    assert data["warning_codes"] == ["speed_lag"]
    assert data["warnings"] == ["the logged speed lags the torque by 0.17 ms (corrected)"]
    accepted, refused = data["ranking"][:2]
    assert (accepted["accepted"], accepted["why_not"], accepted["why_not_code"]) == (True, "", "")
    assert (refused["accepted"], refused["why_not_code"]) == (False, "not_significant")
    assert refused["shown_from"]["T_0"]["unit"] == "N m"
    assert (data["unexplained"], data["unexplained_code"]) == ("", "")
    assert data["timing"] == {"late": 2.5e-4, "lag": 3e-3, "sure": True, "stderr": 1e-5}


@pytest.mark.parametrize(("alarms", "warned"), [(0, False), (1, False), (2, True)])
def test_false_alarms_in_words(alarms: int, warned: bool) -> None:
    rate = Calibration(20, ("delay",) * alarms)
    assert bool(notices.of_calibration(rate)) is warned
    text = notices.calibration_text(rate)
    assert text.startswith(f"{alarms} false alarm{'' if alarms == 1 else 's'} in 20 simulations")
    assert ("(delay)" in text) is (alarms > 0)


# ---- structure that a refused effect resembles ------------------------------------------------------------------


def resembling(
    gain: float, reason: Reason, p_value: float = 1e-20, plain_gain: float | None = None, left_out: float = 1.0,
    size: float = 10.0, flexible: bool = False,
) -> Any:  # fmt: skip
    """A spring that would explain `gain` of 100, in the second of two balances; four samples a balance.

    With `plain_gain` it is judged by the estimate's weights, of whose sum of 1000 it takes that much. Blocks that were
    left out gain `left_out` +- 2. The balances have this size; the residual of the second one has an amplitude of 1.
    """
    t = np.linspace(0.0, 1.0, 200)
    trial = SimpleNamespace(
        gain=gain, p_value=p_value, by_weights=plain_gain is not None, plain_gain=plain_gain or 0.0,
        plain_direction=np.array([0.1, 0.1, 3.0, 3.0]),
        candidate=SimpleNamespace(
            effect=SimpleNamespace(
                id="compliance", label=lambda shape: "compliance",
                structure=SimpleNamespace(never_minor=lambda shape: flexible),
            )
        ),
        group=SimpleNamespace(shape={}),
    )  # fmt: skip
    record = SimpleNamespace(
        channels=("torque", "u_d"), drive="torque", t=t, mask=np.ones(200, dtype=bool), weight=np.ones((2, 200)),
        signals={"omega": np.ones(200), "alpha": np.sin(20.0 * t)}, at_grid=lambda x: x, cutoff=40.0,
        prepared=SimpleNamespace(t=t, motion="rotary", cutoff=40.0), target=np.full((2, 200), size),
    )  # fmt: skip
    fit = SimpleNamespace(
        trials=(trial,), solved=SimpleNamespace(chi2=100.0), plain=SimpleNamespace(rows=4, chi2=1000.0), record=record,
        weights=SimpleNamespace(channel=np.array([0, 0, 1, 1])), residual=np.stack([0.0 * t, np.sin(20.0 * t)]),
    )  # fmt: skip
    refused = {"compliance": Refusal(reason, {"gain": left_out, "stderr": 2.0, "asked": 2.8})}
    return resemblance(SimpleNamespace(fit=fit, refused=refused), POLICY)  # type: ignore[arg-type]


def test_what_only_cross_validation_refused_is_unexplained_when_it_is_large() -> None:
    found = resembling(100.0 * POLICY.excess + 0.1, Reason.NOT_CONFIRMED)
    assert (found.channel, found.coordinate, found.resembles) == ("u_d", "acceleration", "compliance")
    assert found.share == pytest.approx(POLICY.excess + 1e-3)
    assert "compliance would explain 20 % of it, but is not confirmed by cross-validation" in found.notice.text
    x, forward, _ = found.curve
    assert forward[np.isfinite(forward)] == pytest.approx(x[np.isfinite(forward)], abs=0.06)


def test_what_blocks_left_out_contradict_is_an_open_question() -> None:
    assert not resembling(30.0, Reason.NOT_CONFIRMED, left_out=1.0).confirmed
    assert resembling(30.0, Reason.NOT_CONFIRMED, left_out=2.0 * POLICY.first_block_errors + 0.1).confirmed


@pytest.mark.parametrize(("same", "repeated"), [(1.0, True), (0.0, False)])
def test_a_course_that_every_reversal_repeats_is_told_from_noise_that_is_larger_there(
    same: float, repeated: bool
) -> None:
    rate, t = 100.0, np.arange(0.0, 40.0, 0.01)
    omega = np.sin(2.0 * np.pi * 0.5 * t + 0.1)
    since = np.mod(t + 0.1 / np.pi, 1.0)
    rng = np.random.default_rng(5)
    noise = rng.standard_normal(len(t)) * (1.0 + 4.0 * (since < 0.1))
    residual = noise + same * 4.0 * np.sign(omega) * np.exp(-since / 0.05)
    record = SimpleNamespace(
        signals={"omega": omega}, prepared=SimpleNamespace(t=t, cutoff=40.0), t=t, rate=rate,
        weight=np.ones((1, len(t))), mask=np.ones(len(t), dtype=bool),
    )  # fmt: skip
    fit = SimpleNamespace(record=record, residual=residual[None])
    assert (_repeated(fit, 0) > POLICY.block_errors) == repeated  # type: ignore[arg-type]


def test_the_share_of_an_effect_judged_by_plain_weights_is_of_their_sum() -> None:
    found = resembling(90.0, Reason.NOT_CONFIRMED, plain_gain=300.0)
    assert found.share == pytest.approx(300.0 / 1000.0)
    assert resembling(90.0, Reason.NOT_CONFIRMED, plain_gain=20.0) is None  # 2 % of the residual, whatever the test


def test_other_refusals_and_small_shares_are_no_structure() -> None:
    assert resembling(100.0 * POLICY.excess - 0.1, Reason.NOT_CONFIRMED) is None
    assert resembling(50.0, Reason.BALANCE_WORSE) is None
    assert resembling(50.0, Reason.MINOR) is None, "it does not sit around reversals"
    assert resembling(50.0, Reason.NOT_CONFIRMED, size=1e4) is None, "a ten thousandth of the balance"
    assert resembling(50.0, Reason.NOT_CONFIRMED, flexible=True) is None, "it fits a part of any residual"
    assert resembling(50.0, Reason.NOT_CONFIRMED, p_value=0.02) is None

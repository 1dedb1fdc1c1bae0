"""Compensation: what it gains over inertia feedforward alone, what it costs when wrong, where it stops being safe."""

from __future__ import annotations

import importlib
import re
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from pmsm_ctrl.compensate import (
    baseline,
    compensate,
    compensated,
    gain_verdict,
    gain_window,
    judge,
    measure,
    run_trial,
    study_trials,
)  # fmt: skip
from pmsm_ctrl.compensate.acceptance import accept
from pmsm_ctrl.compensate.metrics import Metrics, limit_cycle
from pmsm_ctrl.compensate.motions import CIRCLE, WARM_UP, Trial, _sine_then_rest
from pmsm_ctrl.compensate.plants import bristle_trials, judged, sweep_trials, with_bristle
from pmsm_ctrl.compensate.result import CompensationStudy, own_change
from pmsm_ctrl.compensate.study import SOURCES, with_bandwidth
from pmsm_ctrl.compensate.window import sweep_gains
from pmsm_ctrl.design import Acceptance, Design
from pmsm_ctrl.effects import lookup
from pmsm_ctrl.errors import DesignError, LogError, NextCommand
from pmsm_ctrl.log import Log
from pmsm_ctrl.report import headline_of
from pmsm_ctrl.section import Table
from pmsm_ctrl.simulate import Scenario, scenario, simulate
from pmsm_ctrl.simulate.feedforward import Feedforward, compensation_lines
from pmsm_ctrl.tune import tune
from pmsm_ctrl.tune.observer import design_observer
from tests.benchmarks.exported import drawn
from tests.benchmarks.windows import EFFECTS, check, prepared, side_by_side
from tests.effort import slow
from tests.unit.compensate.random_drives import random_drive


@pytest.fixture(scope="module")
def design(request: pytest.FixtureRequest) -> Design:
    """Return the axis with soft loops, whose friction stands out of the noise."""
    return Design.read(request.config.rootpath / "designs" / "hand_tuned.toml")


@pytest.fixture(scope="module")
def rich(design: Design) -> Design:
    """Return the design with Stribeck friction and cogging."""
    return design.with_effect("stribeck", {"dF_s": 0.01, "w_s": 2.0, "delta": 2.0}).with_effect(
        "cogging", {"a_s": 0.004, "a_c": 0.0, "order": 24.0}
    )


@pytest.fixture(scope="module")
def study(rich: Design) -> CompensationStudy:
    """Return the study of a design whose own compensation is not safe and fails its acceptance."""
    every = ("coulomb", "viscous", "stribeck", "cogging")
    chosen = rich.compensation.model_copy(update={"gain": 1.0, "source": "measured", "effects": every})
    limit = Acceptance(scenario="reversal 2 rad/s", metric="rms", limit=1e-6)
    return compensate(rich.model_copy(update={"compensation": chosen, "acceptance": (limit,)}), gains=(0.0, 0.5, 1.0))


@pytest.fixture(scope="module")
def brief(design: Design) -> CompensationStudy:
    """Return a study of Coulomb and viscous friction on fewer and shorter trials.

    Triangle and warm-up are reversals here. A reversal has one cycle of three, positioning one move and rest of two,
    the push one of two, the circle one turn of two.
    """
    every = study_trials(design)
    few = {name: every[name] for name in {*sweep_trials(design), *bristle_trials(design), CIRCLE}}
    few |= {f"reversal {speed:g} rad/s": Trial((_sine_then_rest(design, speed, cycles=1.0),)) for speed in (0.5, 2.0)}
    for name, duration in (("positioning", 0.5), ("push", 6.2 / 10.2), (CIRCLE, 0.5)):
        motions = (replace(motion, duration=duration * motion.duration) for motion in every[name].motions)
        few[name] = replace(every[name], motions=tuple(motions))
    few |= dict.fromkeys(("triangle", WARM_UP), few["reversal 2 rad/s"])
    module = importlib.import_module("pmsm_ctrl.compensate.study")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "study_trials", lambda design: few)
        return compensate(design, gains=(0.0, 0.5, 1.0))


@pytest.mark.slow
def test_targets_with_the_right_parameters(study: CompensationStudy) -> None:
    assert study.change("all effects", "rms") < -0.80
    assert study.change("all effects", "reversal_peak") < -0.85


@pytest.mark.slow
def test_target_with_all_parameters_wrong_by_a_fifth(study: CompensationStudy) -> None:
    for factor in (0.8, 1.2):
        assert study.change("all effects", "rms", factor) < -0.60


@pytest.mark.slow
def test_diagnosed_effects_are_worth_compensating(study: CompensationStudy) -> None:
    for motion in ("reversal", "creep", "triangle"):
        partial, full = (study.change(name, "rms", motion=motion) for name in ("Coulomb + viscous", "all effects"))
        assert full < partial - 0.15


@pytest.mark.slow
def test_tracking_repairs_wrong_parameters(study: CompensationStudy) -> None:
    for factor in (0.8, 1.2):
        assert study.change("adaptive", "rms", factor) < study.change("all effects", "rms", factor) - 0.05


@pytest.mark.slow
def test_adaptive_wins_while_the_axis_warms_up(study: CompensationStudy) -> None:
    for factor in (0.8, 1.0, 1.2):
        assert study.change("adaptive", "rms", factor, "warm-up") < -0.80
    fixed = min(study.change("all effects", "rms", factor, "warm-up") for factor in (1.0, 1.2))
    assert study.change("adaptive", "rms", 1.0, "warm-up") < fixed - 0.2


@pytest.mark.slow
def test_an_observer_without_a_bandwidth_takes_the_one_that_the_margins_allow(design: Design) -> None:
    """The study refused it at its end, and named the study as the place where to find the bandwidth."""
    asked = design.replace(compensation={"source": "observer", "gain": 0.5})
    limit = Acceptance(scenario="reversal 2 rad/s", metric="peak", limit=1.0)
    with pytest.raises(DesignError, match=r"compensation\.bandwidth: missing"):
        accept(asked, limit)
    found = design_observer(baseline(asked))
    stated = with_bandwidth(asked, found)
    assert stated.compensation.bandwidth == found.bandwidth
    assert accept(stated, limit).value > 0.0
    assert with_bandwidth(design, found) is design


def test_study_compares_with_a_disturbance_observer(brief: CompensationStudy) -> None:
    """The observer leaves more of the error, spends phase margin, and knows no parameter that could be wrong."""
    assert brief.observer is not None
    assert brief.observer.after.phase_margin < brief.observer.before.phase_margin - 5.0
    left, model = (brief.change(name, "reversal_peak") for name in ("disturbance observer", "all effects"))
    assert left > model + 0.05
    assert brief.change("disturbance observer", factor=1.2) < brief.change("all effects", factor=1.2) - 0.05
    assert "Friction feedforward is worth its model where the friction is known well" in brief.summary(width=1000)
    told = brief.to_dict()["observer"]
    assert told["bandwidth"] == brief.observer.bandwidth
    assert "observer" in brief.windows


@pytest.mark.slow
def test_with_stribeck_friction_and_cogging_the_model_is_worth_its_while(study: CompensationStudy) -> None:
    assert study.change("disturbance observer", "rms") > study.change("all effects", "rms") + 0.05
    assert "Friction feedforward is worth its model" in study.summary(width=1000)


@pytest.mark.slow
def test_quadrant_glitch_of_the_circle(study: CompensationStudy) -> None:
    assert study.change("all effects", "reversal_peak", motion="circle") < -0.85
    assert study.change("all effects", "rms", motion="circle") < -0.80


@pytest.mark.slow
def test_every_variant_is_also_run_with_wrong_parameters(study: CompensationStudy) -> None:
    runs = {(row.variant, row.factor) for row in study.table}
    alone = {"none", "axis without friction"}
    variants = {variant for variant, _ in runs} - alone
    assert runs == {(v, f) for v in variants for f in (0.8, 1.0, 1.2)} | {(v, 1.0) for v in alone}
    assert len({row.motion for row in study.table}) == 10


@pytest.mark.parametrize(("T_n", "K_v", "counts"), [(0.006, 20.0, 131072), (0.005, 60.0, 4096), (0.02, 20.0, 131072)])
@pytest.mark.slow
def test_hunting_is_gone_with_the_commanded_speed(design: Design, T_n: float, K_v: float, counts: int) -> None:
    """A soft, integrating speed loop on strong stiction hunts; the motion's own speed, zero at rest, cannot help."""
    hunting = design.with_effect("stribeck", {"dF_s": 0.04, "w_s": 1.0, "delta": 2.0}).replace(
        sensor={"encoder_counts": counts},
        loops={"speed": {"K_p": 0.01, "T_n": T_n}, "position": {"K_v": K_v, "acceleration_feedforward": 1.0}},
    )
    move = scenario("s_curve", design, distance=0.5, speed=5.0, acceleration=50.0, jerk=1000.0, dwell=3.0, cycles=1.0)

    def pushed(t: np.ndarray) -> dict[str, np.ndarray]:
        # Without compensation the axis hunts after a move, or comes to rest, as the noise will have it; a push decides.
        return {**move.references(t), "T_load": np.where((t > 3.5) & (t < 3.505), 0.12, 0.0)}

    motion = Scenario("pushed", move.duration, pushed, "position")
    base, found = baseline(hunting), {}
    # Coulomb and viscous friction alone, in the same kernel
    simple = base.with_effect("stribeck", {"dF_s": 1e-12, "w_s": 1.0, "delta": 2.0})
    for name, believed in (
        ("none", base),
        ("commanded", compensated(base, ["coulomb", "viscous", "stribeck"], source="commanded", gain=0.9)),
        ("simple", compensated(simple, ["coulomb", "viscous", "stribeck"], source="commanded")),
    ):
        runs = [measure(simulate(believed, motion, truth=hunting, seed=s, keep_truth=True)) for s in range(1, 4)]
        found[name] = max(runs, key=lambda metrics: metrics.cycle_amplitude)
    assert found["none"].cycle_amplitude > 0.01
    assert found["none"].cycle_frequency > 1.0
    assert found["commanded"].cycle_amplitude == found["simple"].cycle_amplitude == 0.0
    assert found["commanded"].rms < 0.4 * found["none"].rms


def test_with_stiff_loops_compensation_reaches_the_noise_of_the_axis(design: Design) -> None:
    """`tune`, then `compensate`: the friction's error goes, and what is left is that of the axis without friction."""
    tuned = tune(design, prove=False).design
    base, trial = baseline(tuned), study_trials(tuned)["reversal 2 rad/s"]
    assert base.loops == tuned.loops  # nothing has to be repaired
    plain, on, floor = (
        judge(trial, run_trial(believed, trial, truth=plant))
        for believed, plant in (
            (base, tuned), (compensated(base, ["coulomb", "viscous"]), tuned), (base, tuned.replace_effects(()))
        )
    )  # fmt: skip
    assert plain.rms < 0.2e-3  # the hand-set loops have 2.2 mrad
    assert on.reversal_peak < 0.1 * plain.reversal_peak
    assert on.rms < 1.1 * floor.rms
    assert plain.rms**2 - floor.rms**2 > 10.0 * abs(on.rms**2 - floor.rms**2)


@pytest.mark.parametrize("name", ["low_speed", *map(slow, ("adaptive", "small_servo", "servo_2kw", "geared_resonant"))])
def test_shipped_designs_are_compensated_with_their_tuned_gains(project_root: Path, name: str) -> None:
    """Nine tenths of what friction adds go, and nine tenths of the peak, or all but what noise leaves of it."""
    shipped = Design.read(project_root / "designs" / f"{name}.toml")
    loops, tuned = shipped.require_loops(), tune(shipped, prove=False).design.require_loops()
    assert loops.speed.K_p == pytest.approx(tuned.speed.K_p, rel=2e-3)
    assert loops.position.K_v == pytest.approx(tuned.position.K_v, rel=2e-3)
    base, trial = baseline(shipped), study_trials(shipped)["reversal 2 rad/s"]
    assert base.loops == loops  # nothing has to be repaired
    every = [entry.id for entry in shipped.effects if entry.id != "compliance"]
    smooth = shipped.replace_effects(tuple(entry for entry in shipped.effects if entry.id not in every))
    plain, on, floor = (
        judge(trial, run_trial(believed, trial, truth=plant))
        for believed, plant in ((base, shipped), (compensated(base, every), shipped), (base, smooth))
    )
    assert own_change(on.rms, plain.rms, floor.rms) <= -0.9
    assert on.reversal_peak < max(0.1 * plain.reversal_peak, 1.1 * floor.reversal_peak)
    assert own_change(floor.rms, plain.rms, floor.rms) == -1.0
    assert np.isnan(own_change(floor.rms, floor.rms, floor.rms))


def test_dither_below_a_count_is_no_cycle(design: Design) -> None:
    trial = study_trials(design)["positioning"]
    t = np.arange(0.0, 3.0, 1e-3)
    count = design.encoder_step
    still = {name: np.zeros_like(t) for name in ("theta_ref", "omega_ref", "omega_true", "i_q_ref", "theta")}
    for amplitude, cycles in ((0.9 * count, False), (1.1 * count, True)):
        log = Log({"t": t, **still, "theta_true": amplitude * np.sin(40.0 * t)})
        assert (judge(trial, (log,), count).cycle_amplitude > 0.0) is cycles
        assert judge(trial, (log,)).cycle_amplitude == pytest.approx(amplitude, rel=1e-2)


@pytest.mark.slow
def test_perfect_model_is_the_limit(study: CompensationStudy) -> None:
    best = study.change("perfect model")
    assert all(best <= study.change(name) + 1e-9 for name in ("Coulomb + viscous", "all effects"))


@pytest.mark.slow
def test_measured_speed_has_the_narrower_window(study: CompensationStudy) -> None:
    reference, measured = study.windows["reference"], study.windows["measured"]
    assert reference.safe >= 1.0
    assert measured.safe < 0.5
    assert measured.cycle[-1] > 0.0
    assert not reference.cycle.any()


@pytest.mark.slow
def test_result_renders(study: CompensationStudy) -> None:
    text = " ".join(study.summary(width=1000).split())
    assert "Highest safe gain: 100 % with reference-speed" in text
    assert all(axis.get_ylabel() for axis in study.plot().axes)
    for table in (block for block in study.section().blocks if isinstance(block, Table)):
        assert all(len(row) == len(table.header) for row in table.rows)
    told = study.to_dict()
    assert told["schema"] == "pmsm-ctrl/compensation/1"
    assert told["warnings"] == list(study.warnings)


def test_the_recommended_compensation_can_be_exported_and_is_what_the_first_screen_shows(
    brief: CompensationStudy,
) -> None:
    best = brief.recommended
    assert best is not None
    assert gain_verdict(best, best.compensation.share).safe is True
    told = brief.to_dict()["recommended"]
    assert (told["source"], told["gain"]) == (best.compensation.source, best.compensation.gain)
    text = brief.summary(width=1000, brief=True)
    assumed = "for parameters within 20 % (assumed, without standard errors)"
    assumed += "; safe also with an assumed bristle of 0.5 mrad"
    said = f"Recommended: {told['source']} speed, gain {100 * told['gain']:.0f} %, {assumed}. Highest safe gain: "
    assert said in " ".join(text.split())
    assert f"Why {told['source']} speed: at safe gains no other source leaves less of the RMS error, " in text
    assert f'[compensation]\nsource = "{told["source"]}"\ngain = {told["gain"]}' in brief.summary(width=1000)
    (why,) = (block for block in brief.section().blocks if isinstance(block, str) and block.startswith("Why "))
    (table,) = (b for b in brief.section().blocks if isinstance(b, Table) and b.caption.startswith("RMS error left at"))
    assert set(re.findall(r"\d+ %", why)) <= {cell for row in table.rows for cell in row}, "a number is in no table"
    assert len(table.rows) == len(brief.windows)
    headline = headline_of(brief)
    assert headline is not None
    (gain, meant), (rms, of_rms), (peak, _) = headline.numbers
    assert gain == f"{100 * told['gain']:.0f} %"
    assert meant.startswith(f"recommended gain with {told['source']}-speed feedforward; safe up to ")
    assert "at the recommended gain" in of_rms
    assert rms == f"{100 * brief.change('as recommended'):+.0f} %"
    assert peak == f"{100 * brief.change('as recommended', 'reversal_peak'):+.0f} %"
    assert brief.examples[0].label == f"compensated, {told['source']} speed, gain {gain}"


@pytest.mark.slow
def test_study_says_what_became_of_the_acceptance(study: CompensationStudy) -> None:
    assert not study.accepted
    # By measured speed full gain cycles; by commanded speed the bristle moves by less than a count, which is no cycle.
    codes = [notice.code for notice in study.notices]
    assert codes == ["acceptance_failed", "design_gain_unsafe", "full_gain_unsafe"]
    said = "with measured-speed feedforward the highest safe gain is below 10 % (smallest gain of the sweep)"
    assert said in study.warnings[2]
    assert study.windows["commanded"].safe == 1.0
    assert "acceptance FAILED: reversal 2 rad/s: rms = " in study.warnings[0]
    assert "the design's gain of 100 % with measured-speed feedforward is not safe" in study.warnings[1]
    assert study.to_dict()["acceptance"][0]["passed"] is False


def test_friction_gets_no_credit_for_inertia_and_delay(design: Design) -> None:
    """Without friction the baseline's error is a hundredth of that with friction."""
    base = baseline(design)
    trial = study_trials(design)["reversal 10 rad/s"]
    errors = {}
    for name, plant in (("with", design), ("without", design.replace_effects(()))):
        errors[name] = judge(trial, run_trial(base, trial, truth=plant)).rms
    assert errors["without"] < 0.1 * errors["with"]


def test_kernel_does_what_the_terms_say(rich: Design) -> None:
    """The current reference differs by exactly the believed friction over K_t, where nothing else differs."""
    still = rich.replace(drive={"i_max": 10.0}).replace_effects(rich.effects)
    motion = Scenario("one", 0.02, lambda t: {"omega_ref": np.full(t.shape, 3.0)}, omega_0=3.0)
    loops = still.loops
    assert loops is not None
    quiet = still.replace(sensor={"current_noise": 0.0})
    believed = compensated(quiet, ["coulomb", "viscous", "stribeck", "cogging"], gain=0.7)  # at theta = 0 no cogging
    first = [simulate(d, motion, truth=quiet)["i_q_ref"][0] for d in (believed, quiet)]
    friction = 0.0213 + 0.000168 * 3.0 + 0.01 * np.exp(-((3.0 / 2.0) ** 2))
    assert first[0] - first[1] == pytest.approx(0.7 * friction / 1.032, rel=1e-12)


@pytest.mark.parametrize("source", ["reference", "commanded", "measured"])
def test_compiled_kernel_is_its_plain_twin(rich: Design, source: str) -> None:
    smooth = rich.model_copy(update={"compensation": rich.compensation.model_copy(update={"smoothing": 0.3})})
    believed = compensated(baseline(smooth), ["coulomb", "viscous", "stribeck", "cogging"], source=source)
    motion = Scenario("short", 0.03, scenario("reversal", rich, speed=2.0, frequency=10.0).references, "position")
    compiled, plain = (simulate(believed, motion, truth=rich, compiled=c) for c in (True, False))
    assert np.allclose(compiled["i_q_ref"], plain["i_q_ref"], rtol=1e-9, atol=1e-12)


def test_zero_gain_is_no_compensation_bit_for_bit(design: Design) -> None:
    off = design.model_copy(update={"compensation": design.compensation.model_copy(update={"gain": 0.0})})
    motion = scenario("reversal", design, speed=2.0, cycles=1.0)
    assert np.array_equal(simulate(off, motion)["i_q"], simulate(design, motion)["i_q"])
    assert Feedforward.of(off) is None


def test_what_cannot_be_compensated_is_told(design: Design) -> None:
    warm = design.with_effect("thermal_drift", {"dF_v": 1e-4})
    told = Feedforward.of(compensated(warm, ["coulomb", "thermal_drift"]))
    assert told is not None
    assert told.left_out == ("thermal_drift",)
    with pytest.raises(DesignError, match="not among the design's effects"):
        Feedforward.of(compensated(design, ["coulomb", "cogging"]))
    with pytest.raises(DesignError, match="identify it first"):
        compensate(design.replace_effects(()))
    assert compensation_lines(()) == []
    assert compensation_lines((lookup("coulomb"),))[-1] == "wanted += i_q_add"


def test_no_error_of_a_plain_axis_leads_to_a_command_that_refuses_it(designs: Path) -> None:
    """`compensate` asked for loops, and `tune` refused; with loops by hand it ended in an AssertionError."""
    plain = Design.read(designs / "emps.toml")
    loops = Design.read(designs / "seed_motor.toml").require_loops()
    for design in (plain.model_copy(update={"loops": None}), plain.model_copy(update={"loops": loops})):
        for verb in (compensate, tune):
            with pytest.raises(DesignError, match="this design knows only K_t") as caught:
                verb(design)
            assert caught.value.next_command is NextCommand.ELECTRICAL_DATA
    with pytest.raises(DesignError, match="loops: missing") as caught:
        plain.model_copy(update={"loops": None}).require_loops()
    assert caught.value.next_command is NextCommand.LOOPS


def test_metrics_against_a_made_up_log() -> None:
    t = np.arange(4000) / 1000.0
    moving = t < 2.0
    omega_ref = np.where(moving, np.where(t < 1.0, 1.0, -1.0), 0.0)
    theta_ref = np.where(t < 1.0, t, np.where(moving, 2.0 - t, 0.0))
    # half a milliradian behind, ten after each start, and a cycle of 3 mrad at 5 Hz during the rest
    error = np.where(moving, 0.0005, 0.0)
    error[0:20] = error[1000:1020] = 0.010
    wave = np.where(moving, 0.0, 0.003 * np.sin(2.0 * np.pi * 5.0 * t))
    omega = np.where(moving, omega_ref, 0.003 * 10.0 * np.pi * np.cos(2.0 * np.pi * 5.0 * t))
    omega[200:300] = 0.0
    found = measure(Log({
        "t": t, "theta_ref": theta_ref, "theta_true": theta_ref - error + wave, "omega_ref": omega_ref,
        "omega_true": omega, "i_q_ref": np.full(t.size, 0.02),
    }))  # fmt: skip
    assert found.reversal_peak == pytest.approx(0.010)
    assert found.peak == pytest.approx(0.010)
    assert found.stuck == pytest.approx(0.05)
    assert found.cycle_amplitude == pytest.approx(0.003, rel=0.01)
    assert found.cycle_frequency == pytest.approx(5.0, rel=0.07)
    assert found.effort == pytest.approx(0.02)
    assert found.noise == pytest.approx(0.0, abs=1e-15)
    with pytest.raises(LogError, match="theta_true"):
        measure(Log({"t": t, "theta_ref": theta_ref}))


def at_rest(theta: np.ndarray) -> Metrics:
    """Return the metrics of 1 s of motion and then 5 s of rest, in which the shaft does what `theta` says."""
    t = np.arange(6000) / 1000.0
    moving = t < 1.0
    return measure(Log({
        "t": t, "theta_ref": np.where(moving, t - 1.0, 0.0), "omega_ref": np.where(moving, 1.0, 0.0),
        "theta_true": np.where(moving, t - 1.0, 0.0) + np.concatenate([np.zeros(1000), theta]),
        "omega_true": np.where(moving, 1.0, np.concatenate([np.zeros(1000), np.gradient(theta, 0.001)])),
        "i_q_ref": np.zeros(t.size),
    }))  # fmt: skip


REST = np.arange(5000) / 1000.0


@pytest.mark.parametrize(("amplitude", "frequency"), [(0.003, 0.8), (0.0005, 9.0), (0.001, 170.0)])
def test_a_cycle_is_found_whatever_its_frequency(amplitude: float, frequency: float) -> None:
    found = at_rest(amplitude * np.sign(np.sin(2.0 * np.pi * frequency * REST + 0.1)))  # stick-slip is nearly square
    assert found.cycle_amplitude == pytest.approx(amplitude)
    assert found.cycle_frequency == pytest.approx(frequency, rel=0.02)


def test_a_slip_on_the_way_to_rest_hides_no_cycle() -> None:
    slip = np.where(REST < 3.0, 0.02, 0.0)
    found = at_rest(slip + 0.0004 * np.sin(2.0 * np.pi * 12.0 * REST))
    assert found.cycle_amplitude == pytest.approx(0.0004, rel=0.01)
    assert found.cycle_frequency == pytest.approx(12.0, rel=0.02)


@pytest.mark.parametrize("drift", [0.05 * np.exp(-REST / 2.0), 0.02 * np.sin(2.0 * np.pi * 0.15 * REST)])
def test_a_drift_hides_no_cycle(drift: np.ndarray) -> None:
    """The integral of the speed controller moves a resting axis by many times the amplitude of its cycle."""
    assert at_rest(drift).cycle_amplitude == 0.0
    found = at_rest(drift + 0.0004 * np.sin(2.0 * np.pi * 40.0 * REST))
    assert found.cycle_amplitude == pytest.approx(0.0004, rel=0.05)
    assert found.cycle_frequency == pytest.approx(40.0, rel=0.02)


def test_a_push_ends_a_rest() -> None:
    """A cycle that a push stops was there, and what a push leaves behind is no swing of a cycle."""
    cycling = 0.0004 * np.sin(2.0 * np.pi * 2.0 * REST)
    log = {
        "t": REST, "theta_ref": np.zeros(REST.size), "omega_ref": np.zeros(REST.size), "i_q_ref": np.zeros(REST.size),
        "omega_true": np.zeros(REST.size), "theta_true": np.where(REST < 2.7, cycling, 0.02),
        "T_load": np.where((REST >= 2.7) & (REST < 2.705), 0.1, 0.0),
    }  # fmt: skip
    assert measure(Log(log)).cycle_amplitude == pytest.approx(0.0004, rel=0.01)
    assert measure(Log({name: log[name] for name in log if name != "T_load"})).cycle_amplitude == 0.0


def test_swings_of_a_cycle_need_not_be_equal() -> None:
    """Stick-slip by encoder counts: no swing but the largest goes from the lowest to the highest quarter."""
    places = np.array([-1.7, 1.0, -1.6, 1.5, -0.7, 1.8, -0.6, 1.5])
    found = at_rest(1e-3 * places[np.minimum((REST / 0.625).astype(int), 7)])
    assert found.cycle_amplitude == pytest.approx(1.25e-3, rel=0.2)
    assert found.cycle_frequency == pytest.approx(0.8, rel=0.02)


@pytest.mark.parametrize(
    ("seed", "counts", "elastic"),
    [slow(4011, 2.0, True), slow(4100, 13.8, True), slow(4263, 1.3, False), (6079, 19.9, False)],
)
def test_whether_a_cycle_is_found_hangs_on_no_draw_of_the_noise(seed: int, counts: float, elastic: bool) -> None:
    """Gains by measured speed once declared safe: cycles on a drift, irregular ones, one after another push (6079)."""
    drive, source, gain, _ = drawn(seed)
    base, push = baseline(drive), study_trials(drive)["push"]
    plant = with_bristle(base) if elastic else base
    on = compensated(base, EFFECTS, gain=gain, factor=1.2, source=source)
    for draw in range(4):
        found = judge(push, run_trial(on, push, truth=plant, seed=draw), drive.encoder_step)
        assert found.cycle_amplitude == pytest.approx(counts * drive.encoder_step, rel=0.15)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [4011, slow(4100), slow(4263), slow(6079)])
def test_a_gain_that_cycles_on_a_drift_or_after_one_of_the_pushes_is_not_safe(seed: int) -> None:
    drive, source, gain, _ = drawn(seed)
    verdict = gain_verdict(drive.replace(compensation={"source": source, "gain": gain, "effects": EFFECTS}), gain)
    assert verdict.safe is False
    assert "limit cycle" in verdict.why


def test_what_comes_to_rest_is_no_cycle() -> None:
    twitches = np.where((REST > 4.42) & (REST < 4.43), 2e-5, 0.0) + np.where((REST > 4.45) & (REST < 4.47), 1e-5, 0.0)
    for theta in (
        np.where(REST < 4.5, 0.0016, -0.0016) + twitches,  # a last slip, and twitches of a thousandth of it
        0.01 * np.exp(-REST / 0.3) * np.cos(2.0 * np.pi * 5.0 * REST) * (REST < 2.0),  # swings that die away
        np.zeros(5000),
        -0.003 * np.exp(-REST),
    ):
        assert at_rest(theta).cycle_amplitude == 0.0


def test_window_ends_before_the_first_gain_that_cycles() -> None:
    def run(gain: float, factor: float, motion: str) -> Metrics:
        cycle = 0.01 if gain * factor > 0.85 else 0.0
        return Metrics(1.0 - 0.5 * gain * factor, 1.0, 1.0, 0.0, cycle, 2.0 * (cycle > 0.0), 0.1, 0.0)

    window = gain_window(run, ["any"], "measured", gains=(0.0, 0.2, 0.4, 0.6, 0.8, 1.0))
    assert window.safe == 0.6  # 0.6 * 1.2 = 0.72 is below; 0.8 is as well, and 0.8 * 1.2 is not
    assert window.best == 0.6
    assert window.cycle[-1] == 0.01


def test_gains_of_a_sweep_end_at_150_percent() -> None:
    assert sweep_gains(0.1) == tuple(round(0.1 * k, 1) for k in range(16))
    assert sweep_gains(0.4) == (0.0, 0.4, 0.8, 1.2)
    assert sweep_gains(1.5) == (0.0, 1.5)


@pytest.mark.slow
def test_drives_side_by_side_are_judged_as_one_by_one(design: Design) -> None:
    """The benchmark's lanes give the metrics that `compensate` gets from single runs; quiet, so that both see alike."""
    quiet = random_drive(design, np.random.default_rng(2)).replace(sensor={"current_noise": 0.0})
    base, trials = baseline(quiet), study_trials(quiet)
    keys = [(2, source, 0.9, 1.2, name) for source in SOURCES for name in ("reversal 2 rad/s", "push")]
    found = side_by_side({key: prepared(base, trials[key[4]], *key[1:4]) for key in keys}, 0, trials["push"])
    for key in keys:
        believed = compensated(base, EFFECTS, gain=0.9, factor=1.2, source=key[1])
        single = judge(trials[key[4]], run_trial(believed, trials[key[4]], truth=quiet), quiet.encoder_step)
        assert asdict(found[key]) == pytest.approx(asdict(single), rel=1e-6, abs=1e-9)


@pytest.mark.slow
def test_nothing_cycles_inside_the_safe_window() -> None:
    assert check([0], ["commanded"], step=0.5) == []


@pytest.mark.slow
def test_nothing_cycles_inside_the_safe_window_of_300_drives() -> None:
    """What ``python -m tests.benchmarks.windows`` prints."""
    assert check(range(100, 400)) == []


def test_noise_on_an_elastic_contact_is_no_limit_cycle() -> None:
    """Its largest swing grows with the time one looks; a sine of a little more than a count is a limit cycle."""
    period, rng = 1e-3, np.random.default_rng(4)
    t = period * np.arange(6000)
    commanded = t < 0.1
    shaken = gaussian_filter1d(rng.normal(size=t.size), 8.0)
    shaken *= 0.4 / shaken.std()
    assert 0.5 * np.ptp(shaken) > 1.1
    assert limit_cycle(shaken, commanded, period)[0] > 1.1
    assert limit_cycle(shaken, commanded, period, dither=1.0) == (0.0, 0.0)
    assert limit_cycle(1.05 * np.sin(2.0 * np.pi * 7.0 * t) + shaken, commanded, period, dither=1.0)[0] > 1.05


def test_errors_below_a_count_do_not_end_a_window() -> None:
    """Friction damps noise: without it the error of an axis grows by tenths of a count, which no drive can see."""

    def run(gain: float, factor: float, name: str) -> Metrics:
        rms = 1e-5 * (1.0 + 0.2 * gain)
        return Metrics(rms, rms, rms, 0.0, 0.0, 0.0, 0.0, 0.0)

    gains = (0.0, 0.5, 1.0)
    assert gain_window(run, ["any"], "reference", gains=gains).safe == 0.0
    assert gain_window(run, ["any"], "reference", gains=gains, resolution=4.8e-5).safe == 1.0


@pytest.mark.slow
def test_a_window_holds_with_presliding_too(design: Design) -> None:
    """By commanded speed at 120 % a bristle cycles by some counts, where the rigid contact stands still.

    At full gain the bristle cycles by 0.7 counts without noise, which the encoder does not see, and noise adds to it.
    """
    base, trials, motions = baseline(design), study_trials(design), judged(design)
    assert set(motions) > {"positioning", "positioning, with presliding"}

    def run(gain: float, factor: float, name: str) -> Metrics:
        friction = ["coulomb", "viscous"]
        on = base if gain == 0.0 else compensated(base, friction, gain=gain, factor=factor, source="commanded")
        motion = motions[name]
        return judge(trials[motion.trial], run_trial(on, trials[motion.trial], truth=motion.plant), design.encoder_step)

    found = {}
    for kind, names in (("rigid", ["reversal 2 rad/s", "positioning"]), ("both", ["reversal 2 rad/s", *motions])):
        found[kind] = gain_window(
            run, names, "commanded", gains=(1.0, 1.2), at_rest=[name for name in motions if motions[name].at_rest],
            resolution=design.encoder_step,
        )  # fmt: skip
    assert found["rigid"].safe == 1.2
    assert found["both"].safe == 1.0
    assert found["both"].limited_by.endswith(", with presliding")
    assert 1.0 < found["both"].cycle_counts[-1] < 4.0
    assert found["rigid"].limited_by == ""


def test_a_window_names_the_motion_with_the_worst_error() -> None:
    def run(gain: float, factor: float, name: str) -> Metrics:
        left = 1.0 - (0.9 if name == "fast" else 0.2) * gain
        return Metrics(left, left, left, 0.0, 0.0, 0.0, 0.0, 0.0)

    window = gain_window(run, ["fast", "slow", "rest"], "reference", gains=(0.5, 1.0), at_rest=["rest"])
    assert window.worst == ("", "slow", "slow")
    assert window.rms.tolist() == pytest.approx([1.0, 0.9, 0.8])


def test_a_bristle_is_assumed_once_and_only_with_dry_friction(design: Design) -> None:
    bristled = with_bristle(design)
    assert bristled is not None
    assert bristled.parameters("presliding")["z_s"] == 5e-4
    assert with_bristle(bristled) is None
    assert with_bristle(design.replace_effects(())) is None
    assert set(judged(bristled)) == set(sweep_trials(bristled))

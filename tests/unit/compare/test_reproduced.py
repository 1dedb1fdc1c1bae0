"""What diagnose or add wrote has the same errors when compare reads it on the same log; nothing worse is written."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from pmsm_ctrl.cli import app
from pmsm_ctrl.compare import compare
from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose import add, diagnose, final_fit
from pmsm_ctrl.diagnose.adding import added
from pmsm_ctrl.diagnose.fit import fit_design
from pmsm_ctrl.diagnose.fitted_design import fitted_design
from pmsm_ctrl.diagnose.shapes import with_shapes_fitted
from pmsm_ctrl.effects.catalogue import CATALOGUE
from pmsm_ctrl.identify import identify
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression import worse_than_given as rule
from pmsm_ctrl.regression.balances import STANDSTILL, make_record
from pmsm_ctrl.regression.base_fit import Accepted, base_fit, true_torque
from pmsm_ctrl.regression.conditioning import Processing
from pmsm_ctrl.regression.drive_timing import DriveTiming
from pmsm_ctrl.regression.evaluated import record_as_evaluated, with_evaluation
from pmsm_ctrl.regression.made import Made, for_design
from pmsm_ctrl.regression.prediction import errors, predict
from pmsm_ctrl.regression.timed_record import timed_record
from pmsm_ctrl.simulate import scenario, simulate
from tests.effort import seeds, slow

STRIBECK = {"dF_s": 0.008, "w_s": 8.0, "delta": 2.0}
PRESLIDING = {"z_s": 0.02}


@pytest.fixture(scope="module")
def seed_motor(designs: Path) -> Design:
    return Design.read(designs / "seed_motor.toml")


@pytest.fixture
def without_profiles(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave out the intervals of nonlinear parameters: of a bristle they take four times as long as all the rest."""
    monkeypatch.setattr(final_fit, "with_profiles", lambda design, fit: fit)


@pytest.mark.usefixtures("without_profiles")
@pytest.mark.parametrize(
    ("effect", "values"), [slow("stribeck", STRIBECK), ("presliding", PRESLIDING)], ids=["stribeck", "presliding"]
)
def test_errors_a_written_design_are_those_of_the_diagnosis(
    seed_motor: Design, effect: str, values: dict[str, float]
) -> None:
    motion = scenario("triangle", seed_motor, cycles=2.0)
    log = simulate(seed_motor, motion, truth=seed_motor.with_effect(effect, values), seed=54210)
    found = diagnose(seed_motor, log, candidates=(effect,), plan=False)
    assert effect in [step.effect for step in found.steps]
    written = compare(found.design, log).log.errors["torque"]
    assert written.relative == pytest.approx(found.errors["final"]["torque"]["relative"], rel=1e-3)
    nominal = compare(seed_motor, log).log.errors["torque"]
    assert nominal.relative > 1.3 * written.relative


@pytest.mark.parametrize(("start", "stop", "along"), [(10.8, 11.3, False), (10.8, 1e9, True)], ids=["push", "step"])
@pytest.mark.slow
def test_what_the_diagnosis_left_out_is_left_out(
    seed_motor: Design, start: float, stop: float, along: bool, tmp_path: Path
) -> None:
    log = simulate(seed_motor, "triangle", seed=1)
    inside = (log.t >= start) & (log.t < stop)
    sign = np.sign(log["omega"]) if along else np.sin(np.pi * np.clip((log.t - start) / (stop - start), 0.0, 1.0))
    current = 0.015 * inside * sign / seed_motor.K_t_assumed
    log = log.with_channels(i_q=log["i_q"] + current, u_q=log["u_q"] + 19.0 * current)
    found = diagnose(seed_motor, log, plan=False)
    assert found.events
    judged = found.errors["final"]["torque"]["relative"]
    written = Design.read(found.design.write(tmp_path / "new.toml"))
    # the file's field is J_kg_cm2: its conversion rounds the last bit
    assert pytest.approx(found.design.motor.J, rel=4e-16) == written.motor.J
    assert written.replace(motor={"J": found.design.motor.J}) == found.design
    seen = compare(written, log).log
    assert seen.errors["torque"].relative == pytest.approx(judged, rel=1e-3)
    assert {"left_out_when_fitted", "other_friction_when_fitted"} & {notice.code for notice in seen.notices}
    apart = compare(written, log.with_channels(temperature=np.zeros(len(log)))).log  # another log: all of it is judged
    assert apart.errors["torque"].relative > 1.2 * judged


@pytest.mark.parametrize("cutoff", [20.0, 80.0])
def test_the_log_is_read_in_the_band_of_the_fit(seed_motor: Design, cutoff: float) -> None:
    log = simulate(seed_motor, "triangle", seed=54214)
    timing = DriveTiming(2e-4, 1e-3, reversals=8e-4)
    record = make_record(seed_motor, log, Processing(standstill=STANDSTILL, cutoff=cutoff), 0.0, timing, 0.01)
    record = replace(record, commanded=True)
    written = with_evaluation(seed_motor, record, log)
    again = record_as_evaluated(written, log)
    np.testing.assert_array_equal(again.target, record.target)
    np.testing.assert_array_equal(again.weight, record.weight)
    np.testing.assert_array_equal(again.signals["direction"], record.signals["direction"])
    assert (again.timing, again.commanded) == (timing, True)
    usual = record_as_evaluated(written, log.slice(0, len(log) - 1))
    assert usual.cutoff == timed_record(seed_motor, log).cutoff != cutoff


@pytest.mark.slow
def test_what_add_writes_explains_as_much_as_its_own_fit(seed_motor: Design) -> None:
    log = simulate(seed_motor, "triangle", truth=seed_motor.with_effect("presliding", PRESLIDING), seed=54211)
    written = add(seed_motor, log, "presliding")
    # as it was fitted, but for the inertia with which the error of the encoder's lines becomes a torque
    record = replace(timed_record(seed_motor, log), design=written, memo={}, kept={})
    seen = errors(record, predict(written, record).residual)["torque"][1]
    assert compare(written, log).log.errors["torque"].relative == pytest.approx(seen, rel=1e-6)
    assert seen < 0.9 * compare(seed_motor, log).log.errors["torque"].relative


def test_nothing_of_the_design_is_fitted(seed_motor: Design) -> None:
    log = simulate(seed_motor, "triangle", seed=54212)
    record = timed_record(seed_motor, log)
    off = seed_motor.with_effect("coulomb", {"F_c": 0.03})
    left = predict(off, record).residual[0] - predict(seed_motor, record).residual[0]
    direction = record.shaped(record.signals["direction"])
    level = float(direction @ left / (direction @ direction))
    assert level == pytest.approx(0.0213 - 0.03, rel=0.05)


def test_the_sampling_is_a_nuisance_and_no_parameter(seed_motor: Design) -> None:
    log = simulate(seed_motor, "triangle", seed=54213)
    found = predict(seed_motor, timed_record(seed_motor, log))
    assert "tau_drive" in found.nuisances
    assert not {"J", "R", "psi_f", "F_c", "F_v"} & set(found.nuisances)


def scattered(seed: int) -> tuple[Design, Log]:
    """A drive that knows itself exactly, and a log in which half of the torque is a friction that it has not."""
    rng = np.random.default_rng(seed)
    t = np.arange(12000) / 1000.0
    speed = 12.0 * np.sin(2.1 * t) + 6.0 * np.sin(5.3 * t)
    torque = 0.4 * np.sign(speed) + 0.02 * speed + 0.01 * np.gradient(speed, t) + 0.05 * rng.normal(size=len(t))
    design = Design.from_dict({"name": "made", "motor": {"J": 0.01, "K_t": 1.0}})
    design = design.with_effect("coulomb", {"F_c": 0.4}).with_effect("viscous", {"F_v": 0.02})
    return design, Log({"t": t, "omega": speed, "torque": torque})


@pytest.mark.parametrize("seed", seeds(1, 2))
def test_an_exact_design_is_not_made_worse(seed: int) -> None:
    design, log = scattered(seed)
    result = identify(design, log)
    assert result.improved
    before, after = (compare(one, log).log.errors["torque"].relative for one in (design, result.design))
    assert after < 1.02 * before


def test_a_design_that_would_be_worse_is_not_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    design, log = scattered(3)
    monkeypatch.setattr(rule, "WORSE", 0.5)  # as if the identified one were twice as bad
    result = identify(design, log)
    assert not result.improved
    assert result.design is design
    assert "worse_than_given" in [notice.code for notice in result.notices]
    assert result.to_dict()["improved"] is False
    design.write(tmp_path / "design.toml")
    log.write_csv(tmp_path / "log.csv")
    for verb in ("identify", "diagnose"):
        called = [verb, str(tmp_path / "log.csv"), "--design", str(tmp_path / "design.toml")]
        run = CliRunner().invoke(app, [*called, "--output", str(tmp_path / "new.toml")])
        assert run.exit_code == 1
        assert not (tmp_path / "new.toml").exists()


def test_a_diagnosis_that_would_be_worse_keeps_the_design(monkeypatch: pytest.MonkeyPatch) -> None:
    design, log = scattered(4)
    assert diagnose(design, log, plan=False).improved
    monkeypatch.setattr(rule, "WORSE", 0.5)
    found = diagnose(design, log, plan=False)
    assert not found.improved
    assert found.design is design
    assert "worse_than_given" in [notice.code for notice in found.notices]
    assert found.to_dict()["improved"] is False


def test_worse_is_what_leaves_more_of_the_torque() -> None:
    design, log = scattered(5)
    record = timed_record(design, log)
    off = design.with_effect("coulomb", {"F_c": 0.8})
    assert rule.worse_than_given(design, design, record) is None
    assert rule.worse_than_given(off, design, record) is None
    worse = rule.worse_than_given(design, off, record)
    assert worse is not None
    assert worse.code == "worse_than_given"
    error = 0.4 / np.sqrt(np.mean(log["torque"] ** 2))  # 0.4 N m too much dry friction, nearly always of one sign
    assert worse.detail["percent"] == pytest.approx(100.0 * error, rel=0.1)


# ---- a drive signal that is late --------------------------------------------------------------------------------


def late_log(late: float, stribeck: float = 0.0, rate: float = 500.0) -> tuple[Design, Log]:
    """A design that knows all but a Stribeck friction, and a log whose torque is late, s."""
    t = np.arange(round(16.0 * rate)) / rate
    then = t - late
    speed = 12.0 * np.sin(2.1 * then) + 6.0 * np.sin(5.3 * then)
    alpha = 25.2 * np.cos(2.1 * then) + 31.8 * np.cos(5.3 * then)
    torque = np.sign(speed) * (0.4 + stribeck * np.exp(-np.abs(speed) / 2.0)) + 0.02 * speed + 0.01 * alpha
    theta = 12.0 / 2.1 * (1.0 - np.cos(2.1 * t)) + 6.0 / 5.3 * (1.0 - np.cos(5.3 * t))
    design = Design.from_dict({"name": "late", "motor": {"J": 0.01, "K_t": 1.0}})
    design = design.with_effect("coulomb", {"F_c": 0.4}).with_effect("viscous", {"F_v": 0.02})
    return design, Log(
        {"t": t, "theta": theta, "torque": torque + 0.004 * np.random.default_rng(7).normal(size=len(t))}
    )


def test_a_drive_signal_later_than_sampling_can_make_it_is_predicted_as_late_as_that() -> None:
    """It was predicted as not late at all: three times the error of the fit, which holds the bound."""
    design, log = late_log(2.6e-3)  # a period of this log is 2 ms
    record = make_record(design, log, Processing(standstill=STANDSTILL))
    fit = base_fit(design, record)
    found = predict(design, record)
    assert found.nuisances["tau_drive"][0] == pytest.approx(record.sampling, rel=1e-3)
    left = errors(fit.record, fit.record.target - fit.inside.predicted())["torque"][1]
    assert errors(found.record, found.residual)["torque"][1] == pytest.approx(left, rel=0.02)


def test_designs_with_another_delay_share_no_record() -> None:
    """The moments of reversal follow from the torque as it was: those of a late torque are late."""
    design, log = late_log(8e-3)
    made = Made.kept(log)
    late = made.record(design)
    known = made.record(design.with_effect("delay", {"tau": 8e-3}))
    assert made.record(design).signals["direction"] is late.signals["direction"]
    assert not np.array_equal(known.signals["direction"], late.signals["direction"])


def test_shapes_are_fitted_to_the_torque_that_they_make() -> None:
    """The columns of a late drive signal were made of the torque that the shapes before made."""
    design, log = late_log(1.6e-3, stribeck=0.3)
    record = timed_record(design, log)
    curve = CATALOGUE["stribeck"]
    start = Accepted(curve, {"w_s": 6.0, "delta": 1.0}, ({"w_s": 1.0, "delta": 1.0}, {"w_s": 20.0, "delta": 1.0}))
    fit = with_shapes_fitted(design, fit_design(design, record, (start,), {}, explore=False))
    assert fit.accepted[0].shape["w_s"] == pytest.approx(2.0, rel=0.1)
    own = true_torque(fit.model, fit.estimate)
    read = fit.record.at_grid(fit.record.signals["torque"])
    assert np.linalg.norm((read - own)[fit.record.mask]) < 1e-3 * np.linalg.norm(own[fit.record.mask])


def test_a_design_with_a_delay_and_a_curve_has_the_error_of_their_fit() -> None:
    """The delay was met where the free fit of the first passes had it, not where the design has it."""
    design, log = late_log(5e-3, stribeck=0.3)
    record = make_record(design.with_effect("delay", {"tau": 5e-3}), log, Processing(standstill=STANDSTILL))
    record = for_design(record, design)
    shapes = ({"w_s": 1.0, "delta": 1.0}, {"w_s": 20.0, "delta": 1.0})
    both = Accepted(CATALOGUE["delay"], {}, ({},)), Accepted(CATALOGUE["stribeck"], {"w_s": 3.0, "delta": 1.0}, shapes)
    fit = with_shapes_fitted(design, fit_design(design, record, both, {}, explore=False))
    written = fitted_design(design, fit)
    assert written.parameters("delay")["tau"] == pytest.approx(5e-3, rel=0.03)
    seen = predict(written, record)
    judged = errors(fit.record, fit.residual)["torque"][1]
    assert errors(seen.record, seen.residual)["torque"][1] == pytest.approx(judged, rel=0.03)


@pytest.mark.slow
def test_a_delay_is_written_as_it_was_judged() -> None:
    design, log = late_log(5e-3)
    found = diagnose(design, log, candidates=("delay",), plan=False)
    assert [step.effect for step in found.steps] == ["delay"]
    fit = found.selection.fit
    judged = errors(fit.record, fit.residual)["torque"][1]
    seen = compare(found.design, log).log.errors["torque"].relative
    assert found.errors["final"]["torque"]["relative"] == pytest.approx(seen, rel=1e-3)
    assert judged == pytest.approx(seen, rel=0.01)


def test_a_delay_that_is_added_is_written_as_it_was_judged() -> None:
    design, log = late_log(5e-3)
    found = added(design, log, "delay")
    assert found.design.parameters("delay")["tau"] == pytest.approx(5e-3, rel=0.03)
    seen = compare(found.design, log).log.errors["torque"].relative
    assert found.errors["final"]["torque"]["relative"] == pytest.approx(seen, rel=1e-3)

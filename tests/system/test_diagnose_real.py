"""The diagnosis on measured axes, held against what their authors published."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl.compare import compare
from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose import Diagnosis, diagnose
from pmsm_ctrl.importers import read_log
from pmsm_ctrl.log import Log
from pmsm_ctrl.simulate import scenario, simulate
from tests.effort import seeds

pytestmark = pytest.mark.data


@pytest.fixture(scope="module")
def emps(measured, project_root: Path) -> Diagnosis:
    design = Design.read(project_root / "designs" / "emps.toml")
    log = read_log(measured("emps/DATA_EMPS.mat"), design=design)
    pulses = read_log(measured("emps/DATA_EMPS_PULSES.mat"), design=design)
    return diagnose(design, log, holdout=pulses, plan=False)


def test_emps_finds_the_asymmetry_its_authors_found_years_later(emps: Diagnosis) -> None:
    # A. Janot, M. Gautier, M. Brunot (2019): 203.5 N s/m with one F_v, 166.7 and 240.4 with one per direction
    assert emps.verdict == "effects_missing"
    assert emps.steps[0].effect == "viscous_asymmetry"
    assert -emps.steps[0].parameters["dF_v"].value == pytest.approx(0.5 * (240.4 - 166.7), rel=0.1)


def test_emps_with_its_authors_parameters_has_their_error(measured, project_root: Path) -> None:
    design = Design.read(project_root / "designs" / "emps.toml").replace(log={"sampling": "instant"})
    log = read_log(measured("emps/DATA_EMPS.mat"), design=design)
    assert compare(design, log).log.errors["torque"].relative == pytest.approx(0.0408, abs=0.002)


def test_emps_error_falls_on_both_records(emps: Diagnosis) -> None:
    # the authors: 4.08 % and 5.98 % with four parameters; the time at which the force was sampled is part of the model
    assert 0.02 < emps.errors["nominal"]["torque"]["relative"] < 0.0408
    assert 0.03 < emps.steps[0].holdout_before["torque"]["relative"] < 0.0598
    assert abs(emps.timing.late) < 1e-3  # one period of the log
    assert emps.timing.lag == 0.0
    for step in emps.steps:
        assert step.error_after["torque"]["rms"] < step.error_before["torque"]["rms"]
        assert step.holdout_after["torque"]["rms"] < step.holdout_before["torque"]["rms"]
    assert emps.errors["final"]["torque"]["relative"] <= 0.021
    assert emps.steps[-1].holdout_after["torque"]["relative"] <= 0.028
    assert emps.errors["final"]["torque"]["relative"] > emps.errors["noise_floor"]["torque"]["relative"]


def test_emps_design_holds_what_was_found(emps: Diagnosis) -> None:
    ids = {entry.id for entry in emps.design.effects}
    assert {step.effect for step in emps.steps} <= ids
    assert Design.from_dict(emps.design.to_dict()) == emps.design


@pytest.fixture(scope="module")
def laas(project_root: Path) -> Design:
    return Design.read(project_root / "designs" / "laas_mn4004.toml")


def test_laas_names_cogging_72_18_12(measured, laas: Design) -> None:
    # anti-cogging is off for the first half of the file: its last column, which is no channel, turns 1 at 15 s
    log = read_log(measured("laas_mn4004/speed_test1.txt"), design=laas)
    offered = ("cogging", "torque_ripple", "unbalance", "position_dependent_friction", "current_offset", "stribeck")
    found = diagnose(laas, log.between(0.0, 15.0), candidates=offered, plan=False)
    orders = [step.parameters["order"].value for step in found.steps if step.effect == "cogging"]
    assert found.steps[0].effect == "cogging"
    assert orders[:3] == [72.0, 18.0, 12.0]


@pytest.mark.slow
def test_laas_acceleration_log_shows_the_strongest_cogging_around_its_reversals(measured, laas: Design) -> None:
    log = read_log(measured("laas_mn4004/acc_current.txt"), design=laas)
    found = diagnose(laas, log)
    (step,) = found.steps
    assert (step.effect, step.parameters["order"].value) == ("cogging", 72.0)
    # the quasi-static map of the same motor: 0.138 A rms over all orders, of which 72 is the strongest
    amplitude = np.hypot(step.parameters["a_s"].value, step.parameters["a_c"].value) / laas.K_t
    assert 0.5 < amplitude / (np.sqrt(2.0) * 0.138) < 1.0
    assert not any("cogging: not excited" in text for text in found.warnings)
    # the authors' fit of the same file: 1.93e-4 dv/dt + 0.084 sgn(v) + 1.15e-4 v, in ampere
    values = {d.parameter: d.estimate / laas.K_t for d in found.parameter_deviations}
    assert values["J"] == pytest.approx(1.93e-4, rel=0.03)
    assert values["F_c"] == pytest.approx(0.084, rel=0.05)


@pytest.mark.parametrize("seed", seeds(1, 2))
@pytest.mark.slow
def test_paper_sweep_with_a_torque_constant_of_one(designs: Path, seed: int) -> None:
    # the paper put in 0.0213 and 0.000168 and got back 0.02066 and 0.0001625, both 3 % low
    design = Design.read(designs / "seed_motor.toml").replace(assumed={"K_t": 1.0})
    log = simulate(design, "sweep", seed=seed)
    found = diagnose(design, log)
    deviations = {d.parameter: d for d in found.parameter_deviations}
    assert found.verdict == "consistent"
    assert [d.parameter for d in found.parameter_deviations if d.flagged] == ["K_t"]
    assert deviations["K_t"].estimate == pytest.approx(1.032, rel=2e-3)
    assert deviations["F_c"].estimate == pytest.approx(0.02066, rel=0.01)
    assert deviations["F_v"].estimate == pytest.approx(0.0001625, rel=0.01)
    assert any("torque constant" in text for text in found.warnings)


@pytest.mark.slow
def test_without_voltages_nothing_is_claimed_of_the_torque_constant(designs: Path) -> None:
    design = Design.read(designs / "seed_motor.toml").replace(assumed={"K_t": 1.0})
    log = simulate(design, scenario("sweep", design, speed_step=25.0), seed=1)
    blind = Log({n: v for n, v in log.channels.items() if n not in ("u_d", "u_q")})
    found = diagnose(design, blind, plan=False)
    assert found.verdict == "consistent"
    assert "K_t" not in {d.parameter for d in found.parameter_deviations}
    assert np.isfinite(found.errors["final"]["torque"]["relative"])

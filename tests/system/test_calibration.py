"""The diagnosis judged at its own answer: the accepted model, simulated and diagnosed again."""

from __future__ import annotations

import pytest
from scipy.stats import binomtest

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose import diagnose
from pmsm_ctrl.diagnose.notices import of_calibration
from pmsm_ctrl.diagnose.result import Calibration
from pmsm_ctrl.errors import DesignError, LogError, RequestError
from pmsm_ctrl.log import Log
from pmsm_ctrl.simulate import scenario, simulate
from tests.effort import amount


@pytest.mark.parametrize(("runs", "alarms"), [(20, 1), (20, 3), (100, 2), (3, 3)])
def test_interval_is_that_of_clopper_and_pearson(runs: int, alarms: int) -> None:
    theirs = binomtest(alarms, runs).proportion_ci(0.95, method="exact").high
    assert Calibration(runs, ("delay",) * alarms).most == pytest.approx(theirs, rel=1e-9)


def test_no_alarm_in_twenty_is_the_rule_of_three() -> None:
    # 1 - 0.05^(1/n), about 3 / n
    assert Calibration(20, ()).most == pytest.approx(1.0 - 0.05 ** (1.0 / 20.0))


@pytest.mark.slow
def test_accepted_model_raises_no_alarm(designs) -> None:
    design = Design.read(designs / "seed_motor.toml")
    truth = design.with_effect("stribeck", {"dF_s": 0.008, "w_s": 8.0, "delta": 2.0})
    log = simulate(design, scenario("identification", design, duration=15.0), truth=truth, seed=21)
    shares: list[float] = []
    runs = amount(2, 3)
    found = diagnose(design, log, calibrate=runs, progress=shares.append, plan=False)
    assert [step.effect for step in found.steps] == ["stribeck"]
    assert found.calibration == Calibration(runs, ())
    assert found.to_dict()["calibration"] == {"runs": runs, "alarms": []}
    assert f"0 false alarms in {runs} simulations of the accepted model" in found.summary(width=1000)
    assert "not_calibrated" not in found.to_dict()["warning_codes"]
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


def test_many_alarms_are_a_reason_to_doubt() -> None:
    assert of_calibration(Calibration(20, ("delay",))) == ()
    (notice,) = of_calibration(Calibration(20, ("delay", "delay")))
    assert notice.code == "not_calibrated"
    assert "2 false alarms in 20 simulations" in notice.text


def test_what_cannot_be_simulated_is_said_in_one_line(designs) -> None:
    design = Design.read(designs / "seed_motor.toml")
    log = simulate(design, "identification", seed=1)
    no_reference = Log({name: v for name, v in log.channels.items() if not name.endswith("_ref")})
    with pytest.raises(LogError, match="no omega_ref and no theta_ref"):
        diagnose(design, no_reference, calibrate=1)
    ideal = design.replace(sensor={"current_noise": 0.0, "encoder_counts": 0})
    with pytest.raises(DesignError, match=r"give sensor\.current_noise"):
        diagnose(ideal, log, calibrate=1)
    with pytest.raises(RequestError, match="calibrate: found -1"):
        diagnose(design, log, calibrate=-1)


@pytest.mark.slow
def test_a_log_of_torque_instead_of_currents_is_calibrated_as_well(designs) -> None:
    design = Design.read(designs / "seed_motor.toml")
    log = simulate(design, scenario("identification", design, duration=15.0), seed=22)
    kept = {name: log[name] for name in ("t", "theta", "omega", "omega_ref")}
    found = diagnose(design, Log({**kept, "torque": design.K_t * log["i_q"]}), calibrate=1)
    assert found.verdict == "consistent"
    assert found.calibration == Calibration(1, ())

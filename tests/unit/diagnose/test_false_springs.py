"""What a filter, an average or a wave of a turn does to the channels is no spring and no gap."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose import diagnose
from pmsm_ctrl.log import Log
from pmsm_ctrl.simulate import scenario, simulate
from tests.effort import seeds, slow
from tests.unit.simulate.composed import simulate_composed

SPRINGS = ("compliance", "backlash")


@pytest.fixture(scope="module")
def seed_motor(designs: Path) -> Design:
    return Design.read(designs / "seed_motor.toml")


def filtered(log: Log, seconds: float) -> Log:
    pole = np.exp(-log.period / seconds)
    return log.with_channels(**{k: lfilter([1.0 - pole], [1.0, -pole], log[k]) for k in ("i_d", "i_q")})


@pytest.mark.parametrize("seed", seeds(1, 2))
@pytest.mark.parametrize(
    ("motion", "lag"), [("identification", 1e-3), slow("identification", 5e-3), ("trapezoid", 5e-3)]
)
def test_a_filter_of_the_current_is_no_spring(seed_motor: Design, motion: str, lag: float, seed: int) -> None:
    short = {"duration": 12.0} if motion == "identification" else {}
    log = filtered(simulate(seed_motor, scenario(motion, seed_motor, **short), seed=seed), lag)
    result = diagnose(seed_motor, log, plan=False, candidates=SPRINGS)
    assert not result.steps
    assert not any(one.accepted for one in result.ranking)


@pytest.mark.parametrize(
    ("hidden", "values", "motion"),
    [
        ("encoder_eccentricity", {"e_s": 2e-3, "e_c": 0.0}, "trapezoid"),
        slow("cogging", {"order": 4.0, "a_s": 0.003, "a_c": 0.0}, "sweep"),
    ],
)
def test_a_wave_of_a_turn_is_no_spring(seed_motor: Design, hidden: str, values: dict[str, float], motion: str) -> None:
    truth = seed_motor.with_effect(hidden, values)
    log = simulate_composed(seed_motor, scenario(motion, seed_motor), truth, seed=1, keep_truth=False)
    assert not diagnose(seed_motor, log, plan=False, candidates=SPRINGS).steps


@pytest.mark.parametrize("seed", seeds(1, 2))
def test_a_spring_is_still_found(seed_motor: Design, seed: int) -> None:
    J = 0.5 * seed_motor.J
    true = seed_motor.with_effect("compliance", {"J_load": J, "k": J * (2.0 * np.pi * 25.0) ** 2, "d": 1e-4})
    log = simulate(seed_motor, scenario("identification", seed_motor, duration=15.0), truth=true, seed=seed)
    result = diagnose(seed_motor, log, plan=False, candidates=(*SPRINGS, "delay"))
    assert [step.effect for step in result.steps][:1] == ["compliance"]
    found = result.steps[0].parameters
    assert found["k"].value / found["J_load"].value == pytest.approx((2.0 * np.pi * 25.0) ** 2, rel=0.05)

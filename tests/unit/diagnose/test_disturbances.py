"""A push, a brake and a step of friction are named with their times, and kept out of the fit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose import Diagnosis, diagnose
from pmsm_ctrl.log import Log
from pmsm_ctrl.simulate import simulate
from tests.effort import seeds

DRY = 0.0213  # N m
# What such an event looks like; a search for springs takes as long as all of these.
ALIKE = (
    "thermal_drift", "constant_load", "viscous_asymmetry", "stribeck", "presliding", "load_dependent_friction",
    "cogging", "position_dependent_friction", "unbalance", "torque_saturation",
)  # fmt: skip


@pytest.fixture(scope="module")
def design(designs: Path) -> Design:
    return Design.read(designs / "seed_motor.toml")


def disturbed(design: Design, log: Log, start: float, stop: float, *, along: bool, size: float = 0.7 * DRY) -> Log:
    """The drive holds the motion against a torque, which its current shows."""
    inside = (log.t >= start) & (log.t < stop)
    sign = np.sign(log["omega"]) if along else np.sin(np.pi * np.clip((log.t - start) / (stop - start), 0.0, 1.0))
    current = size * inside * sign / design.K_t_assumed
    return log.with_channels(i_q=log["i_q"] + current, u_q=log["u_q"] + (design.motor.R or 0.0) * current)


def friction(found: Diagnosis) -> float:
    return next(d.estimate for d in found.parameter_deviations if d.parameter == "F_c")


@pytest.mark.parametrize("seed", seeds(1, 2))
@pytest.mark.parametrize(
    ("code", "stop", "along"),
    [("event_push", 11.3, False), ("event_brake", 14.8, True), ("event_friction_step", 1e9, True)],
)
def test_what_happens_once_is_named_and_left_out(
    design: Design, code: str, stop: float, along: bool, seed: int
) -> None:
    log = simulate(design, "triangle", seed=seed)
    found = diagnose(design, disturbed(design, log, 10.8, stop, along=along), candidates=ALIKE, plan=False)
    assert found.steps == ()
    assert found.verdict == "unexplained"
    (event,) = found.events
    assert event.notice.code == code
    assert event.start == pytest.approx(10.8, abs=0.3)
    if code != "event_friction_step":
        assert event.stop == pytest.approx(stop, abs=0.4)
    assert event.size == pytest.approx(0.7 * DRY, rel=0.4)
    assert friction(found) == pytest.approx(DRY, rel=0.03)  # of the rest of the log, or before the step
    data = found.to_dict()
    assert data["events"][0]["code"] == code
    assert code in data["warning_codes"]
    assert data["reason_codes"][0] == code


@pytest.mark.parametrize("effect", [None, "stribeck", "compliance", "cogging", "thermal_drift"])
@pytest.mark.slow
def test_a_log_without_an_event_names_none(design: Design, effect: str | None) -> None:
    from pmsm_ctrl.effects.catalogue import CATALOGUE

    truth = design if effect is None else design.with_effect(effect, dict(CATALOGUE[effect].example))
    assert diagnose(design, simulate(design, "triangle", truth=truth, seed=3), plan=False).events == ()

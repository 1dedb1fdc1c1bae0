"""A motion that repeats itself passes every position in the same state: what is left is a function of the position."""

from __future__ import annotations

import numpy as np
import pytest

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose import diagnose
from pmsm_ctrl.diagnose.criteria import CrossValidation, along_the_way
from pmsm_ctrl.diagnose.refusal import Reason
from pmsm_ctrl.log import Log
from tests.effort import seeds

J, F_C, F_V = 9e-5, 0.02, 2e-4
SWING, TURNS = 2.0 * np.pi * 0.5, 6.0  # rad/s, rad
WAVES = ("cogging", "position_dependent_friction", "unbalance", "torque_ripple")


@pytest.fixture(scope="module")
def design() -> Design:
    effects = [{"id": "coulomb", "F_c": F_C}, {"id": "viscous", "F_v": F_V}]
    return Design.from_dict({"name": "axis", "motor": {"J": J, "K_t": 1.0}, "effects": effects})


def swing(seed: int, left: str) -> Log:
    """Return a sine that repeats itself ten times, exactly known, and what the design does not explain of it."""
    t = np.arange(20000) / 1000.0
    theta, omega = TURNS * np.sin(SWING * t), TURNS * SWING * np.cos(SWING * t)
    alpha = -(SWING**2) * theta
    beside = {
        "at an acceleration": np.exp(-(((alpha - 30.0) / 8.0) ** 2)),
        "over time": np.sin(3.0 * SWING * t + 1.0),
        "cogging": np.sin(5.0 * theta + 0.3),
        "position_dependent_friction": np.sign(omega) * np.sin(theta),
    }[left]
    torque = J * alpha + F_C * np.sign(omega) + F_V * omega + 1e-3 * beside
    return Log({"t": t, "theta": theta, "torque": torque + 1e-3 * np.random.default_rng(seed).standard_normal(t.size)})


@pytest.mark.parametrize("seed", seeds(1, 2))
@pytest.mark.parametrize("left", ["at an acceleration", "over time"])
def test_what_repeats_with_the_motion_is_no_wave_of_the_position(design: Design, left: str, seed: int) -> None:
    """They were named unbalance, and position-dependent friction."""
    found = diagnose(design, swing(seed, left), candidates=WAVES, plan=False)
    assert not found.steps
    assert found.verdict == "unexplained"
    assert any(why.reason is Reason.ONE_PATH for why in found.selection.refused.values())


@pytest.mark.parametrize("seed", seeds(1, 2))
@pytest.mark.parametrize("hidden", ["cogging", "position_dependent_friction"])
def test_a_wave_of_the_position_is_named_in_such_a_motion(design: Design, hidden: str, seed: int) -> None:
    found = diagnose(design, swing(seed, hidden), candidates=WAVES, plan=False)
    assert [step.effect for step in found.steps] == [hidden]


BY_TIME = CrossValidation(30.0, 2.0, 16, 1e-4)  # 15 standard errors


@pytest.mark.parametrize(
    ("found", "refused"),
    [
        (CrossValidation(0.0, 0.0, 0, 1.0), False),  # on a short way nothing can be left out
        (CrossValidation(5.0, 2.0, 16, 0.1), True),
        (CrossValidation(6.0, 2.0, 16, 0.1), False),
    ],
)
def test_parts_of_the_way_have_to_be_sure_where_parts_of_the_time_are(found: CrossValidation, refused: bool) -> None:
    why = along_the_way(found, BY_TIME)
    assert (why is not None) == refused
    assert why is None or why.reason is Reason.ONE_PATH


def test_parts_of_the_way_need_not_be_surer_than_parts_of_the_time() -> None:
    assert along_the_way(CrossValidation(5.0, 2.0, 16, 0.1), CrossValidation(5.0, 2.0, 16, 0.1)) is None

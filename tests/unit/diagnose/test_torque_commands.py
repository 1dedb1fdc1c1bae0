"""A torque command of a few levels hides no effect: its steps are no resolution."""

from __future__ import annotations

import pytest

from pmsm_ctrl.diagnose import diagnose
from tests.effort import seeds, slow
from tests.torque_steps import BARE, torque_steps


@pytest.mark.parametrize("seed", seeds(1, 2))
@pytest.mark.parametrize("levels", [(1.4,), slow((1.2, 1.4, 1.6))], ids=["two levels", "six levels"])
def test_stribeck_under_a_torque_command_is_found(levels: tuple[float, ...], seed: int) -> None:
    log = torque_steps(seed, noise=0.0, levels=levels, stribeck=0.1, stay=0.45, bits=17)
    result = diagnose(BARE, log, plan=False, candidates=("stribeck", "viscous_power", "constant_load"))
    assert [step.effect for step in result.steps] == ["stribeck"]
    assert result.steps[0].parameters["dF_s"].value == pytest.approx(0.1 * 0.0213, rel=0.1)

"""Errors of the acceleration do not shrink the inertia: torque steps, coarse encoders, a noisy current."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pmsm_ctrl.identify import identify
from tests.effort import slow
from tests.torque_steps import BARE, J, torque_steps

SEEDS = range(8)


@pytest.mark.parametrize(
    "case",
    [slow({"bits": 9}), {"bits": 12, "noise": 0.1, "shaken": 0.15}],
    ids=str,
)
@pytest.mark.slow
def test_the_interval_of_the_inertia_covers(case: dict[str, Any]) -> None:
    found = [identify(BARE, torque_steps(seed, **case)) for seed in SEEDS]
    off = np.array([(r.estimates["J"].value - J) / r.estimates["J"].stderr for r in found])
    assert np.sqrt(np.mean(off**2)) < 2.0
    assert abs(np.mean(off)) < 1.5
    assert max(r.estimates["J"].stderr for r in found) < 0.03 * J


def test_a_fine_encoder_keeps_its_band() -> None:
    problem = identify(BARE, torque_steps(1, bits=17)).problem
    assert (problem.inertia_cutoff or problem.cutoff) >= 20.0

"""The narrower bands in which a name is looked for where the usual one has none."""

from __future__ import annotations

from pathlib import Path

import pytest

from pmsm_ctrl import Design, simulate
from pmsm_ctrl.diagnose.diagnosis import condition, in_narrower_bands
from pmsm_ctrl.diagnose.policy import POLICY


@pytest.fixture
def seed_motor(designs: Path) -> Design:
    return Design.read(designs / "seed_motor.toml")


def test_half_of_the_default_band_follows_it_and_nothing_follows_that(seed_motor: Design) -> None:
    log = simulate(seed_motor, "triangle", seed=1)
    case = condition(seed_motor, log, (), {}, POLICY)
    assert case.record.cutoff == 40.0
    (half,) = in_narrower_bands(case)
    assert half.record.cutoff == 20.0
    (said,) = [one for one in half.remarks if one.code == "narrower_band"]
    assert said.detail == {"band": 20.0, "usual": 40.0}
    assert half.believed is case.believed, "log and design are examined once"
    assert not list(in_narrower_bands(half))


@pytest.mark.parametrize("band", [10.0, 20.0])
def test_a_band_that_was_asked_for_is_kept(seed_motor: Design, band: float) -> None:
    log = simulate(seed_motor, "triangle", seed=1)
    assert condition(seed_motor, log, (), {}, POLICY, band=band).record.cutoff == band

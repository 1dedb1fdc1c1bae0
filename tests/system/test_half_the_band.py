"""Worlds of the third simulator in which noise of the motion hides a slow effect in the usual band."""

from __future__ import annotations

import pytest

from pmsm_ctrl.compare import compare
from pmsm_ctrl.diagnose import diagnose
from tests.benchmarks.worlds.hidden import hidden_log
from tests.benchmarks.worlds.world import draw

# world, effect, margin
HIDDEN = [(760134, "torque_saturation", 7.3), (480046, "torque_ripple", 5.0)]


@pytest.mark.parametrize(("seed", "effect", "margin"), HIDDEN)
def test_an_effect_that_noise_hides_in_the_usual_band_is_found_in_half_of_it(
    seed: int, effect: str, margin: float
) -> None:
    world = draw(seed)
    log, *_ = hidden_log(world, effect, margin)
    found = diagnose(world.design, log, plan=False)
    assert [step.effect for step in found.steps] == [effect]
    (said,) = [one for one in found.notices if one.code == "narrower_band"]
    assert said.detail["band"] == found.record.cutoff <= 0.5 * said.detail["usual"]
    written = compare(found.design, log).log.errors["torque"].relative
    assert written == pytest.approx(found.errors["final"]["torque"]["relative"], rel=1e-3)

"""A residual that consists of a single wave has structure, although no curve over a coordinate shows it."""

from __future__ import annotations

import pytest

from pmsm_ctrl import compare
from pmsm_ctrl.result import Verdict
from tests.effort import seeds
from tests.slides import slide
from tests.unit.diagnose.test_single_wave import FREQUENCY, PITCH, axis


@pytest.mark.parametrize(
    ("forces", "period"), [({"ripple": 8.0}, f"{1e3 * PITCH:.3g} mm"), ({"process": 5.0}, f"{FREQUENCY:.3g} Hz")]
)
def test_a_wave_is_no_noise(forces: dict[str, float], period: str) -> None:
    found = compare(*axis(**forces))
    assert found.verdict is Verdict.UNEXPLAINED
    (reason,) = found.reasons
    assert reason.code == "single_wave"
    assert reason.detail["period"] == period
    assert "no significant structure" not in found.summary()


@pytest.mark.parametrize("motion", ["moves", "sines"])
@pytest.mark.parametrize("seed", seeds(1, 2, 3, 4))
def test_a_right_design_leaves_no_wave(motion: str, seed: int) -> None:
    one = slide(motion, seed, {})
    design = one.design.with_parameters(J=one.true["J"])
    for effect, symbol in (("coulomb", "F_c"), ("viscous", "F_v")):
        design = design.without_effect(effect).with_effect(effect, {symbol: one.true[symbol]})
    found = compare(design, one.log)
    assert found.verdict is Verdict.CONSISTENT

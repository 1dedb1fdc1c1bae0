"""A gap whose load has the friction of the axis: named with its size, its load and its friction."""

from __future__ import annotations

from pathlib import Path

import pytest

from pmsm_ctrl import Design, diagnose, simulate
from pmsm_ctrl.simulate.scenarios import scenario
from tests.effort import slow

GAP, SHARE = 0.04, 0.5  # rad; of the inertia


# Another candidate makes the noise a little smaller or larger: with 24 of 25 the second has its name, by 5.8 standard
# errors where 5.6 are asked, and with all of them it has none, by 5.56.
HIDDEN = pytest.mark.xfail(reason="the noise by which candidates are judged holds the gap: not confirmed")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("share", "seed"),
    [
        (0.9, 1), slow(0.6, 2), slow(0.9, 4),
        *(pytest.param(*one, marks=[pytest.mark.slow, HIDDEN]) for one in ((0.6, 1), (0.9, 2), (0.9, 3))),
    ],
)  # fmt: skip
def test_a_gap_before_a_load_that_rubs_is_named_with_its_parts(designs: Path, share: float, seed: int) -> None:
    design = Design.read(designs / "seed_motor.toml")
    dry = next(entry.parameters["F_c"] for entry in design.effects if entry.id == "coulomb")
    wrong = {"gap": GAP, "J_load": SHARE * design.J, "k": 60.0, "d": 0.03, "F_load": share * dry}
    motion = scenario("identification", design, seed=seed, duration=12.0)
    log = simulate(design, motion, truth=design.with_effect("backlash", wrong), seed=seed)
    found = diagnose(design, log, plan=False)
    assert [step.effect for step in found.steps] == ["backlash"]
    parts = {symbol: one.value for symbol, one in found.steps[0].parameters.items()}
    assert parts["gap"] == pytest.approx(GAP, rel=0.05)
    assert parts["J_load"] == pytest.approx(wrong["J_load"], rel=0.15)
    assert parts["F_load"] == pytest.approx(wrong["F_load"], rel=0.1)

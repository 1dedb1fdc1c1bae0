"""No clean log of the third simulator raises a notice; `pytest --slow` looks at a hundred."""

from __future__ import annotations

from pmsm_ctrl.errors import LogError
from pmsm_ctrl.plausibility import examine
from tests.benchmarks.worlds.hidden import simulate_world
from tests.benchmarks.worlds.world import draw
from tests.effort import amount


def test_clean_worlds_raise_nothing() -> None:
    raised = {}
    for seed in range(200, 200 + amount(8, 100)):
        world = draw(seed)
        try:
            log = simulate_world(world)
            log.check_evaluable()
        except (ArithmeticError, LogError):
            continue  # a drive that runs away
        found = examine(world.design, log).notices
        if found:
            raised[seed] = found
    assert raised == {}

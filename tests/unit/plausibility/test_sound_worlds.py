"""No clean log of the third simulator raises a notice; `pytest --slow` looks at a hundred."""

from __future__ import annotations

from pmsm_ctrl.errors import LogError
from pmsm_ctrl.plausibility import examine
from tests.benchmarks.other_plant import other_log
from tests.benchmarks.sizes import SIZES, sized
from tests.benchmarks.worlds.hidden import simulate_world
from tests.benchmarks.worlds.world import draw
from tests.effort import amount


def test_clean_worlds_raise_nothing() -> None:
    raised = {}
    for seed in range(200, 200 + amount(3, 100)):
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


def test_a_drive_that_stops_within_a_window_is_not_late() -> None:
    # what holds the axis at rest is less than F_c: in the means over a window it lags the motion by 6 ms
    fast = sized(*other_log("none", 1180, kind="cycle"), *SIZES["fast"])
    assert examine(*fast).notices == ()

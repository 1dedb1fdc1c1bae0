"""The fourth simulator against its own physics: it judges the diagnosis, so it has to be right itself."""

from __future__ import annotations

import numpy as np
import pytest

from tests.benchmarks.fourth.axis import gcc, simulate
from tests.benchmarks.fourth.cases import build, group_of, name_of, seed_of, stable
from tests.benchmarks.fourth.effects import EFFECTS, hide, wishes
from tests.benchmarks.fourth.regression import regress
from tests.benchmarks.fourth.world import draw

needs_gcc = pytest.mark.skipif(gcc() is None, reason="GCC ABSENT: the fourth simulator cannot be compiled")


@needs_gcc
def test_a_clean_log_gives_back_its_axis_and_its_energy() -> None:
    case = build(1002)
    assert case is not None
    world, run, p = case.world, case.run, case.world.parameters
    found = regress(world, run, case.log, None, None)
    assert {name: found[name] for name in ("J", "F_c", "F_v")} == pytest.approx(
        {"J": 1.0, "F_c": 1.0, "F_v": 1.0}, abs=0.03
    )
    assert "ratio" not in found  # nothing is hidden
    omega = run["omega"]
    spent = np.sum((run["dry friction"] + p["F_v"] * omega + case.noise[2]) * omega) / world.rate
    put_in = np.sum(run["torque"] * omega) / world.rate
    kinetic = 0.5 * p["J"] * omega[-1] ** 2
    assert spent + kinetic == pytest.approx(put_in, rel=0.01)


@needs_gcc
def test_a_current_below_breakaway_moves_nothing() -> None:
    n = 400
    quiet = (np.zeros((2, n)), np.zeros(n), np.zeros(n))
    axis = {"J": 2.0, "F_c": 3.0, "F_v": 0.7, "K_t": 1.5, "T_control": 1e-3, "speed_divider": 1, "substeps": 80}
    loop = {"K_p": 1.0, "J_control": 2.0, "i_max": 10.0, "encoder_step": 1e-6, "speed_only": 1}
    for speed, moves in ((1.9, False), (2.1, True)):  # A by K_p; 2 A carry F_c
        reference = (np.zeros(n), np.full(n, speed), np.zeros(n))
        assert bool(simulate(axis | loop, reference, quiet)["omega"].any()) is moves


@needs_gcc
def test_a_spring_that_makes_the_loop_ring_is_no_world_of_its_seed() -> None:
    world, *_ = draw(209_000, wishes("compliance"))
    spring = hide("compliance", world, np.random.default_rng([209_000, 7])).terms
    assert stable(world, {})
    assert not stable(world, spring)


def test_a_seed_says_what_is_hidden() -> None:
    assert [seed_of(2, number) for number in (0, 999, 1000)] == [2000, 2999, 2_001_000]
    assert [group_of(seed) for seed in (1299, 2000, 3_001_000)] == [1, 2, 3]
    assert {name_of(seed_of(2, number)) for number in range(20)} == set(EFFECTS)
    assert name_of(1000) is None


def test_a_world_is_drawn_the_same_twice() -> None:
    one, two = draw(100_200), draw(100_200)
    assert one[0] == two[0]
    assert all(np.array_equal(a, b) for a, b in zip((*one[1], *one[2]), (*two[1], *two[2]), strict=True))

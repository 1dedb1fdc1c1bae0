"""Intervals where the sum of squares over a parameter is no parabola."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose.adding import added
from pmsm_ctrl.diagnose.profiles import NORMAL, _end
from pmsm_ctrl.rendering.numbers import with_error
from pmsm_ctrl.result import Estimate, jsonable
from pmsm_ctrl.simulate import scenario, simulate
from tests.effort import seeds
from tests.unit.simulate.composed import simulate_composed

DESIGNS = Path(__file__).resolve().parents[3] / "designs"


@pytest.mark.parametrize("bend", [0.2, 1.0, 3.0])
def test_an_end_is_where_the_closed_form_has_it(bend: float) -> None:
    """Profiles log(1 + b s) / b and (exp(b s) - 1) / b, in standard errors: a flat side and a steep one."""
    slow = _end(lambda s: math.log1p(bend * s) / bend, NORMAL)
    steep = _end(lambda s: math.expm1(bend * s) / bend, NORMAL)
    assert steep == pytest.approx(math.log1p(bend * NORMAL) / bend, rel=0.025)
    end = math.expm1(bend * NORMAL) / bend
    assert slow == (pytest.approx(end, rel=0.08) if end < 5.9 * NORMAL else math.inf)


def test_an_end_that_nothing_bounds_is_said() -> None:
    assert _end(lambda s: 1.0 - math.exp(-s), NORMAL) == math.inf
    assert with_error(0.5, 0.1, "N", (0.3, math.inf)) == "0.5 (95 %: above 0.3) N"
    assert with_error(0.5, 0.1, "", (-math.inf, math.inf)) == "0.5 (95 %: not bounded)"
    one = Estimate(0.5, "N", 0.1, ends=(0.3, math.inf))
    assert one.interval() == (0.3, math.inf)
    assert jsonable(one)["interval_95"] == [0.3, None]
    assert "interval_95" not in jsonable(Estimate(0.5, "N", 0.1))


@pytest.mark.slow
@pytest.mark.parametrize("seed", seeds(504, 505, 506))
def test_a_power_of_speed_has_the_interval_of_its_profile(seed: int) -> None:
    """Friction that grows with a power near 0.5 is hardly told from dry and viscous friction.

    Where the fit ends at the bound of the power, standard errors take it as known: F_c was 12 of them off in one of 12
    logs of the coverage benchmark.
    """
    design = Design.read(DESIGNS / "hand_tuned.toml")
    truth = {"k": 0.0009, "n": 0.57}
    motion = scenario("identification", design, duration=15.0)
    log = simulate_composed(design, motion, design.with_effect("viscous_power", truth), seed=seed, keep_truth=False)
    found = added(design, log, "viscous_power")
    true = {**truth, "F_c": design.parameters("coulomb")["F_c"], "F_v": design.parameters("viscous")["F_v"]}
    every = {**found.base, **found.parameters}
    assert every["k"].ends is not None
    for symbol, one in every.items():
        if symbol in true and (one.ends or np.isfinite(one.stderr)):
            low, high = one.interval()
            reach = 0.5 * (high - low) if np.isfinite(high - low) else 0.0  # 3 standard errors in place of 2
            assert low - 0.5 * reach <= true[symbol] <= high + 0.5 * reach, symbol
    low, high = every["k"].interval()
    assert high - every["k"].value > 1.3 * (every["k"].value - low)


@pytest.mark.parametrize("seed", seeds(3004, 3017, 3031))
def test_a_load_whose_resonance_lies_beyond_the_band_has_the_intervals_of_all_its_shapes(seed: int) -> None:
    """Of a resonance at 97 Hz a band of 40 Hz tells J_load^2 / k: both may be large, the load no larger than all of it.

    Its frequency and damping are no parameters of their own. Their profiles were not looked at, and J_load came out as
    1.7e-05 +- 1.0e-05 kg m^2 for a true 4.0e-05; a fit that ended without damping had no interval of d, or a wrong one.
    """
    design = Design.read(DESIGNS / "hand_tuned.toml")
    truth = {"J_load": 4e-05, "k": 15.0, "d": 0.002}
    log = simulate(design, "identification", truth=design.with_effect("compliance", truth), seed=seed)
    made = added(design, log, "compliance")
    found = made.parameters
    for symbol, true in truth.items():
        ends = found[symbol].ends
        assert ends is not None, symbol
        assert ends[0] <= true <= ends[1], symbol
        assert ends[0] <= found[symbol].value <= ends[1], symbol
    assert found["J_load"].interval()[1] <= made.base["J"].value * (1.0 + 1e-9)  # no larger than what was found in all


@pytest.mark.slow
def test_a_well_known_shape_keeps_its_standard_error() -> None:
    design = Design.read(DESIGNS / "hand_tuned.toml")
    truth = design.with_effect("stribeck", {"dF_s": 0.01, "w_s": 5.0, "delta": 2.0})
    found = added(design, simulate(design, "identification", truth=truth, seed=3), "stribeck")
    assert all(one.ends is None for one in (*found.base.values(), *found.parameters.values()))

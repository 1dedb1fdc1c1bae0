"""Properties that hold for any machine, drawn at random over four decades of size."""

from __future__ import annotations

import json
import math
import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pmsm_ctrl.design import Design
from pmsm_ctrl.tune import tune
from pmsm_ctrl.tune.current import highest_bandwidth, tune_current
from pmsm_ctrl.tune.margins import margins
from pmsm_ctrl.tune.requirements import Specification
from pmsm_ctrl.tune.sampled import Cascade, current_loop
from pmsm_ctrl.tune.speed import open_loop, tune_speed
from tests.benchmarks.machines import machine


@st.composite
def machines(draw) -> Design:
    """A machine whose time constants are those of servos, whatever its size."""
    R = 10.0 ** draw(st.floats(-2.0, 2.0))
    electrical = 10.0 ** draw(st.floats(-3.0, -1.7))
    psi = 10.0 ** draw(st.floats(-2.5, 0.0))
    pairs = draw(st.integers(2, 10))
    # The mechanical time constant R J / (1.5 p^2 psi^2) of servos lies between 1 and 30 ms.
    rate = draw(st.sampled_from([4000.0, 8000.0, 16000.0]))
    # Nobody controls a shaft whose EMF time constant is a few control periods: there the late EMF feedforward
    # costs the rule more than 10 deg (the sampled margins know, see docs/tuning.md). Twenty periods at least.
    mechanical = max(10.0 ** draw(st.floats(-3.0, -1.5)), 20.0 / rate)
    J = mechanical * 1.5 * (pairs * psi) ** 2 / R
    return Design.from_dict({
        "motor": {"R": R, "L_d": electrical * R, "L_q": electrical * R, "J": J, "p": pairs, "psi_f": psi},
        "drive": {
            "f_control": rate, "speed_divider": draw(st.sampled_from([1, 2, 4])), "u_dc": 2000.0 * pairs * psi,
            "delay_periods": draw(st.sampled_from([0, 1])),
        },
        "sensor": {"speed_filter": draw(st.sampled_from([0.0, 0.5e-3, 2e-3]))},
    })  # fmt: skip


@settings(max_examples=15, deadline=None, derandomize=True)
@given(machines())
def test_classical_gains_are_stable_with_the_margins_they_are_known_for(design):
    loop = tune_current(design)
    inner = margins(current_loop(design, loop))
    assert inner.stable
    # 90 deg less 1/2 rad of delay at the crossover 1/(2 T_sigma), less what sampling adds without a delay.
    assert 52.0 < inner.phase_margin < 66.0
    cascade = Cascade.of(design, loop, at=1.0)
    found = margins(open_loop(cascade, tune_speed(cascade)))
    assert found.stable
    assert found.phase_margin > 38.0
    assert found.gain_margin_db > 6.0


@settings(max_examples=15, deadline=None, derandomize=True)
@given(machines(), st.floats(0.2, 0.9), st.floats(35.0, 70.0))
def test_a_bandwidth_with_margin_is_met_exactly_wherever_it_is_granted(design, share, phase_margin):
    asked = share * highest_bandwidth(design, phase_margin)
    loop = tune_current(design, Specification(current="bandwidth", current_bandwidth=asked, phase_margin=phase_margin))
    found = margins(current_loop(design, loop))
    assert found.crossover == pytest.approx(asked, rel=2e-3)
    assert found.phase_margin == pytest.approx(phase_margin, abs=0.2)


@settings(max_examples=10, deadline=None, derandomize=True)
@given(machines(), st.floats(0.1, 10.0))
def test_gains_scale_with_the_machine(design, factor):
    # Twice the inertia, twice the gain, the same reset time; impedance scales the current gain alone.
    loop = tune_current(design)
    heavy = design.replace(motor={"J": factor * design.motor.J})
    light_gains, heavy_gains = (tune_speed(Cascade.of(each, loop, at=1e-3)) for each in (design, heavy))
    assert heavy_gains.K_p == pytest.approx(factor * light_gains.K_p, rel=1e-9)
    assert heavy_gains.T_n == light_gains.T_n
    m = design.motor
    thick = design.replace(motor={"R": factor * m.R, "L_d": factor * m.L_d, "L_q": factor * m.L_q})
    assert tune_current(thick).K_p == pytest.approx(factor * loop.K_p, rel=1e-9)
    assert math.isclose(tune_current(thick).T_n, loop.T_n, rel_tol=1e-9)


@pytest.mark.slow
def test_a_linear_axis_is_described_in_metres_and_newtons() -> None:
    """No radian and no newton metre in what is said of a linear axis, the gains in drives' units included."""
    design = next(machine(seed) for seed in range(50) if machine(seed).motion == "linear")
    found = tune(design, prove=False)
    text = found.summary(width=200) + json.dumps(found.gains)
    assert not re.search(r"\brad\b|\bN m\b", text)
    assert "A/(m/s)" in text
    assert "N s/m" in text

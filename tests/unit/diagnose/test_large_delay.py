"""Torque and currents that lag the motion by more than any sampling: the delay is named, with its size."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from pmsm_ctrl.compare import compare
from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose import diagnose
from pmsm_ctrl.diagnose.adding import added
from pmsm_ctrl.log import Log
from pmsm_ctrl.plausibility import examine
from tests.effort import seeds, slow

DESIGN = Design.read(Path(__file__).resolve().parents[3] / "designs" / "hand_tuned.toml")
J, F_C, F_V, T_0 = 8.5e-5, 0.03, 1.5e-4, 0.02  # of the axis; the design has others


def moves(late: float, seed: int, load: float = 0.0) -> Log:
    """Trapezoids of the speed to and fro, the torque in closed form, rounded over 10 ms, and this late; no drive."""
    t = np.arange(0.0, 20.0, 1e-3)
    omega = 40.0 * np.clip(2.5 * np.sin(2.0 * np.pi * 0.35 * t) + np.sin(2.0 * np.pi * 0.11 * t), -1.0, 1.0)
    window = np.hanning(41) / np.hanning(41).sum()
    omega = np.convolve(omega, window, mode="same")
    theta, alpha = np.cumsum(omega) * 1e-3 - 0.5e-3 * omega, np.gradient(omega, t)
    torque = J * alpha + F_C * np.tanh(omega / 0.5) + F_V * omega + load
    torque = np.interp(t - late, t, torque)
    noise = 3e-4 * np.random.default_rng(seed).normal(size=t.size)
    return Log({"t": t, "theta": theta, "torque": torque + noise})


@pytest.mark.slow
@pytest.mark.parametrize("seed", seeds(1, 2, 3))
@pytest.mark.parametrize("late", [60e-3, slow(5e-3), slow(9e-3), slow(14e-3), slow(30e-3)])
def test_it_is_named_with_its_size(late: float, seed: int) -> None:
    log = moves(late, seed)
    found = diagnose(DESIGN, log, plan=False)
    assert [step.effect for step in found.steps] == ["delay"]
    assert found.steps[0].parameters["tau"].value == pytest.approx(late, abs=2e-4)
    assert found.errors["final"]["torque"]["relative"] < 0.02  # moved in time the log has 1 %; unmoved 11 to 40 %
    assert found.design.parameters("coulomb")["F_c"] == pytest.approx(F_C, rel=0.01)
    predicted = compare(found.design, log).log.errors["torque"]
    assert predicted.relative == pytest.approx(found.errors["final"]["torque"]["relative"], rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("seed", seeds(1, 2, 3))
def test_what_else_is_missing_is_named_beside_it(seed: int) -> None:
    found = diagnose(DESIGN, moves(12e-3, seed, T_0), plan=False)
    assert {step.effect for step in found.steps} == {"delay", "constant_load"}
    load = next(step for step in found.steps if step.effect == "constant_load")
    assert load.parameters["T_0"].value == pytest.approx(T_0, rel=0.02)


@pytest.mark.parametrize("seed", seeds(1, 2, 3))
@pytest.mark.parametrize(("filters", "time"), [(1, 12e-3), slow(2, 12e-3)])
def test_a_filter_is_no_delay(filters: int, time: float, seed: int) -> None:
    log, kept = moves(0.0, seed), float(np.exp(-1e-3 / time))
    torque = log["torque"]
    for _ in range(filters):
        torque = lfilter([1.0 - kept], [1.0, -kept], torque)
    found = diagnose(DESIGN, log.with_channels(torque=torque), plan=False)
    assert "delay" not in [step.effect for step in found.steps]


def test_it_is_added_as_it_is_named() -> None:
    one = added(DESIGN, moves(9e-3, 1), "delay")
    assert not one.against
    assert one.parameters["tau"].value == pytest.approx(9e-3, abs=2e-4)


def test_a_delay_that_the_design_knows_is_no_lag() -> None:
    log = moves(20e-3, 1)
    assert [notice.code for notice in examine(DESIGN, log).notices] == ["not_synchronous"]
    known = examine(DESIGN.add_effect("delay", {"tau": 20e-3}), log)
    assert known.notices == ()
    assert known.lag == 0.0
    np.testing.assert_array_equal(known.log["torque"], log["torque"])

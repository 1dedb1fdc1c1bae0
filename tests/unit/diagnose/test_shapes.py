"""Shapes fitted with the amounts: against scipy's own nonlinear least squares on the written-down equation."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import curve_fit

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose import add
from pmsm_ctrl.diagnose.final_fit import not_beside_shapes, reaching_zero, without_end
from pmsm_ctrl.diagnose.fit import Accepted
from pmsm_ctrl.diagnose.refusal import Reason
from pmsm_ctrl.diagnose.shapes import tangent_of
from pmsm_ctrl.effects.catalogue import CATALOGUE
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.columns import UnavailableError
from tests.effort import seeds

J, F_C, F_V, DF, W_S, DELTA = 1e-3, 0.2, 0.002, 0.1, 4.0, 1.6
NOISE = 0.004


def stribeck_log(seed: int, seconds: float = 40.0) -> Log:
    """Slow speeds both ways with white torque noise and an exact angle."""
    t = np.arange(0.0, seconds, 2e-3)
    speed = 12.0 * np.sin(2 * np.pi * 0.05 * t) + 8.0 * np.sin(2 * np.pi * 0.13 * t)
    angle = -12.0 * np.cos(2 * np.pi * 0.05 * t) / (2 * np.pi * 0.05)
    angle -= 8.0 * np.cos(2 * np.pi * 0.13 * t) / (2 * np.pi * 0.13)
    torque = J * np.gradient(speed, t) + friction(speed, F_C, F_V, DF, W_S, DELTA)
    return Log({"t": t, "theta": angle, "torque": torque + NOISE * np.random.default_rng(seed).normal(size=len(t))})


def friction(w: np.ndarray, F_c: float, F_v: float, dF: float, w_s: float, delta: float) -> np.ndarray:
    return F_v * w + np.sign(w) * (F_c + dF * np.exp(-(np.abs(w / w_s) ** delta)))


@pytest.mark.parametrize("seed", seeds(1, 2, 3))
def test_standard_errors_are_those_of_nonlinear_least_squares(seed: int) -> None:
    log = stribeck_log(seed)
    effects = [{"id": "coulomb", "F_c": F_C}, {"id": "viscous", "F_v": F_V}]
    found = add(Design.from_dict({"motor": {"J": J, "K_t": 1.0}, "effects": effects}), log, "stribeck")
    entry = next(e for e in found.effects if e.id == "stribeck")
    speed = np.gradient(log["theta"], log.t)
    dry = log["torque"] - J * np.gradient(speed, log.t)
    start = [F_C, F_V, DF, W_S, DELTA]
    _, covariance = curve_fit(friction, speed, dry, start, sigma=np.full(len(speed), NOISE), absolute_sigma=True)
    expected = dict(zip(("dF_s", "w_s", "delta"), np.sqrt(np.diag(covariance))[2:], strict=True))
    for symbol, true in (("dF_s", DF), ("w_s", W_S), ("delta", DELTA)):
        assert entry.stderr[symbol] == pytest.approx(expected[symbol], rel=0.4)
        assert abs(entry.parameters[symbol] - true) < 3.5 * entry.stderr[symbol]


def test_friction_that_rises_from_standstill_is_no_stribeck_friction() -> None:
    log = stribeck_log(4, 20.0)
    rising = log["torque"] - 2.0 * np.sign(np.gradient(log["theta"])) * DF * np.exp(
        -(np.abs(np.gradient(log["theta"], log.t) / W_S) ** DELTA)
    )
    effects = [{"id": "coulomb", "F_c": F_C}, {"id": "viscous", "F_v": F_V}]
    design = Design.from_dict({"motor": {"J": J, "K_t": 1.0}, "effects": effects})
    turned = Log({"t": log.t, "theta": log["theta"], "torque": rising})
    assert add(design, turned, "stribeck").parameters("stribeck")["dF_s"] == pytest.approx(0.0, abs=1e-3)
    assert add(design, turned, "rising_friction").parameters("rising_friction")["dF_r"] == pytest.approx(DF, rel=0.25)


def test_a_shape_that_vanished_has_no_slope() -> None:
    """A walk along the profile of a hidden presliding took its time constant to zero, which has no logarithm."""
    gone = Accepted(CATALOGUE["presliding"], {"z_s": 0.0476, "z_b": 0.0407, "tau_z": 0.0}, ())
    fit: Any = SimpleNamespace(accepted=(gone,))
    with pytest.raises(UnavailableError, match="vanished"):
        tangent_of(Design.from_dict({"motor": {"J": J, "K_t": 1.0}}), fit, [(0, "tau_z")])


@pytest.mark.parametrize(
    ("n", "at_bound"), [(0.3, True), (0.6, False), (0.85, True), (1.18, True), (2.0, False), (3.0, True)]
)
def test_the_edges_of_what_an_exponent_avoids_are_bounds(n: float, at_bound: bool) -> None:
    """A viscous friction that a drift left out of the model changes was called a drag of exponent 1.18."""
    drag = CATALOGUE["viscous_power"]
    assert drag.structure.at_bound(drag, {"n": n}) is at_bound


@pytest.mark.parametrize(
    ("ends", "refused"), [((0.0, 7.5e-4), True), ((1e-4, 7.5e-4), False), ((0.0, 1.0), False), (None, False)]
)
def test_a_size_whose_interval_reaches_zero_is_not_determined(ends: tuple[float, float] | None, refused: bool) -> None:
    """A presliding was named in a clean log of sines: its interval began at 0."""
    shape = {"z_s": 6.2e-4, "z_b": 0.6, "tau_z": 1e-3}
    bristle = Accepted(CATALOGUE["presliding"], shape, ({**shape, "z_s": 1e-4}, {**shape, "z_s": 1e-3}))
    profiles = {} if ends is None else {(0, "z_s"): ends}
    fit: Any = SimpleNamespace(accepted=(bristle,), profiles=profiles, record=SimpleNamespace(step=1e-5))
    found = reaching_zero(fit)
    assert (found is not None and found.reason is Reason.NOT_DETERMINED) is refused


@pytest.mark.parametrize(("steps", "refused"), [(1.3, True), (2.5, False)])
def test_a_deflection_of_a_step_of_the_angle_is_not_determined(steps: float, refused: bool) -> None:
    """In four of five pairs of clean logs one of 1.1 to 1.3 steps was named: an axis turns somewhere within a step."""
    shape = {"z_s": steps * 1.2e-5, "z_b": 0.6, "tau_z": 1e-3}
    bristle = Accepted(CATALOGUE["presliding"], shape, ({**shape, "z_s": 1e-6}, {**shape, "z_s": 1e-3}))
    ends = {(0, "z_s"): (0.9 * shape["z_s"], 1.1 * shape["z_s"])}
    fit: Any = SimpleNamespace(accepted=(bristle,), profiles=ends, record=SimpleNamespace(step=1.2e-5))
    found = reaching_zero(fit)
    assert (found is not None) is refused


@pytest.mark.parametrize(("ends", "refused"), [((10.2, math.inf), True), ((0.0153, 0.037), False), (None, False)])
def test_a_voltage_proportional_to_the_current_is_a_resistance(ends: tuple[float, float] | None, refused: bool) -> None:
    """A dead time of 5 V was named, linear up to 24 A where 95 % of the currents are below 1.7 A; none was there."""
    loss = Accepted(CATALOGUE["dead_time"], {"i_0": 24.1}, ({"i_0": 0.2}, {"i_0": 2.0}))
    fit: Any = SimpleNamespace(accepted=(loss,), profiles={} if ends is None else {(0, "i_0"): ends})
    found = without_end(fit)
    assert (found is not None and found.reason is Reason.NOT_DETERMINED) is refused
    drift = Accepted(CATALOGUE["thermal_drift"], {"tau": 100.0}, ({"tau": 1.0}, {"tau": 200.0}))
    other: Any = SimpleNamespace(accepted=(drift,), profiles={(0, "tau"): (30.0, math.inf)})
    assert without_end(other) is None, "a drift that goes on is a straight line, which the model does not have"


@pytest.mark.parametrize(("value", "ends", "fallen"), [
    (0.022, None, True), (0.2, None, False), (0.2, (-0.01, 0.4), True), (0.06, (0.01, 0.2), False),
])  # fmt: skip
def test_a_later_bend_as_large_as_it_is_uncertain_falls(
    value: float, ends: tuple[float, float] | None, fallen: bool
) -> None:
    """A Stribeck friction of 0.022 +- 0.049 N m was named beside a friction that rises."""
    grid = ({"w_s": 1.0, "delta": 1.0}, {"w_s": 9.0, "delta": 2.0})
    later = Accepted(CATALOGUE["stribeck"], {"w_s": 3.0, "delta": 1.5}, grid)
    fit: Any = SimpleNamespace(
        accepted=(Accepted(CATALOGUE["rising_friction"], {"w_r": 3.0}, ({"w_r": 1.0}, {"w_r": 9.0})), later),
        covariance=np.eye(2), free=((1, "w_s"),), position=lambda number: number,
        model=SimpleNamespace(columns_of=lambda place: slice(place, place + 1), names=("dF_r", "dF_s")),
        plain=SimpleNamespace(values=np.array([0.3, value]), stderr=np.array([0.01, 0.049])),
        profiles={} if ends is None else {(1, "dF_s"): ends},
    )  # fmt: skip
    found = not_beside_shapes(fit)
    assert (found is not None and found.reason is Reason.NOT_DETERMINED) is fallen

"""The third simulator against closed forms: it judges the diagnosis, so it has to be right itself."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from pmsm_ctrl.diagnose import diagnose, final_fit
from pmsm_ctrl.diagnose.adding import added
from tests.benchmarks.worlds.hidden import EFFECTS, possible, simulate_with_truth, simulate_world
from tests.benchmarks.worlds.margin import HALF, margin, seen
from tests.benchmarks.worlds.plant import COLUMNS, HIDDEN, PLACE, TRUTH, run
from tests.benchmarks.worlds.world import draw

J, F_C, F_V, K = 2.0, 3.0, 0.7, 1.5


def axis(current: float, seconds: float, **hidden: float) -> dict[str, np.ndarray]:
    """An axis known by its force, driven by a constant current; the current loop is fast and nothing is noisy."""
    f_control = 5000.0
    x = np.zeros(len(HIDDEN))
    x[PLACE["stribeck_speed"]] = x[PLACE["warm_time"]] = x[PLACE["dead_current"]] = 1.0
    for name, value in hidden.items():
        x[PLACE[name]] = value
    n = round(seconds * f_control)
    ref = np.column_stack([np.full(n, current), np.full(n, 1e9), np.ones(n)])
    loop = np.array([1e5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1e9, 0.0])
    motor = np.array([0.0, 0.0, 0.0, 0.0, K, J, F_C, F_V])
    table = run(motor, x, ref, np.array([1 / f_control, 7, 1, 0]), loop, 2, np.zeros(3), np.array([0.0, 0.0, 0.0]), 1)
    names = (*COLUMNS, *(f"added {name}" for name in TRUTH))
    return dict(zip(names, table.T, strict=True)) | {"t": np.arange(n) / f_control}


def test_run_up_against_friction_is_the_exponential() -> None:
    out = axis(10.0, 4.0)
    top = (K * 10.0 - F_C) / F_V
    exact = top * (1.0 - np.exp(-out["t"] * F_V / J))
    speed = np.gradient(out["theta"], out["t"])
    assert np.max(np.abs(speed - exact)[5:-5]) < 2e-3 * top


def test_an_axis_below_breakaway_stays_where_it_is() -> None:
    out = axis(0.99 * F_C / K, 1.0)
    assert np.all(out["theta"] == 0.0)


@pytest.mark.parametrize(
    ("hidden", "force"),
    [
        ({"constant_load": 1.3}, 1.3),
        ({"viscous_asymmetry": 0.2}, 0.2 * 10.0),
        ({"drag_gain": 0.05, "drag_power": 2.0}, 0.05 * 100.0),
        ({"stribeck": 4.0, "stribeck_speed": 5.0, "stribeck_lorentz": 1.0}, 4.0 / 5.0),
        ({"load_friction": 0.1}, None),
    ],
)
def test_steady_speed_says_what_an_effect_adds(hidden: dict[str, float], force: float | None) -> None:
    """At 10 m/s the drive has to carry the friction and the effect; from the balance the speed follows."""
    base = F_C + F_V * 10.0
    needed = base / (1.0 - 0.1) if force is None else base + force
    out = axis(needed / K, 40.0, **hidden)
    assert (out["theta"][-1] - out["theta"][-5001]) == pytest.approx(10.0, rel=5e-3)


def test_what_an_effect_adds_is_known_to_the_simulator() -> None:
    """The force that a rigid axis with dry and viscous friction lacks: none, a load, a share of the drive's force."""
    assert np.max(np.abs(axis(10.0, 0.2)["added torque"])) < 1e-9
    loaded = axis(10.0, 0.2, constant_load=1.3, load_friction=0.1)
    assert loaded["added torque"][5:] == pytest.approx(1.3 + 0.1 * K * 10.0, rel=1e-9)


def test_the_margin_is_the_amplitude_over_the_noise() -> None:
    """A constant load shows with amplitude 1, and not at all in the clean log; twice the load has twice the margin."""
    world = replace(draw(167006), duration=6.0)
    clean, once, twice = (simulate_with_truth(world, {"constant_load": load}) for load in (0.0, 0.01, 0.02))
    one, none = seen(world, *once)["torque"], seen(world, clean[0], once[1])["torque"]
    assert abs(one.amplitude - 1.0) < 3.0 * one.stderr
    assert abs(none.amplitude) < 3.0 * none.stderr
    margins = [margin(world, clean[0], *made) for made in (once, twice)]
    assert margins[0] == pytest.approx(1.0 / (HALF * one.stderr))
    assert margins[1] == pytest.approx(2.0 * margins[0], rel=0.1)


def test_load_on_a_spring_rings_at_its_own_frequency() -> None:
    w_a, J_l = 2 * math.pi * 20.0, 1.0
    k = J_l * w_a**2
    out = axis(200.0, 2.0, load_inertia=J_l, stiffness=k)
    speed = np.gradient(out["theta"], out["t"])[100:]
    free = w_a * math.sqrt(J / (J - J_l))
    trend = np.polynomial.Polynomial.fit(out["t"][100:], speed, 5)(out["t"][100:])
    spectrum = np.abs(np.fft.rfft((speed - trend) * np.hanning(len(speed)), 1 << 17))
    found = np.argmax(spectrum) * 5000.0 / (1 << 17)
    assert found == pytest.approx(free / (2 * math.pi), rel=0.02)


def test_a_load_whose_friction_holds_it_is_a_wall() -> None:
    """The shaft swings on the spring alone, at sqrt(k / J_m), as long as that pulls by less than the friction."""
    J_l, k = 1.0, 2e4
    out = axis(0.5 * F_C / K, 1.0, load_inertia=J_l, stiffness=k, load_dry=2.0 * F_C)
    middle, swing = 0.5 * F_C / k, out["theta"][100:]
    assert np.mean(swing) == pytest.approx(middle, rel=0.1)
    rising = np.flatnonzero((swing[:-1] < middle) & (swing[1:] >= middle))
    period = float(np.mean(np.diff(out["t"][100:][rising])))
    assert period == pytest.approx(2.0 * math.pi * math.sqrt((J - J_l) / k), rel=0.02)


@pytest.fixture
def without_profiles(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave out the intervals of nonlinear parameters, which tests/unit/diagnose/test_profiles.py looks at."""
    monkeypatch.setattr(final_fit, "with_profiles", lambda design, fit: fit)


@pytest.mark.usefixtures("without_profiles")
def test_a_load_that_rubs_is_named_with_its_friction() -> None:
    """Friction behind the spring holds the load and lets it go; without it in the model the rest was unexplained."""
    world = replace(draw(650022), duration=15.0)
    hidden = {"load_inertia": 47.71, "stiffness": 2.69e6, "damping": 680.0, "load_dry": 20.07}  # margin 2.7
    offered = ("compliance", "backlash", "stribeck", "presliding", "delay", "load_dependent_friction")
    found = diagnose(world.design, simulate_world(world, hidden), candidates=offered, plan=False)
    assert [step.effect for step in found.steps] == ["compliance"]
    own = found.steps[0].parameters
    for name, true in (("J_load", "load_inertia"), ("k", "stiffness"), ("F_load", "load_dry")):
        assert own[name].value == pytest.approx(hidden[true], rel=0.1)


def test_a_world_is_drawn_the_same_twice_and_others_differ() -> None:
    assert draw(7).properties == draw(7).properties
    seen = {name: {str(draw(seed).properties[name]) for seed in range(80)} for name in draw(0).properties}
    assert all(len(values) > 1 for values in seen.values())


@pytest.mark.parametrize("seed", [1, 4, 9])
def test_a_world_moves_and_its_log_is_one(seed: int) -> None:
    world = draw(seed)
    log = simulate_world(world)
    speed = np.abs(np.diff(log["theta"]) / np.diff(log.t))
    assert 0.3 * world.top < np.quantile(speed, 0.999) < 3.0 * world.top
    assert set(possible(world)) <= set(EFFECTS)


@pytest.mark.slow
def test_an_effect_is_named_though_noise_biases_the_timing_that_is_fitted_without_it() -> None:
    """Errors are compared with the timing held alike: a biased one makes them smaller, whatever the model."""
    world = replace(draw(470186), duration=15.0)
    log = simulate_world(world, {"position_friction": 0.02713, "position_phase": 2.762})  # margin 4.9
    offered = ("position_dependent_friction", "unbalance", "cogging", "stribeck", "presliding", "constant_load")
    found = diagnose(world.design, log, candidates=offered, plan=False)
    assert [step.effect for step in found.steps] == ["position_dependent_friction"]
    errors = [found.errors[model]["torque"]["rms"] for model in ("base", "final")]
    assert errors[1] < errors[0]
    assert found.steps[0].error_before["torque"]["rms"] == errors[0]
    alone = added(world.design, log, "position_dependent_friction").errors
    assert alone["final"]["torque"]["rms"] < alone["base"]["torque"]["rms"]

"""Identification from made-up logs whose parameters are known."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl.compare import compare
from pmsm_ctrl.design import Design
from pmsm_ctrl.effects import Effect, Parameter, kernel
from pmsm_ctrl.identify import Processing, identify
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.drive_timing import SYNCHRONOUS
from pmsm_ctrl.regression.inverse_dynamics import build_problem
from pmsm_ctrl.section import Table
from pmsm_ctrl.simulate import scenario, simulate
from tests.effort import seeds

TRUE = {"J": 0.01, "F_c": 0.4, "F_v": 0.02, "T_0": -0.05}


def design(*ids: str, **start: float) -> Design:
    believed = Design.from_dict({"name": "made", "motor": {"J": 0.0102, "K_t": 1.3}})
    for name, symbol in (("coulomb", "F_c"), ("viscous", "F_v"), ("constant_load", "T_0")):
        if name in ids:
            believed = believed.with_effect(name, {symbol: start.get(symbol, TRUE[symbol])})
    return believed


ALL = design("coulomb", "viscous", "constant_load")


def made_log(speed, acceleration, t, noise: float = 0.0, seed: int = 0, extra=0.0) -> Log:
    force = TRUE["J"] * acceleration + TRUE["F_c"] * np.sign(speed) + TRUE["F_v"] * speed + TRUE["T_0"] + extra
    force = force + noise * np.random.default_rng(seed).normal(size=len(t))
    return Log({"t": t, "omega": speed, "i_q": force / 1.3})


def rich(noise: float = 0.0, seed: int = 0, extra=None, samples: int = 20000) -> Log:
    t = np.arange(samples) / 1000.0
    speed = 12 * np.sin(2.1 * t) + 6 * np.sin(5.3 * t)
    acceleration = 12 * 2.1 * np.cos(2.1 * t) + 6 * 5.3 * np.cos(5.3 * t)
    return made_log(speed, acceleration, t, noise, seed, 0.0 if extra is None else extra(t, speed))


def test_known_parameters_return() -> None:
    result = identify(ALL, rich())
    for name, value in TRUE.items():
        assert result.estimates[name].value == pytest.approx(value, rel=2e-3), name
    assert result.warnings == ()
    assert pytest.approx(0.01, rel=2e-3) == result.design.J
    assert result.design.parameters("coulomb")["F_c"] == result.estimates["F_c"].value
    assert result.estimates["J"].nominal == 0.0102


@pytest.mark.slow  # each time test_quality.py holds such intervals against the errors and their least size
def test_intervals_cover_with_noise() -> None:
    hits = dict.fromkeys(TRUE, 0)
    count = 60
    for seed in range(count):
        result = identify(ALL, rich(0.3, seed, samples=5000))
        for name, value in TRUE.items():
            low, high = result.intervals[name]
            hits[name] += low <= value <= high
    # at 95 % fewer than 52 of 60 happen once in 500
    assert all(hit >= 52 for hit in hits.values()), hits


def test_one_speed_cannot_tell_coulomb_viscous_and_load_apart() -> None:
    t = np.arange(10000) / 1000.0
    result = identify(ALL, made_log(10.0 + 0 * t, 0 * t, t, noise=0.01))
    assert set(result.unidentifiable) == set(TRUE)
    assert result.estimates == {}
    assert result.unidentifiable["F_c"].code == "collinear"
    assert "F_v" in result.unidentifiable["F_c"].detail["partners"]
    assert "two different speeds" in result.unidentifiable["F_v"].text
    assert result.design.parameters("coulomb") == ALL.parameters("coulomb")
    assert "not identifiable, because" in result.summary()


def test_one_direction_confounds_load_and_coulomb_but_not_the_rest() -> None:
    t = np.arange(20000) / 1000.0
    speed = 12 + 5 * np.sin(3.0 * t) + 3 * np.sin(7.1 * t)
    result = identify(ALL, made_log(speed, 15 * np.cos(3 * t) + 21.3 * np.cos(7.1 * t), t, noise=0.01))
    assert set(result.unidentifiable) == {"F_c", "T_0"}
    said = " ".join(result.summary(brief=True).split())
    assert "2 of 4 parameters identified (not F_c, T_0)" in said
    assert "not identifiable, because" in said
    assert "T_0" in result.unidentifiable["F_c"].detail["partners"]
    assert result.estimates["F_v"].value == pytest.approx(TRUE["F_v"], rel=0.01)
    assert result.estimates["J"].value == pytest.approx(TRUE["J"], rel=0.01)


def test_without_acceleration_the_inertia_gets_no_number() -> None:
    t = np.arange(40000) / 1000.0
    speed = 10 * np.sin(0.05 * t + 0.3) + 1e-4 * np.random.default_rng(4).normal(size=len(t))
    result = identify(ALL, made_log(speed, 0.5 * np.cos(0.05 * t + 0.3), t, noise=1.0))
    assert result.unidentifiable["J"].code == "uncertain"
    viscous = result.estimates["F_v"]
    assert abs(viscous.value - TRUE["F_v"]) < 3 * viscous.stderr


@pytest.mark.parametrize("seed", seeds(1, 2, 3))
def test_a_friction_below_zero_stays_at_its_bound_and_the_rest_is_fitted_beside_it(seed: int) -> None:
    log = rich(0.05, seed, extra=lambda t, speed: -0.5 * np.sign(speed))
    known = Processing(sampling=SYNCHRONOUS)  # what the time of sampling takes up hangs on the free fit
    result = identify(ALL, log, processing=known)
    assert [notice.code for notice in result.notices if notice.code == "parameter_at_bound"] == ["parameter_at_bound"]
    free = result.fit.at_bound["F_c"]
    assert free.free == pytest.approx(-0.1, rel=0.05)
    assert result.estimates["F_c"].value == 0.0
    assert np.isnan(result.estimates["F_c"].stderr)
    assert result.intervals["F_c"] == (0.0, 0.0)
    assert result.to_dict()["at_bound"] == ["F_c"]
    assert result.design.parameters("coulomb")["F_c"] == 0.0
    assert "F_c" not in next(entry.stderr for entry in result.design.effects if entry.id == "coulomb")

    without = identify(result.design.replace_effects(result.design.effects[1:]), log, processing=known)
    for name in ("J", "F_v", "T_0"):
        assert result.estimates[name].value == pytest.approx(without.estimates[name].value, rel=1e-6), name
    written = compare(result.design, log).log.errors["torque"]
    assert result.relative_error == pytest.approx(written.relative, rel=0.1)
    worse = {**{n: e.value for n, e in result.estimates.items()}, "F_v": free_viscous(log)}
    clipped = result.shown.target - result.shown.matrix() @ [worse[n] for n in result.shown.names]
    assert result.rms < 0.9 * float(np.sqrt(np.mean(clipped[result.shown.mask] ** 2))), "the optimum, not a clip"


def free_viscous(log: Log) -> float:
    """F_v of the fit without bounds."""
    problem = build_problem(ALL, log, Processing(blank=True))
    x = problem.matrix()[problem.mask]
    return float(np.linalg.lstsq(x, problem.target[problem.mask])[0][problem.names.index("F_v")])


@pytest.mark.parametrize("seed", seeds(1, 2, 3))
def test_a_current_of_the_wrong_sign_gives_no_inertia_and_the_error_of_the_design_that_is_written(seed: int) -> None:
    turned = rich(0.05, seed)
    log = Log({**turned.channels, "i_q": -turned.channels["i_q"]})
    result = identify(ALL, log)
    assert result.unidentifiable["J"].code == "impossible"
    assert result.design.J == ALL.J
    assert {"F_c", "F_v"} <= set(result.fit.at_bound)
    written = compare(result.design, log).log.errors["torque"]
    assert result.relative_error == pytest.approx(written.relative, rel=0.1)


def test_identify_and_compare_print_one_number_of_one_design_on_one_log() -> None:
    """So far as the time of sampling is fitted beside it, the fit's own residual was another one."""
    log = rich(0.05, 4, extra=lambda t, speed: 0.1 * np.sin(3.0 * t))
    result = identify(ALL, log)
    written = compare(result.design, log).log.errors["torque"]
    # the design that is written has its values rounded by their standard errors
    assert result.relative_error == pytest.approx(written.relative, rel=1e-5)
    assert result.rms == pytest.approx(written.rms, rel=1e-5)
    drive = "force" if log.motion == "linear" else "torque"
    assert f"; {drive} error {100 * written.relative:.2f} %." in result.summary(width=1000)


@pytest.mark.parametrize("seed", seeds(1, 2, 3))
@pytest.mark.parametrize("off", [0.7, 1.3])
def test_of_a_drive_whose_windings_are_known_both_print_one_number_too(designs: Path, seed: int, off: float) -> None:
    """The terms of a command widen the standard errors of the fit, and made its error smaller than that of compare."""
    true = Design.read(designs / "seed_motor.toml")
    log = simulate(true, scenario("triangle", true, speed=150.0, period=2.0), seed=seed)
    believed = true.with_parameters(J=off * true.J).with_effect("coulomb", {"F_c": off * 0.0213})
    result = identify(believed, log)
    written = compare(result.design, log).log.errors["torque"]
    assert result.relative_error == pytest.approx(written.relative, rel=1e-5)
    assert result.rms == pytest.approx(written.rms, rel=1e-5)


def test_an_own_effect_takes_part() -> None:
    @kernel
    def term(omega: float, k: float) -> float:
        return k * omega * omega * omega

    own = Effect(
        id="cubic", title="Cubic drag", equation="k w^3", source="test", enters="torque",
        parameters=(Parameter("k", "N m s^3/rad^3", 0.0, 0.0, np.inf, "cubic drag", linear=True),),
        term=term, needs="two speeds",
    )  # fmt: skip
    believed = ALL.with_own_effects(own).with_effect("cubic", {"k": 0.0})
    result = identify(believed, rich(extra=lambda t, speed: 3e-4 * speed**3))
    assert result.estimates["k"].value == pytest.approx(3e-4, rel=2e-3)


def test_nonlinear_parameters_are_held_and_their_linear_one_is_found() -> None:
    believed = ALL.with_effect("stribeck", {"dF_s": 0.0, "w_s": 3.0, "delta": 2.0})
    log = rich(extra=lambda t, w: 0.2 * np.exp(-((w / 3.0) ** 2)) * np.sign(w))
    result = identify(believed, log)
    assert result.estimates["dF_s"].value == pytest.approx(0.2, rel=0.02)
    assert result.design.parameters("stribeck")["w_s"] == 3.0


def test_two_instances_of_an_effect_are_named_apart() -> None:
    believed = ALL.add_effect("cogging", {"order": 6.0}).add_effect("cogging", {"order": 18.0})
    assert "a_s#2" in build_problem(believed, rich()).names


def test_load_torque_is_taken_off() -> None:
    log = rich()
    load = 0.3 * np.sin(0.9 * log.t)
    loaded = log.with_channels(i_q=log["i_q"] + load / 1.3, T_load=load)
    assert identify(ALL, loaded).estimates["F_v"].value == pytest.approx(TRUE["F_v"], rel=2e-3)


def test_reluctance_torque_counts() -> None:
    motor = {"J": 0.01, "p": 4, "psi_f": 0.2, "R": 1.0, "L_d": 5e-3, "L_q": 15e-3}
    believed = (
        Design.from_dict({"motor": motor}).with_effect("coulomb", {"F_c": 0.4}).with_effect("viscous", {"F_v": 0.02})
    )
    log = rich()
    torque, i_d = 1.3 * log["i_q"] - TRUE["T_0"], -4.0
    i_q = torque / (1.5 * 4 * (0.2 - 0.01 * i_d))
    made = Log({"t": log.t, "omega": log["omega"], "i_d": np.full(len(log), i_d), "i_q": i_q})
    assert identify(believed, made).estimates["J"].value == pytest.approx(0.01, rel=2e-3)


def test_result_forms() -> None:
    result = identify(ALL, rich(0.05), processing=Processing(cutoff=30.0))
    json.dumps(result.to_dict(), allow_nan=False)
    table = next(block for block in result.section().blocks if isinstance(block, Table))
    assert table.rows[0][0] == "J"
    assert [axes.get_ylabel() for axes in result.plot().axes] == ["torque [N m]", "residual [N m]"]
    assert "4 of 4 parameters identified" in result.summary()


@pytest.mark.parametrize("seed", [200, 201])
@pytest.mark.slow
def test_friction_by_load_does_not_explain_the_torque_by_itself(designs: Path, seed: int) -> None:
    design = Design.read(designs / "seed_motor.toml").with_effect("load_dependent_friction", {"mu": 0.06})
    # driven by friction alone, the torque is a share of itself: mu = 1 and no inertia would fit it to the last digit
    slow = simulate(design, scenario("reversal", design, speed=80.0, frequency=0.31, cycles=9.0), seed=seed)
    lone = identify(design, slow)
    assert [notice.code for notice in lone.notices] == ["as_stated"]
    assert "mu" not in lone.estimates
    for name, true in (("F_v", 1.68e-4), ("F_c", 0.0213), ("J", design.J)):
        assert lone.estimates[name].value == pytest.approx(true, abs=3.5 * lone.estimates[name].stderr)
    # and its own noise in the column makes that share too large
    rich = identify(design, simulate(design, "identification", seed=seed))
    for name, true in (("mu", 0.06), ("F_c", 0.0213), ("J", design.J)):
        assert rich.estimates[name].value == pytest.approx(true, abs=3.5 * rich.estimates[name].stderr)


def test_a_datasheet_without_friction_gets_that_of_every_axis() -> None:
    """It answered "0 of 1 parameters identified" with 95 % of the torque left."""
    t = np.arange(20000) / 1000.0
    speed = 12 * np.sin(2.1 * t) + 6 * np.sin(5.3 * t)
    acceleration = 12 * 2.1 * np.cos(2.1 * t) + 6 * 5.3 * np.cos(5.3 * t)
    log = made_log(speed, acceleration, t, 0.01, extra=-TRUE["T_0"])
    found = identify(design(), log)
    for name in ("J", "F_c", "F_v"):
        assert found.estimates[name].value == pytest.approx(TRUE[name], rel=0.02), name
    assert found.estimates["F_v"].nominal is None, "the design states none"
    assert found.estimates["J"].nominal == 0.0102
    assert {entry.id for entry in found.design.effects} == {"coulomb", "viscous"}
    assert "F_c" in found.summary()

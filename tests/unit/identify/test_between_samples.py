"""Errors by the torque between the samples: against a closed form, and on the speed sweep of the simulated drive."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl import Design, Log, identify, simulate
from pmsm_ctrl.identify.between_samples import UNIFORM, UNSTATED
from tests.effort import seeds

DESIGN = Design.from_toml(
    "name = 'axis'\n[motor]\nJ = 1e-4\np = 4\npsi_f = 0.1666666666666667\nR = 1.0\nL_d = 0.001\nL_q = 0.001\n"
    "[drive]\nf_control = 16000.0\nu_dc = 300.0\ni_max = 10.0\n"
    "[[effects]]\nid = 'coulomb'\nF_c = 0.02\n[[effects]]\nid = 'viscous'\nF_v = 1e-4\n"
)


def recorded(share: float, noise: float = 1e-3, seed: int = 1) -> Log:
    """Return a log with this share of the acceleration's torque around half of the log's rate; K_t is one."""
    t = np.arange(12_000) * 1e-3
    a, b = 2.0 * np.pi * 0.4, 2.0 * np.pi * 0.9
    theta = 60.0 * (1.0 - np.cos(a * t)) / a + 30.0 * (1.0 - np.cos(b * t)) / b
    omega = 60.0 * np.sin(a * t) + 30.0 * np.sin(b * t)
    alpha = 60.0 * a * np.cos(a * t) + 30.0 * b * np.cos(b * t)
    folded = 1e-4 * alpha * share * np.where(np.arange(len(t)) % 2, -1.0, 1.0)
    torque = 1e-4 * alpha + folded + 0.02 * np.sign(omega) + 1e-4 * omega
    return Log({"t": t, "theta": theta, "i_q": torque + noise * np.random.default_rng(seed).standard_normal(len(t))})


@pytest.mark.parametrize("seed", seeds(1, 2, 3))
def test_what_the_torque_holds_at_half_of_the_rate_is_an_error_of_the_inertia(seed: int) -> None:
    """A tenth of J alpha there: a saw tooth met at two places makes J off by up to as much."""
    plain, found = identify(DESIGN, recorded(0.0, seed=seed)), identify(DESIGN, recorded(0.1, seed=seed))
    assert found.estimates["J"].value == pytest.approx(plain.estimates["J"].value, rel=1e-3)
    assert found.estimates["J"].stderr == pytest.approx(UNIFORM * 0.1 * 1e-4, rel=0.1)
    assert "torque_between_samples" in {notice.code for notice in found.notices}
    assert "torque_between_samples" not in {notice.code for notice in plain.notices}
    assert found.estimates["F_c"].stderr < 2.0 * plain.estimates["F_c"].stderr


@pytest.mark.parametrize("seed", seeds(1, 2, 3))
def test_an_inertia_is_known_no_better_than_the_sampling(seed: int) -> None:
    """Stated, the sampling takes its part of the error away: 0.05 % of the inertia."""
    log = recorded(0.0, noise=1e-4, seed=seed)
    unknown, known = (
        identify(design, log).estimates["J"].stderr for design in (DESIGN, DESIGN.replace(log={"sampling": "instant"}))
    )
    assert known < 0.5 * UNSTATED * 1e-4
    assert UNSTATED * 1e-4 < unknown < 1.2 * UNSTATED * 1e-4


def in_steps(held: int, divider: int, rises: float, seed: int) -> tuple[Log, float]:
    """Return a log of every so many control periods of a drive that holds its reference, and its mean less what acts.

    While the reference waits for its next step the speed controller takes its torque back: a saw tooth that grows with
    the speed. The log meets it at a few of its phases alone. K_t is one, the control period 0.1 ms.
    """
    k = np.arange(0, 120_000, divider)
    t = 1e-4 * k
    a, b = 2.0 * np.pi * 0.4, 2.0 * np.pi * 0.9
    theta = 60.0 * (1.0 - np.cos(a * t)) / a + 30.0 * (1.0 - np.cos(b * t)) / b
    omega = 60.0 * np.sin(a * t) + 30.0 * np.sin(b * t)
    alpha = 60.0 * a * np.cos(a * t) + 30.0 * b * np.cos(b * t)
    tooth = (held - 1) / (2.0 * held) - (k % held) / held
    noise = 1e-4 * np.random.default_rng(seed).standard_normal(len(k))
    torque = 1e-4 * alpha + 0.02 * np.sign(omega) + (1e-4 + rises * tooth) * omega
    return Log({"t": t, "theta": theta, "torque": torque + noise}), rises * float(np.mean(tooth))


# Held for ten control periods and logged at every fourth: five phases, the even ones.
@pytest.mark.parametrize(("held", "divider"), [(10, 4), (16, 4), (16, 6), pytest.param(10, 6, marks=pytest.mark.slow)])
@pytest.mark.parametrize("seed", seeds(1, 2))
def test_a_reference_held_for_some_samples_is_an_error_of_what_grows_with_the_speed(
    held: int, divider: int, seed: int
) -> None:
    """A saw tooth of half of F_v omega, met at its first phases: F_v was off by many of its standard errors.

    The mean of q places of a tooth is off by a half of their distance at most, here by (g - 1) / g of that.
    """
    design = DESIGN.replace(drive={"f_control": 1e4})
    rises = 5e-5
    log, off = in_steps(held, divider, rises, seed)
    found, plain = identify(design, log), identify(design, in_steps(held, divider, 0.0, seed)[0])
    F_v = found.estimates["F_v"]
    assert F_v.value - 1e-4 == pytest.approx(off, rel=0.1)
    bound = rises * math.gcd(held, divider) / (2.0 * held)
    assert F_v.stderr == pytest.approx(UNIFORM * bound, rel=0.1)
    assert off < bound
    assert off > 10.0 * plain.estimates["F_v"].stderr
    assert [n.code for n in found.notices].count("torque_between_samples") == 1
    assert "torque_between_samples" not in {n.code for n in plain.notices}


@pytest.mark.parametrize("rate", [1000.0, 16000.0])
def test_a_drive_that_is_no_faster_than_the_log_has_none(rate: float) -> None:
    design = DESIGN.replace(drive={"f_control": rate})
    codes = {notice.code for notice in identify(design, recorded(0.1)).notices}
    assert ("torque_between_samples" in codes) is (rate > 1000.0)


def test_a_log_that_is_stated_to_hold_means_has_none() -> None:
    """A mean over a period has no content at the log's rate: who follows the advice is not warned again."""
    for sampling in ("instant", "mean"):
        stated = DESIGN.replace(log={"sampling": sampling})
        codes = {notice.code for notice in identify(stated, recorded(0.1)).notices}
        assert ("torque_between_samples" in codes) is (sampling == "instant")


@pytest.mark.slow
@pytest.mark.parametrize("seed", seeds(0, 4, 7))
def test_the_inertia_of_a_speed_sweep(designs: Path, seed: int) -> None:
    """It was 1.1 to 1.6 % too small, 2.4 to 3.4 standard errors, without a word."""
    axis = Design.read(designs / "seed_motor.toml")
    found = identify(axis, simulate(axis, "sweep", seed=seed))
    assert found.estimates["J"].stderr > 0.006 * 9e-5
    assert abs(found.estimates["J"].value - 9e-5) < 2.6 * found.estimates["J"].stderr


@pytest.mark.slow
@pytest.mark.parametrize("seed", seeds(0, 4, 7))
def test_the_torque_between_the_samples_of_a_speed_sweep_is_said(designs: Path, seed: int) -> None:
    axis = Design.read(designs / "seed_motor.toml")
    found = identify(axis, simulate(axis, "sweep", seed=seed))
    assert "torque_between_samples" in {notice.code for notice in found.notices}


@pytest.mark.parametrize("divider", seeds(2, 1))
@pytest.mark.parametrize("seed", seeds(0, 4))
def test_a_log_as_fast_as_the_speed_loop_shows_the_inertia(designs: Path, seed: int, divider: int) -> None:
    """It was known to 2 to 4 %: what a filter had left above 250 Hz counted as edges that were logged too late."""
    axis = Design.read(designs / "seed_motor.toml").replace(sensor={"log_divider": divider})
    found = identify(axis, simulate(axis, "sweep", seed=seed))
    assert found.estimates["J"].stderr < 0.002 * 9e-5
    assert found.estimates["J"].value == pytest.approx(9e-5, rel=0.005)

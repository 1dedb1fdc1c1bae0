"""Errors by the torque between the samples: against a closed form, and on the speed sweep of the simulated drive."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl import Design, Log, identify, simulate
from pmsm_ctrl.identify.between_samples import SHARE, UNSTATED
from tests.effort import seeds, slow

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
    """A tenth of J alpha there: J would be off by as much, and half of it bounds what is folded."""
    plain, found = identify(DESIGN, recorded(0.0, seed=seed)), identify(DESIGN, recorded(0.1, seed=seed))
    assert found.estimates["J"].value == pytest.approx(plain.estimates["J"].value, rel=1e-3)
    assert found.estimates["J"].stderr == pytest.approx(SHARE * 0.1 * 1e-4, rel=0.1)
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


# of seed 7 a command that does not show itself could shift the inertia as far
AS_FAR = pytest.mark.xfail(strict=True, reason="what is folded is no more than half of the standard error")


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, slow(4), pytest.param(7, marks=[pytest.mark.slow, AS_FAR])])
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

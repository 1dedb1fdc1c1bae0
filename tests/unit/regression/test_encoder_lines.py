"""The error of an encoder's lines, put into an angle by hand, is found, sized and kept out of friction and inertia."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl import simulate
from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose import diagnose
from pmsm_ctrl.effects.catalogue import catalogue_of
from pmsm_ctrl.effects.structures.interface import LINE_ERROR
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.balances import make_record
from pmsm_ctrl.regression.base_fit import Estimated, base_fit
from pmsm_ctrl.regression.encoder_lines import likely_error
from pmsm_ctrl.regression.timed_record import timed_record
from tests.effort import seeds

J, F_C, F_V = 9e-5, 0.02, 2e-4


@pytest.fixture(scope="module")
def design() -> Design:
    effects = [{"id": "coulomb", "F_c": F_C}, {"id": "viscous", "F_v": F_V}]
    return Design.from_dict({"name": "axis", "motor": {"J": J, "K_t": 1.0}, "effects": effects})


def swinging(lines: int, error: float, seed: int, noise: float = 1e-3, slow: float = 1.0) -> Log:
    """Return a swing, the slower the more lines pass, that is known exactly, its angle off by the lines' error."""
    t = np.arange(20000) / 1000.0
    theta, omega, alpha = np.zeros_like(t), np.zeros_like(t), np.zeros_like(t)
    for size, rate in ((6.0, 2.0 * np.pi * 0.31), (1.7, 2.0 * np.pi * 1.13)):
        size *= 64.0 / lines / slow
        theta += size * np.sin(rate * t)
        omega += size * rate * np.cos(rate * t)
        alpha -= size * rate**2 * np.sin(rate * t)
    torque = J * alpha + F_C * np.sign(omega) + F_V * omega
    torque += noise * np.random.default_rng(seed).standard_normal(t.size)
    return Log({"t": t, "theta": theta + error * np.sin(lines * theta + 0.4), "torque": torque})


def weighted_rest(fit: Estimated) -> float:
    """Return what a fit leaves of the torque, rms."""
    left = fit.record.target[0] - fit.estimate.predicted()[0]
    return float(np.sqrt(np.mean((left * fit.record.weight[0])[fit.record.mask] ** 2)))


@pytest.mark.parametrize("seed", seeds(1, 2))
@pytest.mark.parametrize(("lines", "error"), [(64, 3e-4), (256, 1e-4)])
def test_the_lines_of_an_encoder_are_found_and_become_part_of_the_model(
    design: Design, lines: int, error: float, seed: int
) -> None:
    record = timed_record(design, swinging(lines, error, seed))
    assert record.lines == (lines,)
    assert [note.code for note in record.notes] == ["encoder_lines"]
    fit = base_fit(design, record)
    found = [fit.value(f"{wave} {lines}")[0] for wave in ("sin", "cos")]
    assert np.hypot(*found) * LINE_ERROR * 2.0 * np.pi / lines == pytest.approx(error, rel=0.25)
    # by the same weights: those of `make_record` alone assume that every edge is off by a period
    clean = make_record(design, swinging(lines, 0.0, seed), wrong=record.wrong, edges=record.edges)
    assert weighted_rest(fit) < 1.05 * weighted_rest(base_fit(design, clean))


@pytest.mark.parametrize("seed", seeds(*range(5)))
def test_an_angle_without_error_has_no_lines(design: Design, seed: int) -> None:
    assert timed_record(design, swinging(64, 0.0, seed)).lines == ()


@pytest.mark.parametrize(("lines", "dF_s", "w_s"), [(64, 0.05, 4.0), (64, 0.02, 2.0), (256, 0.05, 0.5)])
def test_friction_that_rises_towards_standstill_is_no_error_of_the_angle(
    design: Design, lines: int, dF_s: float, w_s: float
) -> None:
    log = swinging(lines, 0.0, 1)
    omega = np.gradient(log["theta"], log.t)
    rising = dF_s * np.sign(omega) * np.exp(-((omega / w_s) ** 2))
    assert timed_record(design, log.with_channels(torque=log["torque"] + rising)).lines == ()


def test_lines_are_what_must_not_be_taken_for_a_wave_of_as_many_periods(design: Design) -> None:
    log = swinging(64, 3e-4, 1)
    record = make_record(design, log)
    cogging = catalogue_of(design)["cogging"]
    rivals = cogging.structure.rivals(cogging, {"order": 64.0}, record)
    inside = slice(500, -500)
    # the acceleration that the error feigns, to the first order: -64^2 omega^2 times the error
    swing = J * 64.0**2 * record.signals["omega"] ** 2 * np.sin(64.0 * record.signals["theta"] + 0.4)
    columns = np.array([rival["torque"] for rival in rivals]).T[inside]
    slow = np.abs(record.signals["omega"][inside]) < 4.0  # where a sample is a small part of a line
    left = np.linalg.lstsq(columns[slow], swing[inside][slow], rcond=None)
    assert 1.0 - left[1][0] / np.sum(swing[inside][slow] ** 2) > 0.9
    assert not cogging.structure.rivals(cogging, {"order": 60.0}, record)
    assert not cogging.structure.rivals(cogging, {"order": 16.0}, record)


@pytest.mark.parametrize("seed", seeds(1, 2))
@pytest.mark.parametrize("error", [0.0, 3e-4])
def test_the_lines_of_an_encoder_show_in_a_speed_alone(design: Design, error: float, seed: int) -> None:
    """They were taken for a cogging of their order."""
    log = swinging(64, error, seed)
    log = Log({"t": log.t, "omega": np.gradient(log["theta"], log.t), "torque": log["torque"]})
    assert timed_record(design, log).lines == ((64,) if error > 0.0 else ())


@pytest.mark.parametrize("seed", seeds(1, 2))
@pytest.mark.parametrize("order", [2, 8])
def test_the_error_of_a_resolver_is_part_of_the_model(design: Design, order: int, seed: int) -> None:
    """It was taken for a cogging of its order."""
    error = 2e-3 / order
    record = timed_record(design, swinging(order, error, seed, slow=8.0))
    assert record.lines == (order,)
    assert [note.code for note in record.notes] == ["resolver_error"]
    fit = base_fit(design, record)
    found = [fit.value(f"{wave} {order}")[0] for wave in ("sin", "cos")]
    assert np.hypot(*found) * likely_error(order) == pytest.approx(error, rel=0.1)


@pytest.mark.parametrize("modulated", [False, True])
@pytest.mark.parametrize("order", [2, 8])
def test_a_wave_of_the_torque_is_no_error_of_a_resolver(design: Design, order: int, modulated: bool) -> None:
    log = swinging(order, 0.0, 1, slow=8.0)
    wave = 0.01 * np.sin(order * log["theta"] + 1.1)
    torque = log["torque"] + wave * (10.0 * log["torque"] if modulated else 1.0)
    assert timed_record(design, log.with_channels(torque=torque)).lines == ()


def test_lines_that_only_a_missing_effect_resembles_are_not_said(designs: Path) -> None:
    """Beside the load that is missing nothing is left of the lines that this log seemed to show."""
    axis = Design.read(designs / "seed_motor.toml")
    log = simulate(axis, "reversal", truth=axis.with_effect("constant_load", {"T_0": 0.02}), seed=2)
    found = diagnose(axis, log, candidates=["constant_load", "stribeck", "cogging"], plan=False)
    assert [step.effect for step in found.steps] == ["constant_load"]
    assert found.record.lines  # they stay nuisances of the fit
    assert "encoder_lines" not in {notice.code for notice in found.notices}

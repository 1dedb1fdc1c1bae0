"""What every effect contributes: the parts sum to the prediction, and have the size of what was hidden."""

from __future__ import annotations

import numpy as np
import pytest

from pmsm_ctrl import Design, Log, diagnose
from pmsm_ctrl.diagnose import Diagnosis, final_fit
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.regression.prediction import errors
from tests.effort import seeds

AMPLITUDE, ORDER, NOISE = 4e-3, 12, 1e-3
ELASTIC = 0.5  # share of the breakaway torque up to which a bristle is elastic


def axis() -> Design:
    return Design.from_dict(
        {"name": "axis", "motor": {"J": 1e-4, "K_t": 1.0},
         "effects": [{"id": "coulomb", "F_c": 0.02}, {"id": "viscous", "F_v": 2e-4}]}
    )  # fmt: skip


def moved(z_s: float = 0.0, seconds: float = 12.0) -> dict[str, np.ndarray]:
    """Closed-form motion, and its torque without ripple; with a breakaway deflection friction is a bristle."""
    t = np.arange(0, seconds, 1e-3)
    omega = 8 * np.sin(np.pi * t) + 4 * np.sin(2.6 * np.pi * t + 1)
    theta = -8 / np.pi * np.cos(np.pi * t) - 4 / (2.6 * np.pi) * np.cos(2.6 * np.pi * t + 1)
    alpha = 8 * np.pi * np.cos(np.pi * t) + 10.4 * np.pi * np.cos(2.6 * np.pi * t + 1)
    direction = np.sign(omega)
    if z_s > 0.0:
        share = 0.0
        for k, step in enumerate(np.diff(theta, prepend=theta[0])):
            along = np.sign(step) * share
            share += step / z_s * (1.0 if along < ELASTIC else (1.0 - along) / (1.0 - ELASTIC))
            direction[k] = share
    torque = 1e-4 * alpha + 0.02 * direction + 2e-4 * omega
    return {"t": t, "theta": theta, "omega": omega, "torque": torque, "sign": np.sign(omega), "direction": direction}


def log_of(motion: dict[str, np.ndarray], torque: np.ndarray, seed: int) -> Log:
    noise = np.random.default_rng(seed).normal(0, NOISE, torque.size)
    return Log({"t": motion["t"], "theta": motion["theta"], "omega": motion["omega"], "torque": torque + noise})


@pytest.fixture(scope="module", params=seeds(5, 6))
def found(request: pytest.FixtureRequest) -> Diagnosis:
    motion = moved()
    ripple = AMPLITUDE * np.sin(ORDER * motion["theta"] + 0.7)
    return diagnose(axis(), log_of(motion, motion["torque"] + ripple, request.param), plan=False)


def test_rest_and_effects_sum_to_the_prediction(found: Diagnosis) -> None:
    parts = found.contributions()
    assert list(parts.effects) == [step.name for step in found.steps] == [f"cogging {ORDER}"]
    assert parts.rest + sum(parts.effects.values()) == pytest.approx(parts.predicted, abs=1e-15)
    assert parts.predicted == pytest.approx(found.selection.fit.estimate.predicted()[0], abs=1e-15)
    # of the fit; the errors of the result are those of the design that is written, its log read again
    fit = found.selection.fit
    assert parts.error() == pytest.approx(errors(fit.record, fit.residual)["torque"][1], rel=1e-9)


def test_a_contribution_is_what_was_hidden(found: Diagnosis) -> None:
    parts = found.contributions()
    theta = np.interp(parts.t, found.record.prepared.t, moved()["theta"][: len(found.record.prepared.t)])
    hidden = AMPLITUDE * np.sin(ORDER * theta + 0.7)
    slow = parts.used & (np.abs(np.gradient(theta, parts.t)) < 4.0)  # the filter of the balances leaves it as it is
    assert np.sqrt(np.mean((parts.effects[f"cogging {ORDER}"] - hidden)[slow] ** 2)) < 0.05 * AMPLITUDE


def test_without_the_effect_the_residual_is_the_effect_and_noise(found: Diagnosis) -> None:
    """Independent parts add in squares: the error with the ripple switched off follows from its amplitude."""
    parts = found.contributions()
    name = f"cogging {ORDER}"
    assert parts.residual((name,)) == pytest.approx(parts.measured - parts.rest, abs=1e-15)
    size = np.mean(parts.measured[parts.used] ** 2)
    expected = np.sqrt(parts.error() ** 2 + 0.5 * AMPLITUDE**2 / size)
    assert parts.error((name,)) == pytest.approx(expected, rel=0.05)


@pytest.fixture
def without_profiles(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave out the intervals of nonlinear parameters: of a bristle they take four times as long as all the rest."""
    monkeypatch.setattr(final_fit, "with_profiles", lambda design, fit: fit)


@pytest.mark.usefixtures("without_profiles")
def test_a_bristle_contributes_the_lag_of_the_friction() -> None:
    """Source of the law that the test integrates by itself: Dupont et al., IEEE Trans. Automat. Control 47 (2002)."""
    motion = moved(z_s=0.012, seconds=6.0)
    log, other = (log_of(motion, motion["torque"], seed) for seed in (7, 8))
    result = diagnose(axis(), log, holdout=other, candidates=("presliding",), plan=False)
    assert [step.effect for step in result.steps] == ["presliding"]
    parts = result.contributions()
    (lag,) = parts.effects.values()
    assert parts.rest + lag == pytest.approx(parts.predicted, abs=1e-15)
    expected = result.record.shaped(0.02 * (motion["direction"] - motion["sign"]))  # through the balances' filter
    used = parts.used
    assert np.corrcoef(lag[used], expected[used])[0, 1] > 0.9
    assert np.std(lag[used]) == pytest.approx(np.std(expected[used]), rel=0.25)
    assert parts.error(tuple(parts.effects)) > 2.0 * parts.error()
    held = result.held_out(0)["torque"]
    (lag,) = held.effects.values()
    assert np.corrcoef(lag[held.used], expected[held.used])[0, 1] > 0.9
    assert held.error() == pytest.approx(result.steps[-1].holdout_after["torque"]["relative"], rel=1e-9)
    with pytest.raises(RequestError, match="held-out record 1: there are 1"):
        result.held_out(1)


def test_unknown_names_are_refused(found: Diagnosis) -> None:
    with pytest.raises(RequestError, match="this log has torque"):
        found.contributions("u_q")
    with pytest.raises(RequestError, match="did you mean 'cogging 12'"):
        found.contributions().residual(("cogging",))

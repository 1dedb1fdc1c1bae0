"""The statistics of the diagnosis against closed forms and simulation."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import chi2

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose import diagnose
from pmsm_ctrl.diagnose.candidates import Candidate
from pmsm_ctrl.diagnose.limits import detection_limits
from pmsm_ctrl.diagnose.made_ready import condition
from pmsm_ctrl.diagnose.policy import POLICY
from pmsm_ctrl.diagnose.search import plain_evidence
from pmsm_ctrl.effects.catalogue import CATALOGUE
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.evidence.whitening import make_whitener
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.columns import effect_group
from pmsm_ctrl.regression.covariance import noise_covariance
from pmsm_ctrl.regression.model import solve_model
from pmsm_ctrl.regression.reversals import timed_sign
from pmsm_ctrl.simulate import scenario, simulate
from tests.effort import seeds, slow


@pytest.mark.parametrize("seed", seeds(1, 2))
@pytest.mark.slow
def test_the_estimates_own_weights_raise_no_more_alarms_than_they_say(designs, seed: int) -> None:
    """Coloured noise (autoregressive, 0.9) in place of the residual: p below 5 % in about 5 % of 400 draws."""
    design = Design.read(designs / "seed_motor.toml")
    fit = diagnose(design, simulate(design, "identification", seed=3), candidates=("constant_load",)).selection.fits[0]
    record, model = fit.record, fit.plain.model
    rng = np.random.default_rng(seed)
    load = effect_group(record, CATALOGUE["constant_load"], {})
    candidate = Candidate(CATALOGUE["constant_load"], ({},))
    below = []
    for _ in range(200):
        # far smaller than the tolerances of the parameters, which stay out of it so
        noise = np.array([lfilter([1.0], [1.0, -0.9], rng.standard_normal(record.target.shape[1])) for _ in range(3)])
        drawn = replace(record, target=1e-3 * noise / np.maximum(record.weight, 1e-3))
        noise = drawn.target, drawn.weight, drawn.mask, drawn.rate, 0
        whitener, weights = make_whitener(*noise), make_whitener(*noise, 0)
        solved = solve_model(drawn, replace(model, nominal=0.0 * model.nominal), weights)
        below.append(plain_evidence(noise_covariance(solved, weights, whitener), candidate, load)[1] < 0.05)
    # 200 draws know 5 % to 1.5 %; taken as independent, such noise would give 65 %
    assert 0.005 <= np.mean(below) <= 0.10


@pytest.mark.parametrize("seed", seeds(1, 2))
@pytest.mark.parametrize(("effect", "symbols"), [("constant_load", 1), ("cogging", 2)])
@pytest.mark.slow
def test_amount_that_a_log_shows_is_found_half_the_time(designs, effect: str, symbols: int, seed: int) -> None:
    """White noise and the effect at that amount, 2000 draws: the chi-square test passes in half of them."""
    design = Design.read(designs / "seed_motor.toml")
    fit = condition(design, (simulate(design, "identification", seed=seed),), (), {}, POLICY).fit(())
    shape = {"order": 24.0} if effect == "cogging" else {}
    group = effect_group(fit.record, CATALOGUE[effect], shape)
    level = 1e-3
    amount = detection_limits(fit.solved, fit.whitener, group, level)[0]
    rng = np.random.default_rng(seed)
    solved = fit.solved
    white = [
        np.zeros((symbols, basis.shape[1])) if columns is None else fit.whitener.part(row, columns)
        for row, (columns, basis) in enumerate(zip(group.rows, solved.bases, strict=True))
    ]
    z = np.vstack([np.concatenate(white, axis=1).T, np.zeros((len(solved.rest) - solved.rows, symbols))])
    balances = [basis.T @ solved.mixing[part] for basis, part in zip(solved.bases, solved.parts, strict=True)]
    q = np.vstack([*balances, solved.mixing[solved.parts[-1].stop :]])
    z -= q @ (q.T @ z)
    hits = 0
    for _ in range(2000):
        y = z[:, 0] * amount + rng.standard_normal(len(z))
        fitted = np.linalg.solve(z.T @ z, z.T @ y)
        hits += float(fitted @ z.T @ z @ fitted) > chi2.isf(level, symbols)
    assert hits / 2000 == pytest.approx(0.5, abs=0.05)


def test_timed_sign_keeps_the_area() -> None:
    t = np.arange(200) * 1e-3
    for moment in (0.1002, 0.1005, 0.1009):
        sign = timed_sign(t - moment)
        area = float(np.sum(0.5 * (sign[1:] + sign[:-1])) * 1e-3)
        assert area == pytest.approx((t[-1] - moment) - moment, abs=1e-12)


def test_result_is_json_with_the_agreed_keys(designs) -> None:
    design = Design.read(designs / "seed_motor.toml")
    truth = design.with_effect("constant_load", {"T_0": 0.004})
    motion = scenario("identification", design, duration=10.0)
    result = diagnose(design, simulate(design, motion, truth=truth, seed=1))
    data = json.loads(json.dumps(result.to_dict(), allow_nan=False))
    assert data["schema"] == "pmsm-ctrl/diagnosis/1"
    assert data["verdict"] == "effects_missing"
    assert set(data["errors"]) >= {"nominal", "final", "noise_floor"}
    assert set(data["errors"]["final"]["torque"]) == {"rms", "unit", "relative"}
    step = data["steps"][0]
    for key in ("effect", "equivalents", "parameters", "error_before", "error_after", "holdout_before", "evidence"):
        assert key in step
    assert step["parameters"]["T_0"]["unit"] == "N m"
    for key in ("effect", "explained", "p_value", "accepted", "why_not"):
        assert key in data["ranking"][0]
    for key in ("parameter", "nominal", "estimate", "stderr", "flagged"):
        assert key in data["parameter_deviations"][0]
    text = result.summary(width=200)
    assert text.index("1 missing effect: Constant load torque.") < text.index("T_0")
    assert result.plot().axes
    assert [row["why_not_code"] for row in data["ranking"] if not row["accepted"]].count("") == 0


def test_unknown_candidate_is_refused(designs) -> None:
    design = Design.read(designs / "seed_motor.toml")
    log = simulate(design, scenario("triangle", design, cycles=1.0), seed=1)
    with pytest.raises(RequestError, match="did you mean 'cogging'"):
        diagnose(design, log, candidates=["coging"])


@pytest.mark.parametrize("every", [slow(20), 50])
def test_a_log_too_slow_for_any_spring_is_diagnosed(designs, every: int) -> None:
    design = Design.read(designs / "seed_motor.toml")
    log = simulate(design, "identification", seed=1)
    slow = Log({name: values[::every] for name, values in log.channels.items()})
    assert diagnose(design, slow).record.prepared.cutoff < 10.0


def test_one_speed_excites_nothing(designs) -> None:
    design = Design.read(designs / "seed_motor.toml")
    log = simulate(design, "multisine", seed=1).between(3.0, 20.0)
    steady = diagnose(design.replace(scenarios={}), log)
    assert steady.verdict in ("not_excited", "consistent")
    assert not steady.steps

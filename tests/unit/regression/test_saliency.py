"""The reluctance torque of inductances that are off inside their tolerance, in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from pmsm_ctrl import Design, diagnose
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.balances import make_record
from pmsm_ctrl.regression.reluctance import saliency_torque
from pmsm_ctrl.regression.sampling_terms import SALIENCY
from tests.effort import seeds

P, PSI, L_D, L_Q, J, F_C, F_V = 4, 0.05, 4e-3, 7e-3, 1e-3, 0.1, 2e-4
OFF = 0.9  # true L_q over the datasheet's


def design(L_d: float = L_D) -> Design:
    motor = {"J": J, "p": P, "psi_f": PSI, "R": 0.5, "L_d": L_d, "L_q": L_Q}
    effects = [{"id": "coulomb", "F_c": F_C}, {"id": "viscous", "F_v": F_V}]
    return Design.from_dict({"name": "salient", "motor": motor, "effects": effects})


def least_current(torque: np.ndarray, L_q: float) -> tuple[np.ndarray, np.ndarray]:
    """Return i_d and i_q of the most torque per ampere, by the condition on the current's angle, and bisection."""
    low, high = np.zeros_like(torque), np.full_like(torque, 200.0)
    for _ in range(60):
        i_q = 0.5 * (low + high)
        i_d = (PSI - np.hypot(PSI, 2.0 * (L_q - L_D) * i_q)) / (2.0 * (L_q - L_D))
        more = 1.5 * P * (PSI + (L_D - L_q) * i_d) * i_q < np.abs(torque)
        low, high = np.where(more, i_q, low), np.where(more, high, i_q)
    i_q = 0.5 * (low + high) * np.sign(torque)
    return (PSI - np.hypot(PSI, 2.0 * (L_q - L_D) * i_q)) / (2.0 * (L_q - L_D)), i_q


def moved(seed: int, lost: float = 0.0) -> Log:
    """Sines of speed at the most torque per ampere; `lost` is the share of it that a saturation takes per ampere."""
    t = 1e-3 * np.arange(12_000)
    a, w, z = np.array([[80.0], [40.0]]), 2.0 * np.pi * np.array([[0.9], [2.3]]), np.array([[0.3], [1.0]])
    omega, alpha = (a * np.sin(w * t + z)).sum(axis=0), (a * w * np.cos(w * t + z)).sum(axis=0)
    theta = (a / w * (np.cos(z) - np.cos(w * t + z))).sum(axis=0)
    torque = J * alpha + F_C * np.sign(omega) + F_V * omega
    i_d, i_q = least_current(torque, OFF * L_Q)
    i_q = i_q * (1.0 + lost * np.abs(i_q))
    noise = np.random.default_rng(seed).normal(0.0, 1e-3, (2, len(t)))
    return Log({"t": t, "theta": theta, "i_q": i_q + noise[0], "i_d": i_d + noise[1]})


def test_there_is_none_without_saliency_or_of_an_i_q_alone() -> None:
    log = moved(1)
    assert saliency_torque(make_record(design(), log)) is not None
    assert saliency_torque(make_record(design(L_Q), log)) is None
    alone = Log({name: log[name] for name in ("t", "theta", "i_q")})
    assert saliency_torque(make_record(design(), alone)) is None


def test_there_is_none_of_a_constant_current_along_d() -> None:
    """It makes as much of any torque: an inertia of a log with a load that the model lacks was 3 % off."""
    log = moved(1)
    load = saliency_torque(make_record(design(), log.with_channels(i_d=np.full(len(log), -4.0))))
    assert load is not None
    assert np.max(np.abs(load)) < 1e-9 * 1.5 * P * 4.0 * np.max(np.abs(log["i_q"]))


@pytest.mark.parametrize("seed", seeds(1, 2, 3))
def test_an_inductance_that_is_off_is_no_saturation(seed: int) -> None:
    """Saturations were named in four clean logs of salient motors at the most torque per ampere."""
    found = diagnose(design(), moved(seed), plan=False)
    assert found.steps == ()
    fit = found.selection.fit
    k = fit.model.names.index(SALIENCY)
    assert fit.model.sigma[k] == pytest.approx(0.2 * np.hypot(L_D, L_Q))  # what the usual tolerances allow
    assert abs(fit.plain.values[k]) == pytest.approx((1.0 - OFF) * L_Q, rel=0.25)


def test_a_saturation_beside_it_has_its_name() -> None:
    found = diagnose(design(), moved(1, lost=0.02), plan=False)
    assert [step.effect for step in found.steps] == ["torque_saturation"]

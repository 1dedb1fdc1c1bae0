"""The reluctance torque of an i_d that a current loop without decoupling lets through, and that no channel holds."""

from __future__ import annotations

import numpy as np
import pytest

from pmsm_ctrl import Design, diagnose
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.balances import make_record
from pmsm_ctrl.regression.reluctance import coupling_torque
from pmsm_ctrl.regression.sampling_terms import COUPLED
from tests.effort import seeds

P, PSI, L_D, L_Q, J, F_C, F_V = 4, 0.1, 0.015, 0.04, 3e-4, 0.02, 2e-4
K_T, K_I = 1.5 * P * PSI, 300.0  # N m/A; V/(A s), of a slow current controller


def salient(L_d: float = L_D) -> Design:
    motor = {"J": J, "p": P, "psi_f": PSI, "R": 1.0, "L_d": L_d, "L_q": L_Q}
    effects = [{"id": "coulomb", "F_c": F_C}, {"id": "viscous", "F_v": F_V}]
    return Design.from_dict({"name": "axis", "motor": motor, "effects": effects})


def moved(seed: int, coupled: bool, logged: bool = False) -> Log:
    """Return sines whose current makes up for the torque that i_d takes, in closed form but for that current."""
    t = 1e-3 * np.arange(12_000)
    a, w, z = np.array([[120.0], [60.0]]), 2.0 * np.pi * np.array([[0.7], [1.9]]), np.array([[0.3], [1.0]])
    omega, alpha = (a * np.sin(w * t + z)).sum(axis=0), (a * w * np.cos(w * t + z)).sum(axis=0)
    theta = (a / w * (np.cos(z) - np.cos(w * t + z))).sum(axis=0)
    torque = J * alpha + F_C * np.tanh(omega / 0.05) + F_V * omega
    i_q, i_d = torque / K_T, np.zeros(len(t))
    for _ in range(20 if coupled else 0):
        i_d = np.gradient(omega * L_Q * i_q, t) / K_I
        i_q = torque / (K_T + 1.5 * P * (L_D - L_Q) * i_d)
    i_q = i_q + np.random.default_rng(seed).normal(0.0, 2e-3, len(t))
    return Log({"t": t, "theta": theta, "i_q": i_q} | ({"i_d": i_d} if logged else {}))


def test_it_grows_with_the_rate_of_the_coupling_voltage() -> None:
    log = moved(1, coupled=False)
    record = make_record(salient(), log)
    found = coupling_torque(record)
    assert found is not None
    i_q, omega = record.signals["torque"] / K_T, record.signals["omega"]
    expected = 1.5 * P * (L_Q - L_D) * i_q * np.gradient(omega * L_Q * i_q, record.prepared.t)
    inside = slice(200, -200)
    assert np.std((found - expected)[inside]) < 0.02 * np.std(expected[inside])
    assert coupling_torque(make_record(salient(L_Q), log)) is None
    assert coupling_torque(make_record(salient(), moved(1, coupled=False, logged=True))) is None


@pytest.mark.parametrize("seed", seeds(1, 2, 3))
def test_it_is_no_saturation(seed: int) -> None:
    """The current is up to 0.019 A of 0.66 A too large where the axis accelerates, and a saturation was named."""
    found = diagnose(salient(), moved(seed, coupled=True), plan=False)
    assert found.steps == ()
    assert found.verdict == "consistent"
    fit = found.selection.fit
    k = fit.model.names.index(COUPLED)
    value, stderr = float(fit.plain.values[k]), float(fit.plain.stderr[k])
    assert value == pytest.approx(1.0 / K_I, abs=4.0 * stderr)
    assert stderr < 0.02 / K_I

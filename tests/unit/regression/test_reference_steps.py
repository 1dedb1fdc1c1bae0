"""Voltages that are instants in step with a held reference: what the log shows of it is in the model."""

from __future__ import annotations

import numpy as np
import pytest

from pmsm_ctrl import Design, diagnose
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression import balances, reference_steps
from pmsm_ctrl.regression.balances import make_record
from tests.effort import seeds

P, PSI, R, L, J, F_C, F_V = 4, 0.055, 1.8, 4e-3, 2.6e-4, 0.18, 2.7e-4
K_T, RATE = 1.5 * P * PSI, 4000.0
DESIGN = Design.from_dict(
    {
        "name": "axis",
        "motor": {"J": J, "p": P, "psi_f": PSI, "R": R, "L_d": L, "L_q": L},
        "drive": {"u_dc": 300.0, "i_max": 20.0, "f_control": 8000.0},
        "effects": [{"id": "coulomb", "F_c": F_C}, {"id": "viscous", "F_v": F_V}],
    }
)


def log_of(by_speed: tuple[float, ...], by_acceleration: tuple[float, ...], seed: int, seconds: float = 12.0) -> Log:
    """Return sines of the speed, whose q voltage has these shares of speed and acceleration in turn, V s and V s^2."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds * RATE)) / RATE
    a, w, z = np.array([[60.0], [40.0]]), 2.0 * np.pi * np.array([[0.5], [1.3]]), np.array([[0.3], [1.0]])
    omega, alpha = (a * np.sin(w * t + z)).sum(axis=0), (a * w * np.cos(w * t + z)).sum(axis=0)
    theta = (a / w * (np.cos(z) - np.cos(w * t + z))).sum(axis=0)
    i_q = (J * alpha + F_C * np.tanh(omega / 0.05) + F_V * omega) / K_T
    u_q = R * i_q + L * np.gradient(i_q, t) + P * PSI * omega
    u_q += np.resize(by_speed, len(t)) * omega + np.resize(by_acceleration, len(t)) * alpha
    noise = rng.normal(0.0, [[5e-3], [0.05], [0.05]], (3, len(t)))
    channels = {"t": t, "theta": theta, "i_q": i_q + noise[0], "i_d": np.zeros(len(t))}
    return Log({**channels, "u_d": -P * omega * L * i_q + noise[1], "u_q": u_q + noise[2]})


@pytest.mark.parametrize("seed", seeds(1, 2))
def test_it_is_found_by_the_places_of_the_period(seed: int) -> None:
    shares, none = (0.1, 0.02, -0.02, 0.0), (0.0,)
    found = make_record(DESIGN, log_of(shares, none, seed)).prepared.swings["u_q"]
    assert found[0] == pytest.approx(np.std(shares), rel=0.03)
    assert make_record(DESIGN, log_of(none, none, seed)).prepared.swings == {}
    assert make_record(DESIGN, log_of((0.05,), (1e-3,), seed)).prepared.swings == {}  # at every place alike
    other = make_record(DESIGN, log_of(none, (1e-3, -4e-4), seed)).prepared.swings["u_q"]
    assert other[1] == pytest.approx(7e-4, rel=0.03)


@pytest.mark.parametrize("seed", seeds(1, 2))
def test_no_winding_is_off_and_no_dead_time_missing_for_it(monkeypatch: pytest.MonkeyPatch, seed: int) -> None:
    """The mean of these shares is 14 % of the back-emf, and a tenth of the drop at the resistance."""
    log = log_of((-0.08, -0.03, -0.02, 0.006), (1.2e-3, -3e-4, -2e-4, 1e-4), seed)
    found = diagnose(DESIGN, log, plan=False)
    assert found.steps == ()
    assert [one.parameter for one in found.parameter_deviations if one.flagged] == []
    monkeypatch.setattr(balances, "with_swings", lambda design, log, prepared: prepared)
    without = diagnose(DESIGN, log, plan=False)
    assert "psi_f" in [one.parameter for one in without.parameter_deviations if one.flagged]


def test_what_every_place_has_of_a_fast_signal_is_no_swing() -> None:
    """Edges of the acceleration are fast themselves; two dead times of clean means were lost for them."""
    along = np.sign(np.sin(0.05 * np.arange(4000)))
    place = np.arange(4000) % 4
    own = np.array([0.2, 0.0, -0.2, 0.0])
    product = (0.3 + own[place]) * along * along
    share, error = reference_steps._shares(along**2, product, product**2, place, 4)
    assert share == pytest.approx(own)
    assert np.all(error > 0.0)

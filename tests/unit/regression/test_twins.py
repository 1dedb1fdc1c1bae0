"""Parameters of the design that no motion of a log tells apart: the sum of their terms is known, and no share of it."""

from __future__ import annotations

import numpy as np
import pytest

from pmsm_ctrl import Design
from pmsm_ctrl.compare import compare
from pmsm_ctrl.diagnose import diagnose
from pmsm_ctrl.log import Log
from tests.effort import seeds

J, F_C, F_V, T_H, K_E, T_0 = 9e-5, 0.0213, 1.68e-4, 0.003, 3.2e-5, 0.05


def design(*effects: dict[str, object]) -> Design:
    dry = [{"id": "coulomb", "F_c": 0.02}, {"id": "viscous", "F_v": 1.8e-4}]
    return Design.from_dict({"motor": {"J": 9.4e-5, "K_t": 1.0, "p": 4}, "effects": [*dry, *effects]})


def moved(seed: int, offset: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Seven sines of the speed beside a constant one."""
    t = np.arange(12000) / 1000.0
    f, a = np.array([0.05, 0.11, 0.37, 0.83, 1.7, 3.1, 5.3]), np.array([40.0, 90.0, 60.0, 30.0, 15.0, 8.0, 4.0])
    x = 2.0 * np.pi * np.outer(t, f) + seed + np.arange(7.0)
    theta = (-a / (2.0 * np.pi * f) * np.cos(x)).sum(1) + offset * t
    return t, theta, (a * np.sin(x)).sum(1) + offset, (a * 2.0 * np.pi * f * np.cos(x)).sum(1)


def log_of(seed: int, offset: float, extra: tuple[float, float]) -> Log:
    """Dry and viscous friction, and an extra share of each."""
    t, theta, omega, alpha = moved(seed, offset)
    torque = J * alpha + (F_C + extra[0]) * np.sign(omega) + (F_V + extra[1]) * omega
    return Log({"t": t, "theta": theta, "torque": torque + 1e-3 * np.random.default_rng(seed).normal(size=t.size)})


@pytest.mark.parametrize("seed", seeds(1, 2, 3))
def test_iron_losses_stay_as_stated_beside_friction(seed: int) -> None:
    losses = {"id": "iron_loss", "T_h": T_H, "k_e": K_E / 4.0}  # half of the friction was given to each, to 0.1 %
    log = log_of(seed, 0.0, (T_H, K_E))
    found = diagnose(design(losses), log, plan=False)
    assert str(found.verdict) == "consistent"
    assert [notice.code for notice in found.notices] == ["as_stated"]
    for effect, symbol, true in (("coulomb", "F_c", F_C), ("viscous", "F_v", F_V)):
        entry = next(one for one in found.design.effects if one.id == effect)
        assert abs(entry.parameters[symbol] - true) < 4.0 * entry.stderr[symbol]
    stated = next(one for one in found.design.effects if one.id == "iron_loss")
    assert dict(stated.parameters) == {"T_h": T_H, "k_e": K_E / 4.0}
    assert not stated.stderr
    assert compare(found.design, log).log.errors["torque"].relative < 0.01


@pytest.mark.parametrize("seed", seeds(1, 2, 3))
def test_a_load_stays_as_stated_in_one_direction(seed: int) -> None:
    """The axis turns one way: the load is a part of the dry friction."""
    log = log_of(seed, 300.0, (T_0, 0.0))
    found = diagnose(design({"id": "constant_load", "T_0": T_0}), log, plan=False)
    assert "as_stated" in [notice.code for notice in found.notices]
    assert found.base["T_0"].value == pytest.approx(T_0, rel=1e-6)
    assert np.isnan(found.base["T_0"].stderr)
    assert abs(found.base["F_c"].value - F_C) < 4.0 * found.base["F_c"].stderr

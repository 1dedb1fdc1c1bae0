"""A speed that an observer tells, too large around its own frequency: no spring and no gap, and no event."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.signal import bilinear, lfilter

from pmsm_ctrl import Design, Log, simulate
from pmsm_ctrl.diagnose import diagnose
from pmsm_ctrl.effects.structures.paths import OBSERVERS, observed_path, voltage_path
from tests.effort import seeds, slow


def observed(omega: np.ndarray, period: float, w: float) -> np.ndarray:
    """Return a speed as a tracking observer of damping 0.5 sees it: (w s + w^2) / (s^2 + w s + w^2)."""
    return np.asarray(lfilter(*bilinear([w, w**2], [1.0, w, w**2], 1.0 / period), omega))


@pytest.mark.parametrize("tau", [OBSERVERS[2], OBSERVERS[3]])
def test_what_an_observer_adds_is_one_of_its_columns(tau: float) -> None:
    """The true acceleration, in closed form, is what is seen and the column of that observer, over the inertia."""
    T, J = 2e-5, 2e-4
    t = np.arange(100_000) * T
    rates = 2.0 * np.pi * np.array([1.0, 7.0, 19.0])
    omega, alpha = np.sin(np.outer(t, rates)).sum(1), (rates * np.cos(np.outer(t, rates))).sum(1)
    seen = np.gradient(observed(omega, T, 1.0 / tau), T)
    balances: Any = SimpleNamespace(
        angle=False, period=T, signals={"alpha": seen}, rate_of=lambda x: np.gradient(x, T),
        design=SimpleNamespace(J=J, log=SimpleNamespace(of=lambda name: SimpleNamespace(stated=False))),
    )  # fmt: skip
    column = observed_path(balances)[OBSERVERS.index(tau)]["torque"]
    settled = slice(50_000, 99_000)
    assert np.std((seen - alpha)[settled]) > 0.05 * np.std(alpha)
    assert (seen + column / J)[settled] == pytest.approx(alpha[settled], abs=5e-3 * np.std(alpha))


def test_a_speed_that_is_stated_or_beside_a_position_has_none() -> None:
    for angle, stated in ((True, False), (False, True)):
        log = SimpleNamespace(of=lambda name, stated=stated: SimpleNamespace(stated=stated))
        balances: Any = SimpleNamespace(angle=angle, design=SimpleNamespace(log=log))
        assert observed_path(balances) == []


def test_a_voltage_that_is_late_or_averaged_differs_by_its_slopes() -> None:
    """By half of a period later, and by the mean over one: a Taylor series in closed form, at 12 Hz and 1 kHz."""
    T, w, peak = 1e-3, 2.0 * np.pi * 12.0, 30.0
    t = np.arange(2000) * T
    motor = SimpleNamespace(p=4, psi_f=0.1)
    balances: Any = SimpleNamespace(
        angle=True, period=T, signals={"u_d": np.cos(w * t), "u_q": peak * np.sin(w * t), "omega": t},
        rate_of=lambda x: np.gradient(x, T), design=SimpleNamespace(motor=motor),
    )  # fmt: skip
    slope, curve = (one["u_q"] for one in voltage_path(balances) if "u_q" in one)
    here = slice(5, -5)
    late = peak * (np.sin(w * (t - 0.5 * T)) - np.sin(w * t))
    assert (-0.5 * slope + 0.125 * curve)[here] == pytest.approx(late[here], abs=2e-3 * np.abs(late).max())
    mean = peak * np.sin(w * t) * (np.sinc(w * T / 2.0 / np.pi) - 1.0)
    assert (curve / 24.0)[here] == pytest.approx(mean[here], abs=5e-3 * np.abs(mean).max())
    balances.angle = False  # the back-emf holds a speed that may be late as well
    assert [list(one) for one in voltage_path(balances)] == [["u_d"]] * 2 + [["u_q"]] * 4


@pytest.mark.parametrize("seed", seeds(5, 6))
@pytest.mark.parametrize("frequency", [25.0, slow(12.0)])
def test_an_excited_log_of_an_observed_speed_has_no_brake(designs: Path, frequency: float, seed: int) -> None:
    """The multisines were two brakes, and the verdict `unexplained`."""
    axis = Design.read(designs / "seed_motor.toml")
    log = simulate(axis, "identification", seed=seed)
    speed = observed(log["omega"], log.period, 2.0 * np.pi * frequency)
    found = diagnose(axis, Log({"t": log.t, "i_q": log["i_q"], "omega": speed}), plan=False)
    assert not found.steps
    assert not found.events
    assert found.verdict.value == "inconclusive"

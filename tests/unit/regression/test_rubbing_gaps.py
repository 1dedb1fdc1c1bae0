"""A load behind a gap that rubs, followed along the motion of its shaft, against closed forms."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from pmsm_ctrl.effects.backlash import effect
from pmsm_ctrl.effects.structures.interface import Known
from pmsm_ctrl.effects.structures.load_table import RigidAxis, made_table, peaks
from pmsm_ctrl.effects.structures.transmission import DAMPING, FREQUENCY, RUBBING

PERIOD, V = 1e-3, 3.0  # s, rad/s
TURNED = 500  # the sample at which the shaft turns round


def passed_on(omega: np.ndarray, gap: float, f: float) -> np.ndarray:
    """What the contact passes on over the load's inertia: the column, and what a rigid load would need."""
    theta = np.concatenate([[0.0], np.cumsum(0.5 * PERIOD * (omega[1:] + omega[:-1]))])
    signals = {"theta": theta, "omega": omega, "alpha": np.zeros_like(omega), "direction": np.sign(omega)}
    balances: Any = SimpleNamespace(signals=signals, period=PERIOD, cutoff=40.0, kept={("alpha", "hard start"): False})
    shape = {"gap": gap, FREQUENCY: 2.0 * np.pi * 150.0, DAMPING: 1.2, RUBBING: f}
    column = effect.structure.columns(balances, effect, shape)[0]["torque"]
    return np.asarray(column + f * signals["direction"])


def turning() -> np.ndarray:
    omega = np.full(1000, V)
    omega[TURNED:] = -V
    return omega


@pytest.mark.parametrize(("gap", "f"), [(0.1, 300.0), (0.05, 900.0), (0.2, 100.0)])
def test_the_load_is_free_until_the_shaft_has_crossed_the_gap(gap: float, f: float) -> None:
    """The load goes on for V^2 / (2 f) and stays; the shaft comes back after (gap + contact - V^2 / (2 f)) / V."""
    got = passed_on(turning(), gap, f)
    free = np.flatnonzero(got[TURNED + 1 :] != 0.0)[0] + 1
    assert free * PERIOD == pytest.approx((gap - V**2 / (2.0 * f)) / V, abs=3.0 * PERIOD)


@pytest.mark.parametrize("f", [100.0, 900.0])
def test_in_contact_the_friction_of_the_load_is_passed_on(f: float) -> None:
    got = passed_on(turning(), 0.02, f)
    assert got[400 : TURNED - 1] == pytest.approx(np.full(TURNED - 401, f), rel=0.02)
    assert got[900:-1] == pytest.approx(np.full(99, -f), rel=0.02)


def test_without_friction_the_load_crosses_the_gap_at_its_own_speed() -> None:
    """The load begins in the middle with the speed of the shaft; they meet at 2 V, half a gap later."""
    got = passed_on(turning(), 0.12, 0.0)
    free = np.flatnonzero(got[TURNED + 1 :] != 0.0)[0] + 1
    assert free * PERIOD == pytest.approx(0.06 / (2.0 * V), abs=3.0 * PERIOD)


def test_the_parameters_hold_the_friction_of_the_load() -> None:
    values = {"gap": 0.02, "J_load": 4e-5, "k": 60.0, "d": 0.03, "F_load": 0.008}
    shape = effect.structure.shape(effect, values)
    assert shape[RUBBING] == pytest.approx(200.0)
    assert effect.structure.parameters(effect, {**shape, "J_load": 4e-5}) == pytest.approx(values)
    assert RUBBING not in effect.structure.shape(effect, {**values, "F_load": 0.0})


def test_the_table_tells_what_a_load_explains() -> None:
    """Against least squares on the same columns, the inertia inside its bounds."""
    rng = np.random.default_rng(11)
    plain, columns, residual = rng.standard_normal((4, 300)), rng.standard_normal((20, 300)), rng.standard_normal(300)
    most = np.full(20, 0.05)
    signals = {name: rng.standard_normal(300) for name in ("theta", "omega")}
    balances: Any = SimpleNamespace(signals=signals, period=PERIOD, shaped=lambda values: values)
    loads = np.column_stack([np.arange(20.0), rng.uniform(0.0, 2.0, 20)])
    weight = rng.uniform(0.2, 1.0, 300)
    axis = RigidAxis(plain, weight, 1.0, 1.0)

    table = made_table(balances, axis, loads, most, lambda some, *_: columns[some])
    for gain, column, (_, f) in zip(table.gains(residual), columns, loads, strict=True):
        whole = weight * np.vstack([plain, column - plain[0] - f * plain[1]])
        low, high = np.array([-np.inf] * 4 + [0.0]), np.array([np.inf] * 4 + [0.05])
        rest = [lsq_linear(whole[:k].T, weight * residual, (low[:k], high[:k])) for k in (4, 5)]
        assert gain == pytest.approx(2.0 * (rest[0].cost - rest[1].cost), rel=1e-3, abs=1e-4)


def test_peaks_are_better_than_all_around_them() -> None:
    table = np.array([[1.0, 2.0, 1.0, 0.0], [0.0, 3.0, 0.0, 5.0], [0.0, 0.0, 0.0, 4.0]])
    assert peaks(table).tolist() == [7, 5]


@pytest.mark.parametrize("F_c", [0.0, -0.3])
def test_a_load_rubs_with_no_more_than_the_axis(F_c: float) -> None:
    """An axis without dry friction had a load that rubs, and nothing could simulate the two (6900079)."""
    low, high = effect.structure.bounds(effect, Known(0.0177, F_c), {RUBBING: 925.0})["J_load"]
    assert low < high < 1.001 * low

"""Friction that bends before it slides, on a sine: around reversals it looks like a torque that is late."""

from __future__ import annotations

import numpy as np
import pytest

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose import diagnose, final_fit
from pmsm_ctrl.diagnose.shapes import trusted
from pmsm_ctrl.log import Log
from pmsm_ctrl.plausibility import examine
from tests.effort import amount, seeds, slow

J, F_C, F_V, Z_B, NOISE = 1e-3, 0.2, 0.002, 0.1, 4e-4
AMPLITUDE, FREQUENCY = 2.0, 0.5  # rad, Hz
DESIGN = Design.from_dict({
    "motor": {"J": J, "K_t": 1.0}, "effects": [{"id": "coulomb", "F_c": F_C}, {"id": "viscous", "F_v": F_V}],
})  # fmt: skip


def bending(z_s: float, seed: int, late: float = 0.0, seconds: float = 20.0) -> Log:
    """A sine of the angle with the friction of an elasto-plastic bristle, in closed form from reversal to reversal.

    Elastic over (1 + z_b) z_s from the level of the other direction; then it tends to its own level over (1 - z_b) z_s.
    """
    t = np.arange(0.0, seconds, 1e-3)
    w = 2.0 * np.pi * FREQUENCY
    theta = -AMPLITUDE * np.cos(w * t)
    half = np.floor(2.0 * FREQUENCY * t)
    side = 1.0 - 2.0 * (half % 2.0)
    x = np.abs(theta + side * AMPLITUDE) / z_s
    x = np.where(half == 0.0, x + 1.0, x)  # the bristle begins straight
    bent = np.where(x < 1.0 + Z_B, x - 1.0, 1.0 - (1.0 - Z_B) * np.exp(-(x - 1.0 - Z_B) / (1.0 - Z_B)))
    torque = J * AMPLITUDE * w**2 * np.cos(w * t) + F_V * AMPLITUDE * w * np.sin(w * t) + F_C * side * bent
    noise = NOISE * np.random.default_rng(seed).normal(size=t.size)
    return Log({"t": t, "theta": theta, "torque": np.interp(t - late, t, torque) + noise})


@pytest.mark.slow
@pytest.mark.parametrize("seed", seeds(1, 2, 3))
@pytest.mark.parametrize("z_s", [0.01, slow(0.002)])
def test_it_is_named_and_its_shapes_are_found(z_s: float, seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    # intervals: tests/unit/diagnose/test_profiles.py
    monkeypatch.setattr(final_fit, "with_profiles", lambda design, fit: fit)
    found = diagnose(DESIGN, bending(z_s, seed, seconds=amount(8.0, 20.0)), plan=False)
    assert [step.effect for step in found.steps] == ["presliding"]
    values = found.steps[0].parameters
    assert values["z_s"].value == pytest.approx(z_s, rel=0.03)
    assert values["z_b"].value == pytest.approx(Z_B, abs=0.03)
    assert found.errors["final"]["torque"]["relative"] < 0.01  # 2 to 13 % with a torque that is moved in time instead


@pytest.mark.parametrize("z_s", [0.003, 0.012, *map(slow, (0.002, 0.006, 0.01, 0.05))])
@pytest.mark.parametrize("seed", seeds(1, 2, 3))
def test_it_is_no_lag_of_the_torque(z_s: float, seed: int) -> None:
    found = examine(DESIGN, bending(z_s, seed))
    assert found.notices == ()
    np.testing.assert_array_equal(found.log["torque"], bending(z_s, seed)["torque"])


@pytest.mark.parametrize("seed", seeds(1, 2, 3))
def test_a_lag_beside_it_is_said(seed: int) -> None:
    found = examine(DESIGN, bending(1e-4, seed, late=0.1))
    assert [notice.code for notice in found.notices] == ["not_synchronous"]


def test_a_step_that_is_trusted_leads_downhill_and_no_further_than_that() -> None:
    rng = np.random.default_rng(7)
    for _ in range(20):
        inverse = rng.normal(size=(3, 5)) * np.array([[0.1], [0.1], [10.0]])  # the third shape hardly matters
        curvature = np.linalg.inv(inverse @ inverse.T)
        step, longest = rng.normal(size=3) * np.array([1.0, 1.0, 50.0]), np.array([0.4, 0.4, 0.4])
        found = trusted(step, inverse, longest)
        assert np.all(np.abs(found) <= longest * (1.0 + 1e-12))
        before, after = (x @ curvature @ x for x in (step, step - found))  # what is left of the sum of squares
        assert after < before
        np.testing.assert_allclose(trusted(step, inverse, 1e3 * np.abs(step)), step, rtol=1e-9)

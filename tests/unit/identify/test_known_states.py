"""Effects with an internal state that the design has: the regression takes them as they are stated."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import uniform_filter1d

from pmsm_ctrl.compare import compare
from pmsm_ctrl.design import Design
from pmsm_ctrl.effects.catalogue import CATALOGUE
from pmsm_ctrl.identify import identify
from pmsm_ctrl.log import Log
from pmsm_ctrl.simulate import simulate
from tests.benchmarks.prescribed import bristle
from tests.effort import seeds

J, F_C, F_V, Z_S, RATE, FINER = 3.8e-3, 0.93, 0.002, 5.5e-3, 1000.0, 4


def staircase(seed: int) -> Log:
    """Steps of the speed with a bristle of Dahl in closed form; without the bristle J comes out 1.4 % low."""
    t = np.arange(0.0, 26.0, 1.0 / (FINER * RATE))
    levels = (-72.0, -48.0, -24.0, 24.0, 48.0, 72.0, 48.0, 24.0, -24.0, -48.0, -24.0, -48.0, -24.0)
    steps = np.repeat(levels, int(2.0 * FINER * RATE))
    omega = uniform_filter1d(uniform_filter1d(steps, int(0.08 * FINER * RATE)), int(0.004 * FINER * RATE))
    theta = np.cumsum(omega) / (FINER * RATE)
    torque = J * np.gradient(omega, t) + F_C * bristle(theta, Z_S, dahl=True) + F_V * omega
    logged = slice(None, None, FINER)
    noise = 5e-3 * np.random.default_rng(seed).normal(size=t[logged].size)
    return Log({"t": t[logged], "theta": theta[logged], "torque": torque[logged] + noise})


@pytest.mark.parametrize("seed", seeds(1, 2, 3))
def test_a_known_bristle_is_part_of_the_model(seed: int) -> None:
    presliding = {"id": "presliding", "z_s": Z_S, "z_b": 0.0, "tau_z": 0.0}
    dry = [{"id": "coulomb", "F_c": 0.8 * F_C}, {"id": "viscous", "F_v": 1.3 * F_V}]
    design = Design.from_dict({"motor": {"J": 1.03 * J, "K_t": 1.0}, "effects": [*dry, presliding]})
    log = staircase(seed)
    found = identify(design, log)
    assert found.improved
    for symbol, true in (("J", J), ("F_c", F_C), ("F_v", F_V)):
        estimate = found.estimates[symbol]
        assert abs(estimate.value - true) < 4.0 * estimate.stderr
        assert estimate.stderr < 0.002 * true
    assert "no_regression" in [notice.code for notice in found.notices]  # its own parameters are not looked for
    seen = compare(found.design, log).log.errors["torque"]
    assert found.relative_error == pytest.approx(seen.relative, rel=1e-3)
    assert seen.rms < 1.5 * seen.floor


@pytest.mark.parametrize("effect", ["compliance", "current_offset"])
def test_the_error_is_that_of_compare(effect: str) -> None:
    """A spring and an offset of the sensors have columns in the model, and stay where the design has them."""
    design = Design.read("designs/hand_tuned.toml").with_effect(effect, dict(CATALOGUE[effect].example))
    log = simulate(design, "identification", seed=1)
    found = identify(design, log)
    assert found.estimates["J"].value == pytest.approx(design.J, rel=0.01)
    seen = compare(found.design, log).log.errors["torque"]
    assert found.relative_error == pytest.approx(seen.relative, rel=0.01)
    assert found.fit.residual[found.problem.mask].std() < 1.1 * seen.floor

"""A drive that holds i_d at a constant: it adds to the magnet's flux linkage, and no log tells the two apart."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pmsm_ctrl.log import Log
from pmsm_ctrl.plausibility import examine
from pmsm_ctrl.plausibility.bins import binned
from pmsm_ctrl.plausibility.relations import evidence_of, fitted
from tests.unit.plausibility.drives import PSI, L, P, R, believed, drawn


def weakened(seed: int, i_d: float, factor: float = 1.0) -> Log:
    """Return a log whose i_d is a constant, with voltages times a factor."""
    log = drawn(seed)
    rng = np.random.default_rng(seed + 1)
    electrical = P * np.gradient(log["theta"], log["t"])
    u_d = log["u_d"] + R * (i_d - log["i_d"])
    u_q = log["u_q"] + electrical * L * (i_d - log["i_d"])
    current = i_d + 1e-4 * rng.standard_normal(len(log))
    return Log(dict(log.channels) | {"i_d": current, "u_d": factor * u_d, "u_q": factor * u_q})


@pytest.mark.parametrize("i_d", [-3.0, -1.0, 2.0])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_voltages_belong_to_the_design(seed: int, i_d: float) -> None:
    log, design = weakened(seed, i_d), believed()
    assert_allclose(evidence_of(design, binned(log)).ratios["psi_f"].value, 1.0, rtol=0.02)
    assert not examine(design, log).contradictions


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_wrong_factor_is_still_told(seed: int) -> None:
    (found,) = examine(believed(), weakened(seed, -3.0, 0.4)).contradictions
    assert found.code == "voltage_factor"


def test_of_two_equal_columns_only_the_sum_is_known() -> None:
    rng = np.random.default_rng(5)
    x, y = rng.standard_normal((2, 500))
    fit = fitted(PSI * x + 0.3 * y + 0.01 * rng.standard_normal(500), {"a": x, "b": -3.0 * x, "c": y})
    assert fit is not None
    assert np.isinf(fit.stderr[:2]).all()
    assert_allclose(fit.value("c"), 0.3, atol=5.0 * fit.stderr[2])
    assert fit.stderr[2] < 0.001

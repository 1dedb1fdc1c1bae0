"""The voltages hold products of speed and current: what lies beyond the band of one comes back into it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl import Design
from pmsm_ctrl.regression.balances import make_record
from pmsm_ctrl.regression.base_fit import base_fit
from tests.effort import amount
from tests.unit.regression.analytic import analytic

# Hz and rad/s: two waves in the band, two beyond its 40 Hz whose product is slow
SLOW, FAST = ((0.7, 60.0), (7.0, 6.0)), ((46.0, 1.5), (49.0, 1.5))


@pytest.fixture(scope="module")
def design(project_root: Path) -> Design:
    return Design.read(project_root / "designs" / "seed_motor.toml")


def test_a_current_beyond_the_band_is_in_the_voltages(design: Design) -> None:
    for seed in range(1, 1 + amount(2, 6)):
        fit = base_fit(design, make_record(design, analytic(design, seed, 120.0, (*SLOW, *FAST))[0]))
        record = fit.record
        assert record.cutoff < FAST[0][0]
        left = (record.target - fit.estimate.predicted())[:, record.mask]
        size = record.target[:, record.mask]
        row = record.channels.index("u_d")
        assert np.std(left[row]) < 1e-3 * np.std(size[row])
        value, _ = fit.value("L_q")
        assert value == pytest.approx(design.motor.L_q, rel=1e-3)

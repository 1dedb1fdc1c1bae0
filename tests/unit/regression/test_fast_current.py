"""A voltage that bends over the current: its column at a current that is faster than the low-pass, and noisy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl import Design
from pmsm_ctrl.effects.catalogue import CATALOGUE
from pmsm_ctrl.effects.evaluate import columns
from pmsm_ctrl.regression.balances import make_record
from pmsm_ctrl.regression.base_fit import base_fit
from pmsm_ctrl.regression.columns import effect_group
from tests.effort import amount
from tests.unit.regression.analytic import analytic

SLOW = ((0.7, 60.0), (2.3, 20.0))  # Hz and rad/s
I_0 = 0.05  # A


@pytest.fixture(scope="module")
def design(project_root: Path) -> Design:
    return Design.read(project_root / "designs" / "seed_motor.toml")


# Hz and rad/s of a wave of the speed, 60 mA of current; A of noise
@pytest.mark.parametrize(("fast", "noise"), [((150.0, 0.73), 1e-4), ((150.0, 0.73), 0.008), ((7.0, 0.0), 0.008)])
def test_the_column_of_a_dead_time_is_that_of_the_true_current(
    design: Design, fast: tuple[float, float], noise: float
) -> None:
    effect = CATALOGUE["dead_time"]
    for seed in range(1, 1 + amount(2, 6)):
        log, i_q = analytic(design, seed, 130.0, (*SLOW, fast), noise)
        record = base_fit(design, make_record(design, log)).record
        row = record.channels.index("u_q")
        made = effect_group(record, effect, {"i_0": I_0}).values[row, :, 0][record.mask]
        known = {"theta": log["theta"], "p": float(design.motor.p or 0), "i_d": np.zeros_like(i_q), "i_q": i_q}
        true = record.shaped(columns(effect, known, {"i_0": I_0})[0]["dU"][1])[record.mask]
        per_volt = float(true @ made) / float(made @ made)
        assert per_volt == pytest.approx(1.0, abs=3e-3)

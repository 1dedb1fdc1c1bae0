"""A linear axis through `tune`: the ripple of its encoder as predicted, and words and units of its own."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pmsm_ctrl.section import Table, present
from pmsm_ctrl.tune.bench import Bench
from pmsm_ctrl.tune.noise import noise
from pmsm_ctrl.tune.proof import RIPPLE_SPEEDS, default_speed
from pmsm_ctrl.tune.tuning import tune
from tests import effort
from tests.linear_motors import COUNTS, linear_motor


@pytest.mark.parametrize("seed", effort.seeds(0, 1, 2, 3))
def test_the_ripple_of_the_encoder_is_as_predicted(seed: int) -> None:
    """It was predicted for steps of 1 um, and simulated with steps of 6.28 um."""
    design = linear_motor(seed).design
    found = noise(tune(design, prove=False).cascade)
    assert found.encoder_ripple == pytest.approx(1.0 / COUNTS / math.sqrt(12.0) * found.encoder_gain)
    speed = default_speed(design)
    quiet = design.replace(sensor={"current_noise": 0.0})
    ideal = quiet.replace(sensor={"encoder_counts": 0})
    coarse, none = (
        np.mean([Bench(design, plant, speed * share).ripple() ** 2 for share in RIPPLE_SPEEDS])
        for plant in (quiet, ideal)
    )
    assert math.sqrt(coarse - none) == pytest.approx(found.encoder_ripple, rel=0.15)


def test_a_linear_axis_has_a_force_and_the_ripples_are_told_apart() -> None:
    tables = [one for one in present(tune(linear_motor().design, prove=False)).blocks if isinstance(one, Table)]
    (stiff,) = (one for one in tables if one.caption == "Stiffness and noise")
    said = {name: (value, unit) for name, value, unit in stiff.rows}
    assert "ripple of the current reference from encoder quantisation" in said
    value, unit = said["ripple of the true force from both"]
    assert unit == "N rms"
    found = noise(tune(linear_motor().design, prove=False).cascade)
    assert float(value) == pytest.approx(found.torque_ripple, rel=1e-3)
    assert not [name for name in said if "torque" in name]

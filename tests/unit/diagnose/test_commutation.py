"""A drive whose d axis is not that of the magnets: the zero of the encoder is off, or half of its step is lost."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pmsm_ctrl.compare import compare
from pmsm_ctrl.diagnose import diagnose
from pmsm_ctrl.log import Log
from tests.effort import seeds
from tests.unit.plausibility.drives import PSI, P, believed, drawn


def turned(seed: int, angle: float) -> Log:
    """The drive of `drawn` in axes that lead the magnets' by an angle: L_d = L_q, so that the back-emf alone turns."""
    log = drawn(seed)
    emf = P * PSI * np.gradient(log["theta"], log["t"])
    noise = np.random.default_rng(seed + 50).normal(size=(2, len(log)))
    u_d = log["u_d"] + math.sin(angle) * emf + 0.02 * noise[0]
    u_q = log["u_q"] + (math.cos(angle) - 1.0) * emf + 0.02 * noise[1]
    return log.with_channels(u_d=u_d, u_q=u_q)


@pytest.mark.parametrize("seed", seeds(1, 2, 3))
@pytest.mark.parametrize(("angle", "said"), [(0.0, False), (0.006, False), (0.04, True), (-0.06, True)])
def test_the_angle_is_part_of_the_model(seed: int, angle: float, said: bool) -> None:
    found = diagnose(believed(), turned(seed, angle), plan=False)
    assert str(found.verdict) == "consistent"
    assert not found.parameter_deviations or not any(d.flagged for d in found.parameter_deviations)
    told = [notice for notice in found.notices if notice.code == "commutation"]
    assert len(told) == said
    for notice in told:
        assert ("leads" in notice.text) == (angle > 0.0)
        degrees = float(notice.text.split(" by ")[1].split()[0])
        assert degrees == pytest.approx(math.degrees(abs(angle)), abs=0.05)
    seen = compare(found.design, turned(seed, angle)).log.errors["u_d"]
    assert seen.rms < 1.2 * seen.floor

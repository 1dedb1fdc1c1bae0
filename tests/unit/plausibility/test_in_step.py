"""Voltages of a slow log that were sampled in step with a held reference say nothing of the winding."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pmsm_ctrl.log import Log
from pmsm_ctrl.plausibility import examine
from tests.unit.plausibility.drives import F_V, K_T, PSI, P, believed, drawn

B = 0.01  # A s/rad: the current that every sample is off by, per speed


def logged(seed: int, rate: float, volts: float, amperes: float = B) -> Log:
    """Return a log whose instants hold more current and less back-emf than the means, in proportion to the speed."""
    log = drawn(seed, rate=rate)
    omega = np.gradient(log["theta"], log.t)
    return log.with_channels(i_q=log["i_q"] + amperes * omega, u_q=log["u_q"] - volts * P * PSI * omega)


def codes(design: Any, log: Log) -> tuple[list[str], bool]:
    found = examine(design, log)
    return [one.code for one in found.notices], "u_q" in found.log


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_they_are_left_out_where_the_current_allows_for_it(seed: int) -> None:
    assert codes(believed(), logged(seed, 250.0, 0.4)) == (["voltages_in_step"], False)
    said = examine(believed(), logged(seed, 250.0, 0.4)).notices[0]
    assert said.detail["percent"] == pytest.approx(100.0 * (B * 2.0 / (P * PSI) - 0.4), abs=12.0)  # R b omega is in it


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_they_are_kept_in_a_sound_log_and_in_a_fast_one(seed: int) -> None:
    assert codes(believed(), drawn(seed, rate=250.0)) == ([], True)
    assert "voltages_in_step" not in codes(believed(), logged(seed, 1000.0, 0.25))[0]


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_wrong_flux_linkage_stays_one(seed: int) -> None:
    """The viscous friction of the axis, which no sampling made, allows for 2 pi 2 kHz L_q F_v / (K_t p psi_f)."""
    allowed = 2.0 * np.pi * 2e3 * 6e-3 * F_V / (K_T * P * PSI)
    assert allowed == pytest.approx(0.155, abs=0.001)  # times 1.5: K_t is in F_v and in the emf
    assert codes(believed(psi_f=PSI / 1.5), logged(seed, 250.0, 0.0, 0.0))[1]  # 50 % less 7 % is more than 23 %
    assert not codes(believed(psi_f=PSI / 1.25), logged(seed, 250.0, 0.0, 0.0))[1]  # 18 of 19 %: nobody can tell


def test_a_design_without_a_tolerance_of_the_flux_linkage_has_the_usual_one() -> None:
    """Without one any log with a thousandth off lost its voltages."""
    assert codes(believed(tolerance={"J": 0.2}), drawn(1, rate=250.0)) == ([], True)
    assert codes(believed(tolerance={"J": 0.2}), logged(1, 250.0, 0.4)) == (["voltages_in_step"], False)


def test_a_sampling_that_is_stated_is_believed() -> None:
    stated = believed().replace(log={"sampling": "instant"})
    assert "voltages_in_step" not in codes(stated, logged(1, 250.0, 0.4))[0]

"""A sweep whose levels do not lie on a line: it says so, and its intervals hold the truth nevertheless."""

from __future__ import annotations

import numpy as np
import pytest

from pmsm_ctrl.design import Design
from pmsm_ctrl.identify import sweep
from pmsm_ctrl.identify.staircase import Level, Line, _fit, _line
from pmsm_ctrl.tune import tune

F_C, F_V = 0.03, 9.5e-5


def levels(bend: float, noise: float = 3e-6) -> list[Level]:
    rng = np.random.default_rng(5)
    omega = np.concatenate([-np.arange(15.0, 301.0, 15.0), np.arange(15.0, 301.0, 15.0)])
    torque = (F_C * np.sign(omega) + F_V * omega) * (1.0 + bend * omega**2) + rng.normal(0.0, noise, omega.size)
    return [Level(w, value, noise, 200.0, 3) for w, value in zip(omega.tolist(), torque.tolist(), strict=True)]


def holds(line: Line) -> bool:
    ends = [(*line.interval(symbol), truth) for symbol, truth in (("F_c", F_C), ("F_v", F_V))]
    return all(low <= truth <= high for low, high, truth in ends)


def test_a_bend_widens_the_errors_and_a_line_keeps_them() -> None:
    bent, straight = levels(3e-8), levels(0.0)
    assert not holds(_fit(bent, "rotary"))
    assert _line(bent, "rotary").rejected
    assert holds(_line(bent, "rotary"))
    assert not _line(straight, "rotary").rejected
    assert _line(straight, "rotary") == _fit(straight, "rotary")


def test_the_current_between_two_samples_of_a_fast_axis_bends_the_line() -> None:
    """Its chord costs (p omega T)^2/12 of the torque, 0.3 % at 300 rad/s, 5 pole pairs and 8 kHz."""
    design = Design.from_dict({
        "name": "axis", "motor": {"p": 5, "K_t_rms": 0.49, "R": 1.35, "L_d": 4.7e-3, "L_q": 4.7e-3, "J": 7.5e-5},
        "drive": {"i_max": 11.9, "u_dc": 325.0, "f_control": 8000.0, "speed_divider": 2},
        "sensor": {"encoder_counts": 1048576},
        "effects": [{"id": "coulomb", "F_c": F_C}, {"id": "viscous", "F_v": F_V}],
    })  # fmt: skip
    found = sweep(tune(design, prove=False).design)
    assert found.lines["both_directions"].misfit > 2.0
    (said,) = (one.text for one in found.notices if one.code == "misfit")
    assert "0.04 % of the torque" in said or "0.03" in said
    assert all(holds(line) for line in found.lines.values())
    dip = [level.torque / (F_C * np.sign(level.omega) + F_V * level.omega) - 1.0 for level in found.levels]
    expected = [(5 * level.omega / 8000.0) ** 2 / 12.0 for level in found.levels]
    assert dip[0] == pytest.approx(expected[0], rel=0.1)
    assert dip[-1] == pytest.approx(expected[-1], rel=0.1)
